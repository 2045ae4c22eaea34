"""Large studies of copies of one robot: written, run here, measured, and predicted from smaller ones."""

import argparse
import json
import os
import resource
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import psutil
import yaml

from benchmarks import ROOT
from benchmarks.command import write_heads, write_row
from wearscope.processes import STARTER, identify_process
from wearscope.storage.files import write_text

#: Of a point of `write_study`'s robot, measured in partitions of 1,000 points (docs/cluster.md).
SECONDS_OF = {"point_seconds": 0.075, "quantity_seconds": 0.035}


def write_study(folder: Path, robots: int, points: int, job_seconds: float, **sections: dict) -> Path:
    """Write a study of copies of one robot, half of its points for identification, half for validation.

    `sections` say more of the configuration's.
    """
    study = yaml.safe_load((ROOT / "config" / "config.yaml").read_text(encoding="utf-8"))
    for number in range(robots):
        shutil.copytree(ROOT / "config/robots/medium", folder / "robots" / f"r{number:04d}")
    study |= {
        "study": "scale",
        "robots": [f"robots/r{number:04d}" for number in range(robots)],
        "design": {"kind": "latin_hypercube", "points": points // 2},
        "simulation": {"step": study["simulation"]["step"], "job_seconds": job_seconds, **SECONDS_OF},
        "surrogates": {"filling": {"enabled": False}},
        "audit": {"enabled": False},
        "direct": {"enabled": False},
        "closed_loop": {"demonstration": False},
        "reevaluate": {"enabled": False},
    }
    for name, settings in sections.items():
        study[name] = study.get(name, {}) | settings
    for section in ("snr", "sensitivity", "scope"):
        if isinstance(study.get(section), dict) and study[section].get("model") == "chosen":
            study[section]["model"] = "full"
    file = folder / "study.yaml"
    file.write_text(yaml.safe_dump(study, sort_keys=False), encoding="utf-8")
    return file


def read_jobs(results: Path) -> pd.DataFrame:
    """Each job of a study: `rule`, `s`, processor seconds `cpu_time` and peak MiB `max_rss`."""
    jobs = []
    for file in sorted(results.glob("benchmarks/**/*.tsv")):
        rule = file.relative_to(results / "benchmarks").parts[0].removesuffix(".tsv")
        jobs.append(pd.read_csv(file, sep="\t").assign(rule=rule))
    return pd.concat(jobs) if jobs else pd.DataFrame(columns=["s", "cpu_time", "max_rss", "rule"])


@dataclass(frozen=True)
class Found:
    """What a study is found to have taken: the logs of its jobs are counted, and times are of all its starts.

    Attributes
    ----------
    gigabytes : float
        Of recordings.
    processor, wall : float
        Of Snakemake and all that it starts [h].
    """

    simulations: float
    jobs: float
    files: float
    gigabytes: float
    processor: float
    wall: float

    def tell(self, name: str, how: str) -> None:
        """Print it as a row of a table; what is not known is left empty."""
        counts = (f"{count:,.0f}" for count in (self.simulations, self.jobs, self.files))
        wall = "" if self.wall != self.wall else f"{self.wall:.3f}"
        row = write_row(name, how, *counts, f"{self.gigabytes:.3f}", f"{self.processor:.3f}", wall)
        print(row, flush=True)


def read_tree_time(pid: int) -> float:
    """Processor time of a process, of those under it and of those that they have waited for [s]."""
    total = 0.0
    try:
        process = psutil.Process(pid)
        for one in [process, *process.children(recursive=True)]:
            times = one.cpu_times()
            total += times.user + times.system + times.children_user + times.children_system
    except psutil.NoSuchProcess:
        return 0.0
    return total


def run_snakemake(folder: Path, target: str, cores: int, watch: Callable[[], None]) -> None:
    """Run a target; add what it takes to the folder's ``spent.json`` [s] all the while, and call `watch`.

    What it starts ends with this process. Ended by SIGKILL, some seconds are not counted.
    """
    kept = folder / "spent.json"
    before = (
        json.loads(kept.read_text(encoding="utf-8")) if kept.is_file() else {"processor": 0.0, "wall": 0.0}
    )
    command = [sys.executable, "-m", "snakemake", target, "--cores", str(cores), "--quiet", "all"]
    command += ["--snakefile", str(ROOT / "Snakefile"), "--configfile", "study.yaml"]
    environment = {**os.environ, STARTER: identify_process(os.getpid())}
    waited, start, spent = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter(), 0.0
    process = subprocess.Popen(command, cwd=folder, env=environment)
    running = True
    while running:
        try:
            process.wait(timeout=5)
            running, now = False, resource.getrusage(resource.RUSAGE_CHILDREN)
            spent = max(spent, now.ru_utime + now.ru_stime - waited.ru_utime - waited.ru_stime)
        except subprocess.TimeoutExpired:
            spent = max(spent, read_tree_time(process.pid))
        wall = before["wall"] + time.perf_counter() - start
        write_text(kept, json.dumps({"processor": before["processor"] + spent, "wall": wall}))
        watch()
    if process.returncode:
        sys.exit(f"{folder}: it failed, or was ended; the same command goes on")


def count_packed(file: Path) -> int:
    """Recordings that a file holds; none where its job is not at its end."""
    marker = file.with_suffix(".json")
    return len(json.loads(marker.read_text(encoding="utf-8"))["fingerprints"]) if marker.is_file() else 0


def count_study(folder: Path) -> Found:
    """What is there of a study, and what was spent on it."""
    spent = json.loads((folder / "spent.json").read_text(encoding="utf-8"))
    files = [file for file in (folder / "results").rglob("*") if file.is_file()]
    recorded = [file for file in files if file.name == "recording.parquet" or file.suffix == ".tar"]
    sizes = [file.stat().st_size for file in recorded]
    runs = [1 if file.suffix == ".parquet" else count_packed(file) for file in recorded]
    jobs = sum(file.suffix == ".log" for file in files)
    times = spent["processor"] / 3600, spent["wall"] / 3600
    return Found(sum(runs), jobs, len(files), sum(sizes) / 1e9, *times)


def run_study(
    folder: Path, robots: int, points: int, given: argparse.Namespace, cores: int | None = None
) -> dict[str, Found]:
    """Run a study up to the scope on one core, or divided on some and up to the report; what came, by target.

    Of a divided study it is told whenever a partition is finished, with what the others have done by then.
    """
    kept = folder / "measured.json"
    if kept.is_file():
        return {name: Found(**one) for name, one in json.loads(kept.read_text(encoding="utf-8")).items()}
    if not (folder / "study.yaml").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        divided = {} if cores is None else {"partitions": {"above": 0}}
        packed = {"packed": given.packed}
        write_study(folder, robots, points, given.job_seconds, simulation=packed, **divided)
    finished = 0

    def watch() -> None:
        nonlocal finished
        there = len(list(folder.glob("results/scale/partitions/*/scope.parquet")))
        if there > finished:
            finished = there
            count_study(folder).tell(f"{robots}x{points}", f"{there} of {robots} partitions finished")

    found = {}
    for target in ["scope"] if cores is None else ["scope", "report"]:
        run_snakemake(folder, target, cores or 1, watch)
        found[target] = count_study(folder)
    write_text(kept, json.dumps({name: asdict(one) for name, one in found.items()}))
    return found


def predict(before: list[Found], robots: int, points: int) -> Found:
    """What a study takes by the line through studies of one robot, once for each of its robots."""
    there = np.array([list(asdict(one).values()) for one in before])
    runs = 6 * (points + 1)
    line = [robots * float(np.polynomial.Polynomial.fit(there[:, 0], column, 1)(runs)) for column in there.T]
    return Found(*line[:-1], wall=float("nan"))


def check_plan(folder: Path, given: argparse.Namespace) -> None:
    """Run studies of one robot, then divided ones, and print what came, with what those before predict."""
    print(write_heads("study", "", "simulations", "jobs", "files", "GB", "processor [h]", "wall [h]"))
    line: list[Found] = []
    for asked in [*given.run, *given.partitions]:
        robots, points = map(int, asked.split("x"))
        if len(line) > 1:
            predict(line, robots, points).tell(asked, f"predicted from the {len(line)} before")
        cores = given.cores if asked in given.partitions else None
        found = run_study(folder / asked, robots, points, given, cores)
        for target, one in found.items():
            one.tell(asked, "measured" if target == "scope" else f"measured, with the {target}")
        if asked in given.run:
            line.append(found["scope"])
