"""Two results compared in the terminal, from tables and verdicts made by hand."""

import json

import pandas as pd
import pytest
from click.testing import CliRunner

from wearscope.archive.packing import pack_study
from wearscope.cli.main import wearscope
from wearscope.errors import InputError
from wearscope.reporting.page import render_page
from wearscope.reporting.page_strip import Strip
from wearscope.storage import tables


def call(*arguments):
    return CliRunner().invoke(wearscope, [str(one) for one in arguments], catch_exceptions=False)


def write_study(folder, medians):
    folder.mkdir(parents=True)
    rows = [
        {"fda": name, "median": value, "median_low": 0.8 * value, "median_high": 1.2 * value,
         "rank": k + 1, "rank_low": k + 1, "rank_high": k + 1}
        for k, (name, value) in enumerate(sorted(medians.items(), key=lambda one: -one[1]))
    ]  # fmt: skip
    tables.write_table(folder / "ranking.parquet", pd.DataFrame(rows))
    return folder


def write_loop(folder, errors, named):
    folder.mkdir(parents=True)
    joints = {one: {"rms_before": 9.0, "rms_after": value, "unit": "N m"} for one, value in errors.items()}
    content = {"joints": joints, "verdict": [{"joint": joint, "effect": effect} for joint, effect in named]}
    (folder / "verdict.json").write_text(json.dumps(content))
    return folder


def test_what_differs_is_said_first(tmp_path):
    """Two studies of one name are called by their folders."""
    left = write_study(tmp_path / "may" / "arm", {"A": 2.0, "C": 5.5})
    right = write_study(tmp_path / "june" / "arm", {"A": 7.25, "C": 3.0})
    said = call("compare", left, right).output
    assert said.startswith(
        "C has the highest median SNR in may/arm.\nA has the highest median SNR in june/arm."
    )
    assert "2 conclusions and 1 table differ." in said and said.index("differ.") < said.index("7.25")


def test_two_answers_are_told_first(tmp_path):
    """The recommendation may change while the ranking does not, as where the best detector is withheld."""
    sides = [write_study(tmp_path / name, {"A": 2.0, "C": 5.5}) for name in ("may", "june")]
    for side, detector in zip(sides, "CA", strict=True):
        shown = render_page("t", [], strip=Strip(f"Use {detector}.", "good", "s", "c", "n"))
        (side / "report.html").write_text(shown)
        (side / ".study.json").write_text(json.dumps({"detectors": {"C": {"use": "friction_fit"}}}))
    outcome = call("compare", *sides)
    assert outcome.output.startswith("The answers differ.\nmay: Use C.\njune: Use A.\n")
    assert "Friction fit (C) has the highest median SNR in both." in outcome.output
    assert call("compare", sides[0], sides[0]).output.startswith("Both answer: Use C.\n")


def test_factors_of_conclusions_are_told_by_their_description(tmp_path):
    sides = [write_study(tmp_path / name, {"A": 2.0}) for name in ("may", "june")]
    for side, passes in zip(sides, (True, False), strict=True):
        row = {"robot": "r", "cycle": "c", "axis": 2, "fda": "A", "factor": "w3", "passes_direct": passes}
        tables.write_table(side / "audit_verdicts.parquet", pd.DataFrame([row | {"agrees": True}]))
        settings = {"factors": {"w3": {"description": "temperature"}}}
        (side / ".study.json").write_text(json.dumps(settings))
    told = "r, c, axis 2, A, temperature: passes by simulation and surrogate against fails by simulation and"
    assert told in call("compare", *sides).output


def test_equal_studies_differ_in_nothing(tmp_path):
    left, right = (write_study(tmp_path / name, {"A": 2.0, "C": 5.5}) for name in ("may", "june"))
    said = call("compare", left, right).output
    assert "C has the highest median SNR in both." in said and "Nothing differs." in said


def test_loops_stand_joint_by_joint(tmp_path):
    left = write_loop(tmp_path / "may", {"a1": 1.5, "a2": 2.0}, [("a1", "stribeck"), ("a2", "backlash")])
    right = write_loop(tmp_path / "june", {"a1": 1.25, "a2": 2.5}, [("a1", "stribeck")])
    said = call("compare", left, right).output
    assert "a2: backlash in may only." in said and "a1:" not in said and "1.25" in said


def test_settings_that_folders_record_are_compared(tmp_path, refuses):
    """A folder that records none differs in none; what only one concludes is counted, not told as changed."""
    left = write_study(tmp_path / "may", {"A": 2.0, "C": 5.5})
    right = write_study(tmp_path / "june", {"A": 2.0})
    (left / ".study.json").write_text(json.dumps({"seed": 1, "snr": {"delta": 0.5, "f0": 2.0}}))
    said = call("compare", left, right).output
    assert "1 conclusion in may only." in said and "none" not in said and "setting" not in said
    (right / ".study.json").write_text(json.dumps({"seed": 1, "snr": {"delta": 0.75, "f0": 2.0}}))
    said = call("compare", left, right, "--all").output
    assert "1 setting" in said and "snr.delta" in said and "0.5 against 0.75" in said
    (right / ".study.json").write_text("[]")
    refuses(call, "compare", left, right)


def test_conclusions_call_detectors_by_their_names(tmp_path):
    sides = (
        write_study(tmp_path / "a", {"A": 2.0, "C": 5.5}),
        write_study(tmp_path / "b", {"A": 7.0, "C": 3.0}),
    )
    settings = json.dumps({"detectors": {"A": {"use": "residual_energy"}, "C": "friction_fit"}})
    for side in sides:
        (side / ".study.json").write_text(settings)
    said = call("compare", *sides).output.replace("\n", " ")
    assert "Ranking: Residual energy (A): rank 2 (2 to 2) against rank 1 (1 to 1)." in said
    assert "Ranking: Friction fit (C): rank 1" in said


def test_an_archive_answers_as_its_folder_does(tmp_path):
    side = write_study(tmp_path / "a", {"A": 2.0, "C": 5.5})
    detectors = {"A": {"use": "residual_energy"}, "C": {"use": "friction_fit"}}
    (side / ".study.json").write_text(json.dumps({"study": "a", "detectors": detectors}))
    config = {"study": "a", "detectors": detectors}
    pack_study(tmp_path / "a.tar", side, [side / "ranking.parquet"], config, [])
    said = call("compare", side, tmp_path / "a.tar").output
    assert "Friction fit (C) has the highest median SNR in both." in said and "n/a" not in said


@pytest.mark.parametrize("odd", [pd.Timestamp("2024-02-28"), pd.Timedelta("1s"), "x"])
def test_conclusions_of_another_kind_are_told_by_none(tmp_path, odd):
    """A date formats as anything, and is true: neither a rank nor a passed audit is read from it."""
    whole = write_study(tmp_path / "a", {"A": 2.0})
    for name, column in (("ranking", "rank_low"), ("audit_verdicts", "passes_direct")):
        place = write_study(tmp_path / name, {"A": 2.0})
        keys = {"robot": "r", "cycle": "c", "axis": 2, "fda": "A", "factor": "w3", "agrees": True}
        rows = {"fda": "A", "rank": 1, "rank_high": 1} if name == "ranking" else keys
        tables.write_table(
            place / f"{name}.parquet", pd.DataFrame([rows]).assign(**{column: pd.Series([odd])})
        )
        with pytest.raises(InputError, match=f"{name}.parquet: a row holds no"):
            call("compare", whole, place)
