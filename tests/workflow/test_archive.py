import gzip
import hashlib
import io
import json
import os
import random
import tarfile
from pathlib import Path

import pandas as pd
import pytest
import yaml
from rocrate.rocrate import ROCrate

from wearscope import archive, tables
from wearscope.archives.manifest import check_names, parse_manifest
from wearscope.config import drop_retired, load_config
from wearscope.errors import InputError


def make_study(folder, shift=0.0):
    table = pd.DataFrame({"point": [1, 2, 3], "fda": ["A", "A", "B"], "y": [1.0, 2.0 + shift, float("nan")]})
    tables.write_table(folder / "test_quantities.parquet", table, {"y": "1"})
    tables.write_text(folder / "report.html", "<p>report</p>")
    tables.write_text(folder / "logs" / "a.log", f"took {shift}")
    return sorted(file for file in folder.rglob("*") if file.is_file())


def pack(tmp_path, name, shift=0.0, config=None):
    folder = tmp_path / name
    files = make_study(folder, shift)
    path = tmp_path / f"{name}.tar"
    archive.pack_study(path, folder, files, config or {"study": "tiny", "seed": 0}, [__file__])
    return path


def test_manifest_says_what_was_run(tmp_path):
    manifest = archive.verify_archive(pack(tmp_path, "a"))
    assert manifest.config == {"study": "tiny", "seed": 0}
    assert manifest.packages["numpy"] and manifest.python.startswith("3.11")
    assert manifest.code.sha256 and manifest.code.files
    made = {"config.yaml", "ro-crate-metadata.json"}
    assert set(manifest.files) == {"test_quantities.parquet", "report.html", "logs/a.log"} | made


def test_same_study_gives_same_bytes(tmp_path):
    assert pack(tmp_path, "a").read_bytes() == pack(tmp_path, "b").read_bytes()


def test_unpacked_is_what_was_packed(tmp_path):
    path = pack(tmp_path, "a")
    archive.unpack_archive(path, tmp_path / "out")
    for file in ("test_quantities.parquet", "report.html", "logs/a.log"):
        assert (tmp_path / "out" / file).read_bytes() == (tmp_path / "a" / file).read_bytes()
    with pytest.raises(InputError, match="is not empty"):
        archive.unpack_archive(path, tmp_path / "out")
    rows = archive.compare_archives(path, tmp_path / "out")
    assert list(rows["outcome"]) == ["same bytes"]


