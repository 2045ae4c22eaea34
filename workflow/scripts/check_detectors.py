"""Refuses a detector that is not there or refuses its options, before anything is simulated."""

import json

from job import run_job
from wearscope import tables
from wearscope.detectors.base import load_detector

with run_job(snakemake) as say:
    made = {}
    for name, detector in snakemake.params.detectors.items():
        made[name] = type(load_detector(detector["use"], detector["options"])).__name__
        say(f"{name}: {made[name]}")
    tables.write_text(snakemake.output[0], json.dumps(made, indent=1) + "\n")
