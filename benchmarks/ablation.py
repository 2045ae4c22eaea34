"""What each number and each move of the search is worth: changed or left out, on the board's cases.

    python -m benchmarks.ablation --out DIR [--cases 60] [--seed 7] [--only NAME ...] [--jobs 1]

Of 200 cases those with the fewest samples are diagnosed, first as they are, then with each number halved and
doubled, and without each move. Printed: for each, how many cases are exact, how many are won and lost, and
McNemar's p-value.
"""

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any
from unittest.mock import patch

from benchmarks.board.regimes import list_cases
from benchmarks.command import write_row
from benchmarks.paired import compare
from benchmarks.runner import make_parser, run_cases
from wearscope.closed_loop.inference.moves import Moves
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.run import close_loop
from wearscope.storage.tables import read_table

NUMBERS = ("form_error", "most_rows", "name_odds", "unknown_odds", "structure_share")
"""Of the policy: those of the score."""
MOVES: dict[str, Callable[..., Any]] = {
    "drop": lambda self, model, *_: None, "swap": lambda self, model: None,
    "add_pair": lambda self, model: None, "split": lambda self, model: None,
    "refuse_delays": lambda self, model: None, "suit_laws": lambda self, model: model,
    "explain_rest": lambda self, model: model,
}  # fmt: skip


def list_variants() -> Iterator[tuple[str, Policy, str]]:
    """Name, policy and left-out move of each variant, what is first."""
    yield "as it is", Policy(), ""
    for name in NUMBERS:
        today = getattr(Policy(), name)
        for word, factor in (("halved", 0.5), ("doubled", 2.0)):
            yield f"{name} {word}", Policy(**{name: today * factor}), ""
    for move in MOVES:
        yield f"without {move}", Policy(), move


def close_with(policy: Policy, move: str, dataset: Path, out_dir: Path) -> Any:
    """Close the loop with other numbers, or without a move."""
    if not move:
        return close_loop(dataset, out_dir, light=True, policy=policy)
    with patch.object(Moves, move, MOVES[move]):
        return close_loop(dataset, out_dir, light=True, policy=policy)


def main(arguments=None):
    """Command line."""
    parser = make_parser(__doc__)
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--only", nargs="*", help="variants")
    given = parser.parse_args(arguments)
    cases = sorted(list_cases("development", 200, given.seed), key=lambda case: case.samples)[: given.cases]
    for name, policy, move in list_variants():
        if given.only and name not in ("as it is", *given.only):
            continue
        out = given.out / name.replace(" ", "_")
        run_cases(cases, out, given.jobs, closer=partial(close_with, policy, move), tell=lambda _: None)
        today = read_table(given.out / "as_it_is" / "cases.parquet")
        (row,) = (
            r for r in compare(today, read_table(out / "cases.parquet")).itertuples() if r.score == "exact"
        )
        won, lost = len(row.won.split()), len(row.lost.split())
        print(write_row(name, f"{row.after} of {row.cases}", won, lost, f"{row.p:.3g}"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
