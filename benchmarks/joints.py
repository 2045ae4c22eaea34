"""What each way of seeing that a joint is `unexplained` finds, and what it says falsely.

python -m benchmarks.joints [--cases 0 36] [--seed 1] --cache DIR

Small cases of both generators: nulls, single effects, effects outside the vocabulary, and torques that are
added to a recording (collisions, mains hum, a friction that differs from run to run). A search is run once
and kept in the cache folder; the joints are judged again at every call. A joint is falsely `unexplained`
where nothing is planted, or all that is planted there is named; it is truly so where an effect outside the
vocabulary, at least twice its just findable size, is planted and not named ``unknown``.
"""

import pickle
import sys
import tempfile
import time
from collections import Counter
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import numpy as np

from benchmarks.board.disturbances import NOISES
from benchmarks.board.draw_machines import draw_machine
from benchmarks.board.generate import generate_dataset
from benchmarks.board.outside import OUTSIDE
from benchmarks.board.recipe import Planted, Recipe, RunPlan
from benchmarks.board.regimes import ONE_JOINT
from benchmarks.command import start_parser, write_heads, write_row
from benchmarks.outside.drawn import HEAVY, ONE, PAYLOAD, SIZES
from benchmarks.outside.forms import OUTSIDERS
from benchmarks.outside.planted import Case, Plant
from benchmarks.recorded import Recorded
from benchmarks.scoring import TIMES, score_case
from wearscope.closed_loop import diagnosis
from wearscope.closed_loop.diagnostics import structure
from wearscope.closed_loop.inference.policy import Policy
from wearscope.effects.base import Effect, load_effect
from wearscope.effects.vocabulary import empirical_effect

ADDED = ("collision", "hum", "run_friction", "run_offset")
WAYS = ("_from_withdrawn", "_from_left", "see_motion", "see_runs", "see_time", "see_test_error")
KINDS = ("null", "outside", "null", "one", "outside", "added")


