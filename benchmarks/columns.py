"""Whether intake takes recordings that are right, and tells what is wrong with those that are not.

python -m benchmarks.columns [--part right|wrong] [--first 0] [--cases 40] [--drawn N] [--seed 0] [--out DIR]

Planted machines of both generators are checked as they are: each refusal is without cause. Then each fault of
a column, and some pairs of faults, or `--drawn` ones of each machine, are made in the recordings, and what
intake says is compared with what was done.
"""

import dataclasses
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.signal import lfilter, savgol_filter

from benchmarks.board.regimes import list_cases
from benchmarks.command import start_parser
from benchmarks.outside.drawn import draw_case
from benchmarks.recorded import Recorded
from wearscope.checking.dataset import check_dataset
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.urdf import normalise_tree, parse_urdf, write_urdf

TAKEN = "taken"
#: Least RMS change of a torque, over its spread, that a fault must make: no motion is followed more exactly.
LEAST = 0.1


class Folder(Recorded):
    """A data set and its robot; `largest` is the joint with the most torque, `widest` turns the farthest."""

    def __init__(self, place):
        super().__init__(place)
        unit = self.fields.get("units", {}).get("q", "rad")
        units = [unit] * len(self.joints) if isinstance(unit, str) else unit
        self.slides = np.array([one == "m" for one in units])
        range_ = np.ptp([self.pool(name) for name in self.columns("q")], axis=1)
        spread = np.std([self.pool(name) for name in self.columns("tau")], axis=1)
        self.largest = int(np.argmax(np.where(range_ > 1e-6, spread, -1.0)))
        self.widest = int(np.argmax(range_ * ~self.slides))

    def columns(self, kind, j=None):
        """Columns of a kind, of one joint where it is given."""
        names = [f"{kind}_{joint}" for joint in self.joints]
        return names if j is None else names[j]

    def body(self, gravity=True):
        """The stated rigid body."""
        robot = self.fields["robot"]
        tree, _ = normalise_tree(
            self.place / robot["urdf"], self.joints, strict=False, locked=robot.get("locked", {})
        )
        stated = robot.get("gravity", [0.0, 0.0, -9.81])
        return RigidBody(write_urdf(tree), self.joints).with_gravity(stated if gravity else [0.0, 0.0, 0.0])

    def first_positions(self):
        """Positions (N, n) of the first run."""
        return next(iter(self.tables.values()))[self.columns("q")].to_numpy()

    def change(self, change, least=0.0):
        """Another folder with each table changed; None where all torques change less."""
        other, shares = super().change(change), []
        for file, table in self.tables.items():
            new = other.tables[file]
            for name in self.columns("tau"):
                off = new[name] - np.interp(new["t"], table["t"], table[name])
                shares.append(np.sqrt(np.mean(off**2)) / max(table[name].std(), 1e-12))
        return other if max(shares) >= least else None


def weigh(body, q):
    """Torque (N, n) that holds a body at rest at positions."""
    return body.inverse_dynamics(q, 0.0 * q, 0.0 * q)


def scale(folder, rng, kind, factor, j=None):
    """Fault: columns times a factor."""

    def change(table):
        for one in [kind] if kind == "tau" else ["q", "qd"]:
            names = folder.columns(one) if j is None else [folder.columns(one, getattr(folder, j))]
            for name in set(names) & set(table):
                table[name] *= factor

    return folder.change(change)


def scale_currents(folder, rng):
    """Fault: currents in place of torques, a constant of its own each joint."""
    constants = 1.0 / np.exp(rng.uniform(np.log(6), np.log(60), 20))

    def change(table):
        table[folder.columns("tau")] *= constants[: len(folder.joints)]

    return folder.change(change)


def exchange(folder, rng, kind):
    """Fault: columns of the two joints with the largest torques exchanged, where there are two."""
    size = [np.mean([t[name].std() for t in folder.tables.values()]) for name in folder.columns("tau")]
    if len(size) == 1:
        return None
    pair = np.argsort(size)[-2:]

    def change(table):
        for kind_ in [kind] if kind == "tau" else ["q", "qd"]:
            one, other = (folder.columns(kind_, j) for j in pair)
            if one in table:
                table[one], table[other] = table[other].copy(), table[one].copy()

    return folder.change(change)


def _motion(folder, table):
    q = table[folder.columns("q")].to_numpy()
    step = float(np.median(np.diff(table["t"])))
    width = max(5, 2 * round(0.05 / step) + 1)
    return q, *(savgol_filter(q, width, 3, deriv=k, delta=step, axis=0) for k in (1, 2))


def take_out_gravity(folder, rng):
    """Fault: torque without gravity."""
    body = folder.body()
    if np.abs(weigh(body, folder.first_positions())).max() < 1e-9:
        return None

    def change(table):
        table[folder.columns("tau")] -= weigh(body, table[folder.columns("q")].to_numpy())

    return folder.change(change)


