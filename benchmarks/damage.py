"""How many flipped bits of a Parquet file are refused, and how many are read as other values.

    python benchmarks/damage.py FILE [FLIPS]

Prints a row of a Markdown table: flips, refused, the same values, other values; first as Arrow reads the file
without being asked to check anything, then as wearscope reads it.
"""

import random
import sys
from collections import Counter
from pathlib import Path

import pandas as pd
import pyarrow.parquet as pq

from wearscope import tables
from wearscope.compare import compare_tables


def judge(read, content: bytes, wanted: pd.DataFrame, bit: int) -> str:
    """What becomes of a flipped bit."""
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << (bit % 8)
    try:
        found = read(bytes(changed))
    except Exception:
        return "refused"
    return "other values" if compare_tables(wanted, found) else "the same values"


def main() -> None:
    """Flip, read, count."""
    path, flips = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 300
    content = path.read_bytes()
    wanted = tables.read_table(path)
    draw = random.Random(0)
    bits = [draw.randrange(8 * len(content)) for _ in range(flips)]
    readers = {
        "Arrow, nothing checked": lambda one: pq.read_table(tables.pa.BufferReader(one)).to_pandas(),
        "wearscope": lambda one: tables.read_arrow(one, name=path.name).to_pandas(),
    }
    for name, read in readers.items():
        counts = Counter(judge(read, content, wanted, bit) for bit in bits)
        numbers = " | ".join(str(counts[key]) for key in ("refused", "the same values", "other values"))
        print(f"| {path.name} ({len(content)} bytes) | {name} | {flips} | {numbers} |")


if __name__ == "__main__":
    main()
