# ruff: noqa: E501
"""Recordings of every kind of file, of odd types, shapes and clocks: one table of what is done to them."""

import io
import json
import random
import zipfile
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
    "wraps as 16 bits of ms": lambda t, draw: np.round(t * 1e3 + 60_000) % 65_536,
    "wraps as 32 bits of us": lambda t, draw: (np.round(t * 1e6) + 4_290_000_000) % 2**32,
    "near the end of 64 bits": lambda t, draw: np.int64(2**63 - 1 - 10**10) + (t * 1e9).astype("i8"),
    "two rows a stamp": lambda t, draw: np.repeat(t[::2], 2)[: len(t)],
    "two clocks": lambda t, draw: np.where(np.arange(len(t)) % 2, t, t + 0.5),
    "an hour back": lambda t, draw: (np.datetime64("2024-10-27T02:59:55") + (t * 1e6).astype("m8[us]") - (t > 5) * np.timedelta64(3600, "s")),
    "a leap second": lambda t, draw: np.array([f"2016-12-31T23:59:{55 + one:06.3f}" for one in t]),
    "two forms": lambda t, draw: np.array([str(one) if k < 500 else f"2024-02-28T10:00:{one:06.3f}" for k, one in enumerate(t)]),
    "zones that change": lambda t, draw: np.array([f"2024-02-28T10:00:{one:06.3f}+0{k // 500}:00" for k, one in enumerate(t)]),
    "as h:mm:ss": lambda t, draw: np.array([f"0:00:{one:06.3f}" for one in t]),
    "days of a spreadsheet": lambda t, draw: 45_350.4 + t / 86_400.0,
    "with units": lambda t, draw: np.array([f"{one:.3f} s" for one in t]),
    "truths": lambda t, draw: t > 5.0,
    "drifts": lambda t, draw: t + 1e-3 * t**2,
    "of NaT": lambda t, draw: np.where(np.arange(len(t)) % 7 == 3, np.datetime64("NaT"), np.datetime64("2024-02-28T10:00:00") + (t * 1e6).astype("m8[us]")),
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
    "a hole in each row": lambda frame: [{**row, name: None} for row, name in zip(frame.to_dict("records"), len(frame) * ["q_j1", "q_j2"], strict=False)],
    "numbers as text": lambda frame: [{name: str(one) for name, one in row.items()} for row in frame.to_dict("records")],
    "numbers and text": lambda frame: [{**row, "q_j1": str(row["q_j1"]) if k % 2 else row["q_j1"]} for k, row in enumerate(frame.to_dict("records"))],
    "no end of numbers": lambda frame: [{**row, "q_j1": float("inf")} for row in frame.to_dict("records")],
    "a name that is none": lambda frame: [{"": row["q_j1"], " ": 1, "\0": 2, **row} for row in frame.to_dict("records")],
    "many columns": lambda frame: [{**row, **{f"k{k}": k for k in range(4000)}} for row in frame.head(3).to_dict("records")],
    "rows of rows": lambda frame: [[row] for row in frame.to_dict("records")],
    "units in rows": lambda frame: [{"t": "s", "q_j1": "rad", "q_j2": "rad", "tau_j1": "N m", "tau_j2": "N m"}, *frame.to_dict("records")],
}  # fmt: skip
#: JSON that no writer of JSON writes.
WRITTEN_JSON = {
    "keys twice": lambda text: text.replace('"q_j1":', '"q_j1": 7, "q_j1":'),
    "commas at ends": lambda text: text.replace("}", ",}"),
    "comments": lambda text: "// a\n" + text,
    "NaN": lambda text: text.replace('"q_j1": 0', '"q_j1": NaN, "a": -Infinity, "b": 0'),
    "a number of thousands of digits": lambda text: text.replace('"q_j1": 0', f'"q_j1": {"9" * 6000}', 1),
    "one after another": lambda text: text + text,
    "single quotes": lambda text: text.replace('"', "'"),
    "controls": lambda text: text.replace('"t"', '"t\x07"'),
    "blank lines": lambda text: text.replace("}, {", "},\n\n\n{"),
}
#: How the zip file around arrays is no plain one.
CONTAINERS: dict[str, Callable[[Columns], bytes]] = {
    "a header that is code": lambda columns: pack_header(
        b"{'descr': __import__('os').system('touch ran'), 'fortran_order': False, 'shape': (9,), }"
    ),
    "a deep header": lambda columns: pack_header(
        b"{'descr': " + b"(" * 4000 + b")" * 4000 + b", 'fortran_order': False, 'shape': (9,), }"
    ),
    "a shape without end": lambda columns: pack_header(
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776,), }"
    ),
    "a negative shape": lambda columns: pack_header(
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (-9,), }"
    ),
    "large items": lambda columns: pack_header(
        b"{'descr': '|V2147483647', 'fortran_order': False, 'shape': (9,), }"
    ),
    "a shape of text": lambda columns: pack_header(b"{'descr': '<f8', 'fortran_order': 'x', 'shape': 'x', }"),
    "a version of tomorrow": lambda columns: pack_header(b"", b"\x93NUMPY\x09\x00"),
    "zeros that grow": lambda columns: pack_zip({"t.npy": bytes(3_000_000_000 // 8)}, zipfile.ZIP_DEFLATED),
    "names twice": lambda columns: pack_zip({f"{name}.npy": one_array(columns["t"]) for name in "tT"}),
    "names that leave": lambda columns: pack_zip(
        {f"../{name}.npy": one_array(x) for name, x in columns.items()}
    ),
    "no arrays": lambda columns: pack_zip({"readme.txt": b"x"}),
    "nothing": lambda columns: pack_zip({}),
    "a comment": lambda columns: pack(columns) + b"\0" * 70_000,
    "something before": lambda columns: b"#!/bin/sh\n" + pack(columns),
    "encrypted": lambda columns: pack(columns).replace(
        b"PK\x01\x02\x14\x03\x14\x00\x00", b"PK\x01\x02\x14\x03\x14\x00\x01"
    ),
    "an unknown method": lambda columns: pack(columns).replace(
        b"PK\x03\x04\x14\x00\x00\x00\x00\x00", b"PK\x03\x04\x14\x00\x00\x00\x63\x00"
    ),
}
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
    "a line for a spreadsheet": lambda text: "sep=,\n" + text,
    "a row of units": lambda text: text.replace("\n", "\ns,rad,N m,rad,N m\n", 1),
    "a title and its date": lambda text: "Recorded by X,,,,\n2024-02-28,,,,\n" + text,
    "the header again": lambda text: "\n".join(text.split("\n")[:500] + text.split("\n")[:1] + text.split("\n")[500:]),
    "a header of two lines": lambda text: "time,position,torque,position,torque\n" + text,
    "a quoted line end in the header": lambda text: text.replace("q_j1", '"q_\nj1"', 1),
    "units in the header": lambda text: text.replace("q_j1", "q_j1 (rad)", 1).replace("tau_j1", "tau_j1/Nm", 1),
    "names twice": lambda text: text.replace("q_j2", "q_j1", 1),
    "empty names": lambda text: text.replace("q_j2", "", 1),
    "a long header": lambda text: text.replace("q_j2", "x" * 5000, 1),
    "separators at ends": lambda text: text.replace("\n", ",\n"),
    "commas of decimals": lambda text: text.replace(",", ";").replace(".", ","),
    "thousands": lambda text: text.replace(",1", ",\"1,000.5\"", 3),
    "signs of MATLAB": lambda text: "% " + text,
    "tabs and blanks": lambda text: text.replace(",", " \t "),
    "cells of code": lambda text: text.replace(",0.", ",=1+0.", 5),
    "a cut last line": lambda text: text[:-20],
    "lines of the log between": lambda text: text.replace("\n0.5", "\n[WARN] late\n0.5"),
    "other minus signs": lambda text: text.replace("-", "\u2013"),
    "degree signs": lambda text: text.replace(",0.", ",0.°", 3),
}  # fmt: skip
ENCODINGS = ("utf-8", "utf-16", "utf-16-le", "utf-32", "latin-1", "cp1252", "shift_jis", "utf-7", "gb18030",
             "utf-16-be", "utf-32-be", "utf-8-sig", "cp437", "mac_roman", "cp037", "koi8-r")  # fmt: skip
#: Names of files: what a shell, YAML, a page or a file system may make of them.
NAMES = ("a\nb: [c]", "\x1b[2J", "\udcff\udcfe", "é" * 60, "x" * 240, "-rf", "a b", "a'b\"c", "#x", "{t}", "~", "*", "..a",
         "\u202egpj", "con", "a%20b", "$(touch ran)", "`touch ran`", "a\\b", ";x", "<b>")  # fmt: skip


def one_array(x: np.ndarray) -> bytes:
    """An array as numpy writes it."""
    out = io.BytesIO()
    np.save(out, x)
    return out.getvalue()


def pack_zip(members: dict[str, bytes], method: int = zipfile.ZIP_STORED) -> bytes:
    """A zip file of some members."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", method) as file:
        for name, content in members.items():
            file.writestr(name, content)
    return out.getvalue()


def pack_header(header: bytes, magic: bytes = b"\x93NUMPY\x01\x00") -> bytes:
    """A zip file of one array with a given header."""
    header = header.ljust(118) + b"\n"
    return pack_zip({"t.npy": magic + len(header).to_bytes(2, "little") + header + bytes(72)})


def pack(columns: Columns) -> bytes:
    out = io.BytesIO()
    np.savez(out, **columns)
    return out.getvalue()


def write_odd_recording(folder: Path, draw: random.Random) -> tuple[str, str]:
    """Write a recording; its name, and what is odd about it."""
    table = make_table(0).drop(columns=["fan", "current_j1", "current_j2"])
    columns = {name: table[name].to_numpy() for name in table}
    ways = draw.choice(["npz", "npz", "clock", "clock", "clock", "json", "cells", "cells", "encoding", "name",
                        "npy", "container", "written"])  # fmt: skip
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
    elif ways == "container":
        what, name = draw.choice(list(CONTAINERS)), "a.npz"
        content = CONTAINERS[what](columns)
    elif ways == "written":
        what, name = draw.choice(list(WRITTEN_JSON)), draw.choice(["a.json", "a.jsonl"])
        lines = [json.dumps(row) for row in table.to_dict("records")]
        content = WRITTEN_JSON[what](
            f"[{', '.join(lines)}]" if name == "a.json" else "\n".join(lines)
        ).encode()
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
