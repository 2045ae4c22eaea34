"""Charts of a study and their tables: factors (Q-1), detectors (Q-2), scope (Q-3), friction, sides.

The last chart compares one quantity of several things between two or three sides: studies, loops, or models
before and after.
"""

import json
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import altair as alt
import numpy as np
import pandas as pd

from wearscope.evaluation.scope import choose_method, count_scope
from wearscope.evaluation.sensitivity import drop_idle
from wearscope.reporting.charts.base import BY_CELL, Chart, Choice, Source, round_digits
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
from wearscope.reporting.labels import (
    CELL,
    factor_label,
    factor_name,
    quantity_text,
    term_name,
    unit_text,
    with_unit,
    words,
)
from wearscope.reporting.study import Study

_KEYS = list(CELL)
FILTER_LABELS = {"robot": "Robot", "cycle": "Test-cycle", "axis": "Axis", "fda": "Detector"}
ALL_ROBOTS = "all robots"
_COLUMNS = {
    "fda": "detector", "cycle": "test-cycle", "p_d": "detected", "p_f": "false alarms",
    "y_held": "y, others held", "natural": "level", "snr": "SNR", "sigma": "standard deviation",
    "change": "change of wear", "place": "cell",
}  # fmt: skip


def study_filters(study: Study) -> list[Choice]:
    """Filters of all charts: robots, test-cycles, axes and detectors of the study."""
    return [
        Choice(key, label, [(str(one), _text(study, key, one)) for one in sorted(study.snr[key].unique())])
        for key, label in FILTER_LABELS.items()
    ]


def _text(study: Study, key: str, value: object) -> str:
    return study.detector_name(str(value)) if key == "fda" else words(value)


def study_labels(study: Study) -> dict[str, Mapping[str, str]]:
    """Labels of every choice's values, and of the tables' columns."""
    names = study.detector_names()
    units = {fda: unit_text(study.units.get(fda, "")) for fda in names}
    return {
        "factor": {one.name: factor_label(one) for one in study.factors},
        "factor.name": {one.name: factor_name(one) for one in study.factors},
        "cycle": {name: words(name) for name in study.snr["cycle"].unique()},
        "axis": {str(axis): f"axis {axis}" for axis in study.snr["axis"].unique()},
        "fda": names,
        "fda.y": {fda: with_unit(f"test quantity of {name}", units[fda]) for fda, name in names.items()},
        "column": _COLUMNS,
    }


def study_tables(study: Study) -> dict[str, pd.DataFrame]:
    """Tables that the charts draw, by name; only those that the study has."""
    ends = {"median_low": "low", "median_high": "high"}
    found = {
        "snr": study.snr[[*_KEYS, "snr_exact", "snr_low", "snr_high", "status"]]
        .rename(columns={"snr_exact": "snr", "snr_low": "low", "snr_high": "high"})
        .assign(place=places(study.snr)),
        "weights": weight_table(study),
        "scope": scope_cells(study),
        "reach": reach_lines(study),
    }
    if study.rankings is not None:
        table = study.rankings[["robot", "fda", "median", *ends, "rank"]].rename(columns=ends)
        found["rankings"] = table.replace({"robot": {"": together(study)}})
    if study.responses is not None and study.simulated is not None:
        found["responses"] = study.responses[[*_KEYS, "factor", "natural", "y", "low", "high"]]
        found["simulated"] = study.simulated[[*_KEYS, "factor", "set", "natural", "y", "y_held"]]
    if study.detection is not None:
        found["detection"] = detection_cases(study)[0]
    if study.friction is not None:
        found["friction"] = study.friction[["robot", "joint", "speed", "temperature", "wear", "torque"]]
    return found


def together(study: Study) -> str:
    """Name of all robots together; a single robot's own name."""
    robots = list(study.snr["robot"].unique())
    return str(robots[0]) if len(robots) == 1 else ALL_ROBOTS


def places(table: pd.DataFrame) -> list[str]:
    """Name of each row's cell without the detector: test-cycle, axis, and robot where there are several."""
    several = table["robot"].nunique() > 1
    cells = zip(*[table[key].tolist() for key in ("robot", "cycle", "axis")], strict=True)
    name = cache(
        lambda robot, cycle, axis: f"{words(cycle)}, axis {axis}" + (f", {robot}" if several else "")
    )
    return [name(*cell) for cell in cells]


