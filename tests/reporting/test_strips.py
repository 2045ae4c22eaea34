"""The strip on top of pages: read back as people see it, on every kind of page; history of a folder."""

import json
import os
import re
import shutil
from dataclasses import replace
from html import unescape

import numpy as np
import pandas as pd
import pytest
from reporting.test_closed_loop_page import VERDICT, write
from reporting.test_page import check_self_contained
from reporting.test_study_page import VERDICT as TWIN
from reporting.test_tracking_page import write as write_tracked

from wearscope.reporting.closed_loop import read_closed_loop
from wearscope.reporting.closed_loop_page import render_closed_loop
from wearscope.reporting.detection_page import Detections, conclude, detection_strip, read_detections
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.history_page import KEPT, find_answers, keep_answer, render_history, trend_table
from wearscope.reporting.page import Section, render_page
from wearscope.reporting.page_strip import Strip, read_strip
from wearscope.reporting.study_page import render_study
from wearscope.reporting.study_words import certainty, study_strip
from wearscope.storage.tables import write_table


def text_of(page):
    """What a page shows, without scripts and styles; marks within a line leave no gap."""
    page = re.sub(r"(?s)<(script|style|pre)\b.*?</\1>", "", page)
    page = re.sub(r"</?(?:a|b|code|span|strong)\b[^>]*>", "", page)
    return unescape(re.sub(r"<[^>]+>", " ", page))


@pytest.fixture(scope="module")
def makers(asked, tmp_path_factory):
    """What makes a page anew, by kind."""
    loop, tracked = tmp_path_factory.mktemp("loop"), tmp_path_factory.mktemp("tracked")
    write(loop, VERDICT)
    with_loop = replace(asked, loops={"twin": TWIN}, planted={"planted": []})
    return {
        "study": lambda: render_study(with_loop, compare_with_paper(with_loop)),
        "loop": lambda: render_closed_loop(read_closed_loop(loop)),
        "tracking": lambda: write_tracked(tracked),
    }


@pytest.fixture(scope="module")
def pages(makers):
    """A page by kind."""
    return {kind: make() for kind, make in makers.items()}


KINDS = ("study", "loop", "tracking")


@pytest.mark.parametrize("kind", KINDS)
def test_every_page_stands_alone_and_is_the_same_for_the_same_files(pages, makers, kind):
    page = pages[kind]
    beside = ("model_after.yaml", "closed_loop/twin/report.html")
    seen = check_self_contained(page, beside)
    assert all(image["alt"] for image in seen.images)
    assert not re.search(r"<(by|were|this|zero|1)>", re.sub(r"(?s)<script\b.*?</script>", "", page))
    assert makers[kind]() == page


@pytest.mark.parametrize("kind", KINDS)
def test_no_markup_no_stray_punctuation_and_no_nan_is_shown(pages, kind):
    # What the planted names hold is escaped on purpose.
    shown = re.sub("<(by|were|this|zero|1)>", "", text_of(pages[kind]))
    assert not re.search(r"</?(span|a|b|p|div|strong)\b", shown)
    assert not re.search(r"\bnan\b|\bNaN\b|\bNone\b(?!:)", re.sub(r"None: the|None was", "", shown))
    assert not re.search(r"(^|\s)[;,](\s|$)|\.\.(?!\.)|,\s*,|\(\s*\)", shown)


@pytest.mark.parametrize("kind", KINDS)
def test_the_strip_has_no_code_and_no_equation(pages, kind, tmp_path):
    page = tmp_path / "report.html"
    page.write_text(pages[kind], encoding="utf-8")
    strip = read_strip(page)
    for text in (strip.answer, strip.sure, strip.caveat, strip.action):
        assert text and not re.search(r"\(\d+\)|\b[0-9a-f]{7,}\b|\bw\d\b|P_[fd]|Q-\d", text)
    assert strip.kind in ("good", "unsure", "bad")


