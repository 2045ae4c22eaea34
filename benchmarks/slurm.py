"""What SLURM adds to a run: a study here, and as one job of a SLURM of one node started for it.

    .venv/bin/python benchmarks/slurm.py                        the quick study, track, the smallest board
    .venv/bin/python benchmarks/slurm.py track --cores 2 --repeats 3

Needs what `make cluster` installs and Debian's SLURM (docs/cluster.md). Each run has a copy of the tree of
its own and begins with nothing; the two ways take turns; the bytes of their results are compared. `within`
is the time of the Snakemake that does the work, inside the job: what there is beyond it is the start of the
job and seeing its end, however busy the machine is.
"""

import argparse
import os
import re
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
        Of the workflow; as one job it is called ``in_one_job`` or ``<target>_in_one_job``.
    arguments : callable
        Snakemake's other arguments, given an empty folder for what they need.
    """

    target: str
    arguments: Callable[[Path], list[str]]

    @property
    def as_one_job(self) -> str:
        """The rule that runs it as one job."""
        return "in_one_job" if self.target == "all" else f"{self.target}_in_one_job"


def make_machine(folder: Path) -> list[str]:
    """Write a small machine of five sessions, worn at the last; arguments that track it."""
    days = [{"temperature": x} for x in (28.0, 42.0, 35.0)] + [{"temperature": 40.0}, {"wear": 0.2}]
    return ["--config", f"dataset={write_machine(folder / 'machine', days, 3)}"]


WORKS = {
    "quick": Work("all", lambda _: ["--configfile", "config/quick.yaml"]),
    "track": Work("track", make_machine),
    "board": Work("attribution_board", lambda _: ["--config", "attribution_board={cases: 2}"]),
}


def run(tree: Path, arguments: list[str], environment: dict[str, str]) -> float:
    """Run Snakemake in a copy of the tree; seconds."""
    start = time.perf_counter()
    command = [sys.executable, "-m", "snakemake", *arguments]
    done = subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        sys.exit(f"{' '.join(arguments)} failed:\n{done.stdout[-2000:]}{done.stderr[-4000:]}")
    return time.perf_counter() - start


def read_results(tree: Path) -> dict[str, bytes]:
    """Content by name of the results, but for what tells of the run itself."""
    results = tree / "results"
    files = {file.relative_to(results).as_posix(): file for file in results.rglob("*") if file.is_file()}
    return {name: file.read_bytes() for name, file in files.items() if not OF_THE_RUN.search(name)}


def read_seconds_within(tree: Path) -> float:
    """How long the Snakemake inside the job took [s], as it says at its end."""
    (log,) = tree.glob("results/*/logs/*in_one_job.log")
    hours, minutes, seconds = re.findall(r"Elapsed time: (\d+):(\d+):([\d.]+)", log.read_text())[-1]
    return 3600 * int(hours) + 60 * int(minutes) + float(seconds)


def compare(name: str, cores: int, environment: dict[str, str], profile: str) -> None:
    """Run one work both ways, and print a row of the table."""
    work = WORKS[name]
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        arguments = work.arguments(folder)
        here, there = (copy_tree(folder / name) for name in ("here", "there"))
        local = run(here, [work.target, "--cores", str(cores), *arguments], {**os.environ})
        options = ["--profile", profile, "--set-threads", f"{work.as_one_job}={cores}"]
        slurm = run(there, [work.as_one_job, *options, *arguments], environment)
        within = read_seconds_within(there)
        one, other = read_results(here), read_results(there)
    differ = sorted(key for key in one.keys() | other.keys() if one.get(key) != other.get(key))
    told = f"{len(one)} the same" if not differ else f"{len(differ)} of {len(one)} differ: {differ[:5]}"
    added = slurm - within
    print(
        f"| {name} | {local:.0f} | {slurm:.0f} | {slurm / local - 1:+.0%} | {within:.0f} | {added:.1f} "
        f"| {added / within:.0%} | {os.getloadavg()[0]:.1f} | {told} |",
        flush=True,
    )


def main() -> None:
    """Print a row a work and repeat."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("works", nargs="*", metavar="WORK", help=f"of {', '.join(WORKS)}; all unless given")
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--profile", default="profiles/srun")
    given = parser.parse_args()
    if unknown := set(given.works) - set(WORKS):
        parser.error(f"no such work: {', '.join(sorted(unknown))}")
    print("| work | local [s] | SLURM [s] | overhead | within [s] | added [s] | of within | load | files |")
    print("|---|---|---|---|---|---|---|---|---|")
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            start_slurm(Path(folder) / "slurm", given.cores) as environment,
        ):
            for name in given.works or WORKS:
                for _ in range(given.repeats):
                    compare(name, given.cores, environment, given.profile)
    except NoSlurm as reason:
        sys.exit(str(reason))


if __name__ == "__main__":
    main()