def leave_body(folder, rng, gravity):
    """Fault: torque of the stated body alone, as behind the gears, with some noise."""
    body = folder.body(gravity)

    def change(table):
        torque = body.inverse_dynamics(*_motion(folder, table))
        noise = 0.005 * torque.std(axis=0) * rng.normal(size=torque.shape)
        table[folder.columns("tau")] = torque + noise

    return folder.change(change)


def delay(folder, rng, seconds):
    """Fault: torques recorded late."""

    def change(table):
        t = table["t"].to_numpy()
        for name in folder.columns("tau"):
            table[name] = np.interp(t - seconds, t, table[name].to_numpy())
        return table[t >= t[0] + seconds].reset_index(drop=True)

    return folder.change(change, LEAST)


def smooth(folder, rng, seconds):
    """Fault: torques behind a filter of first order."""

    def change(table):
        kept = np.exp(-np.median(np.diff(table["t"])) / seconds)
        for name in folder.columns("tau"):
            y = table[name].to_numpy()
            table[name] = lfilter([1.0 - kept], [1.0, -kept], y, zi=[kept * y[0]])[0]

    return folder.change(change, LEAST)


def load(folder, rng, share, com):
    """Fault: a payload of a share of the robot's mass that is not declared."""
    tree = parse_urdf(folder.place / folder.fields["robot"]["urdf"])
    body, mass = folder.body(), share * sum(link.mass for link in tree.links.values())
    loaded = body.with_payload(Payload(mass, com))

    def change(table):
        motion = _motion(folder, table)
        table[folder.columns("tau")] += loaded.inverse_dynamics(*motion) - body.inverse_dynamics(*motion)

    return folder.change(change, LEAST)


def shift(folder, rng, angle):
    """Fault: another zero of the joint with the largest torque, where the torques depend on it."""
    name, body, q = folder.columns("q", folder.largest), folder.body(), folder.first_positions()
    turned = q + angle * (np.arange(q.shape[1]) == folder.largest)
    before, after = weigh(body, q), weigh(body, turned)
    if folder.slides[folder.largest] or np.ptp(after - before) < 0.3 * np.ptp(before):
        return None

    def change(table):
        table[name] += angle

    return folder.change(change)


def wrap(folder, rng):
    """Fault: the widest joint's position wraps round in the middle of its range, where it turns."""
    name = folder.columns("q", folder.widest)
    if folder.slides[folder.widest]:
        return None
    middle = float(np.median(folder.pool(name)))

    def change(table):
        table[name] = np.mod(table[name] - middle, 2 * np.pi) + middle - 2 * np.pi

    return folder.change(change)


def clip(folder, rng):
    """Fault: the largest torque is clipped in one row of six."""
    name = folder.columns("tau", folder.largest)
    top = float(np.percentile(np.abs(folder.pool(name)), 84))

    def change(table):
        table[name] = table[name].clip(-top, top)

    return folder.change(change)


GRAVITY = ("without_gravity tau", "gravity was taken out")
ZERO = ("zero q_{largest}", "q_{largest} counts from another zero", "its positions have another zero")

#: Fault: how it is made and of what, codes or words of which one tells it, and whether taking it says nothing
#: wrong: the reading changes no number, or the loop has a name for it.
FAULTS = {
    "sign of all torques": (scale, ("tau", -1.0), ("sign tau",), False),
    "sign of one torque": (scale, ("tau", -1.0, "largest"), ("sign tau_{largest}",), False),
    "position turned": (scale, ("q", -1.0, "largest"), ("sign q_{largest}",), False),
    "gravity out": (take_out_gravity, (), GRAVITY, False),
    "gravity and friction out": (leave_body, (False,), GRAVITY, False),
    "link side": (leave_body, (True,), ("there is no friction to be seen",), True),
    "currents": (scale_currents, (), ("gain tau",), False),
    "torques in mN m": (scale, ("tau", 1000.0), ("gain tau",), False),
    "torques exchanged": (exchange, ("tau",), ("exchanged tau",), False),
    "positions exchanged": (exchange, ("q",), ("exchanged q",), False),
    "positions in degrees": (scale, ("q", 180.0 / np.pi), ("degrees q",), False),
    "zero a quarter turn off": (shift, (np.pi / 2.0,), ZERO, False),
    "zero 30 degrees off": (shift, (np.pi / 6.0,), ZERO, False),
    "all torques 1.4 times": (scale, ("tau", 1.4), ("times what the stated bodies need", "gain tau"), False),
    "10 ms late": (delay, (0.010,), ("late tau",), True),
    "20 ms late": (delay, (0.020,), ("late tau",), True),
    "40 ms late": (delay, (0.040,), ("late tau", "the torque channels come"), False),
    "60 ms late": (delay, (0.060,), ("late tau", "the torque channels come"), False),
    "behind a filter of 15 ms": (smooth, (0.015,), ("late tau", "follow the motion"), True),
    "behind a filter of 50 ms": (smooth, (0.050,), ("late tau", "the torques are smoothed"), False),
    "payload undeclared": (load, (0.1, (0.0, 0.0, 0.0)), (), True),
    "heavy payload undeclared": (load, (0.3, (0.05, 0.0, 0.1)), ("a payload about", "a payload that"), False),
    "wraps round": (wrap, (), ("wrap", "step q"), False),
    "clipped": (clip, (), ("clipped tau", "at a limit"), False),
}

