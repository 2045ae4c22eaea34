"""Seconds and memory of the closed loop on a data set as large as the contract's, by stage.

python benchmarks/closed_loop.py [--runs 5] [--seconds 60] [--out DIR]
"""

import argparse
import os
import resource
import tempfile
import time
from pathlib import Path

from wearscope.attribution_board.generate import generate_dataset
from wearscope.attribution_board.machines import MACHINES
from wearscope.attribution_board.recipe import Planted, Recipe, RunPlan
from wearscope.closed_loop.run import close_loop
from wearscope.reporting.closed_loop_page import write_closed_loop_page

LIMIT_SECONDS, LIMIT_MIB = 120.0, 2048.0
KINDS = ("fourier", "sweep", "points")


def make_plans(runs):
    """Plans of `runs` runs, the last two for testing."""
    plans = []
    for number in range(runs):
        use = "train" if number < max(1, runs - 2) else "test"
        plans.append(RunPlan(use, KINDS[number % len(KINDS)], number, 24.0 + 7.0 * number))
    return tuple(plans)


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--out", help="keep data set and results there")
    arguments = parser.parse_args()
    machine = next(m for m in MACHINES.values() if len(m.joints) == 6)
    place = Path(arguments.out or tempfile.mkdtemp())
    recipe = Recipe(duration=arguments.seconds, plans=make_plans(arguments.runs), temperatures=True)
    planted = [Planted("load_dependent_friction", machine.joints[1], 4.0)]
    start = time.perf_counter()
    generate_dataset(place / "large", machine.name, planted, 3, recipe)
    print(f"{'made in':58}{time.perf_counter() - start:8.1f} s")

    start = last = time.perf_counter()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime

    def show(line):
        nonlocal last
        now = time.perf_counter()
        print(f"  until '{line[:46]}'".ljust(58) + f"{now - last:8.1f} s", flush=True)
        last = now

    verdict = close_loop(place / "large", place / "out", progress=show)
    show("end of the loop")
    write_closed_loop_page(place / "out")
    show("report.html")
    seconds = time.perf_counter() - start
    usage = resource.getrusage(resource.RUSAGE_SELF)
    memory = usage.ru_maxrss / 1024
    print([(e["joint"], e["effect"]) for e in verdict["verdict"]])
    print(
        f"{len(machine.joints)} joints x {arguments.runs} runs x {arguments.seconds:g} s at "
        f"{recipe.rate:g} Hz: {seconds:.1f} s "
        f"(limit {LIMIT_SECONDS:g}), {usage.ru_utime - before:.1f} s of one core's time, "
        f"{memory:.0f} MiB (limit {LIMIT_MIB:g}); {os.cpu_count()} cores, "
        f"load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
