"""What the workflow itself costs: seconds over the sum of its jobs, idle seconds, peak memory of any job.

    .venv/bin/python benchmarks/workflow.py                                   the paper's study
    .venv/bin/python benchmarks/workflow.py --configfile config/quick.yaml

The study is run from nothing in a copy of the tree, then once more with nothing to do. The overhead is
cores x elapsed time less the jobs' own time: starting processes, Snakemake itself, and cores that wait.
"""

import argparse
import csv
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]


def copy_tree(target: Path) -> None:
    """Copy the files that git knows or would know."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, target / name)


def run_timed(command: list[str], folder: Path) -> float:
    """Seconds that a command takes; ends the benchmark where it fails."""
    start = time.perf_counter()
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    elapsed = time.perf_counter() - start
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}\n{done.stderr[-4000:]}")
    return elapsed


def read_jobs(results: Path) -> list[tuple[str, float, float]]:
    """Rule, seconds and peak MiB of each job, from its benchmark file."""
    jobs = []
    for file in sorted(results.glob("*/benchmarks/**/*.tsv")):
        parts = file.relative_to(results).parts[2:]
        with open(file, encoding="utf-8") as text:
            for row in csv.DictReader(text, delimiter="\t"):
                peak = float(row["max_rss"]) if row["max_rss"] not in ("-", "NA") else float("nan")
                jobs.append((parts[0].removesuffix(".tsv"), float(row["s"]), peak))
    return jobs


def main() -> None:
    """Run the study twice in a copy and print what it cost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--configfile", default="config/config.yaml")
    parser.add_argument("--cores", type=int, default=2)
    given = parser.parse_args()
    command = [sys.executable, "-m", "snakemake", "--cores", str(given.cores)]
    command += ["--configfile", given.configfile]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        copy_tree(folder)
        elapsed = run_timed(command, folder)
        idle = run_timed(command, folder)
        jobs = read_jobs(folder / "results")
    total = sum(seconds for _, seconds, _ in jobs)
    print(f"{'rule':28} {'jobs':>5} {'seconds':>9} {'longest':>9} {'peak MiB':>9}")
    for rule in sorted({rule for rule, _, _ in jobs}):
        seconds = [one[1] for one in jobs if one[0] == rule]
        peak = max(one[2] for one in jobs if one[0] == rule)
        print(f"{rule:28} {len(seconds):5d} {sum(seconds):9.1f} {max(seconds):9.1f} {peak:9.0f}")
    print(f"elapsed on {given.cores} cores      {elapsed:9.1f} s")
    print(f"sum of {len(jobs)} jobs        {total:9.1f} s")
    overhead = given.cores * elapsed - total
    print(f"overhead              {overhead:9.1f} core s, {100 * overhead / total:.1f} % of the jobs")
    print(f"idle run              {idle:9.1f} s")


if __name__ == "__main__":
    main()
