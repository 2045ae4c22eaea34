"""Reads the results of a reevaluation; shared by several scripts."""

import yaml

from wearscope.designs.factors import Factor
from wearscope.detectors.base import list_bounds
from wearscope.evaluation.reevaluation import Reevaluation
from wearscope.reporting.labels import detector_name, factor_name
from wearscope.storage import tables


def read_reevaluation(files, model, factors, detectors):
    """Return the tables of a reevaluation, and the assumptions in the corrected model."""
    with open(model, encoding="utf-8") as file:
        entries = yaml.safe_load(file)["effects"]
    assumed = tuple(f"{one['effect']} at {one['joint']}" for one in entries if one.get("assumed"))
    names = {one["name"]: factor_name(Factor(**one)) for one in factors}
    names |= {code: detector_name(code, one["use"]) for code, one in detectors.items()}
    found = (tables.read_table(file) for file in files)
    return Reevaluation(*found, assumed, names, tuple(list_bounds(detectors)))
