"""Whether intake takes recordings that are right, and tells what is wrong with those that are not.

python -m benchmarks.columns [--part right|wrong] [--first 0] [--cases 40] [--seed 0] [--out DIR]

Planted machines of both generators are checked as they are: each refusal is without cause. Then each fault of
a column, and some pairs of faults, are made in the recordings of some of them, and what intake says is
compared with what was done.
"""

import argparse
import copy
import re
import shutil
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from benchmarks.board.regimes import list_cases
from benchmarks.outside.drawn import draw_case

TAKEN = "taken"
#: Least RMS change of a torque, over its spread, that a fault must make: no motion is followed more exactly.
LEAST = 0.1


class Folder:
    """A data set's columns, its fields and its robot, to be changed and written again."""

    def __init__(self, place):
        self.fields = yaml.safe_load((place / "dataset.yaml").read_text())
        self.place, self.joints = place, self.fields["robot"]["joints"]
        self.tables = {run["file"]: pd.read_parquet(place / run["file"]) for run in self.fields["runs"]}
        q = pd.concat([table[self.columns("q")] for table in self.tables.values()])
        tau = pd.concat([table[self.columns("tau")] for table in self.tables.values()])
        moving = np.ptp(q.to_numpy(), axis=0) > 1e-6
        self.largest = int(np.argmax(np.where(moving, tau.std().to_numpy(), -1.0)))
        self.widest = int(np.argmax(np.ptp(q.to_numpy(), axis=0) * ~self._slides()))

    def _slides(self):
        unit = self.fields.get("units", {}).get("q", "rad")
        return np.array(
            [one == "m" for one in ([unit] * len(self.joints) if isinstance(unit, str) else unit)]
        )

    def columns(self, kind, j=None):
        """Columns of a kind, of one joint where it is given."""
        names = [f"{kind}_{joint}" for joint in self.joints]
        return names if j is None else names[j]

    def body(self, gravity=True):
        """The stated rigid body."""
        from wearscope.robots.dynamics import RigidBody
        from wearscope.robots.urdf import normalise_tree, write_urdf

        robot = self.fields["robot"]
        tree, _ = normalise_tree(
            self.place / robot["urdf"], self.joints, strict=False, locked=robot.get("locked", {})
        )
        urdf = write_urdf(tree)
        body = RigidBody(urdf, self.joints)
        stated = self.fields["robot"].get("gravity", [0.0, 0.0, -9.81])
        return body.with_gravity(stated if gravity else [0.0, 0.0, 0.0])

    def change(self, change, least=0.0):
        """Another folder with each table changed by `change(table)`; None where all torques change less."""
        other = copy.copy(self)
        other.tables, shares = {}, []
        for file, table in self.tables.items():
            other.tables[file] = table.copy()
            changed = change(other.tables[file])
            if changed is not None:
                other.tables[file] = changed
            new = other.tables[file]
            for name in self.columns("tau"):
                off = new[name] - np.interp(new["t"], table["t"], table[name])
                shares.append(np.sqrt(np.mean(off**2)) / max(table[name].std(), 1e-12))
        return other if max(shares) >= least else None

    def write(self, place):
        """Write the data set."""
        (place / "runs").mkdir(parents=True)
        shutil.copy(self.place / self.fields["robot"]["urdf"], place / "robot.urdf")
        fields = copy.deepcopy(self.fields)
        fields["robot"]["urdf"] = "robot.urdf"
        for run in fields["runs"]:
            self.tables[run["file"]].to_parquet(place / run["file"], index=False)
        (place / "dataset.yaml").write_text(yaml.safe_dump(fields, sort_keys=False))


def scale(kind, factor, j=None):
    """Fault: columns times a factor."""

    def fault(folder, rng):
        def change(table):
            for one in [kind] if kind == "tau" else ["q", "qd"]:
                names = folder.columns(one) if j is None else [folder.columns(one, getattr(folder, j))]
                for name in set(names) & set(table):
                    table[name] *= factor

        return folder.change(change)

    return fault


def scale_currents(folder, rng):
    """Fault: currents in place of torques, a constant of its own each joint."""
    factors = dict(
        zip(folder.columns("tau"), 1.0 / np.exp(rng.uniform(np.log(6), np.log(60), 20)), strict=False)
    )

    def change(table):
        for name, factor in factors.items():
            table[name] *= factor

    return folder.change(change)


def exchange(kind):
    """Fault: columns of the two joints with the largest torques exchanged, where there are two."""

    def fault(folder, rng):
        size = [np.mean([t[name].std() for t in folder.tables.values()]) for name in folder.columns("tau")]
        if len(size) == 1:
            return None
        i, j = np.argsort(size)[-2:]
        names = [
            (folder.columns(one, i), folder.columns(one, j))
            for one in ([kind] if kind == "tau" else ["q", "qd"])
        ]

        def change(table):
            for one, other in names:
                if one in table:
                    table[one], table[other] = table[other].copy(), table[one].copy()

        return folder.change(change)

    return fault


