"""Charts of a study's questions: factors (Q-1), detectors (Q-2) and scope (Q-3)."""

import json
from collections.abc import Mapping
from typing import Any

import altair as alt
import numpy as np

from wearscope.reporting.charts.base import BY_CELL, Chart, Choice, Source
from wearscope.reporting.charts.encoding import (
    add_zoom,
    cell_tips,
    detector_axis,
    detector_rows,
    detector_tint,
    named,
    offset,
    rows,
    symlog,
    tint,
    tips,
)
from wearscope.reporting.charts.study import together
from wearscope.reporting.labels import factor_name, with_unit
from wearscope.reporting.study import Study

KINDS = (("direct", "direct effects"), ("interaction", "interactions"), ("square", "squares"))
_SNR = "snr:Q|SNR|.3; low:Q|95 % from|.3; high:Q|to|.3; status:N"
#: An SNR in few characters, for cells that are narrow on a phone: 2.2k, 655, 73.0, 5.39.
_SIZE = "abs(datum.snr)"
_SHORT = (
    f"!isValid(datum.snr) ? '' : format(datum.snr, {_SIZE} >= 1000 ? '.2s' : {_SIZE} >= 100 ? '.0f' : "
    f"{_SIZE} >= 10 ? '.1f' : '.2f')"
)


def _is_upper(study: Study) -> str:
    """Expression that is true of detectors that are told the simulator's law."""
    return f"indexof({json.dumps(study.upper())}, datum.fda) >= 0"


def chart_weights(study: Study) -> Chart:
    """Every cell's coefficients over that of wear, by factor and detector."""
    names = study.detector_names()
    base = named("weights").encode(
        y=rows("term:N"), yOffset=offset("fda:N", names), color=detector_tint(names)
    )
    band = alt.Chart(alt.InlineData([{"low": -1, "high": 1}])).mark_rect(color="var(--line)", opacity=0.45)
    points = base.mark_circle(opacity=0.65).encode(
        x=symlog("weight:Q", "coefficient (wear: 1)", (1, 2, 5)), tooltip=cell_tips("term:N; weight:Q||.3")
    )
    median = base.mark_tick(thickness=2.5, size=13).encode(
        x=alt.X("median(weight):Q", title="coefficient (wear: 1)"),
        color=alt.value("var(--ink)"),
        detail="fda:N",
        tooltip=tips("median(weight):Q|median|.3; fda:N|detector"),
    )
    spec = alt.layer(band.encode(x="low:Q", x2="high:Q"), points, median)
    return Chart(
        "weights",
        "How much each factor weighs relative to wear",
        spec.properties(width="container", height={"step": 13 if len(names) > 2 else 18}),
        {"weights": Source("weights", {"kind": "kind", **BY_CELL})},
        "A point is a cell: what a step of the factor does to y, over what the same step of wear does. "
        "Dark ticks: medians of what is shown. Beyond the grey band a factor weighs more than wear; the "
        "scale turns logarithmic there.",
        [Choice("kind", "Show", KINDS)],
    )


