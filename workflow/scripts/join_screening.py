"""Joins the screening tables of all robots into one."""

from job import run_job
from screening import read_screening
from wearscope.storage import tables

with run_job(snakemake):
    tables.write_table(snakemake.output[0], read_screening(snakemake.input.screening))
