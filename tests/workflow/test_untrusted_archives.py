"""Archives that were damaged, or made by someone who means no good."""

import errno
import gzip
import hashlib
import io
import json
import os
import random
import tarfile
from pathlib import Path

import pytest
from archive_making import make_manifest, pack, write

from wearscope.archive import packing
from wearscope.archive.__main__ import main
from wearscope.archive.packing import check_names, parse_manifest, walk_archive
from wearscope.errors import InputError


def test_altered_byte_is_found(tmp_path, refuses):
    path = pack(tmp_path, "a")
    content = path.read_bytes()
    path.write_bytes(content.replace(b"<p>report</p>", b"<p>rep0rt</p>"))
    refuses(walk_archive, path)
    path.write_bytes(content[: len(content) // 3])
    refuses(walk_archive, path)


def repack(path, change):
    """Write the archive's members again, as `change` (a function of name and bytes) returns them."""
    members = []
    with tarfile.open(path) as tar:
        for member in tar:
            members += change(member.name, tar.extractfile(member).read())
    write(path, *members)


def test_missing_and_foreign_members_are_found(tmp_path, refuses):
    path = pack(tmp_path, "a")
    repack(path, lambda name, content: [] if name == "report.html" else [(name, content)])
    refuses(walk_archive, path)
    path = pack(tmp_path, "b")
    repack(
        path,
        lambda name, content: [(name, content), ("../evil", b"")] if "html" in name else [(name, content)],
    )
    refuses(packing.unpack_archive, path, tmp_path / "out")
    assert not (tmp_path / "evil").exists() and not (tmp_path / "out").exists()


def test_no_archive_gets_one_sentence(tmp_path, capsys):
    assert main(["verify", str(tmp_path / "none.tar")]) == 1
    assert "no such file" in capsys.readouterr().err
    (tmp_path / "text.tar").write_text("no archive")
    assert main(["verify", str(tmp_path / "text.tar")]) == 1
    assert "is no whole tar archive" in capsys.readouterr().err


def test_every_flipped_bit_is_found(tmp_path):
    """In the manifest too; only padding that no one reads, and headers' times and owners, may go unseen."""
    path = pack(tmp_path, "a")
    content = path.read_bytes()
    wanted = walk_archive(path)
    with tarfile.open(path) as tar:
        spans = [(one.offset_data, one.offset_data + one.size) for one in tar.getmembers()]
    draw = random.Random(0)
    inside = [8 * draw.randrange(*spans[0]) + draw.randrange(8) for _ in range(150)]
    inside += [8 * draw.randrange(*draw.choice(spans)) + draw.randrange(8) for _ in range(150)]
    anywhere = [draw.randrange(8 * len(content)) for _ in range(150)]
    for bit in inside + anywhere:
        changed = bytearray(content)
        changed[bit // 8] ^= 1 << (bit % 8)
        path.write_bytes(changed)
        try:
            assert walk_archive(path) == wanted and bit in anywhere
        except InputError as error:
            assert str(error).startswith(str(path)) and "\n" not in str(error)


def test_cut_file_is_found_wherever_it_is_cut(tmp_path):
    path = pack(tmp_path, "a")
    content = path.read_bytes()
    with tarfile.open(path) as tar:
        last = tar.getmembers()[-1]
    for size in [*range(0, last.offset_data + last.size, 997), 1, 511, 512, 513]:
        path.write_bytes(content[:size])
        with pytest.raises(InputError):
            walk_archive(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "not readable JSON"),
        (b"[" * 200_000, "not readable JSON"),
        (b"null", "holds no mapping"),
        (b"[]", "holds no mapping"),
        (b'{"format": 1, "format": 1}', "a key is there twice"),
        (b"\xff", "not readable JSON"),
        (b"9" * 6000, "not readable JSON"),
        (make_manifest(format=3), "has format 3, this version reads 1 to 2"),
        (make_manifest(format=True), "has format True"),
        (make_manifest(format=...), "has format None"),
        (make_manifest(files=...), "files is missing"),
        (make_manifest(files=[]), "files should be"),
        (make_manifest(files={"a": {}}), r"files.a.sha256 is missing"),
        (make_manifest(files={"a": {"sha256": "0", "bytes": 1}}), r"files.a.sha256 should match"),
        (make_manifest(files={"a": {"sha256": "0" * 64, "bytes": -1}}), r"files.a.bytes should be"),
        (make_manifest(files={"a": {"sha256": "0" * 64, "bytes": 1 << 50}}), r"files.a.bytes should"),
        (make_manifest(study=...), "study is missing"),
        (make_manifest(study=None), "study should be a valid string"),
        (make_manifest(study=".."), "study should match"),
        (make_manifest(study="a/b"), "study should match"),
        (make_manifest(config=[]), "config should be"),
        (make_manifest(code={}), r"code.wearscope is missing"),
        (make_manifest(more=1), "more is not permitted"),
        (make_manifest(files={"MANIFEST.json": {"sha256": "0" * 64, "bytes": 1}}), "format 1 has not"),
    ],
)
def test_malformed_manifest_gets_one_sentence(tmp_path, capsys, content, words):
    text = content if isinstance(content, bytes) else json.dumps(content).encode()
    path = tmp_path / "a.tar"
    write(path, ("MANIFEST.json", text), ("a", b"x"))
    with pytest.raises(InputError, match=words):
        walk_archive(path)
    assert main(["verify", str(path)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def entry(name, kind=tarfile.REGTYPE, link="", size=0):
    member = tarfile.TarInfo(name)
    member.type, member.linkname, member.size = kind, link, size
    return member


NAMES = [
    "../evil", "/tmp/evil", "a/../../evil", ".", "a//b", "a/./b", "", "a/", "x" * 300, "a\nb", "\x1b[2J",
    "a\\b", "a/b", "-rf", "b/-x.json", ".bashrc", ".checksums/a.sha256",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_name_that_leads_elsewhere_or_cannot_be_is_refused(tmp_path, name):
    one = {"sha256": hashlib.sha256(b"x").hexdigest(), "bytes": 1}
    path = tmp_path / "in" / "a.tar"
    path.parent.mkdir()
    files = {"a": one, name: one}
    write(path, ("MANIFEST.json", json.dumps(make_manifest(files=files)).encode()), ("a", b"x"), (name, b"x"))
    with pytest.raises(InputError, match="the name ") as found:
        packing.unpack_archive(path, tmp_path / "in" / "out")
    assert str(found.value).isprintable()
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["a.tar", "in"]


def test_member_that_is_no_plain_file_as_listed_is_refused(tmp_path, refuses):
    path = tmp_path / "a.tar"
    for member in (
        entry("a", tarfile.SYMTYPE, "/etc/passwd"),
        entry("a", tarfile.LNKTYPE, "MANIFEST.json"),
        entry("a", tarfile.FIFOTYPE),
        entry("a", tarfile.CHRTYPE),
        entry("a", tarfile.DIRTYPE),
        ("a", b"xx"),
        ("a", b"y"),
        ("b", b"x"),
        ("\x1b[2J", b"x"),
    ):
        write(path, ("MANIFEST.json", json.dumps(make_manifest()).encode()), member)
        refuses(packing.unpack_archive, path, tmp_path / "out")
        assert [one.name for one in tmp_path.iterdir()] == ["a.tar"]


def test_member_that_comes_twice_or_after_the_end_is_refused(tmp_path, refuses):
    path = tmp_path / "a.tar"
    first = ("MANIFEST.json", json.dumps(make_manifest()).encode())
    write(path, first, ("a", b"x"))
    walk_archive(path)
    good = path.read_bytes()
    write(path, first, ("a", b"x"), ("a", b"x"))
    refuses(walk_archive, path)
    write(path, first, ("a", b"x"), first)
    refuses(walk_archive, path)
    path.write_bytes(good + b"junk")
    with pytest.raises(InputError, match=r"something follows its end|no whole tar"):
        walk_archive(path)


def test_sparse_giant_and_compressed_bomb_are_refused_without_being_read(tmp_path):
    path = tmp_path / "a.tar"
    giant = 20 << 30
    manifest = json.dumps(make_manifest(files={"a": {"sha256": "0" * 64, "bytes": giant}})).encode()
    sparse = tarfile.TarInfo("a")
    sparse.size = 512
    sparse.pax_headers = {"GNU.sparse.major": "0", "GNU.sparse.minor": "1", "GNU.sparse.name": "a"}
    sparse.pax_headers |= {"GNU.sparse.size": str(giant), "GNU.sparse.map": "0,512"}
    with tarfile.open(path, "w", format=tarfile.PAX_FORMAT) as tar:
        one = tarfile.TarInfo("MANIFEST.json")
        one.size = len(manifest)
        tar.addfile(one, io.BytesIO(manifest))
        tar.addfile(sparse, io.BytesIO(b"x" * 512))
    with pytest.raises(InputError, match="a is no plain file"):
        walk_archive(path)
    path.write_bytes(gzip.compress(pack(tmp_path, "b").read_bytes()))
    with pytest.raises(InputError, match="is no whole tar archive"):
        walk_archive(path)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="is no plain file; name an archive"):
            walk_archive(path)


def test_names_of_a_study_pass():
    check_names(["snr.parquet", "parts/scope/medium.parquet", "figures/scope w3 (ö).svg"], "a")
    assert parse_manifest(json.dumps(make_manifest()).encode(), "a").study == "tiny"


@pytest.mark.parametrize(
    "name", ["/proc/self/mem", "/proc/kmsg", "/dev/zero", "/dev/stdin", "a\0b", "a" * 5000, "\x1b[2J"]
)
def test_files_that_an_archive_names_are_looked_at_with_bounds(tmp_path, name, capsys):
    """Its inputs may be any path of the machine, and are told as they can be read."""
    path = tmp_path / "a.tar"
    fields = make_manifest(format=2, inputs={name: "0" * 64}, files={})
    fields["code"] |= {"commit": "\x1b]0;x\x07"}
    content = json.dumps(fields).encode()
    digest = f"{hashlib.sha256(content).hexdigest()}  MANIFEST.json\n".encode()
    write(path, ("MANIFEST.json", content), ("MANIFEST.sha256", digest))
    assert main(["restore", str(path), str(tmp_path / "root")]) == 0
    said = capsys.readouterr().out
    assert "1 files of code or input are not as they were" in said
    assert said.replace("\n", "").isprintable() and len(said) < 2000


@pytest.mark.parametrize("study", ["archive", "closed_loop", "detection", "export", "tracking"])
def test_an_archive_takes_no_place_of_other_results(tmp_path, study, capsys):
    path = tmp_path / "a.tar"
    write(path, ("MANIFEST.json", json.dumps(make_manifest(study=study)).encode()), ("a", b"x"))
    assert main(["restore", str(path), str(tmp_path / "root")]) == 1
    assert f"results/{study} holds something else than a study" in capsys.readouterr().err
    assert not (tmp_path / "root").exists()


def test_lines_of_a_configuration_that_name_code_are_refused(tmp_path, capsys):
    config = {
        "study": "tiny", "seed": 0, "cycles": ["point_to_point", "evil.py"], "allow_code": True,
        "detectors": {"A": {"use": "/tmp/evil.py"}}, "closed_loop": {"effects": ["e.py"], "allow_code": True},
        "__use_yte__": True,
    }  # fmt: skip
    path = pack(tmp_path, "a", config=config)
    assert main(["restore", str(path), str(tmp_path / "one")]) == 0
    said = capsys.readouterr().out
    assert "allow_code: True; detectors.A.use: /tmp/evil.py; closed_loop.effects: e.py" in said
    assert "__use_yte__" in said
    kept = (tmp_path / "one" / "results" / "tiny" / "config.yaml").read_text()
    assert ".py" not in kept and "yte" not in kept and "point_to_point" in kept and "true" not in kept
    assert main(["restore", str(path), str(tmp_path / "two"), "--allow-code"]) == 0
    assert "evil.py" in (tmp_path / "two" / "results" / "tiny" / "config.yaml").read_text()


def test_headers_and_manifests_without_end_are_refused(tmp_path, refuses):
    path = tmp_path / "a.tar"
    header = entry("././@LongLink", tarfile.GNUTYPE_LONGNAME, size=1 << 40)
    path.write_bytes(header.tobuf(tarfile.GNU_FORMAT) + b"x" * 1024)
    with pytest.raises(InputError, match=r"a header of more than"):
        walk_archive(path)
    deep = {}
    for _ in range(900):
        deep = {"a": deep}
    write(path, ("MANIFEST.json", json.dumps(make_manifest(config=deep)).encode()), ("a", b"x"))
    refuses(packing.restore_archive, path, tmp_path)


def test_a_full_disk_is_named_and_not_the_archive(tmp_path, monkeypatch):
    path = pack(tmp_path, "a")

    def full(*given, **named):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(tarfile.TarFile, "extractall", full)
    with pytest.raises(InputError, match=r"the disk at .* is full"):
        packing.unpack_archive(path, tmp_path / "out")
