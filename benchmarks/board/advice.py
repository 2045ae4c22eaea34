"""Whether following the advice helps: cases whose verdict leaves names open, recorded on and diagnosed again.

    python -m benchmarks.board.advice --part development --cases 60 --seed 7 --jobs 2 --out DIR

A case has one effect of the vocabulary planted in a machine of which two short runs of one kind of motion are
recorded, so that names are often left open. Where the set of names of the planted effect holds it next to
others, the advised runs are recorded on the same machine, as many as are promised, and the loop is closed
again. The advice sees the recordings only.
"""

import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import yaml

from benchmarks.board.folder import list_run, record_run
from benchmarks.board.generate import declare_effects, generate_dataset, plant_effects, record, warm_up
from benchmarks.board.machines import Body
from benchmarks.board.physics import Structural, behave
from benchmarks.board.recipe import RunPlan, make_stream
from benchmarks.board.regimes import PARTS, Case, draw_axes, make_case
from benchmarks.command import start_parser
from benchmarks.summary import tell_share
from wearscope.demonstration.motions import Motion
from wearscope.storage.tables import write_table, write_text

#: What all cases have in common: little to learn from, and nothing wrong but the plant.
COMMON = {
    "plants": "one", "declared": "friction", "inertials": "exact", "runs": "2", "test_runs": "1",
    "duration": 12.0, "rate": "200", "acts": "record",
}  # fmt: skip
#: Probability from which on an advice is a promise.
PROMISED = 0.9


def list_advice_cases(part: str, cases: int, seed: int) -> list[Case]:
    """Cases of a part: the board's hypercube with `COMMON` in place of some axes."""
    return [make_case(part, seed, k, axes | COMMON) for k, axes in enumerate(draw_axes(part, cases, seed))]


def run_advice_case(case: Case, place: Path) -> dict[str, Any]:
    """Row of one case.

    Returns
    -------
    dict
        `number`, `told`, `outcome`: ``error``, ``not in the set`` (the planted effect is not among the names
        at its joint), ``one name`` (nothing is open), ``no plan``, or of an open one ``right`` (it alone is
        named afterwards), ``still open`` (named next to others), ``lost`` (it is not among the names any
        more); with `names`, `after`, `cycle`, `runs`, `power`, angles, `seconds`.
    """
    from wearscope.closed_loop.diagnosis import diagnose
    from wearscope.closed_loop.diagnostics.next_measurement import plan_measurements, planning_model

    started = time.perf_counter()
    row: dict[str, Any] = {"number": case.number, "told": case.tell(), "outcome": "error", "error": ""}
    folder = place / case.name
    try:
        truth = generate_dataset(folder, case.machine, case.planted, case.seed, case.recipe)
        plants = [plant for plant in truth["planted"] if not plant["standard"]]
        diagnosis = diagnose(folder)
        entry = _find_entry(diagnosis.verdict["verdict"], plants)
        if entry is None:
            return row | {"outcome": "not in the set", "seconds": time.perf_counter() - started}
        row["names"] = ", ".join([entry["effect"], *entry["equivalent"]])
        if not entry["equivalent"]:
            return row | {"outcome": "one name", "seconds": time.perf_counter() - started}
        found = [
            one
            for one in plan_measurements(diagnosis)
            if one.joint == entry["joint"] and one.names[0] == entry["effect"]
        ]
        if not found:
            return row | {"outcome": "no plan", "seconds": time.perf_counter() - started}
        advice = found[0]
        row |= {
            key: value
            for key, value in advice.to_mapping().items()
            if key not in ("names", "payload", "joint")
        }
        row["loaded"] = advice.plan.payload is not None
        model = planning_model(diagnosis.prepared, diagnosis.models["before"])
        motion = _make_motion(advice, model, case)
        record_further(folder, case, motion, advice.runs, row["loaded"], advice.plan.temperature)
        again = diagnose(folder).verdict["verdict"]
        entry = _find_entry(again, plants)
        row["after"] = "; ".join(
            f"{one['joint']}: {', '.join([one['effect'], *one['equivalent']])}" for one in again
        )
        if entry is None:
            row["outcome"] = "lost"
        else:
            alone = not entry["equivalent"] and entry["effect"] in _accepted(plants)
            row["outcome"] = "right" if alone else "still open"
    except Exception as problem:
        row["error"] = f"{type(problem).__name__}: {problem}"
    return row | {"seconds": time.perf_counter() - started}


def _accepted(plants: list[dict[str, Any]]) -> set[str]:
    return {name for plant in plants for name in (*plant["accepted"], *plant["also_accepted"])}


def _find_entry(verdict: list[dict[str, Any]], plants: list[dict[str, Any]]) -> dict[str, Any] | None:
    """The entry of a verdict whose names hold the planted effect at its joint."""
    joints = {joint for plant in plants for joint in plant["joints"]}
    for entry in verdict:
        if entry["joint"] in joints and _accepted(plants) & {entry["effect"], *entry["equivalent"]}:
            return entry
    return None