def weight_table(study: Study) -> pd.DataFrame:
    """Every cell's normalised coefficients (8) of the model that answers Q-1, with terms in words.

    Columns: the keys, ``term``, ``kind`` (direct, interaction, square), ``weight``.
    """
    model = study.config["sensitivity"]["model"]
    rows = study.surrogates[(study.surrogates["model"] == model) & ~study.surrogates["term"].isin(["1", "f"])]
    if study.screening is not None:
        rows = drop_idle(rows, study.screening, "term")
    conditions = [rows["term"].str.contains(mark, regex=False) for mark in (":", "^")]
    table = rows[_KEYS].assign(
        term=[term_name(term, study.factors) for term in rows["term"]],
        kind=np.select(conditions, ["interaction", "square"], "direct"),
        weight=rows["theta_normalised"].to_numpy(dtype=float),
    )
    return table.replace({"weight": {np.inf: np.nan, -np.inf: np.nan}})


def scope_cells(study: Study) -> pd.DataFrame:
    """Scope matrices in natural units.

    Columns: the keys, ``factor``, ``change`` (of wear), ``sigma`` (of the factor), ``p_d``, ``passes``,
    ``sure`` (with 95 % confidence; False where that was not computed), ``place`` (see `places`).
    """
    rows = choose_method(study.scope)
    steps = {one.name: one.step for one in study.factors}
    return rows[[*_KEYS, "factor"]].assign(
        change=rows["delta"] * steps["f"],
        sigma=rows["sigma"] * rows["factor"].map(steps),
        p_d=np.floor(1e4 * rows["p_d"].to_numpy()) / 1e4,
        passes=rows["passes"].to_numpy(),
        sure=(rows["confidence"] >= 0.95).to_numpy(),
        place=places(rows),
    )


def reach_lines(study: Study) -> pd.DataFrame:
    """Smallest wear that each detector surely finds, over how far a factor varies.

    Columns: ``fda``, ``factor``, ``range`` (1.96 standard deviations, natural units), ``wear``. The wear is
    found in as many cells as the conclusion requires: all, or half of them.
    """
    counts = count_scope(choose_method(study.scope))
    sure = counts["sure" if counts["known"].any() else "passes"]
    every = not study.conclusions or study.conclusions[0].cells_sure == study.conclusions[0].cells
    steps, rows = {one.name: one.step for one in study.factors}, []
    for (fda, factor), own in counts.assign(sure=sure).groupby(["fda", "factor"], sort=True):
        wide = own.pivot(index="delta", columns="sigma", values="sure")
        enough = (wide >= np.ceil((1.0 if every else 0.5) * own["cells"].max())).cummin(axis=1)
        for sigma, found in enough[enough.index > 0].items():
            wear = found.idxmax() * steps["f"] if found.any() else np.nan
            rows.append((fda, factor, 1.96 * float(str(sigma)) * steps[str(factor)], wear))
    return pd.DataFrame(rows, columns=["fda", "factor", "range", "wear"]).dropna()


