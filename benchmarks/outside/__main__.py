"""Close the loop on the cases of the second generator and score its answers.

python -m benchmarks.outside [NAME ...] [--drawn FIRST LAST] [--seed 0] --out DIR

Without names and `--drawn` all listed cases are run; `--drawn` adds those drawn at random, by number. Tables
and scores are those of `python -m benchmarks.board`.
"""

import dataclasses
import sys

from benchmarks.outside.cases import CASES
from benchmarks.outside.drawn import draw_case
from benchmarks.runner import make_parser, run_parsed


def main(arguments=None):
    """Command line."""
    parser = make_parser(__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a listed case")
    parser.add_argument("--drawn", nargs=2, type=int, metavar=("FIRST", "LAST"), help="drawn cases by number")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    if unknown := set(given.names) - set(CASES):
        parser.error(f"no such case: {', '.join(sorted(unknown))}; there are {', '.join(CASES)}")
    cases = [CASES[name] for name in given.names]
    if given.drawn:
        cases += [draw_case(number) for number in range(given.drawn[0], given.drawn[1] + 1)]
    cases = [dataclasses.replace(case, seed=given.seed) for case in cases or CASES.values()]
    return run_parsed(cases, given)


if __name__ == "__main__":
    sys.exit(main())
