"""Recordings of a chunk packed into one file, and laid out again elsewhere."""

import io
import tarfile

import pytest

from wearscope.files import DamagedFile
from wearscope.simulation.carried import pack_recordings, unpack_recordings


def write_points(folder, contents):
    for point, content in contents.items():
        path = folder / f"point={point}" / "recording.parquet"
        path.parent.mkdir(parents=True)
        path.write_bytes(content)


def read_points(folder):
    return {path.parent.name: path.read_bytes() for path in folder.rglob("recording.parquet")}


def test_what_was_packed_is_laid_out_where_it_was(tmp_path):
    contents = {2: b"two", 10: b"ten" * 5000, 1: b""}
    write_points(tmp_path / "here", contents | {3: b"failed in an older run"})
    pack_recordings(tmp_path / "here/_chunk-0.tar", contents)
    (tmp_path / "there").mkdir()
    (tmp_path / "here/_chunk-0.tar").rename(tmp_path / "there/_chunk-0.tar")
    write_points(tmp_path / "there", {2: b"an older one"})
    unpack_recordings([tmp_path / "there/_chunk-0.tar"])
    assert read_points(tmp_path / "there") == {f"point={k}": content for k, content in contents.items()}


def test_bytes_depend_on_the_recordings_alone(tmp_path):
    files = [tmp_path / name / "_chunk-0.tar" for name in ("one", "other")]
    for file, order in zip(files, ([1, 2, 3], [3, 1, 2]), strict=True):
        write_points(file.parent, {point: bytes([point]) for point in order})
        pack_recordings(file, order)
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.parametrize("name", ["../point=1/recording.parquet", "/tmp/point=1/recording.parquet", "run.py"])
def test_nothing_but_recordings_is_laid_out(tmp_path, name):
    file = tmp_path / "set" / "_chunk-0.tar"
    file.parent.mkdir()
    with tarfile.open(file, "w") as tar:
        tar.addfile(tarfile.TarInfo(name), io.BytesIO())
    with pytest.raises(DamagedFile, match=r"_chunk-0.tar: not the recordings of a chunk .*delete it"):
        unpack_recordings([file])
    assert [path.name for path in tmp_path.rglob("*")] == ["set", "_chunk-0.tar"]


@pytest.mark.parametrize(
    "damage", [lambda file: file.write_bytes(file.read_bytes()[:700]), lambda file: file.unlink()]
)
def test_damaged_pack_is_named(tmp_path, damage):
    write_points(tmp_path, {1: b"one" * 1000})
    pack_recordings(tmp_path / "_chunk-0.tar", [1])
    damage(tmp_path / "_chunk-0.tar")
    with pytest.raises(DamagedFile, match=r"_chunk-0\.tar: not the recordings"):
        unpack_recordings([tmp_path / "_chunk-0.tar"])
