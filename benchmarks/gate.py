"""Whether a changed search may replace the present one: frozen cases and real machines, paired.

    python -m benchmarks.gate --out DIR [--cases 200] [--smallest N] [--drawn 100] [--data FOLDER] [--jobs 1]
    python -m benchmarks.gate BEFORE AFTER

The first form diagnoses development cases of the board, drawn cases of the second generator and, where the
folder of measured data is named, real machines; a run that was stopped goes on. The second compares two such
folders. It passes, and ends with 0, where the 95 % lower bound of the difference in exact cases is above -3
points, no other score is worse beyond chance, and no real joint's held-out error is more than 5 % larger.
"""

import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.board.regimes import list_cases
from benchmarks.command import start_parser
from benchmarks.outside.drawn import draw_case
from benchmarks.paired import compare, write_comparison
from benchmarks.runner import run_cases
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.storage.tables import read_table, write_text

SEED = 301
"""Of the development cases."""
MARGIN, LARGER = 0.03, 0.05
MACHINES = ("emps", "kr300")


def measure_machines(data: Path, out: Path) -> None:
    """Write each real joint's held-out error and the processor seconds of its machine."""
    rows = {}
    for name in MACHINES:
        begin = time.process_time()
        joints = diagnose(data / name).verdict["joints"]
        rows[name] = {
            "seconds": time.process_time() - begin,
            "rms_after": {joint: one["rms_after"] for joint, one in joints.items()},
        }
    write_text(out / "machines.json", json.dumps(rows, indent=1))


def bound_difference(won: int, lost: int, cases: int) -> tuple[float, float, float]:
    """Difference of two paired shares, and its 95 % interval with one case more on either side.

    Agresti and Min 2005, Statistics in Medicine 24.
    """
    won, lost, cases = won + 0.5, lost + 0.5, cases + 2
    difference = (won - lost) / cases
    error = np.sqrt((won + lost) - (won - lost) ** 2 / cases) / cases
    return difference, difference - 1.96 * error, difference + 1.96 * error


def list_parts(folder: Path) -> list[str]:
    """Generators whose cases a folder has."""
    return [part for part in ("board", "outside") if (folder / part).is_dir()]


def judge(before: Path, after: Path) -> list[str]:
    """Reasons for which the gate is not passed; none where it is."""
    tables = [
        pd.concat([read_table(folder / part / "cases.parquet") for part in list_parts(folder)])
        for folder in (before, after)
    ]
    reasons = []
    for row in compare(*tables).itertuples():
        won, lost = len(row.won.split()), len(row.lost.split())
        difference, low, high = bound_difference(won, lost, row.cases)
        told = f"{row.score}: {100 * difference:+.1f} points ({100 * low:+.1f} to {100 * high:+.1f})"
        sys.stdout.write(f"{told}, {row.cases} cases\n")
        if low <= -MARGIN if row.score == "exact" else high < 0.0:
            reasons.append(told)
    machines = [folder / "machines.json" for folder in (before, after)]
    if all(path.is_file() for path in machines):
        first, second = (json.loads(path.read_text(encoding="utf-8")) for path in machines)
        for name in first:
            for joint, error in first[name]["rms_after"].items():
                ratio = second[name]["rms_after"][joint] / error
                sys.stdout.write(f"{name} {joint}: held-out error {ratio:.3f} times\n")
                if ratio > 1.0 + LARGER:
                    reasons.append(f"{name} {joint}: held-out error {ratio:.2f} times")
    return reasons


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = start_parser(__doc__)
    parser.add_argument("folders", nargs="*", type=Path, metavar="DIR", help="before and after")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--smallest", type=int, help="of these cases those with the fewest samples")
    parser.add_argument("--drawn", type=int, default=100)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args(arguments)
    if given.out is not None:
        frozen = sorted(list_cases("development", given.cases, SEED), key=lambda case: case.samples)
        drawn = [draw_case(k) for k in range(SEED, SEED + given.drawn)]
        for part, cases in (("board", frozen[: given.smallest]), ("outside", drawn)):
            if cases:
                run_cases(cases, given.out / part, given.jobs)
        if given.data is not None:
            measure_machines(given.data, given.out)
        return 0
    if len(given.folders) != 2:
        parser.error("name --out, or the folders before and after")
    for part in list_parts(given.folders[0]):
        sys.stdout.write(write_comparison([folder / part for folder in given.folders]))
    reasons = judge(*given.folders)
    sys.stdout.write("\n".join(["not passed:", *reasons] if reasons else ["passed"]) + "\n")
    return int(bool(reasons))


if __name__ == "__main__":
    sys.exit(main())
