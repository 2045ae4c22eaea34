"""Compares the study's answers before and after a correction."""

import json
from pathlib import Path

import pandas as pd

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.evaluation.reevaluation import (
    Questions,
    answer_side,
    compare_ranking,
    compare_sides,
    share_surrogates,
    withheld_cells,
)
from wearscope.storage import tables

with run_job(snakemake) as say:
    params, given, out = snakemake.params, snakemake.input, snakemake.output
    factors = [Factor(**one) for one in params.factors]
    asked = Questions(factors, params.model, params.snr, params.scope, params.seed)
    answers, models = {}, []
    chosen = tables.read_table(given.chosen)
    shared = share_surrogates(chosen)
    told = {name: why for name, why in json.loads(Path(given.models).read_text()).items() if why}
    for side, own, drawn, left_out in zip(params.sides, given.own, given.drawn, given.left_out, strict=True):
        few = tables.read_table(drawn)
        answers[side] = answer_side(side, tables.read_table(own), shared[shared["robot"] == side], few, asked)
        left = tables.read_table(left_out)
        reasons = {name: why for name, why in told.items() if name.startswith(f"{side}-")}
        reasons |= dict(zip(left["model"], left["reason"], strict=True))
        models.append(
            {
                "side": side,
                "drawn": few["robot"].nunique(),
                "left_out": len(reasons),
                "first_reason": next(iter(reasons.values()), ""),
            }
        )
        say(f"{side}: {few['robot'].nunique()} drawn models, {len(reasons)} left out")
    units = {"delta": "natural"}
    table = compare_sides(answers, params.robot, factors, withheld_cells(chosen))
    tables.write_table(out.table, table, units)
    tables.write_table(out.ranking, compare_ranking(answers, params.robot))
    tables.write_table(out.models, pd.DataFrame(models))
