# ruff: noqa: E501
"""Spoiled tables: CSV and Parquet."""

import io
import random

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from hostile.trees import put, spoil_bytes


def spoil_csv(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    if draw.random() < 0.3:
        return spoil_bytes(content, draw)
    lines = content.decode().splitlines()
    cells = [line.split(",") for line in lines]
    row, column = draw.randrange(len(cells)), draw.randrange(len(cells[0]))
    odd = draw.choice(["", "nan", "inf", "-inf", "1e308", "1e400", "x", "2024-01-01", "True", "0x10", "1_0", '"a\nb"',
                       "\x1b[2J", "=cmd|' /C calc'!A0", "9" * 500, "-", "1.2.3", "1,5", "'", '"', "\u202e1", "\u0661", "#"])  # fmt: skip

    jump = draw.choice([30.0, 7e4, 1.7e9, 1e12, 1e15])

    def whole(change):
        for one in cells[1:]:
            one[column] = change(one[column])

    def order():
        rows = cells[1:]
        draw.shuffle(rows)
        cells[1:] = rows

    ways = {
        "a cell": lambda: put(cells, (row, column), odd),
        "a header": lambda: put(cells, (0, column), draw.choice(["t", "q_j1", "", "a\x1b[2J", "é", "T", "q_j1 [deg]", odd])),
        "a column of one": lambda: whole(lambda one: odd),
        "a column of zeros": lambda: whole(lambda one: "0"),
        "a large column": lambda: whole(lambda one: one + draw.choice(["e29", "e200", "e9"])),
        "a column less": lambda: [one.pop(column) for one in cells],
        "a column more": lambda: [one.append("1") for one in cells[1:]],
        "a ragged row": lambda: cells[row].append("1"),
        "a short row": lambda: cells[row].pop(),
        "shuffled": order,
        "time jumps": lambda: [put(one, (0,), str(float(one[0]) + jump)) for one in cells[max(row, 1):]],
        "time jumps once": lambda: put(cells, (max(row, 1), 0), str(jump)),
        "time back": lambda: put(cells, (row, 0), "-5" if row else "t"),
        "time stands": lambda: [put(one, (0,), "1") for one in cells[1:]],
        "time in years": lambda: [put(one, (0,), str(float(one[0]) * 1e9)) for one in cells[1:]],
        "rows twice": lambda: cells.extend(cells[1:]),
        "no rows": lambda: cells.__delitem__(slice(1, None)),
        "few rows": lambda: cells.__delitem__(slice(1 + draw.randrange(5), None)),
        "many columns": lambda: [one.extend(["1"] * 2500) for one in cells],
        "no header": lambda: cells.pop(0),
        "open quote": lambda: put(cells, (row, column), '"1'),
        "comments": lambda: cells.insert(row, ["# a"]),
        "a blank row": lambda: cells.insert(row, [""]),
        "one column": lambda: [one.__delitem__(slice(1, None)) for one in cells],
    }  # fmt: skip
    what = draw.choice([*ways, "a cell", "a cell"])
    ways[what]()
    separator = draw.choice([",", ",", ",", ";", "\t", "|", " ", ", "])
    return "\n".join(map(separator.join, cells)).encode(
        "utf-8", "surrogatepass"
    ), f"{what} ({separator!r}, {odd[:20]!r})"


def spoil_parquet(content: bytes, draw: random.Random) -> tuple[bytes, str]:
    if draw.random() < 0.35:
        return spoil_bytes(content, draw)
    table = pq.read_table(io.BytesIO(content))
    name = draw.choice(table.column_names)
    k, n = table.column_names.index(name), len(table)
    kinds = {
        "text": pa.array(["x"] * n),
        "numbers as text": pa.array(["1.5"] * n),
        "lists": pa.array([[1.0]] * n),
        "structs": pa.array([{"a": 1}] * n),
        "nothing": pa.nulls(n),
        "truths": pa.array([True] * n),
        "bytes": pa.array([b"\xff"] * n),
        "dates": pa.array([2**60] * n, pa.timestamp("ns")),
        "dates of a zone": pa.array([1] * n, pa.timestamp("ns", tz="Mars/Base")),
        "decimals": pa.array([1] * n, pa.decimal128(30, 2)),
        "a dictionary": pa.array(["x"] * n).dictionary_encode(),
        "huge": pa.array([1e308] * n),
        "NaN": pa.array([float("nan")] * n),
        "large whole numbers": pa.array([2**63 - 1] * n),
        "a hole": pa.array([None if i == 5 else 1.0 for i in range(n)]),
        "times": pa.array([1] * n, pa.time64("us")),
        "half": pa.array(np.ones(n, dtype=np.float16)),
        "whole numbers beyond": pa.array([2**64 - 1] * n, pa.uint64()),
        "durations": pa.array([1] * n, pa.duration("ns")),
        "wide decimals": pa.array([1] * n, pa.decimal256(70, 2)),
        "maps": pa.array([[("a", 1.0)]] * n, pa.map_(pa.string(), pa.float64())),
        "lists of lists": pa.array([[[1.0]]] * n),
        "empty lists": pa.array([[]] * n, pa.list_(pa.float64())),
        "lists of a size": pa.array([[1.0, 2.0]] * n, pa.list_(pa.float64(), 2)),
        "dates of far away": pa.array([2**62] * n, pa.timestamp("us")),
        "days": pa.array([1] * n, pa.date32()),
        "long text": pa.array(["x" * 3000] * n, pa.large_string()),
        "a dictionary of numbers": pa.array([1.5] * n).dictionary_encode(),
        "bytes of a size": pa.array([b"1234"] * n, pa.binary(4)),
    }
    odd = ["", "\x1b[2J", "a\nb", "\u202e", "__index_level_0__"]
    unit = pa.field(name, table.schema.field(name).type, metadata={b"unit": b"\x1b[2J\xff"})
    comments = table.replace_schema_metadata
    ways = {kind: lambda kind=kind: table.set_column(k, name, kinds[kind]) for kind in kinds} | {
        "no rows": lambda: table[:0],
        "gone": lambda: table.remove_column(k),
        "twice": lambda: table.append_column(name, table[name]),
        "odd names": lambda: table.rename_columns(
            [f"{draw.choice(odd)}{i}" for i in range(table.num_columns)]
        ),
        "bomb": lambda: pa.table({"t": np.zeros(5_000_000)}),
        "odd pandas": lambda: comments({b"pandas": b'{"index_columns": ["x"], "columns": [{}]}'}),
        "wide": lambda: pa.table({f"c{i}": [1.0] for i in range(4000)}),
        "nested names": lambda: table.append_column("a.b", table[name]),
        "odd units": lambda: table.set_column(k, unit, table[name]),
        "an odd schema": lambda: comments({b"ARROW:schema": b"AAAA", b"wearscope": b"{", b"\xff": b"\xfe"}),
        "no columns": lambda: table.select([]),
        "groups of a row": lambda: table,
        "a long comment": lambda: comments({b"a": b"x" * 30_000_000}),
    }
    what, out = draw.choice([*ways]), io.BytesIO()
    spoiled = ways[what]()
    with pq.ParquetWriter(out, spoiled.schema) as writer:
        for _ in range(60 if what == "bomb" else 1):
            writer.write_table(spoiled, row_group_size=1 if what == "groups of a row" else None)
    return out.getvalue(), f"{what} at {name}"
