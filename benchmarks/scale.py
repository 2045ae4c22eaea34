"""Large studies, planned dry: jobs, files, bytes, core-hours, and how far a plan of Snakemake gets.

    .venv/bin/python -m benchmarks.scale                                     dry runs of some studies
    .venv/bin/python -m benchmarks.scale --dry --results results/quick       the table of large studies alone
    .venv/bin/python -m benchmarks.scale --dry --run 1x100 1x1000            run some
    .venv/bin/python -m benchmarks.scale --dry --run 1x60 1x120 --partitions 10x1000 --cores 2 --in FOLDER
                                                                             predict one, divided, and run it

Dry runs are `snakemake -n` on this machine, with jobs as long as in the cluster profiles; one that takes more
than two minutes of its one processor or more than 2 GiB is ended, and said so. `--dry ROBOTSxPOINTS` plans 6
test-cycles of each robot with so many points. Seconds and bytes of the table come from benchmark files and
recordings of the finished study that `--results` names. `--run` does what a partition's job does, up to the
scope, on one core; `--partitions` a study divided by robots, a partition a core, joined up to the scope and
then to the report. In `--in` they go on where they were ended, and what is finished is only told.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import psutil

from benchmarks import ROOT
from benchmarks.command import start_parser, write_heads, write_row
from benchmarks.large_studies import check_plan, read_jobs, write_study
from wearscope.config import PartitionSettings

SECONDS, GIBIBYTES = 120, 2
GOAL = {"robots": 1000, "cycles": 6, "points": 1000}
DIRECT = {"cells": 120, "runs": 100_000}
#: Robots and points of what is planned dry: up to the study of the goal, and the direct Monte Carlo, whose
#: 120 cells are those of 12 pairs of a robot and a test-cycle.
PLANNED = ["4x1000", "10x1000", "100x1000", "300x1000", "1000x1000", "2x1000000"]
#: Rules whose time goes with the points, test-cycles and robots.
COUNTED = {"simulate_points", "compute_test_quantities", "check_cycles", "screen_robot"}


@dataclass(frozen=True)
class DryRun:
    """A dry run.

    Attributes
    ----------
    wall, processor, queued : float
        Of it on a processor, and waiting for one that others had [s]; what else there is of the wall time is
        waiting for the disk.
    peak : float
        [MiB]
    jobs : dict
        By rule.
    ended : str
        Why it was ended; empty where it was not.
    """

    wall: float
    processor: float
    queued: float
    peak: float
    jobs: dict[str, int]
    ended: str


def dry_run(folder: Path, study: Path) -> DryRun:
    """Plan a study; ended where it takes too long or too much."""
    command = [sys.executable, "-m", "snakemake", "-n", "--quiet", "rules", "--cores", "1"]
    command += ["--snakefile", str(ROOT / "Snakefile"), "--configfile", str(study)]
    out = folder / "dry.txt"
    start, queued, why = time.perf_counter(), 0.0, ""
    with open(out, "wb") as text:
        process = psutil.Popen(command, cwd=folder, stdout=text, stderr=subprocess.STDOUT)
        while not os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT | os.WNOHANG):
            # How long a process was ready to run and had no processor, which psutil does not tell [ns].
            waited = Path(f"/proc/{process.pid}/schedstat").read_text(encoding="utf-8").split()[1]
            times, queued = process.cpu_times(), int(waited) / 1e9
            if times.user + times.system > SECONDS:
                why = f"ended: over {SECONDS} s"
            if process.memory_info().rss > GIBIBYTES * 1024**3:
                why = f"ended: over {GIBIBYTES} GiB"
            if why:
                process.kill()
            time.sleep(0.1)
        _, status, used = os.wait4(process.pid, 0)
    elapsed = time.perf_counter() - start
    told = out.read_text(encoding="utf-8", errors="replace")
    if status and not why:
        sys.exit(f"the dry run failed:\n{told[-3000:]}")
    jobs = {rule: int(count) for rule, count in re.findall(r"^(\w+) +(\d+)$", told, re.MULTILINE)}
    jobs.pop("total", None)
    return DryRun(elapsed, used.ru_utime + used.ru_stime, queued, used.ru_maxrss / 1024, jobs, why)


def read_costs(results: Path) -> dict[str, float]:
    """What a finished study says of one simulated point, one robot and test-cycle, and one robot.

    Returns
    -------
    dict
        ``point_seconds`` and ``cell_seconds`` (test quantities, by point), ``check_seconds`` (by robot and
        test-cycle), ``screen_seconds`` (by robot), all processor time [s]; ``point_bytes`` of a recording.
    """
    jobs = read_jobs(results).groupby("rule")["cpu_time"]
    seconds = jobs.sum()
    recordings = [file.stat().st_size for file in results.glob("traces/*/*/*/*/recording.parquet")]
    if not recordings or not COUNTED <= {*seconds.index}:
        sys.exit(
            f"{results}: holds no finished study; run one, e.g. snakemake --configfile config/quick.yaml"
        )
    quantified = [
        file
        for set in ("identification", "validation", "filling", "checking", "nominal")
        for file in results.glob(f"traces/*/*/{set}/*/recording.parquet")
    ]
    return {
        "point_seconds": seconds["simulate_points"] / len(recordings),
        "cell_seconds": seconds["compute_test_quantities"] / len(quantified),
        "check_seconds": seconds["check_cycles"] / len(list(results.glob("check/*/*.json"))),
        "screen_seconds": jobs.mean()["screen_robot"],
        "point_bytes": sum(recordings) / len(recordings),
    }


def count_jobs(robots: int, cycles: int, points: int, chunk: int, cut: int) -> int:
    """Jobs of `write_study`'s study: what is once a robot, once a robot and test-cycle, and once.

    A job simulates `chunk` points, or computes the test quantities of `cut`.

    Of a divided study those that a scheduler sees: one a partition, of one robot, and what draws and joins.
    """
    if robots > PartitionSettings().above:
        return robots + 12
    # Identification, validation and the nominal run; all at once where a job holds them.
    chunks = 1 if points + 1 <= chunk else 2 * -(-(points // 2) // chunk) + 1
    chunks += 2 * -(-(points // 2) // cut) if points > cut else 0
    return robots * (3 + cycles * (1 + chunks)) + 16


def plan(
    costs: Mapping[str, float], robots: int, cycles: int, points: int, job_seconds: float
) -> list[float]:
    """Simulations, jobs, files, GB and core-hours of a study, from measured costs."""
    chunk, cut = (max(1, round(job_seconds / costs[of])) for of in ("point_seconds", "cell_seconds"))
    cells, runs = robots * cycles, robots * cycles * (points + 1)
    jobs = count_jobs(robots, cycles, points, chunk, cut)
    # Those within partitions write too: about an output, a log, a benchmark and two digests each.
    writing = jobs + robots * (3 + cycles * (2 + 2 * -(-(points // 2) // chunk) + 1))
    seconds = runs * (costs["point_seconds"] + costs["cell_seconds"])
    seconds += cells * costs["check_seconds"] + robots * costs["screen_seconds"]
    return [runs, jobs, runs + 5 * writing, runs * costs["point_bytes"] / 1e9, seconds / 3600]


def main() -> None:
    """Dry-run studies of some robots, then print the plan of the large ones."""
    parser = start_parser(__doc__)
    parser.add_argument("--dry", nargs="*", default=PLANNED, metavar="ROBOTSxPOINTS")
    parser.add_argument("--job-seconds", type=float, default=600.0)
    parser.add_argument("--results", type=Path, help="folder of a finished study")
    parser.add_argument("--run", nargs="+", default=[], metavar="ROBOTSxPOINTS")
    parser.add_argument("--partitions", nargs="+", default=[], metavar="ROBOTSxPOINTS")
    parser.add_argument(
        "--packed", action="store_true", help="of these two, a chunk's recordings as one file"
    )
    parser.add_argument("--cores", type=int, default=1, help="of --partitions")
    parser.add_argument("--in", dest="folder", type=Path, help="where these two work; a temporary folder")
    given = parser.parse_args()
    if given.dry:
        heads = "robots, points, jobs, wall [s], processor [s], queued [s], peak [MiB]".split(", ")
        print(write_heads(*heads, "120 s, 2 GiB"))
    for asked in given.dry:
        robots, points = map(int, asked.split("x"))
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            one = dry_run(folder, write_study(folder, robots, points, given.job_seconds))
        taken = (f"{number:.0f}" for number in (one.wall, one.processor, one.queued, one.peak))
        jobs = sum(one.jobs.values()) or "-"
        print(write_row(robots, points, jobs, *taken, one.ended or "held"), flush=True)
    if given.run or given.partitions:
        with tempfile.TemporaryDirectory() as temporary:
            check_plan(given.folder or Path(temporary), given)
    if given.results:
        costs = read_costs(given.results)
        print("\n" + "\n".join(f"{name} {value:.3g}" for name, value in costs.items()))
        runs = DIRECT["cells"] * DIRECT["runs"]
        studies = {
            f"{GOAL['robots']} robots x {GOAL['cycles']} x {GOAL['points']}": list(GOAL.values()),
            "a tenth": [GOAL["robots"] // 10, GOAL["cycles"], GOAL["points"]],
            "one partition: 1 robot": [1, GOAL["cycles"], GOAL["points"]],
            f"direct Monte Carlo, {runs:,} runs": [2, 6, runs // 12],
        }
        heads = "study, simulations, jobs, files, GB, core-hours".split(", ")
        print(f"\n{write_heads(*heads, 'hours on 1,000 cores')}")
        for name, numbers in studies.items():
            planned = plan(costs, *numbers, given.job_seconds)
            print(write_row(name, *(f"{one:,.0f}" for one in planned), f"{planned[-1] / 1000:.2f}"))


if __name__ == "__main__":
    main()
