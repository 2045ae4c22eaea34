"""Recordings of a chunk packed into one file, and read there."""

import io
import tarfile

import numpy as np
import pytest

from wearscope.simulation.recording import (
    PackedRecordings,
    Recording,
    pack_recordings,
    point_path,
    read_recording,
    remove_recordings,
    write_recording,
)
from wearscope.storage.files import DamagedFile


@pytest.fixture
def recording():
    values = np.random.default_rng(0).normal(size=(3, 50, 2)).astype(np.float32).astype(float)
    return Recording(np.arange(50) / 100, *values)


def write_points(folder, contents):
    for point, content in contents.items():
        path = folder / f"point={point}" / "recording.parquet"
        path.parent.mkdir(parents=True)
        path.write_bytes(content)


def test_what_was_packed_is_read_by_its_set_and_point(tmp_path):
    contents = {2: b"two", 10: b"ten" * 5000, 1: b""}
    files = [
        tmp_path / "audit/_chunk-0.tar",
        tmp_path / "audit/_chunk-1.tar",
        tmp_path / "direct/_chunk-0.tar",
    ]
    for file, points in zip(files, ([1, 2], [10], [2]), strict=True):
        content = contents if file.parent.name == "audit" else {2: b"another set's"}
        write_points(file.parent, {point: content[point] for point in points})
        pack_recordings(file, points)
        remove_recordings(file.parent, points)
    assert sorted(path for path in tmp_path.rglob("*") if path.is_file()) == files
    packed = PackedRecordings(files)
    for point, file in ((1, files[0]), (2, files[0]), (10, files[1])):
        assert packed.read("audit", point) == (file, contents[point])
    assert packed.read("direct", 2) == (files[2], b"another set's")
    with pytest.raises(DamagedFile, match=r"direct/_chunk-0.tar: no recording of direct point 1;"):
        packed.read("direct", 1)
    assert packed.holds("audit") and not packed.holds("nominal") and not PackedRecordings([]).holds("audit")


def test_points_that_were_not_packed_stay(tmp_path):
    write_points(tmp_path / "direct", {1: b"one", 2: b"two"})
    remove_recordings(tmp_path / "direct", [2, 3])
    assert [path.name for path in (tmp_path / "direct").iterdir()] == ["point=1"]


def test_a_packed_recording_is_checked_as_any(tmp_path, recording):
    path = point_path(tmp_path, "audit", 7)
    write_recording(path, recording, ["j1", "j2"], fingerprint="a" * 64)
    file = path.parents[1] / "_chunk-0.tar"
    pack_recordings(file, [7])
    here, content = PackedRecordings([file]).read("audit", 7)
    assert np.array_equal(read_recording(here, ["j2", "j1"], "a" * 64, content).tau, recording.tau[:, ::-1])
    with pytest.raises(DamagedFile, match=r"_chunk-0.tar: is the recording of another point"):
        read_recording(here, ["j1", "j2"], "b" * 64, content)
    spoilt = bytearray(file.read_bytes())
    spoilt[512 + 100] ^= 1
    file.write_bytes(spoilt)
    with pytest.raises(DamagedFile) as error:
        read_recording(here, ["j1", "j2"], "a" * 64, PackedRecordings([file]).read("audit", 7)[1])
    assert error.value.path == file


def test_bytes_depend_on_the_recordings_alone(tmp_path):
    files = [tmp_path / name / "_chunk-0.tar" for name in ("one", "other")]
    for file, order in zip(files, ([1, 2, 3], [3, 1, 2]), strict=True):
        write_points(file.parent, {point: bytes([point]) for point in order})
        pack_recordings(file, order)
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("name", ["../point=1/recording.parquet", "/tmp/point=1/recording.parquet", "run.py"])
def test_nothing_but_recordings_is_read(tmp_path, name):
    file = tmp_path / "set" / "_chunk-0.tar"
    file.parent.mkdir()
    with tarfile.open(file, "w") as tar:
        tar.addfile(tarfile.TarInfo(name), io.BytesIO())
    with pytest.raises(DamagedFile, match=r"_chunk-0.tar: not the recordings of a chunk .*delete it"):
        PackedRecordings([file])
    assert [path.name for path in tmp_path.rglob("*")] == ["set", "_chunk-0.tar"]


@pytest.mark.parametrize(
    "damage", [lambda file: file.write_bytes(file.read_bytes()[:700]), lambda file: file.unlink()]
)
def test_damaged_pack_is_named(tmp_path, damage):
    write_points(tmp_path, {1: b"one" * 1000})
    pack_recordings(tmp_path / "_chunk-0.tar", [1])
    damage(tmp_path / "_chunk-0.tar")
    with pytest.raises(DamagedFile, match=r"_chunk-0\.tar: not the recordings"):
        PackedRecordings([tmp_path / "_chunk-0.tar"])
