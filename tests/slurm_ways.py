"""The ways in which SLURM runs what also runs here, timed, with the results that are to be the same."""

import re
import resource
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from session_machine import write_machine

SNAKEMAKE = [sys.executable, "-m", "snakemake"]
#: Results that tell of the run itself: times, memory, the page that shows them.
OF_THE_RUN = re.compile(
    r"(^|/)(logs|benchmarks|\.checksums|cases)/|report\.html$|\.(log|tsv)$|in_one_job\.yaml$"
)


@dataclass(frozen=True)
class Work:
    """What is run: a target of the workflow, the target that runs it as one job, and further arguments."""

    target: str
    as_one_job: str
    #: Given an empty folder for what they need.
    arguments: Callable[[Path], list[str]]


def make_machine(folder: Path) -> list[str]:
    """Write a small machine of five sessions, worn at the last; arguments that name it."""
    days = [{"temperature": x} for x in (28.0, 42.0, 35.0)] + [{"temperature": 40.0}, {"wear": 0.2}]
    return ["--config", f"dataset={write_machine(folder / 'machine', days, 3)}"]


WORKS = {
    "tiny": Work("all", "in_one_job", lambda _: ["--configfile", "tests/workflow/tiny/config.yaml"]),
    "quick": Work("all", "in_one_job", lambda _: ["--configfile", "config/quick.yaml"]),
    "track": Work("track", "track_in_one_job", make_machine),
}
#: In addition to the local one, see `build_command`.
WAYS = ("srun", "one job")


def build_command(way: str, work: Work, cores: int) -> list[str]:
    """Command of one way to run a work, but for the work's own arguments.

    `local` starts Snakemake here, `srun` starts the same on the node, `one job` sends the work as one job
    through `profiles/srun`.
    """
    local = [*SNAKEMAKE, work.target, "--cores", str(cores)]
    if way == "local":
        return local
    if way == "srun":
        return ["srun", "--input=none", "--ntasks=1", f"--cpus-per-task={cores}", "--mem=8000", *local]
    sent = [*SNAKEMAKE, work.as_one_job, "--profile", "profiles/srun"]
    return [*sent, "--set-threads", f"{work.as_one_job}={cores}"]


@dataclass(frozen=True)
class Run:
    """Times of a run [s]: all, the Snakemake that does the work, processor time of what is started here."""

    wall: float
    within: float
    processor: float

    def added_to(self, local: "Run") -> float:
        """Time around the Snakemake that does the work, beyond that of a local run [s]."""
        return (self.wall - self.within) - (local.wall - local.within)


def run(tree: Path, command: list[str], environment: dict[str, str]) -> Run:
    """Run a command in a copy of the tree."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    logs = [log.read_text() for log in tree.glob("results/*/logs/*in_one_job.log")]
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(wall, read_elapsed("".join(logs) or done.stderr), processor)


def read_elapsed(told: str) -> float:
    """How long Snakemake took [s], as it says at its end."""
    hours, minutes, seconds = re.findall(r"Elapsed time: (\d+):(\d+):([\d.]+)", told)[-1]
    return 3600 * int(hours) + 60 * int(minutes) + float(seconds)


def read_results(tree: Path) -> dict[str, bytes]:
    """Content by name of the results, but for what tells of the run itself, as a case's seconds."""
    results = tree / "results"
    files = {file.relative_to(results).as_posix(): file for file in results.rglob("*") if file.is_file()}
    found = {name: file.read_bytes() for name, file in files.items() if not OF_THE_RUN.search(name)}
    return found
