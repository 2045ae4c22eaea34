"""Refuses a detector that is missing or does not accept its options, before the simulation."""

import json
from functools import partial

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.detectors.base import load_detector
from wearscope.detectors.run import find_options, set_option
from wearscope.storage import tables
from wearscope.supervision import call_supervised


def name_class(reference, options):
    return type(load_detector(reference, options)).__name__


with run_job(snakemake) as say:
    params, made = snakemake.params, {}
    factors = [Factor(**one) for one in params.factors]
    for name, detector in params.detectors.items():
        make = partial(name_class, detector["use"], detector["options"])
        made[name] = call_supervised(make, params.time_limit, f"detectors: {name}: making it")
        say(f"{name}: {made[name]}")
        for option, factor in find_options(factors, name).items():
            for level in (factor.low, factor.high):
                value = set_option(detector["use"], detector["options"], option, factor, level)
                make = partial(name_class, detector["use"], {**detector["options"], option: value})
                call_supervised(make, params.time_limit, f"factors: {factor.name}: making detector {name}")
    tables.write_text(snakemake.output[0], json.dumps(made, indent=1) + "\n")
