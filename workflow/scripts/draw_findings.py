"""Draws the paper's Figs. 2, 3 and 4 from the study's results."""

from job import run_job
from screening import read_screening
from wearscope.designs.factors import Factor
from wearscope.evaluation.sensitivity import drop_idle
from wearscope.evaluation.snr import answer_rows
from wearscope.reporting.figures import draw_scope, draw_sensitivity, draw_snr
from wearscope.reporting.style import save_figure
from wearscope.storage import tables

with run_job(snakemake) as say:
    params, given, out = snakemake.params, snakemake.input, snakemake.output
    factors = [Factor(**one) for one in params.factors]
    snr = answer_rows(tables.read_table(given.snr))
    scope = tables.read_table(given.scope)

    def save(name, figure):
        save_figure(figure, out[f"{name}_svg"], out[f"{name}_png"])
        say(f"{name} is drawn")

    surrogates = drop_idle(tables.read_table(given.surrogates), read_screening(given.screening), "term")
    save("sensitivity", draw_sensitivity(surrogates, params.model, params.sensitivity_by))
    save("snr", draw_snr(snr, tables.read_table(given.ranking), params.snr_by))
    for name in params.scope_factors:
        save(f"scope_{name}", draw_scope(scope, name, factors, params.scope_by))
