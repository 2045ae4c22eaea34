"""A part of the full attribution board, tracer only: `docs/attribution-board.md` quotes such parts.

python benchmarks/attribution_board_part.py {outside,nulls,planted,missed} --seed 59 --out DIR [--count 120]
    [--board DIR]

`outside`: effects outside the vocabulary; `planted`: effects of the vocabulary, shuffled by the seed;
`missed`: what the finished board in --board, of the same seed, did not answer right.
"""

import argparse
import random
from pathlib import Path

import pandas as pd

from wearscope.attribution_board.board import run_board
from wearscope.attribution_board.cases import Case, list_cases
from wearscope.attribution_board.outside import OUTSIDE


def choose_cases(part: str, seed: int, count: int | None, board: Path | None) -> list[Case]:
    """Cases of a part of the full board, the first `count` of them."""
    cases = list_cases("full", seed)
    if part == "nulls":
        chosen = [c for c in cases if not c.planted]
    elif part == "missed":
        rows = pd.read_parquet(board / "board.parquet").query("method == 'tracer'")
        right = (rows.outcome == "right") | ((rows.outcome == "unknown") & rows.outside.astype(bool))
        missed = set(rows.dataset[(rows.kind != "null") & ~right])
        chosen = [c for c in cases if c.name in missed]
    else:
        chosen = [c for c in cases if c.planted and (c.planted[0].effect in OUTSIDE) == (part == "outside")]
        if part == "planted":
            random.Random(seed).shuffle(chosen)
    return chosen[:count]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("part", choices=("outside", "nulls", "planted", "missed"))
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--count", type=int)
    parser.add_argument("--board", type=Path)
    options = parser.parse_args()
    if options.part == "missed" and options.board is None:
        parser.error("missed: name the folder of a finished board with --board.")
    chosen = choose_cases(options.part, options.seed, options.count, options.board)
    run_board("full", options.out, jobs=2, seed=options.seed, baselines=False, cases=chosen, progress=print)
    print((options.out / "board.md").read_text(encoding="utf-8"))
