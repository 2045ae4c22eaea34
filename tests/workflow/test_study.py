"""The whole workflow on the smallest study, in copies of the tree."""

import importlib.util
import json
import os
import re
import shutil
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from calls import call_python, start, wait_until
from changed_fields import changed_fields
from clones import ROOT, TINY, command, copy_tree, digests, run_ill, run_well, stale, write_study

from wearscope.storage import tables

CONTRACT = {
    "test_quantities.parquet": "robot cycle axis fda set point f w3 w5 y",
    "surrogates.parquet": "robot cycle axis fda model term theta theta_normalised stderr",
    "validation.parquet": "robot cycle axis fda model fit",
    "snr.parquet": "robot cycle axis fda model snr snr_exact",
    "chosen_surrogates.parquet": "robot cycle axis fda kind fit ceiling n_points state",
    "direct.parquet": "robot cycle axis fda snr_direct direct_low direct_high snr_surrogate agrees",
    "mismatch.parquet": "robot cycle axis fda snr_ideal snr_mismatch mismatch_low mismatch_high",
    "audit_answers.parquet": "fda model share_inside answer",
    "scope.parquet": "robot cycle axis fda factor delta sigma p_d passes method",
    "audit.parquet": "robot cycle axis fda point y_direct y_surrogate low high",
    "design/identification.parquet": "point f w3 w5 f_natural w3_natural w5_natural",
    "design/validation.parquet": "point f w3 w5 f_natural w3_natural w5_natural",
    "design/nominal.parquet": "point f w3 w5 f_natural w3_natural w5_natural",
}


_SPEC = importlib.util.spec_from_file_location("data_dictionary", ROOT / "docs" / "site" / "dictionary.py")
dictionary = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(dictionary)


@pytest.fixture
def changed(finished) -> Iterator[Path]:
    """The finished study, to change files of; they are put back afterwards."""
    kept = {path: path.read_bytes() for path in finished.glob("src/wearscope/**/*.py")}
    kept |= {path: path.read_bytes() for path in finished.glob(f"{TINY}/*") if path.is_file()}
    yield finished
    for path, content in kept.items():
        if path.read_bytes() != content:
            path.write_bytes(content)


def test_results_have_the_contract_s_names_and_columns(finished):
    results = finished / "results" / "tiny"
    for name, columns in CONTRACT.items():
        table = tables.read_table(results / name)
        assert set(columns.split()) <= set(table.columns), name
        assert len(table)
    quantities = tables.read_table(results / "test_quantities.parquet")
    assert len(quantities) == 2 * (15 + 15 + 19 + 7)  # detectors x points of each set
    assert set(quantities["robot"]) == {"medium"} and set(quantities["cycle"]) == {"short_moves"}
    assert set(quantities["fda"]) == {"A", "own"} and set(quantities["axis"]) == {1}
    assert (results / "report.html").stat().st_size > 10_000
    figures = {path.suffix for path in (results / "figures").iterdir()}
    assert figures == {".svg", ".png"}


def test_every_column_is_in_the_data_dictionary(finished):
    results = finished / "results" / "tiny"
    written = sorted([*results.glob("*.parquet"), *results.glob("design/*.parquet")])
    assert len(written) > 20
    content = dictionary.read_dictionary()
    for path in written:
        name = path.relative_to(results).with_suffix("").as_posix()
        described = content["tables"][name]["columns"]
        missing, _ = dictionary.compare_columns(pq.read_schema(path).names, described, ("f", "w3", "w5"))
        assert missing == set(), name


def test_traces_are_one_partition_a_point_with_units(finished):
    traces = finished / "results" / "tiny" / "traces" / "medium" / "short_moves"
    files = sorted((traces / "identification").glob("point=*/*.parquet"))
    assert len(files) == 15
    units = tables.read_units(files[0])
    assert units["t"] == "s"
    whole = pq.read_table(traces / "identification")
    assert {"t", "joint", "q", "qd", "tau", "point"} <= set(whole.column_names)
    assert whole.column("point").to_pandas().nunique() == 15


def test_every_job_logged_and_was_timed(finished):
    results = finished / "results" / "tiny"
    logs, times = (
        {
            path.relative_to(results / folder).with_suffix("")
            for path in results.glob(f"{folder}/**/*.{ending}")
        }
        for folder, ending in (("logs", "log"), ("benchmarks", "tsv"))
    )
    assert logs == times and len(logs) > 10
    assert all(path.read_text() for path in results.glob("logs/**/*.log"))