def numbers_of(text):
    found = re.findall(r"\d[\d,]*\.?\d*", text)
    return [float(one.replace(",", "").rstrip(".")) for one in found]


def shown(strip, folder):
    """A strip as a reader of its page sees it."""
    page = folder / "report.html"
    page.write_text(render_page("t", [Section("s", "b", "s")], strip=strip), encoding="utf-8")
    return read_strip(page)


@pytest.mark.parametrize("robot", ["", "medium", "large"])
def test_a_study_s_strip_is_its_conclusion(asked, robot, tmp_path):
    one = next(one for one in asked.conclusions if one.robot == robot)
    strip = shown(study_strip(replace(asked, conclusions=[one], audit_answers=None)), tmp_path)
    if not one.detector:
        assert strip.kind == "bad" and "No detector can be recommended" in strip.answer
        return
    assert f"({one.detector})" in strip.answer
    if np.isnan(one.wear):
        assert "no change of wear" in strip.answer
        return
    told = numbers_of(strip.answer)
    assert float(f"{one.wear:.2g}") in told
    assert all(float(f"{1.96 * bound.sigma:.2g}") in told for bound in one.bounds)
    sure = numbers_of(strip.sure)
    assert {100 * one.p_f, 100 * one.p_d, one.agree, one.resamplings, one.cells_first} <= set(sure)
    assert strip.kind == certainty(asked, one)


def detections(verdicts, wear_detected=(12.0,), one=False):
    """A recording for each verdict of one joint and detector, or one with all verdicts."""
    rows = [
        {"run": "r0" if one else f"r{k}", "kind": "judged", "joint": "a", "fda": "C", "verdict": verdict}
        | {"session": "day" if verdict == "unchecked" and not one else "", "wear": 21.0, "warmer": 3.0}
        for k, verdict in enumerate(verdicts)
    ]
    judged = {"joints": 1, "of": 3, "seconds": 12.3, "refused": ["r9: of another motion"]}
    summary = {"setting": {"p_f": 0.02}, "judged": judged, "refused": [{"run": "r9"}]}
    thresholds = pd.DataFrame({"motion": "m", "joint": "a", "wear_detected": list(wear_detected)})
    return Detections(summary, pd.DataFrame(rows), thresholds, pd.DataFrame())


DETECTIONS = {
    "alarm": (["alarm", "no alarm"], {}),
    "no alarm": (["no alarm", "no alarm"], {}),
    "one is withheld": (["withheld", "no alarm"], {}),
    "none can be judged": (["withheld", "failed"], {}),
    "a threshold is not confirmed": (["unchecked", "no alarm"], {}),
    "detectors differ in the wear that they see": (["no alarm"], {"wear_detected": [12.0, 30.0]}),
    "no wear would have been seen": (["no alarm"], {"wear_detected": [np.nan, np.nan]}),
    "a recording has two verdicts": (["no alarm", "unchecked"], {"one": True}),
}


@pytest.mark.parametrize("case", DETECTIONS)
def test_a_detection_is_concluded_by_its_verdicts(case, tmp_path, says):
    verdicts, more = DETECTIONS[case]
    found = detections(verdicts, **more)
    strip = shown(detection_strip(found), tmp_path)
    told = [f"{kind}: {sentence}" for kind, sentence in conclude(found)]
    says(case, strip.kind, strip.answer, strip.sure, strip.caveat, strip.action, *told)


def test_recordings_of_which_the_same_is_said_share_a_sentence_with_the_detector_s_name(tmp_path):
    tables = {"detection": ["withheld", "no alarm", "withheld"], "thresholds": [], "simulated": []}
    for name, verdicts in tables.items():
        rows = {"run": [f"r{k}" for k in range(len(verdicts))], "verdict": verdicts}
        rows |= dict.fromkeys(("session", "kind", "joint", "fda"), "")
        table = pd.DataFrame(rows).assign(kind="judged", joint="a", fda="C")
        write_table(tmp_path / f"{name}.parquet", table)
    summary = {"detectors": {"C": "friction_fit"}}
    (tmp_path / "detection.json").write_text(json.dumps(summary), encoding="utf-8")
    (first, second) = conclude(read_detections(tmp_path))
    assert first[0] == "notice" and first[1].startswith("r0 and r2: not decided.")
    assert first[1].endswith("Friction fit (C) at a.") and second == ("plain", "r1: no alarm.")