def chart_response(study: Study, first: Mapping[str, str]) -> Chart:
    """Test quantity of a cell over a factor: surrogate, interval, simulated runs."""
    x = alt.X("natural:Q", title="⟦factor⟧", scale=alt.Scale(zero=False))
    lines = named("responses").encode(x=x)
    band = lines.mark_area(opacity=0.2, color="var(--c0)").encode(
        y=alt.Y("low:Q", title="⟦fda.y⟧", scale=alt.Scale(zero=False)), y2="high:Q"
    )
    told = tips("natural:Q|⟦factor⟧|.4; y:Q|surrogate|.4; low:Q||.4; high:Q||.4")
    line = lines.mark_line(color="var(--c0)").encode(y="y:Q", tooltip=told)
    tints = alt.Scale(range=["var(--c1)", "var(--c2)", "var(--c5)", "var(--c3)"])
    told = tips(
        "set:N|run of; natural:Q|⟦factor⟧|.4; y:Q|y as simulated|.4; y_held:Q|y, others at nominal|.4"
    )
    points = (
        named("simulated")
        .transform_calculate(shown="held == 'y' ? datum.y : datum.y_held")
        .mark_circle(opacity=0.7)
        .encode(x=x, y="shown:Q", color=alt.Color("set:N", title="simulated for", scale=tints), tooltip=told)
    )
    held = alt.param(name="held", value="y_held")
    layered, fields = add_zoom(alt.layer(band, line, points).add_params(held), "natural", "low")
    by = {"factor": "factor", **BY_CELL}
    return Chart(
        "response",
        "The test quantity over each factor",
        layered.properties(width="container", height=330),
        {"responses": Source("responses", by), "simulated": Source("simulated", by)},
        "Line: the surrogate that answers, with the other factors at nominal. Band: where 95 % of new runs "
        "should lie. Points: simulated runs, moved by the surrogate to nominal levels of their other "
        "factors, or as they were simulated.",
        [
            Choice("factor", "Over", [(one.name, factor_name(one)) for one in study.factors]),
            Choice("held", "Points", [("y_held", "other factors at nominal"), ("y", "as simulated")]),
        ],
        [*BY_CELL],
        first,
        fields,
    )


