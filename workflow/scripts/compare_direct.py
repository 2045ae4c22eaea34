"""Compares the SNR by direct simulation with that of the chosen surrogates."""

from job import run_job
from wearscope.evaluation.snr import direct_table
from wearscope.storage import tables
from wearscope.surrogates.chosen import read_chosen, read_noise

with run_job(snakemake) as say:
    given, params = snakemake.input, snakemake.params
    direct = tables.read_table(given.direct)
    chosen, quantities = tables.read_table(given.chosen), tables.read_table(given.test_quantities)
    keys = ["robot", "cycle", "axis"]
    here = direct[keys].drop_duplicates()
    chosen = chosen.merge(here, on=keys)
    table = direct_table(
        direct,
        tables.read_table(given.design),
        dict(read_chosen(chosen, quantities.merge(here, on=keys))),
        read_noise(chosen),
        **params.setting,
        seed=params.seed,
    )
    for row in table.itertuples():
        say(f"fda {row.fda}: SNR {row.snr_direct:.3g} directly, {row.snr_surrogate:.3g} by the surrogate")
    tables.write_table(snakemake.output[0], table)
