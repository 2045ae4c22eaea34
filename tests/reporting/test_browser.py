"""Pages in a headless browser: nothing complains, nothing is loaded, filters work, numbers are right."""

import csv
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pandas as pd
import pytest
from reporting.browser import RUNNING_OVER, find_browser, open_page, rows_of
from reporting.test_closed_loop_page import VERDICT, write

from wearscope.closed_loop.diagnostics.profiles import profile_residuals
from wearscope.reporting.charts.study import detection_cases, study_tables
from wearscope.reporting.closed_loop import STAGES
from wearscope.reporting.closed_loop_page import write_closed_loop_page
from wearscope.reporting.findings import compare_with_paper
from wearscope.reporting.labels import CELL
from wearscope.reporting.study_page import render_study
from wearscope.storage import tables

KEYS = list(CELL)
#: Texts of legends that leave their drawing, as a script.
CUT_LEGENDS = """[...document.querySelectorAll(".view svg .role-legend text")].filter((one) => {
    const [text, drawing] = [one, one.ownerSVGElement].map((it) => it.getBoundingClientRect());
    return text.right > drawing.right + 1 || text.left < drawing.left - 1;
}).map((one) => one.textContent)"""


@pytest.fixture(scope="module")
def file(asked, tmp_path_factory):
    find_browser()
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(render_study(asked, compare_with_paper(asked)), encoding="utf-8")
    return path


def check_equal(shown, table, keys):
    """Every row of a table is shown, with its numbers to five digits."""
    table = table.reset_index(drop=True)
    assert len(shown) == len(table)
    shown = shown.sort_values(keys, kind="stable").reset_index(drop=True)
    table = table.sort_values(keys, kind="stable").reset_index(drop=True)
    for name in table.columns:
        if pd.api.types.is_numeric_dtype(table[name]):
            expected = table[name].to_numpy(dtype=float)
            expected = np.where(np.isfinite(expected), expected, np.nan)
            got = pd.to_numeric(shown[name]).to_numpy(dtype=float)
            assert got == pytest.approx(expected, rel=1.01e-4 / 2, abs=1e-12, nan_ok=True), name
        else:
            assert shown[name].to_list() == table[name].astype(str).to_list(), name


@pytest.mark.parametrize("width, scheme", [(1280, "light"), (390, "dark")])
def test_every_chart_is_drawn_and_nothing_complains(browser, file, width, scheme):
    with open_page(browser, file, width, scheme) as page:
        count = page.locator("figure.chart").count()
        assert count >= 7
        for place in range(count):
            figure = page.locator("figure.chart").nth(place)
            assert figure.locator(".view svg").count() == 1
            assert figure.locator(".view svg path, .view svg text").count() > 3
            box = figure.locator(".view svg").bounding_box()
            assert box["width"] <= width and box["height"] > 40
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(RUNNING_OVER) == []
        assert page.evaluate(CUT_LEGENDS) == []


def test_numbers_shown_are_those_of_the_tables(browser, file, asked):
    drawn = study_tables(asked) | {"detection": detection_cases(asked)[0]}
    with open_page(browser, file) as page:
        check_equal(rows_of(page, "snr"), drawn["snr"], KEYS)
        assert (drawn["snr"]["snr"].to_numpy() == asked.snr["snr_exact"].to_numpy()).sum() >= 22
        check_equal(rows_of(page, "snr", "rankings"), drawn["rankings"], ["robot", "fda"])
        weights = drawn["weights"]
        check_equal(rows_of(page, "weights"), weights[weights["kind"] == "direct"], [*KEYS, "term"])
        for key, value in zip(KEYS, ("large", "b", "2", "A"), strict=True):
            page.select_option(f".filters [name={key}]", value)
        page.select_option("#response [data-key=factor]", "w3")
        own = (asked.responses[KEYS] == ["large", "b", 2, "A"]).all(axis=1)
        line = asked.responses[own & (asked.responses["factor"] == "w3")]
        check_equal(rows_of(page, "response"), line[["natural", "y", "low", "high"]], ["natural"])
        own = (asked.simulated[KEYS] == ["large", "b", 2, "A"]).all(axis=1)
        runs = asked.simulated[own & (asked.simulated["factor"] == "w3")]
        check_equal(
            rows_of(page, "response", "simulated"), runs[["natural", "y", "y_held"]], ["natural", "y"]
        )
        scope = asked.exact_scope("w3")
        scope = scope[(scope[KEYS] == ["large", "b", 2, "A"]).all(axis=1)]
        shown = rows_of(page, "scope")
        assert len(shown) == len(scope) == 20
        assert shown["passes"].sum() == scope["passes"].sum()
        assert shown["p_d"].to_numpy() == pytest.approx(scope["p_d"].to_numpy(), abs=1.01e-4)
        assert shown["change"].to_numpy() == pytest.approx(12.5 * scope["delta"].to_numpy(), rel=1e-4)


