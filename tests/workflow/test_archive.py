"""Archives of a study: packed, unpacked, compared, restored; that of an old release."""

import json
import platform
from pathlib import Path

import pandas as pd
import pytest
import yaml
from archive_making import CODE, make_study, pack

from wearscope.archive import packing
from wearscope.archive.__main__ import main
from wearscope.archive.comparison import Content, compare_contents, list_results
from wearscope.archive.packing import walk_archive
from wearscope.config import drop_retired, load_config
from wearscope.storage import tables


def test_manifest_says_what_was_run(tmp_path):
    manifest = walk_archive(pack(tmp_path, "a"))
    assert manifest.config == {"study": "tiny", "seed": 0}
    assert manifest.packages["numpy"] and manifest.python == platform.python_version()
    assert manifest.code.sha256 and manifest.code.files
    assert set(manifest.files) == {"test_quantities.parquet", "report.html", "logs/a.log", "config.yaml"}


def test_same_study_gives_same_bytes(tmp_path):
    assert pack(tmp_path, "a").read_bytes() == pack(tmp_path, "b").read_bytes()


def test_unpacked_is_what_was_packed(tmp_path, refuses):
    path = pack(tmp_path, "a")
    packing.unpack_archive(path, tmp_path / "out")
    for file in ("test_quantities.parquet", "report.html", "logs/a.log"):
        assert (tmp_path / "out" / file).read_bytes() == (tmp_path / "a" / file).read_bytes()
    refuses(packing.unpack_archive, path, tmp_path / "out")
    rows = compare(path, tmp_path / "out")
    assert list(rows["outcome"]) == ["same bytes"]


def test_missing_file_is_not_packed(tmp_path, refuses):
    folder = tmp_path / "a"
    files = [*make_study(folder), folder / "snr.parquet"]
    refuses(packing.pack_study, tmp_path / "a.tar", folder, files, {}, [])
    assert not (tmp_path / "a.tar").exists()


def test_comparison_names_what_differs(tmp_path):
    a = pack(tmp_path, "a")
    b = pack(tmp_path, "b", shift=0.5, config={"study": "tiny", "seed": 1})
    rows = compare(a, b).set_index("item")
    assert rows.loc["seed", "detail"] == "0 against 1"
    assert rows.loc["test_quantities.parquet", "outcome"] == "differs"
    assert rows.loc["test_quantities.parquet", "detail"] == "y: 1 of 3 rows, largest difference 0.5 (20 %)"
    assert "logs/a.log" not in rows.index
    assert set(compare(a, a)["outcome"]) == {"same bytes"}


def test_comparison_says_which_conclusions_differ(tmp_path):
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
    rows = compare(tmp_path / "a", tmp_path / "b")
    rows = rows[rows["what"] == "conclusion"].set_index("item")["detail"]
    assert rows.to_dict() == {
        "findings: Q-1, wear": "agrees against undecided",
        "ranking: A": "rank 1 (1 to 2) against rank 2 (1 to 2)",
        "closed_loop/twin: axis_2": "nothing named against backlash",
    }


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
    assert list_results(folder) == files


def test_failed_unpacking_leaves_nothing(tmp_path, refuses):
    path = pack(tmp_path, "a")
    (tmp_path / "out").write_text("a file")
    refuses(packing.unpack_archive, path, tmp_path / "out")
    refuses(packing.unpack_archive, path, tmp_path / "out" / "in")
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a", "a.tar", "out"]


@pytest.mark.parametrize(
    ("version", "form", "commit"),
    [
        ("0.1.0", 1, "6f32e8f82465ee6a98a6e0cd31b9a868d5367946"),
        ("0.2.0", 2, "6db6038fd2bd335d422bd6a743743dde8ed71c0f"),
    ],
)
def test_archive_of_a_release_opens(tmp_path, capsys, version, form, commit):
    """Made by the release itself of the smallest study, without its page, figures and most recordings."""
    release = Path(__file__).parent / "archives" / f"release-{version}.tar"
    manifest = walk_archive(release)
    assert (manifest.format, manifest.code.wearscope, manifest.code.commit) == (form, version, commit)
    assert main(["restore", str(release), str(tmp_path), "--allow-code"]) == 0
    said = capsys.readouterr().out
    assert "every checksum holds" in said and f"commit {commit[:7]}" in said and "-R compute_snr" in said
    folder = tmp_path / "results" / "tiny"
    snr = tables.read_table(folder / "snr.parquet")
    assert len(snr) == 2 and snr["snr_exact"].notna().all()
    assert "conclusion" not in set(compare(release, folder)["what"])
    # Nothing is older than what it was made of, and the configuration is one that is accepted.
    results = [folder / name for name in manifest.files if name != "config.yaml"]
    assert len({file.stat().st_mtime_ns for file in results}) == 1
    config = yaml.safe_load((folder / "config.yaml").read_text())
    assert holds(load_config(config).model_dump(mode="json"), drop_retired(manifest.config))


def holds(new, old):
    """Whether a configuration keeps every setting of an old one; new settings may be added."""
    if isinstance(old, dict):
        return all(name in new and holds(new[name], value) for name, value in old.items())
    return new == old


def compare(a, b):
    return compare_contents(Content(a), Content(b))


def test_restored_study_has_checksums_and_no_second_restoring(tmp_path, refuses):
    path = pack(tmp_path, "a", config={"study": "tiny", "seed": 0})
    manifest, folder, _, changed = packing.restore_archive(path, tmp_path / "clone")
    assert changed == []
    assert (folder / ".checksums" / "report.html.sha256").read_text().endswith("  report.html\n")
    assert not (folder / ".checksums" / "logs").exists()
    refuses(packing.restore_archive, path, tmp_path / "clone")
    # What was restored is packed again to the same bytes.
    again = tmp_path / "again.tar"
    packing.pack_study(again, folder, list_results(folder), manifest.config, CODE)
    assert again.read_bytes() == path.read_bytes()