def chart_snr(study: Study) -> Chart:
    """Every cell's SNR by detector and robot, with medians and their intervals."""
    robots = sorted(study.snr["robot"].unique())
    tints = {robot: f"var(--c{k % 6})" for k, robot in enumerate(robots)}
    tints.setdefault(together(study), "var(--ink)")
    look: dict[str, Any] = {
        "y": detector_rows(study.detector_names()),
        "yOffset": offset("robot:N", tints),
        "color": tint("robot:N", tints),
    }
    cells = named("snr").transform_filter(f"!({_is_upper(study)})").mark_circle(opacity=0.6)
    points = cells.encode(x=symlog("snr:Q", "signal-to-noise ratio"), tooltip=cell_tips(_SNR), **look)
    told = "fda:N|detector; robot:N; median:Q|median SNR|.3; low:Q|95 % from|.3; high:Q|to|.3; rank:Q"
    ranks = named("rankings").encode(tooltip=tips(told), **look)
    dash = alt.condition(_is_upper(study), alt.value([4, 3]), alt.value([1, 0]))
    spans = ranks.mark_rule(strokeWidth=5, opacity=0.35).encode(x="low:Q", x2="high:Q", strokeDash=dash)
    medians = ranks.mark_tick(thickness=3, size=14).encode(x="median:Q")
    zero = alt.Chart(alt.InlineData([{"snr": 0}])).mark_rule(color="var(--soft)").encode(x="snr:Q")
    spec = alt.layer(zero, points, spans, medians)
    upper = (
        " Dashed: an upper bound, told the simulator's own law; its cells are below." if study.upper() else ""
    )
    return Chart(
        "snr",
        "Signal-to-noise ratio of every cell",
        spec.properties(width="container", height={"step": max(16, 54 // len(tints))}),
        {"snr": Source("snr", BY_CELL), "rankings": Source("rankings", {"robot": "robot", "fda": "fda"})},
        "A point is a cell; marks and bars: medians with 95 % intervals over all test-cycles and axes of the "
        f"study. Below 0 the test quantity falls with wear.{upper}",
    )


def chart_snr_cells(study: Study) -> Chart:
    """SNR of every cell as a heat map."""
    top = detector_axis(study.detector_names())
    base = named("snr").encode(x=alt.X("fda:N", title=None, axis=top), y=rows("place:N"))
    own = study.snr.loc[~study.snr["fda"].isin(study.upper()), "snr_exact"].replace([np.inf, -np.inf], np.nan)
    most = float(own.abs().max()) if own.notna().any() else 1.0
    # The colours are those of what can be deployed; without a negative value they begin at 0.
    ends, tints = ([0.0, most], ["#f1f1f0", "#2166ac"])
    if (own < 0).any():
        ends, tints = ([-most, *ends], ["#b35806", *tints])
    legend = alt.Legend(labelExpr="format(datum.value, abs(datum.value) >= 1000 ? '.2~s' : '.3~g')")
    scale = alt.Scale(type="symlog", domain=ends, range=tints, clamp=True)
    colour = alt.Color("snr:Q", title="SNR", scale=scale, legend=legend)
    cells = base.mark_rect().encode(
        color=alt.condition(_is_upper(study), alt.value("transparent"), colour), tooltip=cell_tips(_SNR)
    )
    dark = {"test": f"abs(datum.snr) > {0.25 * most:.4g}", "value": "white"}
    ink = {"condition": [{"test": _is_upper(study), "value": "var(--ink)"}, dark], "value": "#222"}
    text = base.transform_calculate(short=_SHORT).mark_text(fontSize=10).encode(text="short:N", color=ink)
    return Chart(
        "snr-cells",
        "Cell by cell",
        alt.layer(cells, text).properties(width="container", height={"step": 20}),
        {"snr": Source("snr", BY_CELL)},
        "Test-cycle, axis and robot down. Empty: the detector always says the same, or the robot's model has "
        "no noise." + (" Without colour: an upper bound." if study.upper() else ""),
    )


def chart_reach(study: Study, shifts: Mapping[str, float]) -> Chart:
    """Each detector's smallest wear over how far a factor varies, set against a shift.

    Parameters
    ----------
    study : Study
    shifts : mapping of str to float
        How far each factor moves from its nominal level within a shift, natural units.
    """
    x = alt.X("range:Q", title="⟦factor⟧ varies within ±", scale=alt.Scale(zero=True))
    y = alt.Y("wear:Q", title=with_unit("smallest wear found", study.factor("f").unit))
    lines = named("reach").mark_line(strokeWidth=2.5, point=alt.OverlayMarkDef(size=24))
    told = tips("fda:N|detector; range:Q|⟦factor⟧ within ±|.3; wear:Q|finds wear from|.3")
    colour = detector_tint(study.detector_names())
    dash = alt.condition(_is_upper(study), alt.value([6, 4]), alt.value([1, 0]))
    ends = [{"factor": name, "range": value} for name, value in shifts.items()]
    rule = alt.Chart(alt.InlineData(ends)).transform_filter("datum.factor === factor")
    spec = alt.layer(
        lines.encode(x=x, y=y, color=colour, strokeDash=dash, tooltip=told),
        rule.mark_rule(strokeDash=[5, 4], color="var(--ink)").encode(x="range:Q"),
    ).add_params(alt.param(name="factor", value=next(iter(shifts))))
    options = [(name, factor_name(study.factor(name))) for name in shifts]
    return Chart(
        "reach",
        "The smallest wear that each detector finds",
        spec.properties(width="container", height=210),
        {"reach": Source("reach", {"factor": "factor", "fda": "fda"})},
        "Lower and further right is better. A line ends where no wear that was simulated is found surely; a "
        "detector without a line finds none. Dashed, upright: how far the factor moves in a shift.",
        [Choice("factor", "Varying", options)],
    )


def chart_scope(study: Study, first: Mapping[str, str]) -> Chart:
    """Scope of a cell or a group of cells: how many meet the requirement, and the worst under the pointer."""
    setting = study.config["scope"]
    known = study.scope["confidence"].notna().any()
    surely = "surely:Q|of them with 95 % confidence; " if known else ""
    told = (
        "change:Q|change of wear|.3; sigma:Q|standard deviation of ⟦factor⟧|.3; "
        f"passing:Q|cells that meet it; {surely}cells:Q|of; "
        "lowest:Q|lowest probability of detection|.3f; at:N|which is at; "
        "highest:Q|highest probability of detection|.3f"
    )
    axis: dict[str, Any] = {"format": ".2~g", "labelOverlap": "greedy"}
    counted = (
        named("scope")
        .transform_aggregate(
            cells="count()",
            passing="sum(passes)",
            surely="sum(sure)",
            worst="argmin(p_d)",
            best="argmax(p_d)",
            groupby=["change", "sigma"],
        )
        .transform_calculate(
            share="datum.passing / datum.cells",
            lowest="datum.worst.p_d",
            highest="datum.best.p_d",
            at="datum.worst.place",
        )
        .mark_rect()
        .encode(
            x=alt.X(
                "sigma:O",
                title="standard deviation of ⟦factor⟧",
                axis=alt.Axis(labelAngle=0, labelSeparation=6, **axis),
            ),
            y=alt.Y(
                "change:O",
                title=with_unit("change of wear", study.factor("f").unit),
                sort="descending",
                axis=alt.Axis(labelSeparation=4, **axis),
            ),
            color=alt.Color(
                "share:Q",
                title="share of cells that meet the requirement",
                scale=alt.Scale(domain=[0, 1], scheme="cividis"),
                legend=alt.Legend(format=".0%", gradientLength=180, titleLimit=300),
            ),
            tooltip=tips(told),
        )
    )
    return Chart(
        "scope",
        "Where it works",
        counted.properties(width="container", height=max(240, min(420, 14 * setting["grid"][0]))),
        {"scope": Source("scope", {"factor": "factor", **BY_CELL})},
        f"Meets the requirement: at least {100 * setting['p_d']:g} % detected at {100 * setting['p_f']:g} % "
        "false alarms, with the factor normally distributed about nominal, all else nominal. Filter to one "
        "robot, test-cycle and axis for the scope of a cell. The pointer tells the worst cell.",
        [Choice("factor", "Varying", [(one, factor_name(study.factor(one))) for one in setting["factors"]])],
        ["fda"],
        first,
    )


def chart_roc(study: Study, choices: list[Choice]) -> Chart:
    """Probability of detection over that of false alarm: medians, and every cell where a reader asks."""
    colour = detector_tint(study.detector_names())
    base = named("roc").encode(
        x=alt.X(
            "p_f:Q",
            title="probability of false alarm",
            scale=alt.Scale(type="log"),
            axis=alt.Axis(format="~%", tickCount=4),
        ),
        color=colour,
    )
    shown = alt.Y(
        "p_d:Q", title="probability of detection", scale=alt.Scale(domain=[0, 1]), axis=alt.Axis(format="%")
    )
    told = cell_tips("p_f:Q|false alarms|.2~%; p_d:Q|detected|.2%; threshold:Q||.4")
    lines = (
        base.transform_filter("lines == 'cells'")
        .mark_line(opacity=0.18, strokeWidth=1, point=alt.OverlayMarkDef(size=9, opacity=0.3))
        .encode(y=shown, detail=["robot:N", "cycle:N", "axis:N"], tooltip=told)
    )
    medians = (
        named("roc")
        .mark_line(strokeWidth=3)
        .encode(
            x="p_f:Q",
            y=alt.Y("median(p_d):Q", title="probability of detection"),
            color=colour,
            strokeDash=alt.condition(_is_upper(study), alt.value([6, 4]), alt.value([1, 0])),
            tooltip=tips("fda:N|detector; p_f:Q|false alarms|.2~%; median(p_d):Q|detected, median|.2%"),
        )
    )
    wanted = alt.InlineData([{"p_f": study.config["scope"]["p_f"]}])
    rule = alt.Chart(wanted).mark_rule(strokeDash=[5, 4], color="var(--ink)").encode(x="p_f:Q")
    spec = alt.layer(lines, medians, rule).add_params(alt.param(name="lines", value="medians"))
    return Chart(
        "roc",
        "Detection against false alarms",
        spec.properties(width="container", height=320),
        {"roc": Source("detection", {"case": "case", "change": "change", **BY_CELL})},
        "Thick: the median of each detector's cells; thin: every cell. Dashed: the study's false-alarm rate. "
        "Filter to a cell: the numbers then list the threshold of each false-alarm rate.",
        [Choice("lines", "Show", [("medians", "medians"), ("cells", "every cell too")]), *choices],
    )
