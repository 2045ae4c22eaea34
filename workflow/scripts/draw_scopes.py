"""Draws the paper's Fig. 4 of a divided study, from the sums of its partitions' counts."""

from job import run_job
from wearscope.designs.factors import Factor
from wearscope.evaluation.scope import add_counts, count_scope
from wearscope.reporting.figures import draw_scope_counts
from wearscope.reporting.style import save_figure
from wearscope.storage import tables

COLUMNS = [
    "robot", "cycle", "axis", "fda", "factor", "delta", "sigma", "passes", "method", "confidence",
]  # fmt: skip

with run_job(snakemake):
    params, out = snakemake.params, snakemake.output
    factors = [Factor(**one) for one in params.factors]
    parts = tables.Parts(snakemake.input.scope, COLUMNS)
    counts = add_counts(count_scope(part, params.by) for part in parts)
    for name in params.names:
        figure = draw_scope_counts(counts, name, factors, params.by)
        save_figure(figure, out[f"scope_{name}_svg"], out[f"scope_{name}_png"])