def _motion(folder, table):
    t = table["t"].to_numpy()
    q = table[folder.columns("q")].to_numpy()
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(t)))
    width = max(5, 2 * round(0.05 / step) + 1)
    return q, *(savgol_filter(q, width, 3, deriv=k, delta=step, axis=0) for k in (1, 2))


def take_out_gravity(folder, rng):
    """Fault: torque without gravity."""
    body = folder.body()
    q = next(iter(folder.tables.values()))[folder.columns("q")].to_numpy()
    if np.abs(body.inverse_dynamics(q, 0.0 * q, 0.0 * q)).max() < 1e-9:
        return None

    def change(table):
        q = table[folder.columns("q")].to_numpy()
        table[folder.columns("tau")] -= body.inverse_dynamics(q, 0.0 * q, 0.0 * q)

    return folder.change(change)


def leave_body(gravity):
    """Fault: torque of the stated body alone, as behind the gears, with some noise."""

    def fault(folder, rng):
        body = folder.body(gravity)

        def change(table):
            torque = body.inverse_dynamics(*_motion(folder, table))
            noise = 0.005 * torque.std(axis=0) * rng.normal(size=torque.shape)
            table[folder.columns("tau")] = torque + noise

        return folder.change(change)

    return fault


def delay(seconds):
    """Fault: torques recorded late."""

    def fault(folder, rng):
        def change(table):
            t = table["t"].to_numpy()
            for name in folder.columns("tau"):
                table[name] = np.interp(t - seconds, t, table[name].to_numpy())
            return table[t >= t[0] + seconds].reset_index(drop=True)

        return folder.change(change, LEAST)

    return fault


def smooth(seconds):
    """Fault: torques behind a filter of first order."""
    from scipy.signal import lfilter

    def fault(folder, rng):
        def change(table):
            kept = np.exp(-np.median(np.diff(table["t"])) / seconds)
            for name in folder.columns("tau"):
                y = table[name].to_numpy()
                table[name] = lfilter([1.0 - kept], [1.0, -kept], y, zi=[kept * y[0]])[0]

        return folder.change(change, LEAST)

    return fault


def load(share, com):
    """Fault: a payload of a share of the robot's mass that is not declared."""
    from wearscope.robots.dynamics import Payload
    from wearscope.robots.urdf import parse_urdf

    def fault(folder, rng):
        tree = parse_urdf(folder.place / folder.fields["robot"]["urdf"])
        mass = share * sum(link.mass for link in tree.links.values())
        body = folder.body()
        loaded = body.with_payload(Payload(mass, com))

        def change(table):
            motion = _motion(folder, table)
            table[folder.columns("tau")] += loaded.inverse_dynamics(*motion) - body.inverse_dynamics(*motion)

        return folder.change(change, LEAST)

    return fault


def shift(angle):
    """Fault: another zero of the joint with the largest torque, where the torques depend on it."""

    def fault(folder, rng):
        name, body = folder.columns("q", folder.largest), folder.body()
        q = next(iter(folder.tables.values()))[folder.columns("q")].to_numpy()
        turned = q + angle * (np.arange(q.shape[1]) == folder.largest)
        torques = [body.inverse_dynamics(x, 0.0 * x, 0.0 * x) for x in (q, turned)]
        if folder._slides()[folder.largest] or np.ptp(torques[1] - torques[0]) < 0.3 * np.ptp(torques[0]):
            return None

        def change(table):
            table[name] += angle

        return folder.change(change)

    return fault


def wrap(folder, rng):
    """Fault: the widest joint's position wraps round in the middle of its range."""
    name = folder.columns("q", folder.widest)
    middle = float(np.median(np.concatenate([table[name] for table in folder.tables.values()])))

    def change(table):
        table[name] = np.mod(table[name] - middle, 2 * np.pi) + middle - 2 * np.pi

    return folder.change(change)


def clip(folder, rng):
    """Fault: the largest torque is clipped in one row of six."""
    name = folder.columns("tau", folder.largest)
    top = float(np.percentile(np.abs(np.concatenate([table[name] for table in folder.tables.values()])), 84))

    def change(table):
        table[name] = table[name].clip(-top, top)

    return folder.change(change)


