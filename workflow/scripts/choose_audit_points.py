"""Chooses the points at which the surrogates are compared with direct simulation."""

import pandas as pd

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.evaluation.audit import choose_audit_points, scope_boundary
from wearscope.storage import tables

with run_job(snakemake):
    params = snakemake.params
    factors = [Factor(**one) for one in params.factors]
    scope = pd.concat([tables.read_table(part) for part in snakemake.input.scope], ignore_index=True)
    boundaries = {name: scope_boundary(scope, name) for name in params.about}
    points = choose_audit_points(factors, boundaries, params.points, params.axes, params.f0, params.detection)
    units = {f"{factor.name}_natural": factor.unit for factor in factors}
    tables.write_table(snakemake.output[0], points, units)
