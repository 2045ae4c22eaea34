"""Charts of Q-3: scope matrices, and detection at the reader's own probability of false alarm."""

import json

import altair as alt
import pandas as pd

from wearscope.reporting.charts.base import BY_CELL, Chart, Choice, Source
from wearscope.reporting.charts.encoding import cell_tips, colour, named, tips
from wearscope.reporting.charts.study import detection_cells
from wearscope.reporting.labels import factor_name, quantity_text, unit_text
from wearscope.reporting.study import Study


def chart_scope(study: Study, detector: str = "") -> Chart:
    """Scope of a cell or a group of cells: how many meet the requirement, and the worst under the pointer."""
    names = study.config["scope"]["factors"]
    n_delta = study.config["scope"]["grid"][0]
    known = study.scope["confidence"].notna().any()
    surely = "surely:Q|of them with 95 % confidence; " if known else ""
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
                axis=alt.Axis(format=".2~g", labelAngle=0, labelOverlap="greedy", labelSeparation=6),
            ),
            y=alt.Y(
                "change:O",
                title=f"change of wear{_unit(study)}",
                sort="descending",
                axis=alt.Axis(format=".2~g", labelOverlap="greedy", labelSeparation=4),
            ),
            color=alt.Color(
                "share:Q",
                title="share of cells that meet the requirement",
                scale=alt.Scale(domain=[0, 1], scheme="cividis"),
                legend=alt.Legend(format=".0%", gradientLength=180, titleLimit=300),
            ),
            tooltip=tips(
                "change:Q|change of wear|.3; sigma:Q|standard deviation of ⟦factor⟧|.3; "
                f"passing:Q|cells that meet it; {surely}cells:Q|of; "
                "lowest:Q|lowest probability of detection|.3f; at:N|which is at; "
                "highest:Q|highest probability of detection|.3f"
            ),
        )
    )
    setting = study.config["scope"]
    return Chart(
        "scope",
        "Where it works",
        counted.properties(width="container", height=max(240, min(420, 14 * n_delta))),
        {"scope": Source("scope", {"factor": "factor", **BY_CELL})},
        f"Meets the requirement: at least {100 * setting['p_d']:g} % detected at {100 * setting['p_f']:g} % "
        "false alarms, with the factor normally distributed about nominal, all else nominal. Filter to one "
        "robot, test-cycle and axis for the scope of a cell. The pointer tells the worst cell.",
        [Choice("factor", "Varying", [(name, factor_name(study.factor(name))) for name in names])],
        ["fda"],
        {"fda": detector} if detector else {},
    )


def _unit(study: Study) -> str:
    unit = unit_text(study.factor("f").unit)
    return f" [{unit}]" if unit else ""


def detection_cases(study: Study) -> tuple[pd.DataFrame, list[Choice]]:
    """ROC table with a column ``case`` (factor and its variation), and what a reader chooses of it."""
    table = detection_cells(study)
    cases = table[["factor", "sigma"]].drop_duplicates()
    keys = {(row.factor, row.sigma): f"{row.factor}:{k}" for k, row in enumerate(cases.itertuples())}
    texts = [
        (
            key,
            f"{factor_name(study.factor(name))}, σ = {quantity_text(sigma, study.factor(name).unit)}",
        )
        for (name, sigma), key in keys.items()
    ]
    table["case"] = [
        keys[pair] for pair in zip(table["factor"].tolist(), table["sigma"].tolist(), strict=True)
    ]
    changes = sorted(float(one) for one in table["change"].unique())
    fault = study.factor("f")
    factor, sigma, change = _asked_first(study, cases, changes)
    return table.drop(columns=["factor", "sigma"]), [
        Choice("case", "Varying", texts, keys[factor, sigma]),
        Choice(
            "change",
            "Change of wear",
            [(one, quantity_text(one, fault.unit, 3)) for one in changes],
            change,
            slides=True,
        ),
    ]


def _asked_first(study: Study, cases: pd.DataFrame, changes: list[float]) -> tuple[str, float, float]:
    """Factor, variation and change of wear nearest to the conclusion's; the middle ones without any."""
    conclusion = study.conclusions[0] if study.conclusions else None
    if conclusion is not None and conclusion.bounds:
        bound = conclusion.bounds[0]
        own = cases.loc[cases["factor"] == bound.factor, "sigma"].to_list()
        return bound.factor, _nearest(own, bound.sigma), _nearest(changes, conclusion.wear)
    factor = str(cases["factor"].iloc[0])
    own = cases.loc[cases["factor"] == factor, "sigma"].to_list()
    return factor, float(own[len(own) // 2]), changes[len(changes) // 2]


def _nearest(values: list[float], wanted: float) -> float:
    return min(values, key=lambda value: abs(value - wanted))


def chart_roc(study: Study, choices: list[Choice]) -> Chart:
    """Probability of detection over that of false alarm: medians, and every cell where a reader asks."""
    names = study.detector_names()
    base = named("roc").encode(
        x=alt.X(
            "p_f:Q",
            title="probability of false alarm",
            scale=alt.Scale(type="log"),
            axis=alt.Axis(format="~%", tickCount=4),
        ),
        y=alt.Y(
            "p_d:Q",
            title="probability of detection",
            scale=alt.Scale(domain=[0, 1]),
            axis=alt.Axis(format="%"),
        ),
        color=alt.Color("fda:N", **colour(names)),
        detail=["robot:N", "cycle:N", "axis:N"],
    )
    told = [*cell_tips(), *tips("p_f:Q|false alarms|.2~%; p_d:Q|detected|.2%; threshold:Q||.4")]
    upper = f"indexof({json.dumps(study.upper())}, datum.fda) >= 0"
    asked = alt.param(name="lines", value="medians")
    lines = base.transform_filter("lines == 'cells'").mark_line(
        opacity=0.18, strokeWidth=1, point=alt.OverlayMarkDef(size=9, opacity=0.3)
    )
    medians = (
        named("roc")
        .mark_line(strokeWidth=3)
        .encode(
            x="p_f:Q",
            y=alt.Y("median(p_d):Q", title="probability of detection"),
            color=alt.Color("fda:N", **colour(names)),
            strokeDash=alt.condition(upper, alt.value([6, 4]), alt.value([1, 0])),
            tooltip=tips("fda:N|detector; p_f:Q|false alarms|.2~%; median(p_d):Q|detected, median|.2%"),
        )
    )
    wanted = alt.InlineData([{"p_f": study.config["scope"]["p_f"]}])
    rule = alt.Chart(wanted).mark_rule(strokeDash=[5, 4], color="var(--ink)").encode(x="p_f:Q")
    return Chart(
        "roc",
        "Detection against false alarms",
        alt.layer(lines.encode(tooltip=told), medians, rule)
        .add_params(asked)
        .properties(width="container", height=320),
        {"roc": Source("detection", {"case": "case", "change": "change", **BY_CELL})},
        "Thick: the median of each detector's cells; thin: every cell. Dashed: the study's false-alarm rate. "
        "Filter to a cell: the numbers then list the threshold of each false-alarm rate.",
        [Choice("lines", "Show", [("medians", "medians"), ("cells", "every cell too")]), *choices],
    )
