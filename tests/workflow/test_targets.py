"""Targets in addition to the study: a stage, a model that borrows, reevaluation, data sets."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from changed_fields import changed_fields
from clones import run_ill, run_well, stale, write_study
from plain_robot import write_plain_robot

from wearscope.jobs.study_files import NamedDataSet
from wearscope.storage import tables


@pytest.mark.parametrize(
    ("target", "rules"),
    [
        ("design", {"make_design", "design"}),
        ("simulate", {"make_design", "check_cycles", "screen_robot", "simulate_points", "simulate"}),
    ],
)
def test_stage_needs_only_what_is_before_it(clone, target, rules):
    assert stale(clone, target) == rules


def test_model_that_borrows_wear_and_temperature_passes_the_check(clone):
    write_study(clone, "borrowed", robots=[write_plain_robot(clone)], carry_over={"plain": "medium"})
    run_well(clone, "check", study="borrowed.yaml")
    text = (clone / "results" / "borrowed" / "robots" / "plain.yaml").read_text()
    assert text.count("assumed: true") == 1 + 6  # wear of the axis asked for, temperature everywhere
    screening = tables.read_table(clone / "results" / "borrowed" / "screening" / "plain.parquet")
    assert screening["moves"].all() and not screening["dropped"].any()


@pytest.mark.slow
def test_two_models_are_reevaluated(clone):
    small = {"points": 8, "local_points": 6, "question_points": 2, "replicates": 2, "checking_points": 4}
    models = {"before": ["medium"], "after": [write_plain_robot(clone)]}
    write_study(clone, "two", reevaluate=models | small)
    run_well(clone, "reevaluate", cores=2, study="two.yaml")
    results = clone / "results" / "two"
    table = tables.read_table(results / "reevaluation" / "reevaluation.parquet")
    assert set(table["question"]) == {"coefficient", "snr", "rank", "scope"}
    wanted = "robot cycle axis fda question truth p_changed before before_low before_high after after_low"
    assert set(wanted.split()) <= set(table.columns)
    assert table["truth"].isna().all() and (results / "reevaluation" / "report.html").is_file()
    assert stale(clone, "reevaluate", study="two.yaml") <= {"reevaluate"}


@pytest.mark.long
def test_the_quick_study_reevaluates_its_demonstration_to_the_end(clone):
    settings = yaml.safe_load((clone / "config" / "quick.yaml").read_text())
    (clone / "quick.yaml").write_text(yaml.safe_dump(settings | {"reevaluate": {"enabled": True}}))
    text = run_well(clone, cores=2, study="quick.yaml")
    assert re.search(r"^(\d+) of \1 steps", text, re.MULTILINE)
    results = clone / "results" / "quick"
    table = tables.read_table(results / "reevaluation" / "reevaluation.parquet")
    assert set(table["question"]) == {"coefficient", "snr", "rank", "scope"}
    answered = table[~table["withheld"]]
    assert len(answered) and answered[["before", "after", "truth"]].notna().all(axis=None)
    ranked = tables.read_table(results / "reevaluation" / "reevaluation_ranking.parquet")
    pair = ranked.groupby(["robot", "cycle", "axis"])[["before", "after", "truth"]].sum()
    assert np.allclose(pair, 1.0)  # of two detectors one ranks above the other
    assert (results / "reevaluation" / "report.html").is_file()
    assert stale(clone, study="quick.yaml") == set()


def make_dataset(folder: Path, name: str) -> Path:
    (folder / "runs").mkdir(parents=True)
    (folder / "runs" / "a.parquet").write_bytes(b"")
    (folder / "robot.urdf").write_text("<robot/>")
    content = {"name": name, "robot": {"urdf": "robot.urdf"}, "runs": [{"file": "runs/a.parquet"}]}
    (folder / "dataset.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_data_set_anywhere_is_a_job_of_its_own(clone, tmp_path):
    folder = make_dataset(tmp_path / "machine", "my-robot")
    text = run_well(clone, "-n", "closed_loop", "--config", f"dataset={folder}")
    rules = set(re.findall(r"^(\w+) +\d+$", text, re.MULTILINE))
    assert rules == {"close_loop", "report_loop", "show_loop", "closed_loop", "total"}
    assert "Close the loop on" in text


def test_loop_depends_on_its_own_effects_and_on_all_of_its_code(clone, tmp_path):
    folder = make_dataset(tmp_path / "machine", "my-robot")
    with changed_fields(folder / "dataset.yaml") as content:
        content["effects"] = ["mine.py", "gone.py"]
        content["declared_effects"] = ["rigid_body", "declared.py"]
    for path in (folder / "mine.py", folder / "declared.py", tmp_path / "candidate.py"):
        path.write_text("EFFECT = 0\n")
    write_study(clone, "own", closed_loop={"effects": [str(tmp_path / "candidate.py")]})
    options = ["--config", f"dataset={folder}", "allow_code=true"]
    inputs = run_well(clone, "--filegraph", "closed_loop", *options, study="own.yaml")
    for path in (folder / "mine.py", folder / "declared.py", tmp_path / "candidate.py"):
        assert str(path) in inputs
    assert "gone.py" not in inputs
    code = {path.relative_to(clone).as_posix() for path in clone.glob("src/wearscope/closed_loop/**/*.py")}
    code |= {path.relative_to(clone).as_posix() for path in clone.glob("src/wearscope/effects/*.py")}
    assert not [path for path in code if path not in inputs]


def test_data_set_that_is_not_there_or_has_no_name_is_told(clone, tmp_path, refuses):
    told = run_ill(clone, "-n", "closed_loop", "--config", f"dataset={tmp_path / 'nowhere'}")
    assert "config: dataset:" in told and "a data set is a folder with a dataset.yaml" in told
    for place, name in (("x", "a/b"), ("y", "..")):
        refuses(NamedDataSet, str(make_dataset(tmp_path / place, name)))
