"""A damaged file is refused, never read as other values."""

import fcntl
import os
import random
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest

from wearscope.errors import InputError
from wearscope.simulation.recording import Recording, read_fingerprint, read_recording, write_recording
from wearscope.storage import files, tables
from wearscope.storage.files import check_file, record_checksums


def flip(content: bytes, bit: int) -> bytes:
    changed = bytearray(content)
    changed[bit // 8] ^= 1 << (bit % 8)
    return bytes(changed)


def sample_bits(content: bytes, count: int, seed: int = 0) -> list[int]:
    """Bits anywhere, and as many in the last kilobyte, where the footer is."""
    draw = random.Random(seed)
    end = 8 * len(content)
    return [draw.randrange(end) for _ in range(count)] + [
        draw.randrange(max(end - 8192, 0), end) for _ in range(count)
    ]


@pytest.fixture
def table(tmp_path):
    rng = np.random.default_rng(0)
    frame = pd.DataFrame({"fda": ["A", "B"] * 200, "point": np.arange(400), "y": rng.normal(size=400)})
    path = tmp_path / "snr.parquet"
    tables.write_table(path, frame, {"y": "N m"})
    return path, frame


@pytest.fixture
def recording(tmp_path):
    rng = np.random.default_rng(1)
    one = Recording(np.arange(300) / 250, *(rng.normal(size=(300, 2)) for _ in range(3)))
    path = tmp_path / "recording.parquet"
    write_recording(path, one, ["j1", "j2"], fingerprint="a" * 64)
    return path


def test_no_flipped_bit_of_a_table_passes_its_kept_checksum_or_is_read_as_other_values(table, tmp_path):
    """The list finds every bit; the page checksums alone, every value."""
    path, frame = table
    content = path.read_bytes()
    record_checksums(tmp_path, [path])
    check_file(tmp_path, path)
    for bit in sample_bits(content, 200):
        path.write_bytes(flip(content, bit))
        with pytest.raises(tables.DamagedFile, match=r"^\S*snr\.parquet: .*; delete it and make it again\.$"):
            check_file(tmp_path, path)
        try:
            found = tables.read_table(path)
        except tables.DamagedFile as error:
            assert str(error).endswith("; delete it and make it again.")
        else:
            if "y" in found:  # a changed footer may rename a column
                assert np.array_equal(found["y"], frame["y"])


def test_no_flipped_bit_of_a_recording_is_read_as_other_values(recording):
    content, wanted = recording.read_bytes(), read_recording(recording, ["j1", "j2"])
    assert read_fingerprint(recording) == "a" * 64
    refused, bits = 0, sample_bits(content, 150)
    for bit in bits:
        recording.write_bytes(flip(content, bit))
        try:
            found = read_recording(recording, ["j1", "j2"], "a" * 64)
        except InputError as error:
            assert re.search(r"recording\.parquet: .*again\.$", str(error))
            refused += 1
        else:
            assert all(np.array_equal(getattr(found, key), getattr(wanted, key)) for key in vars(wanted))
    assert refused > len(bits) / 2


def test_truncated_file_is_refused(table):
    path, _ = table
    content = path.read_bytes()
    for size in (0, 3, 11, 12, 100, len(content) - 1):
        path.write_bytes(content[:size])
        with pytest.raises(tables.DamagedFile, match="not a whole Parquet file"):
            tables.read_table(path)
    path.unlink()
    with pytest.raises(tables.DamagedFile, match="no such file; run the stage that makes it"):
        tables.read_table(path)


def test_recording_of_another_point_is_refused(recording):
    read_recording(recording, fingerprint="a" * 64)
    with pytest.raises(tables.DamagedFile, match="is the recording of another point"):
        read_recording(recording, fingerprint="b" * 64)


def test_killed_writer_s_file_is_cleared_by_the_next_write_and_nothing_else(tmp_path):
    writer = (
        "import os, signal, sys; from wearscope.storage.tables import write_whole\n"
        "write_whole(sys.argv[1], lambda name: os.kill(os.getpid(), signal.SIGKILL))"
    )
    target = tmp_path / "r2.parquet"
    subprocess.run([sys.executable, "-c", writer, str(target)], check=False)
    (left,) = tmp_path.iterdir()
    assert files.OWN.fullmatch(left.name)
    others = [tmp_path / name for name in (".r2.parquet.part", ".r2.parquet.abcdefgh", "mine.part", ".git")]
    for other in others:
        other.write_text("mine")
    alive = tmp_path / ".r3.parquet.abcdefgh.part"
    alive.write_text("being written")
    with open(alive) as handle:
        fcntl.flock(handle, fcntl.LOCK_EX)
        tables.write_text(target, "new")
    assert not left.exists() and target.read_text() == "new"
    assert alive.exists() and all(other.exists() for other in others)
    tables.write_text(target, "newer")
    assert not alive.exists()


def test_a_link_or_pipe_of_that_name_is_not_followed(tmp_path):
    precious = tmp_path / "precious"
    precious.write_text("mine")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / ".a.abcdefgh.part").symlink_to(precious)
    os.mkfifo(tmp_path / "out" / ".b.abcdefgh.part")
    tables.write_text(tmp_path / "out" / "a", "text")
    assert precious.read_text() == "mine"


def test_failed_write_leaves_the_old_file_and_nothing_else(tmp_path):
    tables.write_text(tmp_path / "a.json", "old")

    def fail(name):
        raise RuntimeError("no")

    with pytest.raises(RuntimeError):
        tables.write_whole(tmp_path / "a.json", fail)
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]
    assert (tmp_path / "a.json").read_text() == "old"