def test_second_run_does_nothing(finished):
    assert "Nothing to be done" in run_well(finished)


def test_touched_files_and_other_files_rerun_nothing(changed):
    later = time.time() + 10
    for path in [*changed.glob("src/**/*.py"), *changed.glob("workflow/**/*"), *changed.glob("config/**/*")]:
        if path.is_file():
            os.utime(path, (later, later))
    with open(changed / "README.md", "a", encoding="utf-8") as file:
        file.write("\nMore to read.\n")
    assert stale(changed) == set()


AFTER_SNR = {
    "compute_snr", "draw_findings", "draw_conclusion", "compare_paper", "write_report", "report", "all",
}  # fmt: skip
AFTER_SCOPE = {
    "compute_scope", "join_scope", "choose_audit_points", "simulate_points", "compute_audit_quantities",
    "audit_surrogates", "draw_findings", "compute_responses", "draw_conclusion",
    "compare_paper", "write_report", "report", "all",
}  # fmt: skip
AFTER_SURROGATES = (
    AFTER_SNR
    | AFTER_SCOPE
    | {"fit_surrogates", "validate_surrogates", "compute_sensitivity"}
    | {"choose_surrogates", "join_chosen", "compare_direct", "compare_mismatch"}
)
AFTER_TEST_QUANTITIES = AFTER_SURROGATES | {"compute_test_quantities", "join_test_quantities"}


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


@pytest.mark.parametrize(
    ("setting", "change", "expected"),
    [
        ("snr", {"runs": 2000}, AFTER_SNR),
        ("scope", {"grid": [5, 4], "runs": 1000, "p_d": 0.95}, AFTER_SCOPE),
        ("max_failed_share", 0.2, AFTER_TEST_QUANTITIES),
        ("seed", 1, None),
    ],
)
def test_changed_setting_reruns_its_stage_and_what_follows(changed, setting, change, expected):
    with changed_fields(changed / TINY / "config.yaml") as config:
        config[setting] = change
    rules = stale(changed)
    if expected is None:
        assert {"simulate_points", "compute_snr", "compute_scope"} <= rules
    else:
        assert rules <= expected and expected - {"report", "all"} <= rules | {"simulate_points"}


@pytest.mark.parametrize(
    ("file", "must", "must_not"),
    [
        (
            "src/wearscope/evaluation/snr.py",
            {"compute_snr", "write_report"},
            {"compute_test_quantities", "fit_surrogates"},
        ),
        (f"{TINY}/torque_change.py", {"compute_test_quantities"}, {"make_design"}),
        (f"{TINY}/short_moves.py", {"check_cycles", "simulate_points"}, {"make_design"}),
        (
            "src/wearscope/closed_loop/intake/dataset.py",
            set(),
            {"simulate_points", "compute_snr", "fit_surrogates"},
        ),
    ],
)
def test_changed_code_reruns_its_stage_and_what_follows(changed, file, must, must_not):
    with open(changed / file, "a", encoding="utf-8") as code:
        code.write("\n# An edit.\n")
    rules = stale(changed)
    assert must <= rules
    assert not must_not & rules


@pytest.mark.slow
def test_two_cores_and_a_killed_run_give_the_same_bytes(finished, tmp_path):
    folder = tmp_path / "two-cores"
    shutil.copytree(finished, folder, ignore=shutil.ignore_patterns("results", ".snakemake"))
    job = start(*command("simulate", cores=2), folder=folder)
    pattern = "results/tiny/traces/medium/short_moves/*/point=*/*.parquet"
    wait_until(lambda: len(list(folder.glob(pattern))) >= 3 or job.poll() is not None, 120.0, 0.02)
    os.killpg(job.pid, signal.SIGKILL)
    job.wait()
    halfway = {path: path.stat().st_mtime_ns for path in folder.glob(pattern)}
    assert len(halfway) >= 3
    run_well(folder, "validate", "sensitivity", "snr", "scope", "audit", "direct", cores=2)
    assert all(path.stat().st_mtime_ns == moment for path, moment in halfway.items()), (
        "a finished point was redone"
    )
    ours, theirs = digests(folder), digests(finished)
    asked = ("responses", "simulated", "detection", "thresholds", "rankings", "friction")
    assert theirs.keys() - ours.keys() <= {f"{name}.parquet" for name in (*asked, "findings")}
    assert [name for name in ours if ours[name] != theirs[name]] == []