def _make_motion(advice: Any, model: Any, case: Case) -> Motion:
    """The advised test-cycle on the case's fine grid."""
    from wearscope.closed_loop.diagnostics.next_measurement import DWELL, hold_still
    from wearscope.cycles.base import load_cycle

    step = 1.0 / (case.recipe.rate * case.recipe.oversampling)
    build = (
        advice.plan.motion.build if advice.plan.motion is not None else load_cycle(advice.plan.cycle).build
    )
    reference = hold_still(build(model, DWELL, step), advice.plan.moving, model)
    return Motion(reference.t, reference.q, reference.v, reference.a)


def record_further(
    folder: Path, case: Case, motion: Motion, runs: int, loaded: bool, temperature: float
) -> None:
    """Add training runs along one motion to a case's data set.

    The machine, its plants and the torque noise are those of the case, and so are the data set's other runs.

    Parameters
    ----------
    folder : Path
    case : Case
    motion : Motion
        On the case's fine grid.
    runs : int
    loaded : bool
        Whether the machine carries its payload.
    temperature : float
        At the start [deg C]; 35 where it is NaN.
    """
    recipe, machine, seed = case.recipe, case.machine, case.seed
    recording = record(machine, seed, recipe, declare_effects(recipe, case.planted), case.planted)
    actives, _ = plant_effects(recording, case.planted, seed)
    setting, body = recording.setting, recording.body
    if not loaded:
        # Without its payload the machine has no error of it either.
        setting = replace(setting, machine=replace(machine, payload_mass=0.0))
        body = Body(machine.urdf, machine.gravity, 0.0, (0.0, 0.0, 0.0))
        actives = [
            a for a in actives if not (isinstance(a.plant, Structural) and a.plant.kind == "payload_error")
        ]
    data = yaml.safe_load((folder / "dataset.yaml").read_text(encoding="utf-8"))
    names = pq.read_schema(folder / data["runs"][0]["file"]).names
    plan = RunPlan("train", "given", -1, 35.0 if np.isnan(temperature) else temperature)
    for number in range(runs):
        rng = make_stream(seed, machine.name, "further", str(number))
        heat = warm_up(plan, len(machine.joints), motion.t, rng)
        behaviour = behave(setting, motion, heat, actives, body)
        warm = any("temp_" in name for name in names)
        columns, units, _ = record_run(machine, recipe, behaviour, recording.sigma, rng, warm)
        file = f"runs/further{number + 1}.parquet"
        write_table(folder / file, columns, units)
        data["runs"].append(list_run(file, "train", machine, loaded))
    write_text(folder / "dataset.yaml", yaml.safe_dump(data, sort_keys=False))


def summarise_advice(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Shares with Clopper-Pearson 95 % intervals: of all open cases, and of those with a promise."""
    followed = [row for row in rows if row["outcome"] in ("right", "still open", "lost")]
    promised = [row for row in followed if row["power"] >= PROMISED]
    outcomes = pd.Series([row["outcome"] for row in rows]).value_counts().to_dict()
    summary: dict[str, Any] = {"cases": len(rows), "outcomes": outcomes}
    for name, some in (("followed", followed), ("promised", promised)):
        right = pd.Series([row["outcome"] == "right" for row in some], dtype=object)
        summary[name] = {"right": tell_share(right)} | {
            word: sum(row["outcome"] == word for row in some) for word in ("still open", "lost")
        }
    return summary


def _work(job: tuple[str, int, int, int]) -> dict[str, Any]:
    part, cases, seed, number = job
    case = list_advice_cases(part, cases, seed)[number]
    with tempfile.TemporaryDirectory(prefix="advice-") as place:
        return run_advice_case(case, Path(place))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the cases and write ``advice.parquet`` and ``advice.json``."""
    parser = start_parser(__doc__)
    parser.add_argument("--part", choices=PARTS, default="held_out")
    parser.add_argument("--cases", type=int, default=60, help="size of the hypercube")
    parser.add_argument("--first", type=int, help="run only the first so many of them")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    count = given.cases if given.first is None else min(given.first, given.cases)
    jobs = [(given.part, given.cases, given.seed, number) for number in range(count)]
    rows = []
    with multiprocessing.get_context("spawn").Pool(given.jobs, maxtasksperchild=1) as pool:
        for row in pool.imap(_work, jobs):
            rows.append(row)
            promise = f", promised {row['power']:.2f} with {row['runs']} runs" if "power" in row else ""
            said = row["error"] or row["outcome"]
            print(
                f"[{len(rows)}/{count}] {row['told']} -> {row.get('names', '')}: {said}{promise}", flush=True
            )
            write_table(given.out / "advice.parquet", pd.DataFrame(rows))
            write_text(given.out / "advice.json", json.dumps(summarise_advice(rows), indent=1) + "\n")
    print(json.dumps(summarise_advice(rows), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
