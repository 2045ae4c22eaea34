"""Folders of data sets: of real machines, changed, and read as a diagnosis does; the plans of a short one."""

import os
from pathlib import Path

import pandas as pd
import pytest
import yaml

from benchmarks.board.recipe import RunPlan
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.posing import find_prismatic


def plan(*runs):
    """Runs of a kind of motion that start at a temperature [deg C]; the last is the test run."""
    last = len(runs) - 1
    return tuple(
        RunPlan("test" if k == last else "train", kind, k, warmth) for k, (kind, warmth) in enumerate(runs)
    )


#: Three training runs of different motions, and a test run.
PLANS = plan(("fourier", 24.0), ("sweep", 52.0), ("points", 31.0), ("points", 47.0))


def find_real(name):
    """Folder with the recordings of a real machine; the test skips where there is none."""
    place = Path(os.environ.get("WEARSCOPE_DATA", Path(__file__).parents[2] / "shared" / "data")) / name
    if not place.is_dir():
        pytest.skip(f"needs {name} in WEARSCOPE_DATA or ../shared/data (docs/measured-data.md says whence)")
    return place


def read_prepared(folder):
    return prepare(read_dataset(folder, find_prismatic))


def check(folder):
    prepared = read_prepared(folder)
    check_plausibility(prepared)
    return prepared


def fit_problem(problem):
    """The declared model of a problem, fitted."""
    return fit_declared_model(
        problem.prepared, problem.declared_terms, problem.inertial, problem.layout.blocks
    )


def change_runs(folder, change, use=None, first=False):
    """Change the tables of all runs, of those with a `use`, or of the `first` of them."""
    runs = yaml.safe_load((folder / "dataset.yaml").read_text())["runs"]
    files = [folder / run["file"] for run in runs if use in (None, run["use"])]
    for file in files[:1] if first else files:
        change(pd.read_parquet(file)).to_parquet(file, index=False)


def scale(column, factor):
    return lambda table: table.assign(**{column: table[column] * factor})
