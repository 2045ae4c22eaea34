"""What SLURM adds to a run: a study here, and as one job of a SLURM of one node started for it.

    .venv/bin/python benchmarks/slurm.py                        the quick study, track, the smallest board
    .venv/bin/python benchmarks/slurm.py track --cores 2 --repeats 3

Needs what `make cluster` installs and Debian's SLURM (docs/cluster.md). Each run has a copy of the tree of
its own and begins with nothing; the bytes of the results are compared. The ways: `srun` starts Snakemake on
the node, as it would be started here; `one job` sends the target `in_one_job` through `profiles/srun`.

On a busy machine two runs of the same take different times. So each also says how long the Snakemake took
that does the work; what a run takes beyond it, more than the local run does, is `added`: the starts of what
stands around it, and seeing the end.
"""

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "workflow")]

from clones import copy_tree  # noqa: E402
from one_node_slurm import NoSlurm, start_slurm  # noqa: E402
from session_machine import write_machine  # noqa: E402

SNAKEMAKE = [sys.executable, "-m", "snakemake"]
#: Results that tell of the run itself: times, memory, the page that shows them.
OF_THE_RUN = re.compile(
    r"(^|/)(logs|benchmarks|\.checksums|cases)/|report\.html$|\.(log|tsv)$|in_one_job\.yaml$"
)


@dataclass(frozen=True)
class Work:
    """What is run.

    Attributes
    ----------
    target : str
        Of the workflow.
    as_one_job : str
        The target that runs it as one job.
    arguments : callable
        Snakemake's other arguments, given an empty folder for what they need.
    """

    target: str
    as_one_job: str
    arguments: Callable[[Path], list[str]]


def make_machine(folder: Path) -> list[str]:
    """Write a small machine of five sessions, worn at the last; arguments that name it."""
    days = [{"temperature": x} for x in (28.0, 42.0, 35.0)] + [{"temperature": 40.0}, {"wear": 0.2}]
    return ["--config", f"dataset={write_machine(folder / 'machine', days, 3)}"]


WORKS = {
    "quick": Work("all", "in_one_job", lambda _: ["--configfile", "config/quick.yaml"]),
    "track": Work("track", "track_in_one_job", make_machine),
    "board": Work(
        "attribution_board",
        "attribution_board_in_one_job",
        lambda _: ["--config", "attribution_board={cases: 2}"],
    ),
}


def build_command(way: str, work: Work, cores: int) -> list[str]:
    """Command of one way to run a work, but for the work's own arguments."""
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


def run(tree: Path, command: list[str], environment: dict[str, str]) -> Run:
    """Run a command in a copy of the tree."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    wall, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode:
        sys.exit(f"{' '.join(command)} failed:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    logs = [log.read_text() for log in tree.glob("results/*/logs/*in_one_job.log")]
    processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return Run(wall, read_elapsed("".join(logs) or done.stderr), processor)


def read_elapsed(told: str) -> float:
    """How long Snakemake took [s], as it says at its end."""
    hours, minutes, seconds = re.findall(r"Elapsed time: (\d+):(\d+):([\d.]+)", told)[-1]
    return 3600 * int(hours) + 60 * int(minutes) + float(seconds)


def read_results(tree: Path) -> dict[str, bytes]:
    """Content by name of the results, but for what tells of the run itself."""
    results = tree / "results"
    files = {file.relative_to(results).as_posix(): file for file in results.rglob("*") if file.is_file()}
    return {name: file.read_bytes() for name, file in files.items() if not OF_THE_RUN.search(name)}


def compare(name: str, ways: list[str], cores: int, environment: dict[str, str]) -> None:
    """Run one work locally and by each way, and print a row of the table for each."""
    work = WORKS[name]
    with tempfile.TemporaryDirectory() as temporary:
        arguments = work.arguments(Path(temporary))
        for way in ["local", *ways]:
            tree = copy_tree(Path(temporary) / way)
            one = run(tree, [*build_command(way, work, cores), *arguments], environment)
            found = read_results(tree)
            if way == "local":
                local, wanted = one, found
                told = f"{len(wanted)} | {one.processor:.0f} s of processor"
                print(
                    f"| {name} | {way} | {one.wall:.0f} | | | {os.getloadavg()[0]:.1f} | {told} |", flush=True
                )
                continue
            differ = sorted(key for key in wanted.keys() | found.keys() if wanted.get(key) != found.get(key))
            told = f"{len(differ)} differ, e.g. {differ[0]}" if differ else "the same bytes"
            over, added = one.wall - local.wall, (one.wall - one.within) - (local.wall - local.within)
            print(
                f"| {name} | {way} | {one.wall:.0f} | {over / local.wall:+.0%} | {added:.1f} "
                f"({added / local.wall:.0%}) | {os.getloadavg()[0]:.1f} | {len(found)} | {told} |",
                flush=True,
            )


def main() -> None:
    """Print a row a work, repeat and way."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("works", nargs="*", metavar="WORK", help=f"of {', '.join(WORKS)}; all unless given")
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--ways", nargs="+", default=["srun", "one job"], choices=["srun", "one job"])
    given = parser.parse_args()
    if unknown := set(given.works) - set(WORKS):
        parser.error(f"no such work: {', '.join(sorted(unknown))}")
    print("| work | way | wall [s] | over local | added [s] | load | files | |\n|" + 8 * "---|")
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            start_slurm(Path(folder) / "slurm", given.cores) as environment,
        ):
            for name in given.works or WORKS:
                for _ in range(given.repeats):
                    compare(name, given.ways, given.cores, environment)
    except NoSlurm as reason:
        sys.exit(str(reason))


if __name__ == "__main__":
    main()
