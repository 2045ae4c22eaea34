"""A data set's folder changed, and read as a diagnosis does; the plans of a short one."""

import pandas as pd
import yaml

from benchmarks.board.recipe import RunPlan
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.posing import find_prismatic

#: Three training runs of different motions, and a test run.
PLANS = (
    RunPlan("train", "fourier", 0, 24.0),
    RunPlan("train", "sweep", 1, 52.0),
    RunPlan("train", "points", 2, 31.0),
    RunPlan("test", "points", 3, 47.0),
)


def check(folder):
    prepared = prepare(read_dataset(folder, find_prismatic))
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
