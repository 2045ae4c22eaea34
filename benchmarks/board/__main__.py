"""Close the loop on the attribution board's cases and score its verdicts.

python -m benchmarks.board [--part development] [--cases 200] [--seed 7] [--case K ...] --out DIR

The defaults are the frozen development cases: drawn once by their seed, and never changed one by one.
"""

import sys

from benchmarks.board.regimes import PARTS, list_cases
from benchmarks.runner import make_parser, run_parsed


def main(arguments=None):
    """Command line."""
    parser = make_parser(__doc__)
    parser.add_argument("--part", choices=PARTS, default="development")
    parser.add_argument("--cases", type=int, default=200, help="size of the Latin hypercube")
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--case", type=int, action="append", help="this case alone; may be repeated")
    given = parser.parse_args(arguments)
    cases = list_cases(given.part, given.cases, given.seed)
    return run_parsed([case for case in cases if not given.case or case.number in given.case], given)


if __name__ == "__main__":
    sys.exit(main())