def test_altered_byte_is_found(tmp_path):
    path = pack(tmp_path, "a")
    content = path.read_bytes()
    path.write_bytes(content.replace(b"<p>report</p>", b"<p>rep0rt</p>"))
    with pytest.raises(InputError, match=r"report.html is not what was packed"):
        archive.verify_archive(path)
    path.write_bytes(content[: len(content) // 3])
    with pytest.raises(InputError, match="get the file again"):
        archive.verify_archive(path)


def repack(path, change):
    """Write the archive's members again, as `change` (a function of name and bytes) returns them."""
    members = []
    with tarfile.open(path) as tar:
        for member in tar:
            members += change(member.name, tar.extractfile(member).read())
    write(path, *members)


def write(path, *members):
    with tarfile.open(path, "w") as tar:
        for member in members:
            name, content = member if isinstance(member, tuple) else (member, b"")
            if not isinstance(name, tarfile.TarInfo):
                name = tarfile.TarInfo(name)
                name.size = len(content)
            tar.addfile(name, io.BytesIO(content))


def test_missing_and_foreign_members_are_found(tmp_path):
    path = pack(tmp_path, "a")
    repack(path, lambda name, content: [] if name == "report.html" else [(name, content)])
    with pytest.raises(InputError, match=r"report.html is missing"):
        archive.verify_archive(path)
    path = pack(tmp_path, "b")
    repack(
        path,
        lambda name, content: [(name, content), ("../evil", b"")] if "html" in name else [(name, content)],
    )
    with pytest.raises(InputError, match=r"evil is not in its manifest"):
        archive.unpack_archive(path, tmp_path / "out")
    assert not (tmp_path / "evil").exists() and not (tmp_path / "out").exists()


def test_no_archive_gets_one_sentence(tmp_path, capsys):
    assert archive.main(["verify", str(tmp_path / "none.tar")]) == 1
    assert "no such file" in capsys.readouterr().err
    (tmp_path / "text.tar").write_text("no archive")
    assert archive.main(["verify", str(tmp_path / "text.tar")]) == 1
    assert "is no whole tar archive" in capsys.readouterr().err


def test_missing_file_is_not_packed(tmp_path):
    folder = tmp_path / "a"
    files = [*make_study(folder), folder / "snr.parquet"]
    with pytest.raises(InputError, match=r"snr.parquet: no such file"):
        archive.pack_study(tmp_path / "a.tar", folder, files, {}, [])
    assert not (tmp_path / "a.tar").exists()


def test_comparison_names_what_differs(tmp_path, capsys):
    a = pack(tmp_path, "a")
    b = pack(tmp_path, "b", shift=0.5, config={"study": "tiny", "seed": 1})
    rows = archive.compare_archives(a, b).set_index("item")
    assert rows.loc["seed", "detail"] == "0 against 1"
    assert rows.loc["test_quantities.parquet", "outcome"] == "differs"
    assert rows.loc["test_quantities.parquet", "detail"] == "y: 1 of 3 rows, largest difference 0.5 (20 %)"
    assert "logs/a.log" not in rows.index
    assert archive.main(["compare", str(a), str(b)]) == 1
    assert "largest difference 0.5" in capsys.readouterr().out
    assert archive.main(["compare", str(a), str(a)]) == 0
    out = capsys.readouterr().out
    assert "no conclusion differs" in out


def test_comparison_says_which_conclusions_differ(tmp_path, capsys):
    loop = {"joints": {"axis_1": {}, "axis_2": {}}, "verdict": []}
    named = {**loop, "verdict": [{"joint": "axis_2", "effect": "backlash"}]}
    for name, verdict, rank, content in (("a", "agrees", 1, loop), ("b", "undecided", 2, named)):
        folder = tmp_path / name
        make_study(folder)
        findings = {"question": ["Q-1", "Q-2"], "paper": ["wear", "rank"], "verdict": [verdict, "agrees"]}
        tables.write_table(folder / "findings.parquet", pd.DataFrame(findings))
        ranking = {"fda": ["A"], "rank": [rank], "rank_low": [1], "rank_high": [2]}
        tables.write_table(folder / "ranking.parquet", pd.DataFrame(ranking))
        tables.write_text(folder / "closed_loop" / "twin" / "verdict.json", json.dumps(content))
    rows = archive.compare_archives(tmp_path / "a", tmp_path / "b")
    rows = rows[rows["what"] == "conclusion"].set_index("item")["detail"]
    assert rows.to_dict() == {
        "findings: Q-1, wear": "agrees against undecided",
        "ranking: A": "1, 1, 2 against 2, 1, 2",
        "closed_loop/twin: axis_2": "nothing named against backlash",
    }
    assert archive.main(["compare", str(tmp_path / "a"), str(tmp_path / "b")]) == 1
    assert "3 conclusions differ: findings: Q-1, wear; " in capsys.readouterr().out


def test_crate_is_read_by_its_library_and_has_every_checksum(tmp_path):
    path = pack(tmp_path, "a")
    manifest = archive.unpack_archive(path, tmp_path / "out")
    crate = ROCrate(tmp_path / "out")
    files = {one.id: one for one in crate.data_entities}
    assert set(files) == set(manifest.files) - {"ro-crate-metadata.json"}
    for name, one in files.items():
        content = (tmp_path / "out" / name).read_bytes()
        assert one["sha256"] == hashlib.sha256(content).hexdigest() and one["contentSize"] == str(
            len(content)
        )
    assert crate.get("#wearscope")["sha256"] == manifest.code.sha256
    assert crate.get("#package/numpy")["softwareVersion"] == manifest.packages["numpy"]
    assert crate.name == "wearscope study tiny" and crate.license


def test_every_flipped_bit_is_found(tmp_path):
    """In the manifest too; only padding that no one reads, and headers' times and owners, may go unseen."""
    path = pack(tmp_path, "a")
    content = path.read_bytes()
    wanted = archive.verify_archive(path)
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
            assert archive.verify_archive(path) == wanted and bit in anywhere
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
            archive.verify_archive(path)


def make_manifest(**changes):
    fields = {
        "format": 1,
        "study": "tiny",
        "config": {},
        "python": "3.11.7",
        "packages": {},
        "code": {"wearscope": "0.1.0", "commit": None, "changed": False, "sha256": "0" * 64, "files": {}},
        "files": {"a": {"sha256": hashlib.sha256(b"x").hexdigest(), "bytes": 1}},
    }
    fields |= changes
    return {key: value for key, value in fields.items() if value is not Ellipsis}


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
        (make_manifest(files=...), "files: field required"),
        (make_manifest(files=[]), "files: input should be"),
        (make_manifest(files={"a": {}}), r"files.a.sha256: field required"),
        (make_manifest(files={"a": {"sha256": "0", "bytes": 1}}), r"files.a.sha256: string should match"),
        (make_manifest(files={"a": {"sha256": "0" * 64, "bytes": -1}}), r"files.a.bytes: input should be"),
        (make_manifest(files={"a": {"sha256": "0" * 64, "bytes": 1 << 50}}), r"files.a.bytes: input should"),
        (make_manifest(study=...), "study: field required"),
        (make_manifest(study=None), "study: input should be a valid string"),
        (make_manifest(study=".."), "study: string should match"),
        (make_manifest(study="a/b"), "study: string should match"),
        (make_manifest(config=[]), "config: input should be"),
        (make_manifest(code={}), r"code.wearscope: field required"),
        (make_manifest(more=1), "more: extra inputs are not permitted"),
        (make_manifest(files={"MANIFEST.json": {"sha256": "0" * 64, "bytes": 1}}), "format 1 has not"),
    ],
)
def test_malformed_manifest_gets_one_sentence(tmp_path, capsys, content, words):
    text = content if isinstance(content, bytes) else json.dumps(content).encode()
    path = tmp_path / "a.tar"
    write(path, ("MANIFEST.json", text), ("a", b"x"))
    with pytest.raises(InputError, match=words):
        archive.verify_archive(path)
    assert archive.main(["verify", str(path)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def entry(name, kind=tarfile.REGTYPE, link="", size=0):
    member = tarfile.TarInfo(name)
    member.type, member.linkname, member.size = kind, link, size
    return member


NAMES = [
    "../evil", "/tmp/evil", "a/../../evil", ".", "a//b", "a/./b", "", "a/", "x" * 300, "a\nb", "\x1b[2J",
    "a\\b", "a/b",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_name_that_leads_elsewhere_or_cannot_be_is_refused(tmp_path, name):
    one = {"sha256": hashlib.sha256(b"x").hexdigest(), "bytes": 1}
    path = tmp_path / "in" / "a.tar"
    path.parent.mkdir()
    files = {"a": one, name: one}
    write(path, ("MANIFEST.json", json.dumps(make_manifest(files=files)).encode()), ("a", b"x"), (name, b"x"))
    with pytest.raises(InputError, match="the name ") as found:
        archive.unpack_archive(path, tmp_path / "in" / "out")
    assert str(found.value).isprintable()
    assert sorted(one.name for one in tmp_path.rglob("*")) == ["a.tar", "in"]


@pytest.mark.parametrize(
    ("member", "words"),
    [
        (entry("a", tarfile.SYMTYPE, "/etc/passwd"), "a is no plain file"),
        (entry("a", tarfile.LNKTYPE, "MANIFEST.json"), "a is no plain file"),
        (entry("a", tarfile.FIFOTYPE), "a is no plain file"),
        (entry("a", tarfile.CHRTYPE), "a is no plain file"),
        (entry("a", tarfile.DIRTYPE), "a is no plain file"),
        (("a", b"xx"), "its size is 2, not 1"),
        (("a", b"y"), "a is not what was packed .its checksum differs"),
        (("b", b"x"), "b is not in its manifest"),
        (("\x1b[2J", b"x"), r"x1b\[2J is not in its manifest"),
    ],
)
def test_member_that_is_no_plain_file_as_listed_is_refused(tmp_path, member, words):
    path = tmp_path / "a.tar"
    write(path, ("MANIFEST.json", json.dumps(make_manifest()).encode()), member)
    with pytest.raises(InputError, match=words):
        archive.unpack_archive(path, tmp_path / "out")
    assert [one.name for one in tmp_path.iterdir()] == ["a.tar"]


def test_member_that_comes_twice_or_after_the_end_is_refused(tmp_path):
    path = tmp_path / "a.tar"
    first = ("MANIFEST.json", json.dumps(make_manifest()).encode())
    write(path, first, ("a", b"x"))
    archive.verify_archive(path)
    good = path.read_bytes()
    write(path, first, ("a", b"x"), ("a", b"x"))
    with pytest.raises(InputError, match="a is not in its manifest"):
        archive.verify_archive(path)
    write(path, first, ("a", b"x"), first)
    with pytest.raises(InputError, match=r"MANIFEST.json is not in its manifest"):
        archive.verify_archive(path)
    path.write_bytes(good + b"junk")
    with pytest.raises(InputError, match=r"something follows its end|no whole tar"):
        archive.verify_archive(path)


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
        archive.verify_archive(path)
    path.write_bytes(gzip.compress(pack(tmp_path, "b").read_bytes()))
    with pytest.raises(InputError, match="is no whole tar archive"):
        archive.verify_archive(path)


def test_what_is_no_file_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", Path("/dev/zero")):
        with pytest.raises(InputError, match="is no plain file; name an archive"):
            archive.verify_archive(path)


def test_hidden_and_made_files_are_not_packed(tmp_path):
    folder = tmp_path / "a"
    files = make_study(folder)
    for name in (
        ".checksums/report.html.sha256",
        ".r2.parquet.4m4pxayd.part",
        "MANIFEST.json",
        "config.yaml",
    ):
        tables.write_text(folder / name, "not a result")
    assert archive.list_results(folder) == files


def test_failed_unpacking_leaves_nothing(tmp_path):
    path = pack(tmp_path, "a")
    (tmp_path / "out").write_text("a file")
    with pytest.raises(InputError, match="is not empty"):
        archive.unpack_archive(path, tmp_path / "out")
    with pytest.raises(InputError, match="cannot be written"):
        archive.unpack_archive(path, tmp_path / "out" / "in")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a", "a.tar", "out"]


RELEASE = Path(__file__).parent / "archives" / "release-0.1.0.tar"


def test_archive_of_release_0_1_0_opens(tmp_path, capsys):
    manifest = archive.verify_archive(RELEASE)
    assert manifest.format == 1 and manifest.code.wearscope == "0.1.0"
    assert manifest.code.commit == "6f32e8f82465ee6a98a6e0cd31b9a868d5367946"
    assert archive.main(["restore", str(RELEASE), str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "every checksum holds" in said and "commit 6f32e8f" in said and "-R compute_snr" in said
    folder = tmp_path / "results" / "tiny"
    snr = tables.read_table(folder / "snr.parquet")
    assert len(snr) == 2 and snr["snr_exact"].notna().all()
    assert "no conclusion differs" in run_compare(RELEASE, folder, capsys)
    # Nothing is older than what it was made of, and the configuration is one that is accepted.
    assert len({file.stat().st_mtime_ns for file in folder.rglob("*")}) == 1
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert holds(load_config(config).model_dump(mode="json"), drop_retired(manifest.config))


def holds(new, old):
    """Whether a configuration keeps every setting of an old one; new settings may stand beside them."""
    if isinstance(old, dict):
        return all(name in new and holds(new[name], value) for name, value in old.items())
    return new == old


def run_compare(a, b, capsys):
    archive.main(["compare", str(a), str(b)])
    return capsys.readouterr().out


def test_restored_study_has_checksums_and_no_second_restoring(tmp_path):
    path = pack(tmp_path, "a", config={"study": "tiny", "seed": 0})
    manifest, folder, changed = archive.restore_archive(path, tmp_path / "clone")
    assert changed == []
    assert (folder / ".checksums" / "report.html.sha256").read_text().endswith("  report.html\n")
    assert not (folder / ".checksums" / "logs").exists()
    with pytest.raises(InputError, match="is not empty"):
        archive.restore_archive(path, tmp_path / "clone")
    # What was restored is packed again to the same bytes.
    again = tmp_path / "again.tar"
    archive.pack_study(again, folder, archive.list_results(folder), manifest.config, [__file__])
    assert again.read_bytes() == path.read_bytes()


def test_names_of_a_study_pass():
    check_names(["snr.parquet", "parts/scope/medium.parquet", "figures/scope w3 (ö).svg"], "a")
    assert parse_manifest(json.dumps(make_manifest()).encode(), "a").study == "tiny"
