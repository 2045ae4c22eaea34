"""The default study's own page in a headless browser, against the Parquet files that lie next to it.

``WEARSCOPE_RESULTS`` names another folder of results of the study than ``results/paper``.
"""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from reporting.browser import RUNNING_OVER, open_page, rows_of

from wearscope.evaluation.snr import answer_rows
from wearscope.reporting.labels import CELL, read_detector_names
from wearscope.storage import tables
from wearscope.storage.files import SETTINGS

ROOT = Path(__file__).parents[2]
RESULTS = Path(os.environ.get("WEARSCOPE_RESULTS", ROOT / "results" / "paper")).absolute()
KEYS = list(CELL)
CELL = {"robot": "large", "cycle": "spot_welding", "axis": 2, "fda": "C"}

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def file():
    path = RESULTS / "report.html"
    if not path.is_file():
        pytest.skip(f"{path} is not there: run the default study, or name its results by WEARSCOPE_RESULTS")
    return path


def read(name):
    return tables.read_table(RESULTS / f"{name}.parquet")


def check_same(shown, table, columns, keys=KEYS):
    """The same rows, their numbers to four digits; what is not finite is not shown as a number."""
    assert len(shown) == len(table) > 0
    shown = shown.astype({"axis": int}) if "axis" in keys else shown
    both = shown.merge(table, on=keys, suffixes=("", "_file"), validate="one_to_one")
    assert len(both) == len(table)
    for one, other in columns.items():
        other = f"{other}_file" if f"{other}_file" in both else other
        expected = both[other].to_numpy(dtype=float)
        expected = np.where(np.isfinite(expected), expected, np.nan)
        got = pd.to_numeric(both[one]).to_numpy(dtype=float)
        assert got == pytest.approx(expected, rel=1.01e-4, abs=1e-9, nan_ok=True), one


@pytest.mark.parametrize("width, scheme", [(1280, "light"), (1280, "dark"), (390, "light"), (390, "dark")])
def test_nothing_complains_and_every_chart_is_drawn(browser, file, width, scheme):
    assert file.stat().st_size <= 6e6
    with open_page(browser, file, width, scheme) as page:
        figures = page.locator("figure.chart:not(.empty)")
        assert figures.count() >= 7
        for place in range(figures.count()):
            drawn = figures.nth(place).locator(".view svg")
            assert drawn.count() == 1 and drawn.bounding_box()["width"] <= width
            assert drawn.locator("path, text").count() > 3
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(RUNNING_OVER) == []
        assert "(not asked)" not in page.locator("body").inner_text()


def test_numbers_of_every_cell_are_those_of_the_files(browser, file):
    with open_page(browser, file) as page:
        snr = {"snr": "snr_exact", "low": "snr_low", "high": "snr_high"}
        check_same(rows_of(page, "snr"), answer_rows(read("snr")).drop(columns="snr"), snr)
        shown = rows_of(page, "weights").astype({"axis": int})
        terms = read("surrogates")
        terms = terms[terms["model"] == "simplified"].set_index([*KEYS, "term"])["theta_normalised"]
        for term, name in (("w3", "temperature"), ("w5", "payload mass error")):
            own = shown[shown["term"] == name].set_index(KEYS)["weight"]
            expected = terms.xs(term, level="term").reindex(own.index)
            assert len(own) == len(answer_rows(read("snr")))
            assert own.to_numpy(float) == pytest.approx(expected.to_numpy(), rel=1e-3, abs=1e-9)


def test_one_cell_chosen_by_the_filters(browser, file):
    with open_page(browser, file) as page:
        for key, value in CELL.items():
            page.select_option(f".filters [name={key}]", str(value))
        page.wait_for_function("wearscope.rows('snr').length === 1")
        page.select_option("#response [data-key=factor]", "w3")

        def own(name):
            table = read(name)
            return table[(table[KEYS] == list(CELL.values())).all(axis=1) & (table["factor"] == "w3")]

        line = {"y": "y", "low": "low", "high": "high"}
        shown = rows_of(page, "response")
        expected = own("responses").assign(place=lambda t: t["natural"].round(6))
        shown = shown.assign(place=shown["natural"].astype(float).round(6))
        check_same(shown, expected.drop(columns="natural"), line, ["place"])
        scope = own("scope")
        scope = scope[scope["method"] == "exact"].sort_values(["delta", "sigma"])
        cells = rows_of(page, "scope").sort_values(["change", "sigma"], kind="stable")
        assert len(cells) == len(scope) == 900
        assert cells["p_d"].to_numpy(float) == pytest.approx(scope["p_d"].to_numpy(), abs=1.01e-4)
        assert cells["passes"].sum() == scope["passes"].sum()
        page.click(".filters .reset")
        page.wait_for_function(f"wearscope.rows('snr').length === {len(answer_rows(read('snr')))}")


def test_sentences_and_tables_say_what_the_files_say(browser, file):
    ranking = read("ranking").sort_values("rank")
    with open_page(browser, file) as page:
        text = page.locator("body").inner_text()
        rows = page.locator("#q2 tbody tr")
        shown = [row.split("\t")[0].strip() for row in rows.all_inner_texts()]
        names = read_detector_names(RESULTS / SETTINGS)
        assert shown[: len(ranking)] == [names[code] for code in ranking["fda"]]
        for code in ("σ of w3", "σ of w5", "first_reason"):
            assert code not in text, code
        for row in read("findings").itertuples():
            assert row.paper.split(".")[0] in text