@dataclass(frozen=True)
class Small:
    """A small case by its number."""

    number: int
    seed: int

    @property
    def rng(self):
        """Random numbers of the case."""
        return np.random.default_rng(np.random.SeedSequence([41, self.seed, self.number]))

    @property
    def kind(self):
        """What is planted."""
        return KINDS[self.number % len(KINDS)]

    def make(self, folder):
        """Write the data set; its truth."""
        rng = self.rng
        own = bool((self.number // len(KINDS)) % 2)
        truth = (_make_outside if own else _make_board)(self, folder, rng)
        truth = {"generator": "outside" if own else "board", "kind": self.kind, "added": ""} | truth
        if self.kind == "added":
            truth |= _add(folder, truth, ADDED[(self.number // len(KINDS) // 2) % len(ADDED)], rng)
        return truth


def _make_board(case, folder, rng):
    machine = draw_machine("serial", rng, int(rng.integers(2, 4)))
    joint = machine.joints[int(rng.integers(len(machine.joints)))]
    size = float(rng.uniform(3.0, 8.0))
    planted = []
    if case.kind == "one":
        planted = [Planted(str(rng.choice(ONE_JOINT)), joint, size)]
    if case.kind == "outside":
        planted = [Planted(str(rng.choice(list(OUTSIDE))), joint, size)]
    noise = str(rng.choice(NOISES)) if case.kind == "null" else str(rng.choice(["plain", "coloured"]))
    kinds = rng.permutation(["fourier", "points", "fourier", "sweep"])
    count = int(rng.choice([1, 2, 3, 4], p=[0.1, 0.2, 0.4, 0.3]))
    plans = [RunPlan("train", str(kinds[k]), k, 24.0 + 6.0 * k) for k in range(count)]
    plans += [RunPlan("test", "points", 8, 35.0)]
    recipe = Recipe(
        noise=noise,
        noise_level=float(10 ** rng.uniform(-2.4, -1.2)),
        duration=14.0,
        rate=float(rng.choice([100.0, 200.0])),
        plans=tuple(plans),
    )
    return generate_dataset(folder, machine, planted, 1000 * case.seed + case.number, recipe)


def _make_outside(case, folder, rng):
    arm, joints = (("planar", 2), ("scara", 4))[int(rng.integers(2))]
    joint = int(rng.choice(HEAVY[arm]))
    plants = ()
    if case.kind == "one":
        name = str(rng.choice(ONE))
        joint = (
            joints - 1 if name == "payload_error" else max(joint, 1) if name == "cross_coupling" else joint
        )
        size = PAYLOAD[arm] if name == "payload_error" else rng.uniform(*SIZES.get(name, (3.0, 6.0)))
        plants = (Plant(name, joint, float(size)),)
    if case.kind == "outside":
        plants = (Plant(str(rng.choice(list(OUTSIDERS))), joint, float(rng.uniform(3, 6))),)
    noises = ["white", "coloured", "hum", "heavy", "drift"] if case.kind == "null" else ["white", "coloured"]
    noise = str(rng.choice(noises))
    count = int(rng.choice([1, 2, 3], p=[0.1, 0.3, 0.6]))
    train = tuple((str(rng.choice(["fourier", "points"])), 18.0) for _ in range(count))
    return Case(
        f"joints-{case.seed}-{case.number}",
        arm,
        plants,
        noise=noise,
        level=float(10 ** rng.uniform(-2.4, -1.4)),
        rate=float(200.0 if noise == "hum" else rng.choice([100.0, 200.0])),
        train=train,
        test=(("points", 15.0),),
    ).make(folder)


def _add(folder, truth, kind, rng):
    """Add a torque to every run of a data set at one joint."""
    joint = str(rng.choice(truth["joints"]))
    data = Recorded(folder)
    tables = [data.tables[file] for file in sorted(data.tables)]
    scale = float(np.sqrt(np.mean(np.concatenate([x[f"tau_{joint}"] for x in tables]) ** 2)))
    size = scale * float(rng.uniform(0.04, 0.12))
    for table in tables:
        t, q = table["t"].to_numpy(), table[f"q_{joint}"].to_numpy()
        speed = np.sign(np.gradient(np.convolve(np.pad(q, 4, "edge"), np.ones(9) / 9, "valid"), t))
        added = np.zeros(len(t))
        if kind == "collision":
            for moment in rng.uniform(t[0] + 1.0, t[-1] - 1.0, 2):
                added += 4.0 * size * rng.choice([-1, 1]) * np.exp(-(((t - moment) / 0.08) ** 2))
        if kind == "hum":
            added = size * np.sin(2 * np.pi * 50.003 * t + rng.uniform(0, 6.28))
        if kind == "run_friction":
            added = size * rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.5) * speed
        if kind == "run_offset":
            added = size * rng.uniform(-1.5, 1.5) * np.ones(len(t))
        table[f"tau_{joint}"] += added
    data.write(folder)
    return {"added": kind, "added_joint": joint}


def search(case, cache):
    """What the judgement of a case's joints is given, its truth and verdict; from the cache where there."""
    file = cache / f"{case.seed}-{case.number}.pickle"
    if not file.exists():
        given, judge = {}, diagnosis.judge_joints

        def listen(*arguments):
            given["arguments"] = arguments
            return judge(*arguments)

        with tempfile.TemporaryDirectory() as place:
            truth = case.make(Path(place) / "data")
            truth.pop("signals", None)
            with mock.patch.object(diagnosis, "judge_joints", listen):
                given |= {"truth": truth, "verdict": diagnosis.diagnose(Path(place) / "data").verdict}
        with file.open("wb") as stream:
            Pickler(stream).dump(given)
    return pickle.loads(file.read_bytes())


class Pickler(pickle.Pickler):
    """Effects go by their names: they hold functions without one."""

    def reducer_override(self, obj):
        """An effect as the call that finds it."""
        return (find_effect, (obj.name,)) if isinstance(obj, Effect) else NotImplemented


def find_effect(name):
    """An effect of the vocabulary, or the generic one."""
    effect = empirical_effect()
    return effect if name == effect.name else load_effect(name)


def list_open(truth, verdict):
    """What is left at each joint: ``outside`` (must be seen), ``open`` or ``added`` (may be), or ``none``."""
    _, entries = score_case(truth, verdict)
    left = dict.fromkeys(verdict["joints"], "none")
    planted = (entry for entry in entries if entry["kind"] == "planted")
    for plant, entry in zip(truth["planted"], planted, strict=True):
        if plant["outside"] or not entry["found"]:
            due = plant["outside"] and plant["times_findable"] >= TIMES and entry["grade"] != "unknown"
            left |= dict.fromkeys(plant["joints"], "outside" if due else "open")
    if truth["added"] not in ("", "hum"):
        left[truth["added_joint"]] = "added"
    return left


def judge(given):
    """Rows of the joints that move: what may be left at each, and which ways saw something; their seconds."""
    log, seconds = [], Counter()

    def listen(way, see):
        def look(*arguments):
            begun = time.process_time()
            seen = see(*arguments)
            seconds[way] += time.process_time() - begun
            log.append((way, any(one.share >= Policy().structure_share for one in seen)))
            return seen

        return look

    with ExitStack() as stack:
        for way in WAYS:
            stack.enter_context(mock.patch.object(structure, way, listen(way, getattr(structure, way))))
        structure.judge_joints(*given["arguments"])
    prepared = given["arguments"][0]
    left = list_open(given["truth"], given["verdict"])
    moving = [prepared.dataset.joints[j] for j in np.flatnonzero(prepared.moving)]
    each = [log[k : k + len(WAYS)] for k in range(0, len(log), len(WAYS))]
    rows = [
        {"joint": joint, "left": left[joint], "seen": {way for way, found in own if found}}
        for joint, own in zip(moving, each, strict=True)
    ]
    return rows, seconds


def write_ablation(rows, seconds):
    """Truly and falsely `unexplained` joints with all ways, and with each switched off."""
    due = [row["seen"] for row in rows if row["left"] == "outside"]
    none = [row["seen"] for row in rows if row["left"] == "none"]
    lines = [write_heads("switched off", "of outside effects found", "falsely unexplained", "processor s")]
    for way in ("", *WAYS):
        found, false = (sum(bool(seen - {way}) for seen in some) for some in (due, none))
        cost = f"{seconds[way]:.2f}" if way else ""
        lines.append(write_row(way or "nothing", f"{found} of {len(due)}", f"{false} of {len(none)}", cost))
    return "\n".join(lines) + "\n"


def main(arguments=None):
    """Command line."""
    parser = start_parser(__doc__)
    parser.add_argument("--cases", type=int, nargs=2, default=(0, 36), metavar=("FIRST", "LAST"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--cache", type=Path, required=True, help="where searches are kept")
    given = parser.parse_args(arguments)
    given.cache.mkdir(parents=True, exist_ok=True)
    rows, seconds = [], Counter()
    for number in range(*given.cases):
        more, spent = judge(search(Small(number, given.seed), given.cache))
        rows += more
        seconds += spent
    sys.stdout.write(write_ablation(rows, seconds))
    return 0


if __name__ == "__main__":
    sys.exit(main())
