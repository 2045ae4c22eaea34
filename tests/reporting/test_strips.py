"""The strip on top of pages: read back as people see it, on every kind of page; history of a folder."""

import json
import os
import re
from html.parser import HTMLParser

import pytest
from reporting.test_closed_loop_page import VERDICT, write

from wearscope.reporting.closed_loop import read_closed_loop
from wearscope.reporting.closed_loop_page import render_closed_loop
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.history_page import find_answers, render_history, trend_table
from wearscope.reporting.page import Section, Strip, read_strip, render_page
from wearscope.reporting.study_page import render_study


class Text(HTMLParser):
    """What a page shows: its text without scripts and styles."""

    def __init__(self, page):
        super().__init__()
        self.said, self.hidden = [], 0
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.hidden += tag in ("script", "style", "pre")
        if tag not in ("a", "b", "code", "span", "strong"):
            self.said.append(" ")

    def handle_endtag(self, tag):
        self.hidden -= tag in ("script", "style", "pre")

    def handle_data(self, data):
        if not self.hidden:
            self.said.append(data)


@pytest.fixture(scope="module")
def pages(asked, tmp_path_factory):
    """Text of a page by kind."""
    folder = tmp_path_factory.mktemp("loop")
    write(folder, VERDICT)
    return {
        "study": render_study(asked, compare_with_paper(asked)),
        "loop": render_closed_loop(read_closed_loop(folder)),
    }


@pytest.mark.parametrize("kind", ["study", "loop"])
def test_no_markup_no_stray_punctuation_and_no_nan_is_shown(pages, kind):
    text = "".join(Text(pages[kind]).said)
    # What the planted names hold is escaped on purpose.
    shown = text.replace("<by>", "").replace("<were>", "").replace("<zero>", "")
    assert not re.search(r"</?(span|a|b|p|div|strong)\b", shown)
    assert not re.search(r"\bnan\b|\bNaN\b|\bNone\b(?!:)", re.sub(r"None: the|None was", "", shown))
    assert not re.search(r"(^|\s)[;,](\s|$)|\.\.(?!\.)|,\s*,|\(\s*\)", shown)


@pytest.mark.parametrize("kind", ["study", "loop"])
def test_the_strip_has_no_code_and_no_equation(pages, kind, tmp_path):
    page = tmp_path / "report.html"
    page.write_text(pages[kind], encoding="utf-8")
    strip = read_strip(page)
    for text in (strip.answer, strip.sure, strip.caveat, strip.action):
        assert text and not re.search(r"\(\d+\)|\b[0-9a-f]{7,}\b|\bw\d\b|P_[fd]|Q-\d", text)
    assert strip.kind in ("good", "unsure", "bad")


def test_what_is_read_is_what_was_written(tmp_path):
    strip = Strip("Use <A> & B.", "unsure", "Sure at 95 %.", "", "Do it.")
    page = tmp_path / "report.html"
    page.write_text(render_page("t", [Section("s", "b")], strip=strip), encoding="utf-8")
    assert read_strip(page) == strip
    page.write_text(render_page("t", [Section("s", "b")]), encoding="utf-8")
    assert read_strip(page) is None


def write_verdict(folder, when, error, answer):
    """A diagnosis of a joint, written at a time."""
    folder.mkdir(parents=True)
    (folder / "verdict.json").write_text(json.dumps({"joints": {"j1": {"rms_after": error}}}))
    page = folder / "report.html"
    strip = Strip(answer, "good", "Sure.", "", "Next.")
    page.write_text(render_page("t", [Section("s", "b")], strip=strip), encoding="utf-8")
    os.utime(page, (when, when))


def test_a_folder_s_answers_are_listed_newest_first_with_their_trend(tmp_path):
    write_verdict(tmp_path / "closed_loop" / "may", 1_000_000, 4.0, "May.")
    write_verdict(tmp_path / "closed_loop" / "june", 2_000_000, 2.5, "June.")
    found = find_answers(tmp_path)
    assert [one.strip.answer for one in found] == ["June.", "May."]
    assert {one.kind for one in found} == {"diagnosis"}
    assert trend_table(tmp_path, found)["value"].to_list() == [2.5, 4.0]
    page = render_history(tmp_path, found)
    assert page.index("closed_loop/june") < page.index("closed_loop/may")
    assert 'href="closed_loop/may/report.html"' in page and 'id="trend-chart"' in page
    assert "&lt;a" not in page
