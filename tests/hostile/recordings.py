# ruff: noqa: E501
"""Recordings of every kind of file, of odd types, shapes and clocks: one table of what is done to them."""

import io
import json
import random
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from hostile.samples import make_table

Columns = dict[str, np.ndarray]


def _of(kind: str) -> Callable[[np.ndarray, random.Random], np.ndarray]:
    return lambda x, draw: x.astype(kind)


#: What becomes of a column, or of all, of an ``.npz``.
ARRAYS: dict[str, Callable[[np.ndarray, random.Random], np.ndarray]] = {
    **{kind: _of(kind) for kind in ("<f2", ">f2", "<f4", ">f4", ">f8", "<f8", "g", "c8", "c16", ">i2", "<i8", ">u4", "i1", "?",
                                    "U9", "S9", "M8[ns]", ">M8[us]", "m8[ms]", "V8")},
    "structured": lambda x, draw: np.array([(one, 1) for one in x], dtype=[("a", "f8"), ("b", "i4")]),
    "empty": lambda x, draw: x[:0],
    "a number": lambda x, draw: np.float64(3.0),
    "a row": lambda x, draw: x[None],
    "a column": lambda x, draw: x[:, None],
    "many": lambda x, draw: np.tile(x[:, None], (1, draw.choice([0, 3, 3000]))),
    "three ways": lambda x, draw: x.reshape(10, 10, -1),
    "longer": lambda x, draw: np.append(x, 0.0),
    "NaN": lambda x, draw: np.where(np.arange(len(x)) % 7 == 3, np.nan, x),
    "objects": lambda x, draw: np.array([{"a": 1}] * len(x), dtype=object),
    "Fortran": lambda x, draw: np.asfortranarray(np.tile(x[:, None], (1, 2))),
    "masked by huge": lambda x, draw: np.where(np.arange(len(x)) == 5, 1e308, x),
}  # fmt: skip
#: What becomes of the time [s] of a recording: clocks as they are, and as none should be.
CLOCKS: dict[str, Callable[[np.ndarray, random.Random], np.ndarray]] = {
    "jumps ahead": lambda t, draw: t + np.where(np.arange(len(t)) >= draw.randrange(1, len(t)), draw.choice([30, 7e4, 1.7e9, 1e12, 1e15]), 0),
    "jumps back": lambda t, draw: t - np.where(np.arange(len(t)) >= draw.randrange(1, len(t)), draw.choice([1, 30, 7e4, 1.7e9]), 0),
    "jumps and comes back": lambda t, draw: t + np.where(np.arange(len(t)) % 300 == 7, draw.choice([1, 1e3, 1e12]), 0),
    "starts late": lambda t, draw: t + draw.choice([1e9, 1.7e9, 1e12, 1e15, -1e9]),
    "stamps of another origin first": lambda t, draw: np.where(np.arange(len(t)) < draw.choice([1, 3, 200]), t, t + 1.7e9),
    "zero first": lambda t, draw: np.where(np.arange(len(t)) < draw.choice([1, 5, 50]), 0.0, t + 1.7e9),
    "pauses": lambda t, draw: t + 3600.0 * (np.arange(len(t)) // draw.choice([60, 150, 400])),
    "huge": lambda t, draw: t * draw.choice([1e12, 1e30, 1e300]),
    "tiny": lambda t, draw: t * draw.choice([1e-12, 1e-30, 1e-300]),
    "in ms": lambda t, draw: t * 1e3,
    "in us as whole numbers": lambda t, draw: (t * 1e6).astype("i8"),
    "since 1970 in ns": lambda t, draw: (t * 1e9).astype("i8") + 1_700_000_000_000_000_000,
    "in days": lambda t, draw: t / 86400.0 + draw.choice([0, 45000.0]),
    "as dates": lambda t, draw: np.datetime64("2024-02-28T23:59:55") + (t * 1e6).astype("m8[us]"),
    "as times of a day": lambda t, draw: (np.datetime64("2024-02-28T23:59:55") + (t * 1e6).astype("m8[us]")).astype(str).astype("U23").view("U1").reshape(len(t), -1)[:, 11:].copy().view("U12")[:, 0],
    "stands": lambda t, draw: np.zeros_like(t),
    "coarse": lambda t, draw: np.floor(t * 10.0) / 10.0,
    "holes": lambda t, draw: np.where(np.arange(len(t)) % draw.choice([2, 9, 400]) == 1, np.nan, t),
    "all holes": lambda t, draw: np.full(len(t), np.nan),
    "infinite once": lambda t, draw: np.where(np.arange(len(t)) == draw.randrange(len(t)), np.inf, t),
    "counts rows": lambda t, draw: np.arange(len(t)),
    "falls": lambda t, draw: t[::-1].copy(),
    "random": lambda t, draw: np.random.default_rng(1).permutation(t),
    "jitters": lambda t, draw: t + 0.004 * np.random.default_rng(1).random(len(t)),
    "text": lambda t, draw: np.array(["x"] * len(t)),
}  # fmt: skip
#: How JSON may hold a table.
SHAPES: dict[str, Callable[[pd.DataFrame], object]] = {
    **{kind: (lambda frame, kind=kind: json.loads(frame.to_json(orient=kind))) for kind in ("values", "records", "split", "index",
                                                                                           "columns", "table")},
    "lists": lambda frame: {name: frame[name].tolist() for name in frame},
    "ragged lists": lambda frame: {name: frame[name].tolist()[k:] for k, name in enumerate(frame)},
    "in a key": lambda frame: {"data": frame.to_dict("records")},
    "nested": lambda frame: [{"t": row["t"], "joints": {"j1": {"q": row["q_j1"]}}} for row in frame.to_dict("records")],
    "lists in rows": lambda frame: [{"t": row["t"], "q": [row["q_j1"], row["q_j2"]], "tau": [row["tau_j1"], row["tau_j2"]]}
                                    for row in frame.to_dict("records")],
    "lists of other lengths": lambda frame: [{"t": row["t"], "q": [0.0] * (k % 4)} for k, row in enumerate(frame.to_dict("records"))],
    "other keys in each row": lambda frame: [{f"k{k}": k} for k in range(len(frame))],
    "a number": lambda frame: 3,
    "a text": lambda frame: "x",
    "null": lambda frame: None,
    "nothing": lambda frame: [],
    "no row": lambda frame: {},
    "truths": lambda frame: [True] * 100,
    "halves of a character": lambda frame: [{"\ud800": 1.0, **row} for row in frame.to_dict("records")],
    "halves in cells": lambda frame: [{**row, "note": "\udfff"} for row in frame.to_dict("records")],
    "large whole numbers": lambda frame: [{**row, "q_j1": 10**30} for row in frame.to_dict("records")],
    "an odd name": lambda frame: [{"a\nb: [c]": 1, "\x1b[2J": 2, **row} for row in frame.to_dict("records")],
    "deep": lambda frame: json.loads("[" * 90 + "]" * 90),
}  # fmt: skip
#: Signs and digits of text that people and spreadsheets write.
CELLS = {
    "minus of print": lambda text: text.replace("-", "\u2212"),
    "minus of print above": lambda text: "\n".join(line.replace("-", "\u2212") if k < 40 else line for k, line in enumerate(text.split("\n"))),
    "thin spaces": lambda text: text.replace(",", "\u2009,"),
    "other digits": lambda text: text.translate({48 + k: 0x660 + k for k in range(10)}),
    "no break spaces": lambda text: text.replace(",", "\xa0,\xa0"),
    "carriage returns": lambda text: text.replace("\n", "\r"),
    "line separators": lambda text: text.replace("\n", "\u2028"),
    "zeros": lambda text: text.replace("0.0,", "\0,"),
    "quotes": lambda text: "\n".join('"' + line.replace(",", '","') + '"' for line in text.split("\n")),
    "open quote": lambda text: text.replace(",", ',"', 1),
    "mark": lambda text: "\ufeff" + text,
    "two marks": lambda text: "\ufeff\ufeff" + text,
    "percent": lambda text: text.replace(",0.", ",0.%"),
    "exponents": lambda text: text.replace(",0.", ",1e9999"),
}  # fmt: skip
ENCODINGS = ("utf-8", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp1252", "shift_jis", "utf-7", "gb18030")
#: Names of files: what a shell, YAML, a page or a file system may make of them.
NAMES = ("a\nb: [c]", "\x1b[2J", "\udcff\udcfe", "é" * 60, "x" * 240, "-rf", "a b", "a'b\"c", "#x", "{t}", "~", "*", "..a",
         "\u202egpj", "con", "a%20b", "$(touch ran)", "`touch ran`", "a\\b", ";x", "<b>")  # fmt: skip


def pack(columns: Columns) -> bytes:
    out = io.BytesIO()
    np.savez(out, **columns)
    return out.getvalue()


def write_odd_recording(folder: Path, draw: random.Random) -> tuple[str, str]:
    """Write a recording; its name, and what is odd about it."""
    table = make_table(0).drop(columns=["fan", "current_j1", "current_j2"])
    columns = {name: table[name].to_numpy() for name in table}
    ways = draw.choice(["npz", "npz", "clock", "clock", "clock", "json", "cells", "encoding", "name", "npy"])
    name, what = f"a.{'csv' if ways in ('cells', 'encoding', 'name') else ways}", ""
    if ways == "npz":
        what = draw.choice(list(ARRAYS))
        for one in columns if draw.random() < 0.4 else [draw.choice(list(columns))]:
            columns[one] = ARRAYS[what](columns[one], draw)
        content = pack(columns)
    elif ways == "npy":
        out = io.BytesIO()
        np.save(out, table.to_numpy() if draw.random() < 0.5 else table.to_records(index=False))
        name, content = draw.choice(["a.npz", "a.npy", "a.csv", "a.parquet", "a.json"]), out.getvalue()
    elif ways == "clock":
        what = draw.choice(list(CLOCKS))
        columns["t"] = CLOCKS[what](columns["t"], draw)
        name = draw.choice(["a.csv", "a.parquet", "a.npz", "a.jsonl"])
        frame = pd.DataFrame(columns)
        content = {
            "a.csv": lambda: frame.to_csv(index=False).encode(), "a.parquet": frame.to_parquet,
            "a.npz": lambda: pack({k: np.asarray(x) for k, x in columns.items()}),
            "a.jsonl": lambda: frame.to_json(orient="records", lines=True, date_format="iso").encode(),
        }[name]()  # fmt: skip
    elif ways == "json":
        what = draw.choice(list(SHAPES))
        made = SHAPES[what](table)
        name = draw.choice(["a.json", "a.json", "a.jsonl"])
        if name == "a.jsonl":
            content = "\n".join(map(json.dumps, made if isinstance(made, list) else [made])).encode()
        else:
            content = json.dumps(made).encode()
    elif ways == "cells":
        what = draw.choice(list(CELLS))
        content = CELLS[what](table.to_csv(index=False)).encode()
    elif ways == "encoding":
        what = draw.choice(ENCODINGS)
        content = (
            table.rename(columns={"t": draw.choice(["t", "Zeit °", "t [µs]"])})
            .to_csv(index=False)
            .encode(what, "replace")
        )
    else:
        name = f"{draw.choice(NAMES)}.{draw.choice(['csv', 'CSV', 'npz'])}"
        content = pack(columns) if name.endswith("npz") else table.to_csv(index=False).encode()
    (folder / name).write_bytes(content)
    return name, f"{ways}: {what or name!a}"
