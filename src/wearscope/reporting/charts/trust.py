"""How well the surrogates fit."""

import altair as alt

from wearscope.reporting.charts.base import BY_CELL, Chart, Source
from wearscope.reporting.charts.encoding import cell_tips, colour, name_labels, named, tips
from wearscope.reporting.study import Study


def chart_fits(study: Study) -> Chart:
    """Fit of every cell's surrogate, by detector."""
    names = study.detector_names()
    axis = alt.Axis(labelExpr=name_labels(names), labelLimit=220)
    base = named("fits").encode(y=alt.Y("fda:N", title=None, axis=axis), yOffset="robot:N")
    told = [*cell_tips(), *tips("fit:Q|fit [%]|.4; ceiling:Q|ceiling [%]|.4; kind:N")]
    points = base.mark_circle(opacity=0.7).encode(
        x=alt.X("fit:Q", title="fit on runs that no choice saw [%]", scale=alt.Scale(zero=False)),
        color=alt.Color("fda:N", **colour(names, legend=False)),
        tooltip=told,
    )
    ceilings = base.mark_tick(color="var(--soft)", thickness=1.5, size=11).encode(
        x=alt.X("ceiling:Q"), tooltip=told
    )
    return Chart(
        "fits",
        "How well the surrogates fit",
        alt.layer(ceilings, points).properties(width="container", height={"step": 20}),
        {"fits": Source("fits", BY_CELL)},
        "A point is a cell, a row a robot; 100 % is perfect, a constant has 0 %. Ticks: what a perfect "
        "surrogate would have, as the noise of single runs leaves the rest.",
    )
