"""Charts of Q-2: the detectors' signal-to-noise ratios, robots side by side."""

import json

import altair as alt
import numpy as np

from wearscope.reporting.charts.base import BY_CELL, Chart, Source
from wearscope.reporting.charts.encoding import cell_tips, name_labels, named, tips
from wearscope.reporting.charts.factors import SYMLOG, symlog_axis
from wearscope.reporting.charts.study import together
from wearscope.reporting.study import Study

#: An SNR in few characters, for cells that are narrow on a phone: 2.2k, 655, 73.0, 5.39.
_SIZE = "abs(datum.snr)"
_SHORT = (
    f"!isValid(datum.snr) ? '' : format(datum.snr, {_SIZE} >= 1000 ? '.2s' : {_SIZE} >= 100 ? '.0f' : "
    f"{_SIZE} >= 10 ? '.1f' : '.2f')"
)


def chart_snr(study: Study) -> Chart:
    """Every cell's SNR by detector and robot, with medians and their intervals."""
    robots = sorted(study.snr["robot"].unique())
    shown = list(dict.fromkeys([*robots, together(study)]))
    x = alt.X("snr:Q", title="signal-to-noise ratio", scale=SYMLOG, axis=symlog_axis((1, 3)))
    offset = alt.YOffset("robot:N", scale=alt.Scale(domain=shown))
    tint = alt.Color(
        "robot:N",
        title=None,
        scale=alt.Scale(
            domain=shown,
            range=[*(f"var(--c{k % 6})" for k in range(len(robots))), "var(--ink)"][: len(shown)],
        ),
    )
    axis = alt.Axis(labelExpr=name_labels(study.detector_names()), labelLimit=220)
    rows = alt.Y("fda:N", title=None, axis=axis)
    deployable = "datum.rank > 0"
    cells = (
        named("snr")
        .transform_filter(f"indexof({json.dumps(study.upper())}, datum.fda) < 0")
        .mark_circle(opacity=0.6)
        .encode(
            x=x,
            y=rows,
            yOffset=offset,
            color=tint,
            tooltip=[*cell_tips(), *tips("snr:Q|SNR|.3; low:Q|95 % from|.3; high:Q|to|.3; status:N")],
        )
    )
    ranks = named("rankings").encode(y=rows, yOffset=offset, color=tint)
    told = tips("fda:N|detector; robot:N; median:Q|median SNR|.3; low:Q|95 % from|.3; high:Q|to|.3; rank:Q")
    bound = (
        named("rankings")
        .transform_filter(f"!({deployable}) && datum.robot === {json.dumps(together(study))}")
        .mark_rule(strokeDash=[6, 4], strokeWidth=2, color="var(--soft)")
        .encode(x=alt.X("median:Q", title="signal-to-noise ratio"), y=rows, tooltip=told)
    )
    ranks = ranks.transform_filter(deployable)
    spans = ranks.mark_rule(strokeWidth=5, opacity=0.35).encode(
        x=alt.X("low:Q", title="signal-to-noise ratio"), x2="high:Q", tooltip=told
    )
    medians = ranks.mark_tick(thickness=3, size=14).encode(
        x=alt.X("median:Q", title="signal-to-noise ratio"), tooltip=told
    )
    zero = alt.Chart(alt.InlineData([{"snr": 0}])).mark_rule(color="var(--soft)").encode(x="snr:Q")
    return Chart(
        "snr",
        "Signal-to-noise ratio of every cell",
        alt.layer(zero, cells, spans, medians, bound).properties(
            width="container", height={"step": max(16, 54 // len(shown))}
        ),
        {"snr": Source("snr", BY_CELL), "rankings": Source("rankings", {"robot": "robot", "fda": "fda"})},
        "A point is a cell; marks and bars: medians with 95 % intervals over all test-cycles and axes of the "
        "study. Below 0 the test quantity falls with wear."
        + (" Dashed: an upper bound; it is told the simulator's own law." if study.upper() else ""),
    )


def chart_snr_cells(study: Study) -> Chart:
    """SNR of every cell as a heat map."""
    base = named("snr").encode(
        x=alt.X("fda:N", title="detector", axis=alt.Axis(orient="top", labelAngle=0)),
        y=alt.Y("place:N", title=None, sort=None, axis=alt.Axis(labelLimit=200)),
    )
    upper = study.upper()
    own = study.snr.loc[~study.snr["fda"].isin(upper), "snr_exact"].replace([np.inf, -np.inf], np.nan)
    top = float(own.abs().max()) if own.notna().any() else 1.0
    # The colours are those of what can be deployed; without a negative value they begin at 0.
    ends, tints = ([0.0, top], ["#f1f1f0", "#2166ac"])
    if (own < 0).any():
        ends, tints = ([-top, *ends], ["#b35806", *tints])
    apart = f"indexof({json.dumps(upper)}, datum.fda) >= 0"
    cells = base.mark_rect().encode(
        color=alt.condition(
            apart,
            alt.value("transparent"),
            alt.Color(
                "snr:Q",
                title="SNR",
                scale=alt.Scale(type="symlog", domain=ends, range=tints, clamp=True),
                legend=alt.Legend(labelExpr="format(datum.value, abs(datum.value) >= 1000 ? '~s' : '~g')"),
            ),
        ),
        tooltip=[*cell_tips(), *tips("snr:Q|SNR|.3; low:Q|95 % from|.3; high:Q|to|.3; status:N")],
    )
    text = (
        base.transform_calculate(short=_SHORT)
        .mark_text(fontSize=10)
        .encode(
            text="short:N",
            color={
                "condition": [
                    {"test": apart, "value": "var(--ink)"},
                    {"test": f"abs(datum.snr) > {0.25 * top:.4g}", "value": "white"},
                ],
                "value": "#222",
            },
        )
    )
    return Chart(
        "snr-cells",
        "Cell by cell",
        alt.layer(cells, text).properties(width="container", height={"step": 20}),
        {"snr": Source("snr", BY_CELL)},
        "Test-cycle, axis and robot down. Empty: the detector always says the same, or the robot's model has "
        "no noise." + (" Without colour: an upper bound." if upper else ""),
    )
