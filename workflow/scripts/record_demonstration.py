"""Records the demonstration's data set: a simulated robot with an undeclared effect."""

from pathlib import Path

from job import run_job
from wearscope.demonstration.twin import record_twin

with run_job(snakemake) as say:
    folder, params = Path(snakemake.output.dataset).parent, snakemake.params
    record_twin(folder, params.seed, duration=params.seconds, truth_path=snakemake.output.truth)
