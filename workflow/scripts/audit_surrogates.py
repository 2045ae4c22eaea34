"""Surrogate against direct simulation: both values, how often the interval held, what is withheld."""

import pandas as pd

from job import run_job
from wearscope import tables
from wearscope.evaluation.audit import audit_answers, audit_table, audit_verdicts
from wearscope.surrogates.chosen import read_chosen

with run_job(snakemake) as say:
    direct = pd.concat([tables.read_table(part) for part in snakemake.input.parts], ignore_index=True)
    points = tables.read_table(snakemake.input.points)
    surrogates, *asked = [tables.read_table(file) for file in snakemake.input.asked]
    model = snakemake.params.model
    chosen = dict(read_chosen(*asked)) if model == "chosen" else None
    table = audit_table(direct, surrogates, points, model, chosen=chosen)
    say(f"the prediction interval held {int(table['inside'].sum())} of {len(table)} direct values")
    answers = audit_answers(table)
    for row in answers.itertuples():
        say(f"fda {row.fda}: {row.n_inside} of {row.n} values inside, answer {row.answer}")
    tables.write_table(snakemake.output.audit, table)
    tables.write_table(snakemake.output.verdicts, audit_verdicts(table))
    tables.write_table(snakemake.output.answers, answers)
