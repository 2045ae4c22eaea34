"""Joins all test quantities into one table, and lists failures of simulations and of detectors."""

import pandas as pd

from job import run_job
from wearscope.detectors.run import count_failures
from wearscope.storage import tables

with run_job(snakemake) as say:
    given, made = snakemake.input, snakemake.output
    failed = pd.concat(list(tables.Parts(given.failed)), ignore_index=True)
    failures = []

    def count(part):
        failures.append(count_failures(part))
        return part

    tables.join_tables(made.table, tables.Parts(given.parts).by("robot", count))
    failures = pd.concat(failures, ignore_index=True)
    for row in failed.itertuples():
        say(f"the simulation of {row.robot}, {row.cycle}, {row.set} point {row.point} failed: {row.reason}")
    for row in failures.itertuples():
        say(
            f"fda {row.fda} failed at {row.failed} of {row.points} {row.set} points of {row.robot}, "
            f"{row.cycle}, axis {row.axis}; first {row.first_reason}"
        )
    tables.write_table(made.failures, failures)
    tables.write_table(made.failed_simulations, failed)
