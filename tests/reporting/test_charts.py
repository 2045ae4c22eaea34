import base64
import gzip
import json
import re
from dataclasses import replace

import altair as alt
import numpy as np
import pandas as pd
import pytest

from wearscope.reporting.charts.base import Choice, chart_library, pack_table, round_digits
from wearscope.reporting.charts.encoding import symlog
from wearscope.reporting.charts.study import (
    ALL_ROBOTS,
    chart_roc,
    chart_scope,
    chart_snr_cells,
    detection_cases,
    study_filters,
    study_labels,
    study_tables,
)
from wearscope.reporting.labels import quantity_text, term_name
from wearscope.reporting.page import Section, embed_chart, embed_json, render_page
from wearscope.reporting.study_page import render_study


def unpack_table(text):
    """Values by column, as a page's script reads them."""
    columns = json.loads(gzip.decompress(base64.b64decode(text)))["columns"]
    return {
        name: [column["values"][code] for code in column["codes"]] if isinstance(column, dict) else column
        for name, column in columns.items()
    }


def test_tables_keep_their_numbers_to_five_digits_and_what_is_missing():
    table = pd.DataFrame(
        {"x": [1.23456789, np.nan, -np.inf, 0.0], "n": [1, 2, 3, 4], "t": ["b", "a", "</script>", "b"],
         "flag": [True, False, True, True]}
    )  # fmt: skip
    read = unpack_table(pack_table(table))
    assert read["x"] == [1.2346, None, None, 0.0]
    assert read["n"] == [1, 2, 3, 4] and read["flag"] == [1, 0, 1, 1]
    assert read["t"] == ["b", "a", "</script>", "b"]
    assert pack_table(table) == pack_table(table)


@pytest.mark.parametrize("digits", [3, 5])
def test_rounding_is_that_of_the_decimal(digits):
    rng = np.random.default_rng(4)
    values = rng.standard_normal(3000) * 10.0 ** rng.integers(-9, 12, 3000)
    assert round_digits(values, digits) == [float(f"{value:.{digits}g}") for value in values]


def test_json_within_a_script_cannot_end_it():
    text = embed_json({"a": "</script><b>"})
    assert "<" not in text and json.loads(text) == {"a": "</script><b>"}
    assert "</script" not in chart_library()


def test_a_page_without_charts_carries_no_library(asked):
    plain = render_page("t", [Section("a", "<p>b</p>", "a")])
    assert len(plain) < 40_000 and "vegaEmbed=" not in plain
    chart = embed_chart(chart_scope(asked, {}))
    page = render_page("t", [Section("a", chart, "a")], tables={"scope": study_tables(asked)["scope"]})
    assert chart_library() in page


def test_choices_know_their_default():
    choice = Choice("k", "label", [(1, "one"), (2.5, "two")], default=2.5)
    assert (choice.place, choice.options) == (1, [(1, "one"), (2.5, "two")])
    assert Choice("k", "label", [(1, "one")], default=9).place == 0


def test_filters_are_what_the_study_has(asked):
    filters = {one.key: [value for value, _ in one.options] for one in study_filters(asked)}
    assert filters == {
        "robot": ["large", "medium"], "cycle": ["a", "b"], "axis": ["1", "2"], "fda": ["A", "B", "C"]
    }  # fmt: skip
    labels = study_labels(asked)
    assert labels["factor"]["w3"] == "temperature [°C]" and labels["factor.name"]["f"] == "wear"
    assert labels["fda.y"] == {
        "A": "test quantity of Residual energy (A)",
        "B": "test quantity of Distribution distance (B)",
        "C": "test quantity of Friction fit (C) [N m]",
    }


def test_robots_stand_side_by_side_with_all_together(asked):
    table = study_tables(asked)["rankings"]
    assert sorted(table["robot"].unique()) == [ALL_ROBOTS, "large", "medium"]
    page = render_study(asked, [])
    assert "Robots side by side" in page


def test_every_source_of_a_chart_is_a_table_of_the_page(asked):
    page = render_study(asked, [])
    tables = set(re.findall(r'class="data" data-name="(\w+)"', page))
    definitions = re.findall(r'class="definition">(.*?)</script>', page)
    assert len(definitions) >= 7
    for text in definitions:
        definition = json.loads(text)
        alt.Chart.from_dict(definition["spec"])  # keeps to Vega-Lite's schema
        for name, source in definition["sources"].items():
            assert source["table"] in tables
            assert f'"name":"{name}"' in json.dumps(definition["spec"], separators=(",", ":"))
    # Nothing rides along that no chart draws.
    assert tables == {s["table"] for text in definitions for s in json.loads(text)["sources"].values()}


def test_the_roc_begins_at_the_conclusion_s_variation_where_detectors_differ_most(asked):
    table, choices = detection_cases(asked)
    case, change = choices
    bound = asked.conclusions[0].bounds[0]
    assert case.default.startswith(f"{bound.factor}:")
    at = table[(table["case"] == case.default) & np.isclose(table["p_f"], asked.config["scope"]["p_f"])]
    spread = {}
    for value, _ in change.options:
        medians = at[at["change"] == value].groupby("fda")["p_d"].median()
        spread[value] = np.ptp(medians.drop(asked.upper(), errors="ignore"))
    assert spread[change.default] == max(spread.values()) > 0
    assert json.dumps(chart_roc(asked, choices).definition())


def test_an_upper_bound_does_not_choose_where_the_roc_begins(asked):
    rows = asked.detection
    bound = rows["fda"].eq("A") & rows["delta"].eq(rows["delta"].max())
    bent = replace(asked, detection=rows.assign(p_d=rows["p_d"].where(~bound, -100.0)))
    told = replace(bent, conclusions=[replace(asked.conclusions[0], upper=["A"])])
    begins = [detection_cases(one)[1][1].default for one in (bent, told)]
    assert begins[0] == max(detection_cases(bent)[0]["change"]) != begins[1]


def test_narrow_columns_have_letters_and_their_legend_few_digits(asked):
    spec = json.dumps(chart_snr_cells(asked).definition()["spec"])
    assert "width < 225 ? datum.label : split(" in spec and "'.3~g'" in spec


def test_terms_and_quantities_are_words(study):
    assert term_name("w3^2", study.factors) == "temperature²"
    assert term_name("f:w3", study.factors) == "wear × temperature"
    assert quantity_text(4.04, "degC") == "4 °C" and quantity_text(-1234.5, "1") == "−1,234"
    assert quantity_text(0.0123, "N m") == "0.012 N m"


def test_numbers_next_to_nothing_are_shown_as_zero():
    frame = pd.DataFrame({"x": [5e-324, -3e-310, 1e-200, 1.5e300, np.inf]})
    assert unpack_table(pack_table(frame))["x"] == [0.0, 0.0, 1e-200, 1.5e300, None]


def test_an_axis_of_ratios_has_ticks_on_both_sides_of_one():
    axis = symlog("snr:Q", "signal-to-noise ratio").to_dict()["axis"]
    assert {0.5, 1, 2, 5, 10} <= {*axis["values"]} and axis["format"] == ",.2~r"
