"""Chosen surrogate of every cell of one robot and test-cycle."""

from job import run_job
from wearscope import tables
from wearscope.designs.factors import Factor
from wearscope.surrogates.chosen import choose_surrogates

with run_job(snakemake) as say:
    params = snakemake.params
    table = choose_surrogates(
        tables.read_table(snakemake.input.test_quantities),
        [Factor(**one) for one in params.factors],
        params.kinds,
        params.goal,
        params.max_failed_share,
    )
    for state, rows in table.groupby("state"):
        say(f"{len(rows)} of {len(table)} cells: {state}")
    tables.write_table(snakemake.output[0], table, dict.fromkeys(["fit", "ceiling", "ceiling_low"], "%"))
