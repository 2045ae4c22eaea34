"""Test quantities of one robot and test-cycle."""

from job import run_job
from wearscope import tables
from wearscope.designs.factors import Factor

with run_job(snakemake) as say:
    params, wildcards = snakemake.params, snakemake.wildcards
    factors = [Factor(**one) for one in params.factors]
    designs = {name: tables.read_table(snakemake.input[name]) for name in params.sets}
    total = sum(map(len, designs.values()))
