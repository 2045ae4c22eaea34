"""What a study takes, and what of it the workflow itself: seconds, processor seconds, memory of any job.

    taskset -c 0,1 .venv/bin/python benchmarks/workflow.py                    the default study
    taskset -c 0,1 .venv/bin/python benchmarks/workflow.py --first            four detectors, full models only
    .venv/bin/python benchmarks/workflow.py --configfile config/quick.yaml

In a copy of the tree, what studies run is compiled as the set-up does; then the study is run from nothing,
and once more with nothing to do, next to which Snakemake's own start is stated. Processor seconds are
those of all processes, so that others' work on the machine counts little; what no job states is Snakemake's
main process, the shells that it starts and the ends of the jobs' processes. The overhead is cores x elapsed
time less the jobs' own time: starting processes, Snakemake itself, and cores that wait.
"""

import argparse
import csv
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import yaml

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from clones import copy_tree  # noqa: E402


def write_first_study(file: Path) -> None:
    """Write a smaller default study: four detectors, questions to the full quadratic model.

    Points for chosen surrogates, direct runs and what the correction changes are left out.
    """
    study = yaml.safe_load((ROOT / "config" / "config.yaml").read_text(encoding="utf-8"))
    del study["detectors"]["E"]
    study["surrogates"] = {"filling": {"enabled": False}}
    for section in ("direct", "reevaluate"):
        study[section] = {"enabled": False}
    for section in ("snr", "scope"):
        study[section]["model"] = "full"
    file.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")


def run_timed(
    command: list[str], folder: Path, names: Mapping[str, str] | None = None
) -> tuple[float, float, float]:
    """Seconds of a command, processor seconds with all it starts, and its own; ends where it fails."""
    start = time.perf_counter()
    with open(folder / "benchmark.log", "w+", encoding="utf-8") as log:
        process = subprocess.Popen(command, cwd=folder, env=names, stdout=log, stderr=log)
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)
        elapsed = time.perf_counter() - start
        # The 14th to 17th field: ticks in user and system mode of a process, and of those that it waited for.
        stat = Path(f"/proc/{process.pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
        own, system, children, their_system = (int(one) / os.sysconf("SC_CLK_TCK") for one in stat[11:15])
        if process.wait():
            log.seek(0)
            sys.exit(f"{' '.join(command)} failed:\n{log.read()[-4000:]}")
    return elapsed, own + system + children + their_system, own + system


def read_jobs(results: Path) -> list[tuple[str, float, float, float]]:
    """Rule, seconds, processor seconds and peak MiB of each job, from its benchmark file."""
    jobs: list[tuple[str, float, float, float]] = []
    for file in sorted(results.glob("*/benchmarks/**/*.tsv")):
        parts = file.relative_to(results).parts[2:]
        with open(file, encoding="utf-8") as text:
            for row in csv.DictReader(text, delimiter="\t"):
                seconds, processor, peak = map(float, row.values())
                jobs.append((parts[0].removesuffix(".tsv"), seconds, processor, peak))
    return jobs


def main() -> None:
    """Run the study twice in a copy and print what it cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--configfile", default="config/config.yaml")
    parser.add_argument("--first", action="store_true", help="four detectors, full models, no direct runs")
    parser.add_argument("--cores", type=int, default=2)
    given = parser.parse_args()
    command = [sys.executable, "-m", "snakemake", "--cores", str(given.cores)]
    command += ["--configfile", "first.yaml" if given.first else given.configfile]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        copy_tree(folder, compiled=False)
        if given.first:
            write_first_study(folder / "first.yaml")
        source = os.environ | {"PYTHONPATH": str(folder / "src")}
        compiling, *_ = run_timed([sys.executable, "-m", "wearscope.jobs.compiled"], folder, source)
        load = os.getloadavg()[0]
        elapsed, processor, own = run_timed(command, folder)
        loads = f"load {load:.1f} before, {os.getloadavg()[0]:.1f} after"
        idle, planning, _ = run_timed(command, folder)
        _, starting, _ = run_timed([*command[:3], "--version"], folder)
        jobs = read_jobs(folder / "results")
        simulated = len(list((folder / "results").glob("*/traces/*/*/*/*/recording.parquet")))
    total, used = sum(job[1] for job in jobs), sum(job[2] for job in jobs)
    print(f"{'rule':28} {'jobs':>5} {'seconds':>9} {'longest':>9} {'processor':>9} {'peak MiB':>9}")
    for rule in sorted({job[0] for job in jobs}):
        seconds, busy, peaks = zip(*[job[1:] for job in jobs if job[0] == rule], strict=True)
        print(
            f"{rule:28} {len(seconds):5d} {sum(seconds):9.1f} {max(seconds):9.1f} {sum(busy):9.1f} "
            f"{max(peaks):9.0f}"
        )
    print(f"simulations           {simulated:9d}")
    print(f"compiled at set-up    {compiling:9.1f} s")
    print(f"elapsed on {given.cores} cores      {elapsed:9.1f} s, {loads}")
    print(f"processor             {processor:9.1f} s")
    print(f"sum of {len(jobs)} jobs        {total:9.1f} s, {used:.1f} s of processor")
    print(f"processor of no job   {processor - used:9.1f} s, {own:.1f} s of it Snakemake's main process")
    overhead = given.cores * elapsed - total
    print(f"overhead              {overhead:9.1f} core s, {100 * overhead / total:.1f} % of the jobs")
    print(f"idle run              {idle:9.1f} s, {planning:.1f} s of processor")
    print(f"Snakemake's own start {starting:9.1f} s of processor")


if __name__ == "__main__":
    main()