def test_what_is_read_is_what_was_written(tmp_path):
    strip = Strip("Use <A> & B.", "unsure", "Sure at 95 %.", "", "Do it.")
    page = tmp_path / "report.html"
    page.write_text(render_page("t", [Section("s", "b", "s")], strip=strip), encoding="utf-8")
    assert read_strip(page) == strip
    page.write_text(render_page("t", [Section("s", "b", "s")]), encoding="utf-8")
    assert read_strip(page) is None


def write_verdict(folder, when, error, answer, joint="j1"):
    """A diagnosis of a joint, written at a time."""
    folder.mkdir(parents=True)
    (folder / "verdict.json").write_text(json.dumps({"joints": {joint: {"rms_after": error}}, "verdict": []}))
    page = folder / "report.html"
    strip = Strip(answer, "good", "Sure.", "", "Next.")
    page.write_text(render_page("t", [Section("s", "b", "s")], strip=strip), encoding="utf-8")
    os.utime(page, (when, when))


def test_a_folder_s_answers_are_listed_newest_first_with_their_trend(tmp_path):
    write_verdict(tmp_path / "closed_loop" / "may", 1_000_000, 4.0, "May.")
    write_verdict(tmp_path / "closed_loop" / "june", 2_000_000, 2.5, "June.")
    found = find_answers(tmp_path)
    assert [one.strip.answer for one in found] == ["June.", "May."]
    assert {one.kind for one in found} == {"diagnosis"}
    assert trend_table(found)["value"].to_list() == [2.5, 4.0]
    page = render_history(tmp_path, found)
    assert page.index("closed_loop/june") < page.index("closed_loop/may")
    assert 'href="closed_loop/may/report.html"' in page and 'id="trend-0-chart"' in page
    assert "&lt;a" not in page


def test_errors_of_two_machines_are_not_drawn_on_one_axis(tmp_path):
    for k, joint in enumerate(("j1", "a1", "j1", "a1")):
        write_verdict(tmp_path / f"day{k}", 1_000_000 + k, 100.0 ** (joint == "a1"), "Day.", joint)
    page = render_history(tmp_path, find_answers(tmp_path))
    assert page.count('class="chart"') == 2


def test_what_is_written_over_stays_in_the_history_once(tmp_path):
    folder = tmp_path / "closed_loop" / "arm"
    write_verdict(folder, 1_000_000, 4.0, "May.")
    for _ in range(2):
        keep_answer(tmp_path, folder / "report.html", "seed: 1")
    assert len((tmp_path / KEPT).read_text().splitlines()) == 1
    shutil.rmtree(folder)
    write_verdict(folder, 2_000_000, 2.5, "June.")
    keep_answer(tmp_path, folder / "report.html", "seed: 2")
    keep_answer(tmp_path, tmp_path / "none" / "report.html", "seed: 2")
    found = find_answers(tmp_path)
    assert [(one.strip.answer, one.path) for one in found] == [
        ("June.", "closed_loop/arm/report.html"), ("May.", ""),
    ]  # fmt: skip
    assert trend_table(found)["value"].to_list() == [2.5, 4.0]
    old = found[1]
    assert len(old.settings) == 12 and old.version and old.name == "closed_loop/arm"
    page = render_history(tmp_path, found)
    assert "May." in page and page.count("<a href=") >= 1
    with open(tmp_path / KEPT, "a") as file:
        file.write("no line\n[1, 2]\n{}\n")
    assert len(find_answers(tmp_path)) == 2