def test_detection_at_one_s_own_false_alarm(browser, file, asked):
    with open_page(browser, file) as page:
        page.select_option("#roc [data-key=case]", "w5:3")
        page.locator("#roc [data-key=change]").fill("2")
        page.wait_for_function("wearscope.rows('roc').every((row) => row.change === 50)")
        table = asked.detection
        wanted = (table["factor"] == "w5") & (table["sigma"] == 0.5) & (table["delta"] == 4.0)
        check_equal(rows_of(page, "roc"), table[wanted][[*KEYS, "p_f", "p_d", "threshold"]], [*KEYS, "p_f"])
        shown = table[wanted].drop_duplicates(KEYS)
        thin = page.locator("#roc .view path[stroke-width='1']")
        assert thin.count() < len(shown)
        page.select_option("#roc [data-key=lines]", "cells")
        page.wait_for_function(
            f"document.querySelectorAll(\"#roc .view path[stroke-width='1']\").length >= {len(shown)}"
        )


def test_filters_reach_charts_and_tables(browser, file, asked):
    with open_page(browser, file) as page:
        page.select_option(".filters [name=robot]", "large")
        page.select_option(".filters [name=fda]", "C")
        page.wait_for_function("wearscope.rows('snr').length === 4")
        assert set(rows_of(page, "weights")["robot"]) == {"large"}
        assert set(rows_of(page, "weights")["fda"]) == {"C"}
        assert "large" in page.locator("#response .shown").inner_text()
        assert "Friction fit (C)" in page.locator("#response .shown").inner_text()
        assert page.url.endswith("?robot=large&fda=C")
        assert page.locator(".filtered").is_visible()
        robots = page.locator("#summary tr[data-cell]:visible td:first-child").all_inner_texts()
        assert robots == ["large"]
        page.click(".filters .reset")
        page.wait_for_function("wearscope.rows('snr').length === 24")
        assert page.locator("#summary tr[data-cell]:visible").count() == 2
        assert "?" not in page.url and not page.locator(".filtered").is_visible()


def test_tables_sort_and_export(browser, file, asked, tmp_path):
    with open_page(browser, file) as page:
        section = page.locator("#q2")
        head = section.locator("th", has_text="median SNR")
        for order, step in (("ascending", 1), ("descending", -1)):
            head.locator("button").click()
            assert head.get_attribute("aria-sort") == order
            cells = section.locator("tbody tr td:nth-child(4)").all_inner_texts()
            values = [float(text.replace("−", "-").replace(",", "")) for text in cells]
            assert values == sorted(values)[::step]
        with page.expect_download() as waiting:
            page.click("#snr .csv")
        waiting.value.save_as(tmp_path / "snr.csv")
        with page.expect_download() as waiting:
            page.click("#snr .drawing")
        waiting.value.save_as(tmp_path / "snr.svg")
    with open(tmp_path / "snr.csv", encoding="utf-8-sig", newline="") as stream:
        saved = pd.DataFrame(list(csv.DictReader(stream)))
    table = study_tables(asked)["snr"]
    saved["axis"] = saved["axis"].astype(int)
    check_equal(saved.replace({"": None}), table, KEYS)
    drawing = ElementTree.parse(tmp_path / "snr.svg").getroot()
    assert drawing.tag.endswith("svg") and len(list(drawing.iter("{http://www.w3.org/2000/svg}path"))) > 20
    assert "var(" not in (tmp_path / "snr.svg").read_text()


def test_keys_read_values_zoom_and_theme(browser, file):
    with open_page(browser, file) as page:
        page.locator("#response .view").focus()
        page.keyboard.press("ArrowRight")
        assert page.locator("#response .readout").inner_text().startswith("1 of 9: ")
        page.keyboard.press("ArrowRight")
        assert page.locator("#response .readout").inner_text().startswith("2 of 9: ")
        page.click("#response .numbers")
        assert page.locator("#response .sheet tbody tr").count() == 9
        domain = "wearscope.charts.get('response').view.scale('x').domain()"
        wide = page.evaluate(domain)
        page.click("#response [data-zoom=in]")
        near = page.evaluate(domain)
        assert wide[0] < near[0] < near[1] < wide[1]
        page.click("#response [data-zoom=reset]")
        assert page.evaluate(domain) == wide
        ground = "getComputedStyle(document.documentElement).backgroundColor"
        light = page.evaluate(ground)
        page.click(".theme")
        page.click(".theme")
        assert page.locator(".theme").inner_text() == "Theme: dark" and page.evaluate(ground) != light


def test_the_pointer_tells_of_a_point(browser, file):
    with open_page(browser, file) as page:
        page.locator("#snr .view .mark-symbol path").first.hover(force=True)
        page.wait_for_selector("#vg-tooltip-element.visible")
        assert "test-cycle" in page.locator("#vg-tooltip-element").inner_text()


