"""Compares surrogates with the first simulated points; if the result is close, chooses further points."""

import pandas as pd
from auditing import weigh

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.evaluation.audit import choose_more_points
from wearscope.storage import tables

with run_job(snakemake) as say:
    given, params = snakemake.input, snakemake.params
    answers = weigh(given, params.model, [given.points], given.parts)[2]
    close = sorted(answers.loc[answers["close"], "fda"])
    factors = [Factor(**one) for one in params.factors]
    scope = pd.concat(map(tables.read_table, given.scope), ignore_index=True)
    first = len(tables.read_table(given.points)) + 1
    points = choose_more_points(
        factors, scope, params.about, params.places, params.axes, params.f0, params.detection, first
    )
    say(f"{len(points)} more points, for {', '.join(close)}" if close else "no detector is close")
    units = {f"{factor.name}_natural": factor.unit for factor in factors}
    tables.write_table(snakemake.output[0], points if close else points[:0], units)
