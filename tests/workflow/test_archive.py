import tarfile

import pandas as pd
import pytest

from wearscope import archive, tables
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
    assert manifest["config"] == {"study": "tiny", "seed": 0}
    assert manifest["packages"]["numpy"] and manifest["python"].startswith("3.11")
    assert manifest["code"]["sha256"] and manifest["code"]["files"]
    assert set(manifest["files"]) == {"test_quantities.parquet", "report.html", "logs/a.log"}


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
    with tarfile.open(path, "w") as tar:
        for name, content in members:
            file = path.with_name("member")
            file.write_bytes(content)
            tar.add(file, arcname=name)


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
