"""What joining a divided study takes: processor time and largest memory of each joining job, by robots.

    .venv/bin/python benchmarks/joining.py FOLDER --robots 2 6 10 --in OTHER

FOLDER holds a finished study of one robot a partition, as `benchmarks/scale.py --partitions` leaves it. Its
first robots are taken as studies of their own, whose partitions are hard links to the finished ones, and
joined up to the report. What the partitions took is not counted.

    .venv/bin/python benchmarks/joining.py FOLDER --repeated 60 --in OTHER

joins the largest tables, those of test quantities and scopes, of as many robots as are said: the finished
ones over and over, each time by another name.
"""

import argparse
import csv
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pandas as pd
import yaml
from large_studies import ROOT

from wearscope.storage import tables


def take_robots(source: Path, target: Path, robots: int) -> None:
    """Make a study of the first robots of a finished one, its partitions among the results."""
    study = yaml.safe_load((source / "study.yaml").read_text(encoding="utf-8"))
    study["robots"] = study["robots"][:robots]
    study["partitions"] = {"above": 0}
    shutil.copytree(source / "robots", target / "robots")
    (target / "study.yaml").write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    for number in range(robots):
        folder = Path("results", study["study"], "partitions", f"{number:05d}")
        (target / folder).mkdir(parents=True)
        for file in [*(source / folder).glob("*.parquet"), source / folder / "report.html"]:
            os.link(file, target / folder / file.name)


def run_snakemake(folder: Path, *asked: str) -> None:
    """Ask something of the study in a folder; ends this process where it fails."""
    command = [sys.executable, "-m", "snakemake", *asked, "--cores", "1", "--quiet", "all"]
    command += ["--snakefile", str(ROOT / "Snakefile"), "--configfile", "study.yaml"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{folder}: it failed:\n{done.stderr[-4000:]}")


def read_jobs(results: Path) -> dict[str, tuple[float, float]]:
    """Processor time [s] and largest resident memory [MiB] of each joining job."""
    found = {}
    for file in sorted((results / "benchmarks").rglob("*.tsv")):
        name = file.relative_to(results / "benchmarks").with_suffix("").as_posix()
        if not name.startswith("partitions/"):
            with open(file, encoding="utf-8") as text:
                row = next(csv.DictReader(text, delimiter="\t"))
            found[name] = float(row["cpu_time"]), float(row["max_rss"])
    return found


def join_repeated(finished: Path, name: str, robots: int, out: Path) -> None:
    """Join a table of many robots here; print the largest memory after the finished, and after all."""
    files = sorted(finished.glob(f"results/*/partitions/*/{name}.parquet"))

    def make_parts() -> Iterator[pd.DataFrame]:
        for number in range(robots):
            yield tables.read_table(files[number % len(files)]).assign(robot=f"r{number:05d}")
            if number + 1 in (len(files), robots):
                peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                print(f"{name}, {number + 1} robots: {peak:.0f} MiB at most so far", flush=True)

    tables.join_tables(out, make_parts())
    out.unlink()


def main() -> None:
    """Join some robots, then more; print a row a job."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("finished", type=Path, help="folder of a finished divided study")
    parser.add_argument("--robots", type=int, nargs="+", default=[2, 6, 10])
    parser.add_argument("--in", dest="folder", type=Path, required=True, help="where the joined studies go")
    parser.add_argument("--repeated", type=int, default=0, metavar="ROBOTS")
    given = parser.parse_args()
    if given.repeated:
        given.folder.mkdir(parents=True, exist_ok=True)
        for name in ("test_quantities", "scope"):
            join_repeated(given.finished, name, given.repeated, given.folder / f"{name}.parquet")
        return
    measured = {}
    for robots in given.robots:
        folder = given.folder / f"{robots}"
        take_robots(given.finished, folder, robots)
        run_snakemake(folder, "report", "--touch", "--until", "run_partition")
        run_snakemake(folder, "report")
        (results,) = (folder / "results").iterdir()
        measured[robots] = read_jobs(results)
        page = (results / "report.html").stat().st_size / 2**20
        print(f"{robots} robots: the page has {page:.2f} MiB", flush=True)
    print("\n| job |" + "".join(f" {robots} robots [s] | [MiB] |" for robots in given.robots))
    print("|" + (1 + 2 * len(given.robots)) * "---|")
    for job in measured[given.robots[-1]]:
        told = (" | ".join(f"{value:,.1f}" for value in measured[robots][job]) for robots in given.robots)
        print(f"| {job} | {' | '.join(told)} |")


if __name__ == "__main__":
    main()