#: Pairs of faults that are made one after the other; each of them must be told.
PAIRS = (
    ("sign of one torque", "zero a quarter turn off"),
    ("torques exchanged", "zero a quarter turn off"),
    ("position turned", "torques in mN m"),
    ("positions in degrees", "sign of all torques"),
    ("40 ms late", "sign of one torque"),
    ("zero a quarter turn off", "60 ms late"),
)


def list_faults(wanted):
    """Single faults and pairs by their names, each as changes and the words of which one must tell it."""
    names = [*((name,) for name in FAULTS), *PAIRS]
    found = {" and ".join(pair): [FAULTS[name] for name in pair] for pair in names}
    return {name: parts for name, parts in found.items() if not wanted or name in wanted}


def draw_faults(faults, count, machine):
    """Some of the faults, drawn for a machine by its name; all where no count is given."""
    if count is None or count >= len(faults):
        return faults
    rng = np.random.default_rng(list(machine.encode()))
    return {name: faults[name] for name in sorted(rng.permutation(list(faults))[:count])}


def make(folder, faults, rng):
    """Folder with faults in it; None where one of them does not apply."""
    for fault, arguments, _, _ in faults:
        folder = folder and fault(folder, rng, *arguments)
    return folder


def ask(place):
    """What intake says of a folder: a refusal's codes, or `TAKEN` and its notes."""
    found = check_dataset(place)
    if not found.problems:
        return TAKEN, " | ".join(found.notes)
    text = " | ".join(found.problems)
    codes = re.search(r'"accept: \[(.*?)\]"', text)
    return (codes[1] if codes else text), text


def judge(said, text, faults):
    """``right``, ``part`` (one of two is told), ``other`` (refused as something else) or ``silent``.

    Parameters
    ----------
    said, text : str
    faults : list of (tuple of str, bool)
        Words of which one tells a fault, and whether taking it is harmless.
    """
    told = [any(one in said or (said == TAKEN and one in text) for one in words) for words, _ in faults]
    if all(found or (said == TAKEN and harmless) for found, (_, harmless) in zip(told, faults, strict=True)):
        return "right"
    if any(told):
        return "part"
    return "silent" if said == TAKEN else "other"


def list_machines(first, cases, seed):
    """Cases of both generators by turns."""
    board = list_cases("development", 200, 1000 + seed)[first : first + cases]
    outside = [dataclasses.replace(draw_case(2000 + k), seed=seed) for k in range(first, first + cases)]
    return [case for pair in zip(board, outside, strict=True) for case in pair]


def ask_timed(place, case, fault, told):
    """Row of the table: what intake says of a folder, and what of `told` (see `judge`) is in it."""
    begun = time.process_time()
    said, text = ask(place)
    seconds, result = time.process_time() - begun, judge(said, text, told)
    print(f"{case.name} {fault}: {result}: {said[:120]}", flush=True)
    row = {"case": case.tell(), "fault": fault, "said": said, "result": result}
    return row | {"seconds": seconds, "text": text}


def main(arguments=None):
    """Command line."""
    parser = start_parser(__doc__)
    parser.add_argument("--part", choices=["right", "wrong"], default="right")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", type=int, default=40, help="of each generator")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--drawn", type=int, help="number of faults and pairs drawn for each machine, not all"
    )
    parser.add_argument("--fault", action="append", help="this one alone; may be repeated")
    parser.add_argument("--out", help="keep the tables there")
    given = parser.parse_args(arguments)
    rows = []
    for case in list_machines(given.first, given.cases, given.seed):
        with tempfile.TemporaryDirectory() as scratch:
            place = Path(scratch) / "machine"
            place.mkdir()
            case.make(place)
            rows.append(ask_timed(place, case, "none", [((), True)]))
            if given.part == "right" or rows[-1]["said"] != TAKEN:
                continue
            folder = Folder(place)
            # All torques of a machine with one joint are those of this joint.
            largest = folder.joints[folder.largest]
            alone = "sign tau" if len(folder.joints) == 1 else f"sign tau_{largest}"
            for name, faults in draw_faults(list_faults(given.fault), given.drawn, case.name).items():
                changed = make(folder, faults, np.random.default_rng(given.seed))
                if changed is None:
                    continue
                other = changed.write(Path(scratch) / name)
                told = [
                    ([one.replace("sign tau_{largest}", alone).format(largest=largest) for one in words], ok)
                    for _, _, words, ok in faults
                ]
                rows.append(ask_timed(other, case, name, told))
                shutil.rmtree(other)
    table = pd.DataFrame(rows)
    print(pd.crosstab(table["fault"], table["result"]).to_string())
    print(f"{table['seconds'].mean():.1f} s of processor a data set, at most {table['seconds'].max():.1f}")
    if given.out:
        Path(given.out).mkdir(parents=True, exist_ok=True)
        table.to_csv(Path(given.out) / f"{given.part}.csv", index=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