def test_it_prints(browser, file):
    with open_page(browser, file) as page:
        content = page.pdf(format="A4")
        assert content.startswith(b"%PDF") and content.count(b"/Type /Page\n") < 30


@pytest.mark.parametrize("width, height", [(718, 1047), (739, 979)], ids=["A4", "letter"])
def test_the_answer_prints_on_one_page(browser, file, width, height):
    """Width and height [px] within a browser's margins."""
    with open_page(browser, file, width) as page:
        page.emulate_media(media="print")
        end = page.evaluate("document.querySelector('.cards').getBoundingClientRect().bottom + scrollY")
        assert 500 < end <= height


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    """Folder of a loop made by hand, with its page."""
    find_browser()
    folder = tmp_path_factory.mktemp("loop")
    write(folder, VERDICT)
    residual = tables.read_table(folder / "residual.parquet")
    for stage in STAGES:
        residual[f"predicted_{stage}"] = residual["measured"] - residual[f"residual_{stage}"]
    tables.write_table(folder / "residual.parquet", residual)
    signals = tables.read_table(folder / "signals.parquet")
    tables.write_table(folder / "profiles.parquet", profile_residuals(residual, signals))
    write_closed_loop_page(folder)
    return folder


@pytest.mark.parametrize("width, scheme", [(1280, "dark"), (390, "light")])
def test_every_chart_of_a_loop_is_drawn(browser, loop, width, scheme):
    with open_page(browser, loop / "report.html", width, scheme) as page:
        assert page.locator("figure.chart .view svg").count() == 4
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_a_legend_is_whole_after_the_window_changed(browser, loop):
    inside = """(() => {
        const svg = document.querySelector("#errors-chart .view svg");
        const legend = svg.querySelector(".role-legend").getBoundingClientRect();
        return legend.height > 20 && legend.top >= svg.getBoundingClientRect().top;
    })()"""
    with open_page(browser, loop / "report.html", 360) as page:
        assert page.evaluate(inside)
        page.set_viewport_size({"width": 360, "height": 700})
        page.wait_for_timeout(600)
        assert page.evaluate(inside)


def test_legends_of_a_study_are_whole_after_the_phone_turned(browser, file):
    with open_page(browser, file, 844) as page:
        page.set_viewport_size({"width": 360, "height": 844})
        page.wait_for_function(f"{CUT_LEGENDS}.length === 0 && document.querySelector('#friction svg')")
        page.wait_for_timeout(1500)
        assert page.evaluate(CUT_LEGENDS) == []


def test_numbers_of_a_loop_are_those_of_its_tables(browser, loop):
    residual = tables.read_table(loop / "residual.parquet")
    profiles = tables.read_table(loop / "profiles.parquet")
    own = residual[(residual["joint"] == "b") & (residual["run"] == "runs/r2.parquet")]
    counted = own["counts"].to_numpy(dtype=bool)
    with open_page(browser, loop / "report.html") as page:
        page.select_option(".filters [name=joint]", "b")
        page.select_option(".filters [name=run]", "runs/r2.parquet")
        columns = ["t", "measured", "predicted_before", "predicted_after"]
        check_equal(rows_of(page, "torque")[columns], own[columns], ["t"])
        shown = rows_of(page, "residual-chart")
        expected = np.where(counted, own["residual_after"], np.nan)
        assert shown["residual_after"].to_numpy(float) == pytest.approx(expected, rel=1e-4, nan_ok=True)
        page.select_option("#against [data-key=choice]", "load")
        lines = profiles[(profiles["joint"] == "b") & (profiles["signal"] == "load_b")]
        shown = rows_of(page, "against", "profiles")
        check_equal(shown, lines[["stage", "x", "median", "low", "high", "n"]], ["stage", "x"])
        title = page.locator("#against .view svg").text_content()
        assert "rigid-body torque of b [N m]" in title and "residual [N m]" in title
        errors = rows_of(page, "errors-chart").set_index("kind")
        assert errors.loc["before", "value"] == 1.5 and errors.loc["after", "value"] == 1.6
        assert "noise floor" not in errors.index
        assert set(page.locator("#errors tr[data-cell]:visible td:first-child").all_inner_texts()) == {"b"}


FINISHED = sorted(Path("results").glob("*/report.html")) + sorted(
    Path("results").glob("*/closed_loop/*/report.html")
)


@pytest.mark.parametrize("path", FINISHED, ids=str)
def test_pages_of_finished_studies_open(browser, path):
    if 'id="settings"' not in path.read_text(encoding="utf-8"):
        pytest.skip("made by an earlier release")
    assert path.stat().st_size <= 6e6
    with open_page(browser, path.absolute()) as page:
        charts = page.locator("figure.chart:not(.empty)").count()
        assert page.locator("figure.chart .view svg").count() == charts > 0
