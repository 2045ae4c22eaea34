"""One table of all test quantities, and one of the points at which a detector failed."""

import pandas as pd

from job import run_job
from wearscope import tables
from wearscope.detectors.run import count_failures

with run_job(snakemake) as say:
    table = pd.concat([tables.read_table(part) for part in snakemake.input.parts], ignore_index=True)
    failures = count_failures(table)
    for row in failures.itertuples():
        say(
            f"fda {row.fda} failed at {row.failed} of {row.points} {row.set} points of {row.robot}, "
            f"{row.cycle}, axis {row.axis}; first {row.first_reason}"
        )
    tables.write_table(snakemake.output.table, table)
    tables.write_table(snakemake.output.failures, failures)
