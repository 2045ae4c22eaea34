"""The surrogates' error where they were held against direct simulation."""

from job import run_job
from wearscope import tables
from wearscope.reporting.figures.audit import draw_audit
from wearscope.reporting.style import save_figure

with run_job(snakemake):
    figure = draw_audit(tables.read_table(snakemake.input.audit))
    save_figure(figure, snakemake.output.audit_svg, snakemake.output.audit_png)
