"""Makes the design of the runs that give the SNR without a surrogate."""

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.evaluation.snr import direct_design
from wearscope.storage import tables

with run_job(snakemake):
    params = snakemake.params
    factors = [Factor(**one) for one in params.factors]
    design = direct_design(factors, params.runs, params.axis, **params.setting, seed=params.seed)
    units = {f"{factor.name}_natural": factor.unit for factor in factors}
    tables.write_table(snakemake.output[0], design, units)
