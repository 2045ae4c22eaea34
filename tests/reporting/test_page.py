import base64
import re
from html.parser import HTMLParser

import numpy as np
import pandas as pd
import pytest

from wearscope.reporting.page import (
    Section,
    badge,
    embed_figure,
    format_number,
    render_page,
    render_table,
    unbreak,
)
from wearscope.reporting.style import figure_bytes, figure_style, new_figure, save_figure


class References(HTMLParser):
    """Everything that a page refers to, and its images."""

    def __init__(self, page):
        super().__init__()
        self.found, self.images, self.ids = [], [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.found += [named[name] for name in ("src", "href", "srcset", "data", "action") if name in named]
        self.ids += [named["id"]] if "id" in named else []
        if tag == "img":
            self.images.append(named)


def check_self_contained(page, beside=()):
    """A page refers to itself, to data and to some files beside it only, also within its images."""
    seen = References(page)
    assert seen.found
    for reference in seen.found:
        assert reference.startswith(("data:", "#")) or reference in beside, reference[:80]
        if reference.startswith("#"):
            assert reference[1:] in seen.ids
        if reference.startswith("data:image/svg+xml;base64,"):
            svg = base64.b64decode(reference.split(",", 1)[1]).decode()
            for inner in re.findall(r'href="([^"]*)"', svg):
                assert inner.startswith(("#", "data:"))
            assert "url(http" not in svg and "@import" not in svg
    written = re.sub(r"<script>.*?</script>", "", re.sub(r'"data:[^"]*"', "", page), flags=re.S)
    assert not re.search(r"url\(|@import|<script [^>]*src|<iframe|<object", written)
    assert len(seen.ids) == len(set(seen.ids))
    return seen


def make_figure():
    with figure_style():
        figure = new_figure(3, 2)
        ax = figure.subplots()
        ax.plot([1, 2, 3], [3, 1, 2])
        ax.set_title("a line")
    return figure


def test_page_is_self_contained_and_has_every_section(tmp_path):
    files = [tmp_path / "a.svg", tmp_path / "a.png"]
    save_figure(make_figure(), *files)
    sections = [
        Section("First & best", embed_figure(files[0], 'a "line"', "x < y"), "first-best"),
        Section("Second", embed_figure(files[1], "the same"), "second"),
        Section("Third", "<p>text</p>", anchor="own"),
    ]
    page = render_page("A <title>", sections, "about", "end")
    seen = check_self_contained(page)
    assert [image["alt"] for image in seen.images] == ['a "line"', "the same"]
    assert {"first-best", "second", "own"} <= set(seen.ids)
    assert "A &lt;title&gt;" in page and "x &lt; y" in page and "<p>text</p>" in page
    assert '<html lang="en">' in page and "viewport" in page


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_equal_figures_give_equal_bytes(kind):
    first, second = figure_bytes(make_figure(), kind), figure_bytes(make_figure(), kind)
    assert first == second
    assert b"dc:date" not in first and b"Matplotlib v" not in first


def test_figure_files_are_whole_and_embedded_as_they_are(tmp_path):
    paths = [tmp_path / "a" / "x.svg", tmp_path / "a" / "x.png"]
    save_figure(make_figure(), *paths)
    assert paths[0].read_bytes() == figure_bytes(make_figure(), "svg")
    assert paths[1].read_bytes().startswith(b"\x89PNG")
    assert base64.b64encode(paths[1].read_bytes()).decode() in embed_figure(paths[1], "x")
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["x.png", "x.svg"]


def test_missing_numbers_are_said_not_shown_as_zero():
    table = pd.DataFrame({"x": [1.5, np.nan, np.inf], "n": [1, 2, 12345], "t": ["<b>", None, "c"]})
    html = render_table(table, "caption & more")
    assert html.count("n/a") == 2 and "∞" in html and "12,345" in html
    assert "&lt;b&gt;" in html and "<b>" not in html and "caption &amp; more" in html


def test_badges_in_a_table_stay_html():
    table = pd.DataFrame({"verdict": pd.Series([badge("no & yes", "bad")], dtype=object)})
    assert '<span class="badge bad">no &amp; yes</span>' in render_table(table)


@pytest.mark.parametrize(
    "value, text",
    [
        (12345.6, "12,346"), (0.00123456, "0.00123"), (np.float64("nan"), "n/a"), (None, "n/a"),
        (np.int64(-3), "−3"), (0.0, "0"), (-np.inf, "−∞"), (1e-7, "1.00e−07"), (True, "yes"), ("s", "s"),
        (-0.0, "0"),
    ],
)  # fmt: skip
def test_numbers_are_written(value, text):
    assert format_number(value) == text


def test_numbers_stay_with_their_units():
    assert unbreak("96.5 % of 3 cells, 10 °C") == "96.5\u00a0% of 3 cells, 10\u00a0°C"
