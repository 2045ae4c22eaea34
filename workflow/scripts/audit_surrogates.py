"""Compares surrogates with direct simulation, and decides which detectors' answers are withheld."""

from auditing import weigh

from job import run_job
from wearscope.storage import tables

with run_job(snakemake) as say:
    given, out = snakemake.input, snakemake.output
    designs = given.points if len(given.more) else given.points[:1]
    table, verdicts, answers = weigh(given, snakemake.params.model, designs, [*given.parts, *given.more])
    say(f"the prediction interval held {int(table['inside'].sum())} of {len(table)} direct values")
    for row in answers.itertuples():
        say(f"fda {row.fda}: {row.n_inside} of {row.n} values inside, p {row.p:.2g}, answer {row.answer}")
    tables.write_table(out.audit, table)
    tables.write_table(out.verdicts, verdicts)
    tables.write_table(out.answers, answers)
