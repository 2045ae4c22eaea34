"""Seconds and memory of the closed loop and its page on data sets of five sizes, by stage.

    python -m benchmarks.closed_loop [--size small|contract|large|longer|hundredfold] [--light] [--out DIR]

small: 6 joints x 6 runs x 40 s at 100 Hz; contract: 6 joints x 5 runs x 60 s at 250 Hz; large: 7 joints x 50
runs x 60 s at 1 kHz, made as in benchmarks/intake.py with an undeclared spring at the second joint; longer
and hundredfold: 400 and 5,000 such runs, of which the stretches that inform most are used. The data set is
made in a process of its own, whose memory is not counted; the largest is 44 GB and an hour's work.

Before all else, one pass over the dictionary: the columns of every candidate at every joint, and their
products with the declared model. No search of these candidates can take less. Its processor time and peak
memory stand next to those of `diagnose`.
"""

import argparse
import multiprocessing
import os
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.board.generate import generate_dataset
from benchmarks.board.machines import MACHINES
from benchmarks.board.recipe import Planted, Recipe, RunPlan
from benchmarks.intake import make_folder
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.diagnostics.examination import examine
from wearscope.closed_loop.inference.offers import list_offers
from wearscope.closed_loop.inference.score import Model
from wearscope.closed_loop.posing import pose_problem
from wearscope.reporting.closed_loop_page import write_closed_loop_page

KINDS = ("fourier", "sweep", "points")
SPRING = 4.0


@dataclass(frozen=True)
class Size:
    """A data set's size and the limits that closing the loop on it must keep to [s, MiB]."""

    joints: int
    runs: int
    seconds: float
    rate: float
    limit_seconds: float
    limit_mib: float


SIZES = {
    "small": Size(6, 6, 40.0, 100.0, 60.0, 2048.0),
    "contract": Size(6, 5, 60.0, 250.0, 120.0, 2048.0),
    "large": Size(7, 50, 60.0, 1000.0, 900.0, 4096.0),
    "longer": Size(7, 400, 60.0, 1000.0, 900.0, 4096.0),
    "hundredfold": Size(7, 5000, 60.0, 1000.0, 3600.0, 4096.0),
}


def make_plans(runs):
    """Plans of `runs` runs, the last two for testing."""
    plans = []
    for number in range(runs):
        use = "train" if number < max(1, runs - 2) else "test"
        plans.append(RunPlan(use, KINDS[number % len(KINDS)], number, 24.0 + 7.0 * number))
    return tuple(plans)


def make_data(place, name):
    """Write the data set of a size, with one effect that it does not declare."""
    size = SIZES[name]
    if name in ("large", "longer", "hundredfold"):
        make_folder(place, size.runs, size.seconds, size.rate, size.joints)
        for file in sorted((place / "runs").glob("*.parquet")):
            table = pd.read_parquet(file)
            table["tau_j2"] += SPRING * table["q_j2"]
            table.to_parquet(file, index=False)
        return
    machine = next(m for m in MACHINES.values() if len(m.joints) == size.joints)
    recipe = Recipe(duration=size.seconds, rate=size.rate, plans=make_plans(size.runs), temperatures=True)
    planted = [Planted("load_dependent_friction", machine.joints[1], 4.0)]
    generate_dataset(place, machine.name, planted, 3, recipe)


def pass_over(data):
    """Processor seconds of one pass over the dictionary of columns, and how many columns it has."""
    problem = pose_problem(data)
    model = Model(problem, (), np.ones(problem.prepared.n))
    begin = time.process_time()
    offers = list_offers(model, range(problem.prepared.n))
    candidates = {id(o.term.candidate): o.term.candidate for o in offers}
    count = sum(x.shape[1] for candidate in candidates.values() for x in candidate.rows)
    return time.process_time() - begin, count


def measure_peak():
    """Peak memory of this process [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--light", action="store_true", help="without diagnostics and forward simulation")
    parser.add_argument("--out", help="keep data set and results there, and use a data set that is there")
    arguments = parser.parse_args()
    place, size = Path(arguments.out or tempfile.mkdtemp()), SIZES[arguments.size]
    data, out = place / arguments.size, place / f"{arguments.size}-out"
    start = time.perf_counter()
    if not (data / "dataset.yaml").is_file():
        maker = multiprocessing.get_context("spawn").Process(target=make_data, args=(data, arguments.size))
        maker.start()
        maker.join()
        print(f"{'made in':58}{time.perf_counter() - start:8.1f} s", flush=True)

    once, columns = pass_over(data)
    first_peak = measure_peak()
    start = last = time.perf_counter()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    begin = time.process_time()

    def show(line):
        nonlocal last
        now = time.perf_counter()
        print(
            f"  until '{line[:46]}'".ljust(58) + f"{now - last:8.1f} s{measure_peak():8.0f} MiB", flush=True
        )
        last = now

    diagnosis = diagnose(data, progress=show)
    asked = time.process_time() - begin
    show("diagnosed")
    print(
        f"processor time: diagnose {asked:.1f} s, peak {measure_peak():.0f} MiB; "
        f"one pass over {columns} columns {once:.1f} s, peak {first_peak:.0f} MiB"
    )
    extra = {} if arguments.light else examine(out, diagnosis, show)
    verdict = diagnosis.write(out, extra)
    show("written")
    write_closed_loop_page(out)
    show("report.html")
    seconds = time.perf_counter() - start
    usage = resource.getrusage(resource.RUSAGE_SELF)
    print([(e["joint"], e["effect"], e["status"]) for e in verdict["verdict"]])
    print({joint: one["state"] for joint, one in verdict["joints"].items()})
    print(
        f"{size.joints} joints x {size.runs} runs x {size.seconds:g} s at {size.rate:g} Hz: {seconds:.1f} s "
        f"(limit {size.limit_seconds:g}), {usage.ru_utime - before:.1f} s of one core's time, "
        f"{measure_peak():.0f} MiB (limit {size.limit_mib:g}); {os.cpu_count()} cores, "
        f"load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
