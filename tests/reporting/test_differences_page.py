"""The page of two results side by side, from tables and verdicts made by hand."""

import json
import re

import pandas as pd
import pytest
from click.testing import CliRunner
from reporting.browser import open_page

from wearscope import tables
from wearscope.archive import pack_study
from wearscope.cli.main import wearscope
from wearscope.errors import InputError
from wearscope.reporting.page import render_page
from wearscope.reporting.page_strip import Strip, read_strip


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


def read_text(page):
    shown = page.read_text().partition("<h1")[2].partition("</main>")[0]
    return re.sub(r"<[^>]+>", " ", shown.replace("\N{ZERO WIDTH SPACE}", ""))


@pytest.fixture
def studies(tmp_path):
    """Two studies of one name, whose best detectors differ, and their page."""
    left = write_study(tmp_path / "may" / "arm", {"A": 2.0, "C": 5.5})
    right = write_study(tmp_path / "june" / "arm", {"A": 7.25, "C": 3.0})
    page = tmp_path / "both.html"
    outcome = call("compare", left, right, "--page", page)
    assert outcome.exit_code == 0 and str(page) in outcome.output
    return page


def test_what_differs_is_said_first(studies):
    text = read_text(studies)
    assert text.index("C has the highest median SNR in may/arm.") < text.index("7.25")
    assert "A has the highest median SNR in june/arm." in text
    assert "2 conclusions and 1 table differ." in text
    strip = read_strip(studies)
    assert strip.answer.startswith("C has the highest median SNR in may/arm.") and strip.kind == "unsure"
    assert strip.caveat == "No setting that both record differs." and strip.action == "See Conclusions."


def test_two_answers_are_told_first(tmp_path):
    """The recommendation may change while the ranking does not, as where the best detector is withheld."""
    sides = [write_study(tmp_path / name, {"A": 2.0, "C": 5.5}) for name in ("may", "june")]
    for side, detector in zip(sides, "CA", strict=True):
        shown = render_page("t", [], strip=Strip(f"Use {detector}.", "good", "s", "c", "n"))
        (side / "report.html").write_text(shown)
        (side / ".study.json").write_text(json.dumps({"detectors": {"C": {"use": "friction_fit"}}}))
    outcome = call("compare", *sides, "--page", tmp_path / "both.html")
    assert outcome.output.startswith("The answers differ.\nmay: Use C.\njune: Use A.\n")
    assert "Friction fit (C) has the highest median SNR in both." in outcome.output
    strip = read_strip(tmp_path / "both.html")
    assert strip.answer == "The answers differ. may: Use C. june: Use A." and strip.kind == "unsure"
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
    call("compare", left, right, "--page", tmp_path / "both.html")
    text = read_text(tmp_path / "both.html")
    assert "C has the highest median SNR in both." in text and "Nothing differs." in text


def test_loops_stand_joint_by_joint(tmp_path):
    left = write_loop(tmp_path / "may", {"a1": 1.5, "a2": 2.0}, [("a1", "stribeck"), ("a2", "backlash")])
    right = write_loop(tmp_path / "june", {"a1": 1.25, "a2": 2.5}, [("a1", "stribeck")])
    call("compare", left, right, "--page", tmp_path / "both.html")
    text = read_text(tmp_path / "both.html")
    assert "a2: backlash in may only." in text and "a1:" not in text
    assert "1.25" in text and "nothing" in text


def test_without_a_page_none_is_written_and_none_is_opened(tmp_path):
    left, right = (write_study(tmp_path / name, {"A": 2.0}) for name in ("may", "june"))
    call("compare", left, right)
    assert not list(tmp_path.glob("*.html"))
    with pytest.raises(ValueError, match="say where it goes with --page FILE"):
        call("compare", left, right, "--open")


@pytest.mark.slow
@pytest.mark.parametrize("width, scheme", [(1280, "light"), (390, "dark")])
def test_its_chart_shows_the_files_numbers(browser, studies, width, scheme):
    with open_page(browser, studies, width, scheme) as page:
        assert page.locator("figure.chart .view svg").count() == 1
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        rows = pd.DataFrame(page.evaluate("wearscope.rows('sides-chart')"))
        found = rows.set_index(["side", "thing"])["value"].to_dict()
        assert found == {
            ("may/arm", "C"): 5.5,
            ("may/arm", "A"): 2.0,
            ("june/arm", "A"): 7.25,
            ("june/arm", "C"): 3.0,
        }


def test_settings_that_folders_record_are_compared(tmp_path):
    """A folder that records none differs in none; what only one concludes is counted, not told as changed."""
    left = write_study(tmp_path / "may", {"A": 2.0, "C": 5.5})
    right = write_study(tmp_path / "june", {"A": 2.0})
    page = tmp_path / "both.html"
    (left / ".study.json").write_text(json.dumps({"seed": 1, "snr": {"delta": 0.5, "f0": 2.0}}))
    outcome = call("compare", left, right, "--page", page)
    assert "1 conclusion in may only." in outcome.output and "none" not in outcome.output
    assert read_strip(page).caveat == "No setting that both record differs."
    (right / ".study.json").write_text(json.dumps({"seed": 1, "snr": {"delta": 0.75, "f0": 2.0}}))
    call("compare", left, right, "--page", page)
    text = read_text(page)
    assert (
        read_strip(page).caveat.startswith("1 setting differs")
        and "snr.delta" in text
        and "0.5 against 0.75" in text
    )
    (right / ".study.json").write_text("[]")
    with pytest.raises(InputError, match="holds no settings"):
        call("compare", left, right)


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
