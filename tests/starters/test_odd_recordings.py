"""Recordings of every number type, shape and clock: read as what they hold, or refused in a sentence."""

import gzip
import io
import json
import random

import numpy as np
import pandas as pd
import pytest
from hostile.bags import write_bag
from hostile.recordings import ARRAYS, CELLS, CLOCKS, SHAPES, pack
from hostile.samples import URDF, make_table

from wearscope.errors import InputError
from wearscope.starters.conversion import convert_recordings
from wearscope.starters.held import find_hold
from wearscope.starters.mapped import Mapped
from wearscope.starters.recordings import read_recording
from wearscope.starters.stamps import find_rate, order_rows, to_seconds
from wearscope.starters.states import spread_states

NUMBERS = [kind for kind in ARRAYS if kind.lstrip("<>")[:1] in "fgiu" and len(kind) < 4]


@pytest.fixture(scope="module")
def table():
    return make_table(0)[["t", "q_j1", "q_j2", "tau_j1", "tau_j2"]]


def read(path, content):
    """The table of a file, or None where it is refused in a sentence."""
    path.write_bytes(content)
    try:
        frame = spread_states(read_recording(path)[0])
    except InputError as error:
        assert str(path) in str(error)
        return None
    assert all(isinstance(name, str) and name.isprintable() for name in frame)
    return frame


@pytest.mark.parametrize("kind", NUMBERS)
def test_numbers_of_any_type_are_read(table, tmp_path, kind):
    columns = {name: (100.0 * table[name].to_numpy()).astype(kind) for name in table}
    frame = read(tmp_path / "a.npz", pack(columns))
    for name, x in columns.items():
        np.testing.assert_array_equal(frame[name].to_numpy(), x.astype("f8" if x.dtype.kind == "f" else "i8"))
        assert frame[name].dtype.isnative and frame[name].dtype.itemsize <= 8


def test_arrays_of_any_kind_are_read_or_refused(table, tmp_path):
    refused = set()
    for kind, change in ARRAYS.items():
        columns = {name: table[name].to_numpy() for name in table}
        columns["q_j1"] = change(columns["q_j1"], random.Random(kind))
        if read(tmp_path / "a.npz", pack(columns)) is None:
            refused.add(kind)
    assert {"c8", "c16", "V8", "structured", "empty", "longer", "objects"} <= refused
    assert not refused & {*NUMBERS, "NaN", "a column", "Fortran"}
    rows = {name: table[name].to_numpy()[None] for name in table}  # a column for each sample
    assert read(tmp_path / "c.npz", pack(rows)) is None
    out = io.BytesIO()
    np.save(out, table.to_numpy())
    assert read(tmp_path / "b.npz", out.getvalue()) is None


def test_json_of_any_shape_is_read_or_refused(table, tmp_path):
    table = table[:100]
    alike = {shape for shape, make in SHAPES.items() if (frame := read(
        tmp_path / "a.json", json.dumps(make(table)).encode())) is not None and "q_j2" in frame
        and len(frame) == len(table)
        and np.allclose(pd.to_numeric(frame["q_j2"], errors="coerce"), table["q_j2"])}  # fmt: skip
    assert {"records", "columns", "lists", "an odd name"} <= alike
    assert not alike & {"values", "ragged lists", "nested", "deep"}


def test_signs_as_in_print_drop_no_row(table, tmp_path):
    """Also where they stand in the first rows alone, by which the header is found."""
    text = (-table).assign(t=table["t"]).to_csv(index=False)
    whole = read(tmp_path / "a.csv", text.encode())
    for kind in ("minus of print", "minus of print above"):
        frame = read(tmp_path / "b.csv", CELLS[kind](text).encode())
        pd.testing.assert_frame_equal(frame, whole)
    for kind, change in CELLS.items():
        read(tmp_path / "c.csv", change(text).encode())
        assert kind


