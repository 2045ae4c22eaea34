"""Time and memory of simulating and reading 10 to 10,000 points: the first grows with them, the second not.

    .venv/bin/python -m benchmarks.points                       10, 100, 1,000 points, about two minutes
    .venv/bin/python -m benchmarks.points --points 10 100 1000 10000

Every number of points is run in a process of its own: random levels of all factors, so that each point has
its own motion, on the test-cycle of the tests. Processor time is counted, not the time of day.
"""

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks import ROOT
from benchmarks.command import start_parser, write_heads, write_row

CYCLE = ROOT / "tests" / "workflow" / "tiny" / "short_moves.py"
KINDS = {"f": "wear", "w3": "temperature", "w4": "dwell", "w5": "payload_mass_error"}
LOW, HIGH = np.array([0.0, 30.0, 25.0, -10.0]), np.array([50.0, 70.0, 75.0, 10.0])


def run_points(count: int) -> dict[str, float]:
    """Simulate and read back `count` points in this process."""
    from wearscope.cycles.base import load_cycle
    from wearscope.robots.model import load_model
    from wearscope.simulation.chunk import Plan, simulate_chunk
    from wearscope.simulation.recording import read_points

    model = load_model("medium", ROOT / "config" / "robots")
    cycle, plan = load_cycle(str(CYCLE)), Plan("medium", "short_moves", KINDS, 0, 0.004)
    levels = np.random.default_rng(0).uniform(LOW, HIGH, (count, len(KINDS)))
    names = [f"{name}_natural" for name in KINDS]
    rows = [{"point": k, **dict(zip(names, row, strict=True))} for k, row in enumerate(levels.tolist())]
    with tempfile.TemporaryDirectory() as folder:
        simulate_chunk(Path(folder, "warm"), "identification", rows[:1], model, cycle, plan, "code")
        start = time.process_time()
        failed = simulate_chunk(folder, "identification", rows, model, cycle, plan, "code").failed
        simulated = time.process_time() - start
        start = time.process_time()
        points = read_points(folder, "identification", range(count), model)
        samples = sum(len(recording.t) for _, recording in points)
        read = time.process_time() - start
    if failed:
        sys.exit(f"{len(failed)} points failed")
    return {
        "points": count,
        "samples_a_point": samples / count,
        "simulate_ms_a_point": 1e3 * simulated / count,
        "read_ms_a_point": 1e3 * read / count,
        "peak_mib": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
    }


def main() -> None:
    """Print a table, one row a number of points."""
    parser = start_parser(__doc__)
    parser.add_argument("--points", type=int, nargs="+", default=[10, 100, 1000])
    parser.add_argument("--one", type=int, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one is not None:
        print(json.dumps(run_points(given.one)))
        return
    print(write_heads("points", "simulate [ms a point]", "read [ms a point]", "peak [MiB]"))
    for count in given.points:
        command = [sys.executable, "-m", "benchmarks.points", "--one", str(count)]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        row = json.loads(done.stdout.splitlines()[-1])
        times = f"{row['simulate_ms_a_point']:.1f}", f"{row['read_ms_a_point']:.2f}"
        print(write_row(count, *times, f"{row['peak_mib']:.0f}"), flush=True)


if __name__ == "__main__":
    main()