#: Fault: how it is made, codes or words of which one tells it, and whether taking it says nothing wrong:
#: the reading changes no number, or the loop has a name for it.
FAULTS = {
    "sign of all torques": (scale("tau", -1.0), ("sign tau",), False),
    "sign of one torque": (scale("tau", -1.0, "largest"), ("sign tau_{largest}",), False),
    "position turned": (scale("q", -1.0, "largest"), ("sign q_{largest}",), False),
    "gravity out": (take_out_gravity, ("without_gravity tau", "gravity was taken out"), False),
    "gravity and friction out": (leave_body(False), ("without_gravity tau", "gravity was taken out"), False),
    "link side": (leave_body(True), ("there is no friction to be seen",), True),
    "currents": (scale_currents, ("gain tau",), False),
    "torques in mN m": (scale("tau", 1000.0), ("gain tau",), False),
    "torques exchanged": (exchange("tau"), ("exchanged tau",), False),
    "positions exchanged": (exchange("q"), ("exchanged q",), False),
    "positions in degrees": (scale("q", 180.0 / np.pi), ("degrees q",), False),
    "zero a quarter turn off": (
        shift(np.pi / 2.0),
        ("zero q_{largest}", "q_{largest} counts from another zero"),
        False,
    ),
    "zero 30 degrees off": (
        shift(np.pi / 6.0),
        ("zero q_{largest}", "q_{largest} counts from another zero"),
        False,
    ),
    "all torques 1.4 times": (scale("tau", 1.4), ("times what the stated bodies need", "gain tau"), False),
    "10 ms late": (delay(0.010), ("late tau",), True),
    "20 ms late": (delay(0.020), ("late tau",), True),
    "40 ms late": (delay(0.040), ("late tau", "the torque channels come"), False),
    "60 ms late": (delay(0.060), ("late tau", "the torque channels come"), False),
    "behind a filter of 15 ms": (smooth(0.015), ("late tau", "follow the motion"), True),
    "behind a filter of 50 ms": (smooth(0.050), ("late tau", "the torques are smoothed"), False),
    "payload undeclared": (load(0.1, (0.0, 0.0, 0.0)), (), True),
    "heavy payload undeclared": (load(0.3, (0.05, 0.0, 0.1)), ("a payload about", "a payload that"), False),
    "wraps round": (wrap, ("wrap", "step q"), False),
    "clipped": (clip, ("clipped tau", "at a limit"), False),
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


def make(folder, faults, rng):
    """Folder with faults in it; None where one of them does not apply."""
    for fault, _, _ in faults:
        folder = folder and fault(folder, rng)
    return folder


def ask(place):
    """What intake says of a folder: a refusal's codes, or `TAKEN` and its notes."""
    from wearscope.checking.dataset import check_dataset

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


def note(case, fault, said, text, result, begun):
    """Row of the table."""
    seconds = time.process_time() - begun
    return {
        "case": case.tell(), "fault": fault, "said": said, "result": result, "seconds": seconds, "text": text,
    }  # fmt: skip


def list_machines(first, cases, seed):
    """Cases of both generators by turns."""
    import dataclasses

    board = list_cases("development", 200, 1000 + seed)[first : first + cases]
    outside = [dataclasses.replace(draw_case(2000 + k), seed=seed) for k in range(first, first + cases)]
    return [case for pair in zip(board, outside, strict=True) for case in pair]


def main(arguments=None):
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", choices=["right", "wrong"], default="right")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--cases", type=int, default=40, help="of each generator")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fault", action="append", help="this one alone; may be repeated")
    parser.add_argument("--out", help="keep the tables there")
    given = parser.parse_args(arguments)
    rows = []
    for case in list_machines(given.first, given.cases, given.seed):
        with tempfile.TemporaryDirectory() as scratch:
            place = Path(scratch) / "machine"
            place.mkdir()
            case.make(place)
            begun = time.process_time()
            said, text = ask(place)
            rows.append(note(case, "none", said, text, judge(said, text, [((), True)]), begun))
            print(f"{case.name} none: {said if said == TAKEN else text}", flush=True)
            if given.part == "right" or said != TAKEN:
                continue
            folder = Folder(place)
            for name, faults in list_faults(given.fault).items():
                if name == "wraps round" and folder._slides()[folder.widest]:
                    continue
                rng = np.random.default_rng(given.seed)
                other = Path(scratch) / "fault"
                shutil.rmtree(other, ignore_errors=True)
                changed = make(folder, faults, rng)
                if changed is None:
                    continue
                changed.write(other)
                largest = folder.joints[folder.largest]
                # All torques of a machine with one joint are those of this joint.
                alone = "sign tau" if len(folder.joints) == 1 else "sign tau_{largest}"
                words = [
                    ([one.replace("sign tau_{largest}", alone).format(largest=largest) for one in told], ok)
                    for _, told, ok in faults
                ]
                begun = time.process_time()
                said, text = ask(other)
                result = judge(said, text, words)
                rows.append(note(case, name, said, text, result, begun))
                print(f"{case.name} {name}: {result}: {said[:120]}", flush=True)
    table = pd.DataFrame(rows)
    print(pd.crosstab(table["fault"], table["result"]).to_string())
    print(f"{table['seconds'].mean():.1f} s of processor a data set, at most {table['seconds'].max():.1f}")
    if given.out:
        Path(given.out).mkdir(parents=True, exist_ok=True)
        table.to_csv(Path(given.out) / f"{given.part}.csv", index=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