def detection_cases(study: Study) -> tuple[pd.DataFrame, list[Choice]]:
    """ROC of every cell in natural units, and the choices that a reader has.

    Columns: the keys, ``change`` (of wear), ``p_f``, ``p_d``, ``threshold``, ``place``, ``case`` (factor and
    its variation). The default is the variation nearest to the conclusion's, or the middle one without a
    conclusion, and the change of wear at which detectors differ most.
    """
    rows, fault = study.detection, study.factor("f")
    assert rows is not None
    steps = {one.name: one.step for one in study.factors}
    sigma = _shorten(rows["sigma"] * rows["factor"].map(steps))
    change = _shorten(rows["delta"] * steps["f"])
    pairs = list(zip(rows["factor"].tolist(), sigma, strict=True))
    keys = {(name, size): f"{name}:{k}" for k, (name, size) in enumerate(dict.fromkeys(pairs))}
    table = rows[_KEYS].assign(
        change=change,
        p_f=rows["p_f"],
        p_d=rows["p_d"],
        threshold=rows["threshold"],
        place=places(rows),
        case=[keys[pair] for pair in pairs],
    )
    changes = sorted(set(change))
    asked = study.conclusions[0].bounds if study.conclusions else []
    factor = asked[0].factor if asked else next(iter(keys))[0]
    own = [size for name, size in keys if name == factor]
    first = _nearest(own, asked[0].sigma if asked else float(np.median(own)))
    near = table["p_f"] == _nearest(sorted(set(table["p_f"])), study.config["scope"]["p_f"])
    shown = table[near & (table["case"] == keys[factor, first])]
    medians = shown.groupby(["change", "fda"])["p_d"].median().unstack("fda")
    spread = medians.drop(columns=study.upper(), errors="ignore").var(axis=1, ddof=0).fillna(0.0)
    texts = [
        (key, f"{factor_name(one)}, σ = {quantity_text(size, one.unit)}")
        for one, size, key in ((study.factor(name), size, key) for (name, size), key in keys.items())
    ]
    sizes = [(one, quantity_text(one, fault.unit, 3)) for one in changes]
    return table, [
        Choice("case", "Varying", texts, keys[factor, first]),
        Choice("change", "Change of wear", sizes, spread.idxmax(), slides=True),
    ]


def _shorten(values: pd.Series) -> list[float]:
    return [float(one) for one in round_digits(values.to_numpy()) if one is not None]


def _nearest(values: list[float], wanted: float) -> float:
    return min(values, key=lambda value: abs(value - wanted))


def chart_friction(table: pd.DataFrame) -> Chart:
    """Friction of a joint over speed at several temperatures and wear levels."""
    unit = sorted(table["torque_unit"].unique())[0]
    tints = alt.Scale(range=["var(--c0)", "var(--c5)", "var(--c1)"])
    lines = named("friction").mark_line()
    drawn = lines.encode(
        x=alt.X(
            "speed:Q",
            title=f"joint speed [{table['speed_unit'].iloc[0]}]",
            scale=alt.Scale(type="log", nice=False),
            axis=alt.Axis(tickCount=5, format="~g"),
        ),
        y=alt.Y("torque:Q", title=f"friction torque [{unit}]", scale=alt.Scale(zero=False)),
        color=alt.Color("temperature:O", title="temperature [°C]", scale=tints),
        strokeDash=alt.StrokeDash("wear:O", title="wear"),
        tooltip=tips("speed:Q||.3; torque:Q||.4; temperature:O|temperature [°C]; wear:O"),
    )
    spec, fields = add_zoom(drawn.properties(width="container", height=320), "speed", "torque")
    return Chart(
        "friction",
        "Friction over speed",
        spec,
        {"friction": Source("friction", {"robot": "robot", "joint": "joint"})},
        "The friction law of the robot's model.",
        [Choice("joint", "Joint", [(name, words(name)) for name in table["joint"].unique()])],
        ["robot"],
        zoom=fields,
    )


_TINTS = ("var(--before)", "var(--after)", "var(--ink)")


def side_table(sides: dict[str, pd.DataFrame], thing: str, value: str) -> pd.DataFrame:
    """Rows of all sides: ``side``, ``thing``, ``value``, and ``low``, ``high`` where a side has intervals.

    Parameters
    ----------
    sides : mapping of str to DataFrame
        Tables by side; the ends of a value's interval are called ``<value>_low`` and ``<value>_high``.
    thing, value : str
        Names of the columns.
    """
    names = {thing: "thing", value: "value", f"{value}_low": "low", f"{value}_high": "high"}
    parts = [
        frame.reindex(columns=list(names)).rename(columns=names).assign(side=side)
        for side, frame in sides.items()
    ]
    return pd.concat(parts, ignore_index=True).astype({"value": float, "low": float, "high": float})


