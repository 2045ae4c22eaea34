"""What SLURM adds to a run: a study here, and as one job of a SLURM of one node started for it.

    .venv/bin/python -m benchmarks.slurm                        the quick study, track
    .venv/bin/python -m benchmarks.slurm track --cores 2 --repeats 3

Needs what `make cluster` installs and Debian's SLURM (docs/cluster.md). Each run has a copy of the tree of
its own and begins with nothing; the bytes of the results are compared. The ways: `srun` starts Snakemake on
the node, as it would be started here; `one job` sends the target `in_one_job` through `profiles/srun`.

On a busy machine two runs of the same take different times. So each also says how long the Snakemake took
that does the work; what a run takes beyond it, more than the local run does, is `added`: the starts of what
stands around it, and seeing the end.
"""

import os
import sys
import tempfile
from pathlib import Path

from clones import copy_tree
from one_node_slurm import NoSlurm, start_slurm
from slurm_ways import WAYS, WORKS, build_command, read_results, run

from benchmarks.command import start_parser, write_heads, write_row


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
                beyond, told = ("", ""), f"{one.processor:.0f} s of processor"
            else:
                differ = sorted(
                    key for key in wanted.keys() | found.keys() if wanted.get(key) != found.get(key)
                )
                told = f"{len(differ)} differ, e.g. {differ[0]}" if differ else "the same bytes"
                over, added = one.wall - local.wall, one.added_to(local)
                beyond = f"{over / local.wall:+.0%}", f"{added:.1f} ({added / local.wall:.0%})"
            load = f"{os.getloadavg()[0]:.1f}"
            print(write_row(name, way, f"{one.wall:.0f}", *beyond, load, len(found), told), flush=True)


def main() -> None:
    """Print a row a work, repeat and way."""
    parser = start_parser(__doc__)
    parser.add_argument("works", nargs="*", metavar="WORK", help=f"of {', '.join(WORKS)}; all unless given")
    parser.add_argument("--cores", type=int, default=2)
    parser.add_argument("--repeats", type=int, default=1)
    parser.add_argument("--ways", nargs="+", default=WAYS, choices=WAYS)
    given = parser.parse_args()
    if unknown := set(given.works) - set(WORKS):
        parser.error(f"no such work: {', '.join(sorted(unknown))}")
    print(write_heads("work", "way", "wall [s]", "over local", "added [s]", "load", "files", ""))
    try:
        with (
            tempfile.TemporaryDirectory() as folder,
            start_slurm(Path(folder) / "slurm", given.cores) as environment,
        ):
            for name in given.works or ["quick", "track"]:
                for _ in range(given.repeats):
                    compare(name, given.ways, given.cores, environment)
    except NoSlurm as reason:
        sys.exit(str(reason))


if __name__ == "__main__":
    main()