def test_archive_holds_the_study(finished, tmp_path):
    run_well(finished, "archive")
    path = finished / "results" / "archive" / "tiny.tar"
    environment = {**os.environ, "PYTHONPATH": str(finished / "src")}
    for words in (("verify", path), ("unpack", path, tmp_path / "out")):
        assert call_python("-m", "wearscope.archive", *words, env=environment).returncode == 0
    manifest = json.loads((tmp_path / "out" / "MANIFEST.json").read_text())
    assert manifest["config"]["study"] == "tiny"
    assert "src/wearscope/archive.py" in manifest["code"]["files"]
    for name, content in digests(finished).items():
        assert (tmp_path / "out" / name).read_bytes() == content


@pytest.mark.slow
def test_a_study_simulated_by_one_job_has_the_bytes_of_one_cut_into_chunks(finished, tmp_path):
    clone = copy_tree(tmp_path / "at-once")
    study = write_study(clone, "whole", study="tiny", simulation={"chunk": 1000})
    text = run_well(clone, "test_quantities", study=study)
    assert re.search(r"^simulate_study +1$", text, re.MULTILINE)
    assert "simulate_points" not in stale(clone, "test_quantities", study=study)
    ours, theirs = (folder / "results" / "tiny" for folder in (clone, finished))
    recordings = [path.relative_to(ours) for path in ours.glob("traces/**/*.parquet")]
    assert len(recordings) > 30
    for name in [*recordings, "test_quantities.parquet"]:
        assert (ours / name).read_bytes() == (theirs / name).read_bytes()


@pytest.mark.slow
def test_detector_that_fails_too_often_is_told_and_nothing_else_lost(finished, tmp_path):
    folder = shutil.copytree(finished, tmp_path / "fails", symlinks=True)
    with changed_fields(folder / TINY / "config.yaml") as config:
        config["detectors"]["own"] = {"use": f"{TINY}/torque_change.py", "options": {"fail_above": 0.0}}
    before = digests(folder)
    told = run_ill(folder, "test_quantities")
    assert "fda 'own', robot medium, cycle short_moves, axis 1: failed at" in told
    assert "max_failed_share" in told
    after = digests(folder)
    assert {name for name in before if name.startswith("traces/")} <= after.keys()


@pytest.mark.slow
def test_failed_simulation_is_counted_left_out_and_refused_above_the_share(finished, tmp_path):
    folder = tmp_path / "one-fails"
    shutil.copytree(finished, folder, ignore=shutil.ignore_patterns("results", ".snakemake"))
    edit(
        folder / "src/wearscope/simulation/study.py",
        "        check_temperature(",
        '        if conditions.temperature == 70.0:\n            raise SimulationError("the oil boils.")\n'
        "        check_temperature(",
    )
    write_study(folder, "lenient", study="tiny", max_failed_share=0.07)
    told = run_ill(folder, "test_quantities")
    sentence = (
        "robot medium, cycle short_moves: the simulation failed at 1 of 15 identification points, more than "
        "the share 0.05 allowed; first at point "
    )
    assert sentence in told and "the oil boils; correct the robot" in told
    results = folder / "results" / "tiny"
    recordings = {path: path.stat().st_mtime_ns for path in results.glob("traces/**/*.parquet")}
    assert len(recordings) == 15 + 14 + 19 + 7 + 1

    run_well(folder, "validate", "snr", "scope", study="lenient.yaml")
    assert {path: path.stat().st_mtime_ns for path in recordings} == recordings
    failed = tables.read_table(results / "failed_simulations.parquet")
    assert list(failed["reason"]) == ["the oil boils"] and list(failed["set"]) == ["identification"]
    quantities = tables.read_table(results / "test_quantities.parquet")
    lost = quantities[quantities["y"].isna()]
    assert set(lost["fda"]) == {"A", "own"} and set(lost["point"]) == set(failed["point"])
    assert set(lost["status"]) == {"simulation failed: the oil boils"} and set(lost["w3"]) == {2.0}
    assert tables.read_table(results / "failures.parquet").empty
    surrogates = tables.read_table(results / "surrogates.parquet")
    assert set(surrogates["n_failed"]) == {1} and set(surrogates["n_points"]) == {14}
    assert surrogates["theta"].notna().all()
    assert tables.read_table(results / "snr.parquet")["snr_exact"].notna().all()
    assert tables.read_table(results / "scope.parquet")["p_d"].notna().all()