def chart_sides(names: Sequence[str], title: str, quantity: str, thing: str, caption: str) -> Chart:
    """Values of the table ``sides`` (see `side_table`), with their intervals where there are some."""
    tints = dict(zip(names, _TINTS, strict=False))
    base = named("sides").encode(
        y=rows("thing:N", 220),
        yOffset=offset("side:N", names),
        color=tint("side:N", tints, legend=alt.Legend(labelLimit=260, columns=1)),
        tooltip=tips(f"thing:N|{thing}; side:N|in; value:Q|{quantity}|.4; low:Q|95 % from|.4; high:Q|to|.4"),
    )
    spans = base.transform_filter("isValid(datum.low)").mark_rule(strokeWidth=4, opacity=0.4)
    points = base.mark_circle(size=70, opacity=1).encode(x=symlog("value:Q", quantity))
    spec = alt.layer(spans.encode(x="low:Q", x2="high:Q"), points)
    spec = spec.properties(width="container", height={"step": 14})
    return Chart("sides-chart", title, spec, {"sides": Source("sides")}, caption)


KINDS = (("direct", "direct effects"), ("interaction", "interactions"), ("square", "squares"))
_SNR = "snr:Q|SNR|.3; low:Q|95 % from|.3; high:Q|to|.3; status:N"
#: An SNR in few characters, for cells that are narrow on a phone: 2.2k, 655, 73.0, 5.39.
_SIZE = "abs(datum.snr)"
_SHORT = (
    f"!isValid(datum.snr) ? '' : format(datum.snr, {_SIZE} >= 1000 ? '.2s' : {_SIZE} >= 100 ? '.0f' : "
    f"{_SIZE} >= 10 ? '.1f' : '.2f')"
)


def _is_upper(study: Study) -> str:
    """Chart expression that is true for detectors that are given the simulator's friction law."""
    return f"indexof({json.dumps(study.upper())}, datum.fda) >= 0"


def chart_weights(study: Study) -> Chart:
    """Every cell's coefficients over that of wear, by factor and detector."""
    names = study.detector_names()
    base = named("weights").encode(
        y=rows("term:N"), yOffset=offset("fda:N", names), color=detector_tint(names)
    )
    band = alt.Chart(alt.InlineData([{"low": -1, "high": 1}])).mark_rect(color="var(--line)", opacity=0.45)
    points = base.mark_circle(opacity=0.65).encode(
        x=symlog("weight:Q", "coefficient (wear: 1)"), tooltip=cell_tips("term:N; weight:Q||.3")
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
        "A point is a cell: the effect of the factor on the test quantity, divided by that of an equal step "
        "of wear. Upright ticks: medians of the points shown. Beyond the grey band a factor weighs more than "
        "wear, and the scale is logarithmic.",
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
        "Line: the chosen surrogate, with the other factors at nominal. Band: where 95 % of new runs should "
        "lie. Points: simulated runs; the surrogate corrects them to nominal levels of the other factors, "
        "unless you choose them as simulated.",
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
        "A point is a cell. Marks and bars: medians with 95 % intervals over all test-cycles and axes of the "
        f"study. Where the ratio is negative, the test quantity falls with wear.{upper}",
    )


def chart_snr_cells(study: Study) -> Chart:
    """SNR of every cell as a heat map."""
    top = detector_axis(study.detector_names())
    base = named("snr").encode(x=alt.X("fda:N", title=None, axis=top), y=rows("place:N"))
    own = study.snr.loc[~study.snr["fda"].isin(study.upper()), "snr_exact"].replace([np.inf, -np.inf], np.nan)
    most = float(own.abs().max()) if own.notna().any() else 1.0
    # The colour scale covers the detectors that can be deployed; without negative values it begins at 0.
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
        "Rows: test-cycle, axis and robot. Empty: the test quantity is always the same, or the robot's model "
        "has no noise." + (" Without colour: an upper bound." if study.upper() else ""),
    )


def chart_reach(study: Study, shifts: Mapping[str, float]) -> Chart:
    """Smallest wear that each detector finds over how far a factor varies, with the size of a shift.

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
        "Lower and further right is better. A line ends where no simulated wear is surely found; a detector "
        "without a line finds none. Dashed line: how far the factor moves in a shift.",
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
        "robot, test-cycle and axis for the scope of a cell. Point at a square to see its worst cell.",
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
        "If you filter to one cell, the numbers list the threshold of each false-alarm rate.",
        [Choice("lines", "Show", [("medians", "medians"), ("cells", "every cell too")]), *choices],
    )
