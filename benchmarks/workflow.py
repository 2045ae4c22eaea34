"""What a study takes, and what of it the workflow itself: seconds, processor seconds, memory of any job.

    taskset -c 0,1 .venv/bin/python -m benchmarks.workflow                    the default study
    taskset -c 0,1 .venv/bin/python -m benchmarks.workflow --first            four detectors, full models only
    .venv/bin/python -m benchmarks.workflow --configfile config/quick.yaml

In a copy of the tree, what studies run is compiled as the set-up does; then the study is run from nothing,
and once more with nothing to do, next to which Snakemake's own start is stated. Processor seconds are
those of all processes, so that others' work on the machine counts little; what no job states is Snakemake's
main process, the shells that it starts and the ends of the jobs' processes. The overhead is cores x elapsed
time less the jobs' own time: starting processes, Snakemake itself, and cores that wait.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import yaml
from clones import copy_tree

from benchmarks import ROOT
from benchmarks.command import start_parser
from benchmarks.large_studies import read_jobs


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


def main() -> None:
    """Run the study twice in a copy and print what it cost."""
    parser = start_parser(__doc__)
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
        (results,) = (file.parent for file in folder.glob("results/*/benchmarks"))
        jobs = read_jobs(results)
        simulated = len(list(results.glob("traces/*/*/*/*/recording.parquet")))
    rules = jobs.groupby("rule").agg(
        jobs=("s", "size"), seconds=("s", "sum"), longest=("s", "max"), processor=("cpu_time", "sum"),
        peak_mib=("max_rss", "max"),
    )  # fmt: skip
    total, used = rules["seconds"].sum(), rules["processor"].sum()
    print(rules.to_string(float_format="%.1f"))
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
