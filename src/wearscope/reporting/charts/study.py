"""Tables that the charts of a study draw, the words for what a reader chooses, and two small charts.

One chart has the robots' friction. The other compares a number of several things between two or three sides:
studies, loops, or models before and after.
"""

from collections.abc import Mapping, Sequence
from functools import cache

import altair as alt
import numpy as np
import pandas as pd

from wearscope.evaluation.ranking import choose_method
from wearscope.evaluation.scope import count_scope
from wearscope.reporting.charts.base import CELL_KEYS, Chart, Choice, Source, round_digits
from wearscope.reporting.charts.encoding import add_zoom, named, offset, rows, symlog, tint, tips
from wearscope.reporting.labels import (
    factor_label,
    factor_name,
    quantity_text,
    term_factors,
    term_name,
    unit_text,
    with_unit,
    words,
)
from wearscope.reporting.study import Study

_KEYS = list(CELL_KEYS)
FILTER_LABELS = {"robot": "Robot", "cycle": "Test-cycle", "axis": "Axis", "fda": "Detector"}
ALL_ROBOTS = "all robots"
_COLUMNS = {
    "fda": "detector", "cycle": "test-cycle", "p_d": "detected", "p_f": "false alarms",
    "y_held": "y, others held", "natural": "level", "snr": "SNR", "sigma": "standard deviation",
    "change": "change of wear", "place": "cell",
}  # fmt: skip


def study_filters(study: Study) -> list[Choice]:
    """What a reader may filter all charts by: robots, test-cycles, axes, detectors of the study."""
    return [
        Choice(key, label, [(str(one), _text(study, key, one)) for one in sorted(study.snr[key].unique())])
        for key, label in FILTER_LABELS.items()
    ]


def _text(study: Study, key: str, value: object) -> str:
    return study.detector_name(str(value)) if key == "fda" else words(value)


def study_labels(study: Study) -> dict[str, Mapping[str, str]]:
    """Text of every choice's value, and of the tables' columns."""
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
    """Where each row's cell is, without its detector: test-cycle, axis, and robot where there are several."""
    several = table["robot"].nunique() > 1
    cells = zip(*[table[key].tolist() for key in ("robot", "cycle", "axis")], strict=True)
    name = cache(
        lambda robot, cycle, axis: f"{words(cycle)}, axis {axis}" + (f", {robot}" if several else "")
    )
    return [name(*cell) for cell in cells]


def weight_table(study: Study) -> pd.DataFrame:
    """Every cell's normalised coefficients (8) of the model that Q-1 asks, terms in words.

    Columns: the keys, ``term``, ``kind`` (direct, interaction, square), ``weight``.
    """
    model = study.config["sensitivity"]["model"]
    rows = study.surrogates[(study.surrogates["model"] == model) & ~study.surrogates["term"].isin(["1", "f"])]
    if study.screening is not None:
        idle = study.screening[study.screening["dropped"]]
        gone = set(zip(idle["robot"], idle["factor"], strict=True))
        pairs = zip(rows["robot"], rows["term"], strict=True)
        rows = rows[[not any((robot, one) in gone for one in term_factors(term)) for robot, term in pairs]]
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
    ``sure`` (with 95 % confidence; never where that was not asked), ``place`` (see `places`).
    """
    method = "exact" if (study.scope["method"] == "exact").any() else "kde"
    rows = study.scope[study.scope["method"] == method]
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
    """Smallest wear that each detector surely finds over how far a factor varies.

    Columns: ``fda``, ``factor``, ``range`` (1.96 standard deviations, natural units), ``wear``. In as many
    cells as the conclusion asks: all, or half.
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
    its variation). The choices begin nearest to the conclusion's variation, in the middle where there is
    none, and at the change of wear that tells detectors best apart.
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
        "As the robot's model has it.",
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
        By name; the ends of a value's interval are called ``<value>_low`` and ``<value>_high``.
    thing, value : str
        Columns.
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