def test_clocks_of_any_kind_give_seconds_or_a_sentence(table):
    for kind, change in CLOCKS.items():
        stamps = pd.Series(change(table["t"].to_numpy(), random.Random(kind)))
        try:
            t, _ = to_seconds(stamps, "a.csv: column 't'")
            rows, kept, _ = order_rows(t, "a.csv: column 't'")
        except InputError:
            continue
        assert len(rows) == len(kept) and (np.diff(kept) > 0.0).all(), kind
        assert 5.0 <= find_rate(kept) <= 20_000.0, kind


def test_times_that_are_all_missing_are_told(refuses):
    refuses(order_rows, np.full(100, np.nan), "a.csv")


def test_names_are_bounded_and_plain(table, tmp_path):
    odd = table.rename(columns={"tau_j2": "a\nb: [c]", "q_j2": "\x1b[2J"})
    frame = read(tmp_path / "a.json", odd.to_json(orient="records").encode())
    assert {r"a\nb: [c]", r"\x1b[2J"} <= set(frame)
    assert read(tmp_path / "a.json", table.rename(columns={"t": "x" * 301}).to_json().encode()) is None
    assert read(tmp_path / "a.json", b'[{"\\ud800": 1.0, "t": 2.0}, {"\\ud800": 1.0, "t": 3.0}]') is not None


def to_bytes(frame, way):
    """A table written in some way."""
    out = io.BytesIO()
    way(frame, out)
    return out.getvalue()


ODD = {
    "lines of several kinds.jsonl": b'{"t": 0}\n[1, 2]\n"x"\n' * 50,
    "bytes.parquet": lambda frame: to_bytes(
        frame.assign(q_j1=[b"\xff"] * len(frame)), pd.DataFrame.to_parquet
    ),
    "no table.json": b"3",
    "deep.json": b"[" * 100_000,
    "long number.json": b'[{"t": ' + b"9" * 5000 + b"}]",
    "ends early.csv.gz": lambda frame: gzip.compress(frame.to_csv(index=False).encode())[:-20],
    "ends of lines.csv": b"\n" * 100_000,
    "no rows.csv": b"t,q_j1\n",
    "structs.parquet": lambda frame: to_bytes(
        frame.assign(q_j1=[{"a": 1}] * len(frame)), pd.DataFrame.to_parquet
    ),
    "a dictionary of text.parquet": lambda frame: to_bytes(
        frame.assign(q_j1=pd.Categorical(["x"] * len(frame))), pd.DataFrame.to_parquet
    ),
    "leap second.csv": lambda frame: frame.assign(t="2016-12-31 23:59:60").to_csv(index=False).encode(),
}


@pytest.mark.parametrize("name", ODD)
def test_odd_files_are_refused_in_a_sentence(table, tmp_path, name):
    path, content = tmp_path / name, ODD[name]
    path.write_bytes(content if isinstance(content, bytes) else content(table))
    (tmp_path / "duo.urdf").write_text(URDF)
    with pytest.raises(InputError) as caught:
        convert_recordings([path], tmp_path / "duo.urdf", Mapped(joints=["j1", "j2"]))
    assert "\n" not in str(caught.value)


def test_values_of_a_dictionary_are_read_as_they_are(table, tmp_path):
    frame = table.assign(q_j1=[1.5, None, 2.5, 1.5] * (len(table) // 4))
    packed = frame.assign(q_j1=frame.q_j1.astype("category"))
    pd.testing.assert_frame_equal(
        read(tmp_path / "a.parquet", to_bytes(packed, pd.DataFrame.to_parquet)), frame
    )


def test_a_bag_that_names_a_joint_twice_is_refused(tmp_path, refuses):
    """One of both positions would be taken for the joint's."""
    write_bag(tmp_path / "bag", "a name twice")
    refuses(read_recording, tmp_path / "bag")


def test_values_that_are_infinite_are_held_by_nothing():
    assert find_hold(np.full(500, -np.inf)) == 1
