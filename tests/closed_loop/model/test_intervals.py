"""Intervals hold what has no name: plain friction that is too small for one, and what differs by run."""

import numpy as np
import pytest
from folders import fit_problem

from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.model.prediction import refit


def fit(problem, without=()):
    declared = fit_problem(problem)
    return refit(declared, [term for term in declared.entries if term.label not in without])


def find_level(model, label, conditional=False):
    (own,) = (e for e in estimate(model, conditional=conditional) if e.entry.label == label)
    return own.intervals["level"]


def test_an_interval_holds_what_plain_friction_without_a_name_takes(record, pose):
    problem = pose(record(noise=0.3, seed=4))
    without, complete = fit(problem, without=("viscous@0",)), fit(problem)
    low, high = find_level(without, "coulomb@0", conditional=True)
    assert not low <= 6.0 <= high
    low, high = find_level(without, "coulomb@0")
    assert low <= 6.0 <= high
    # With its name, friction is as sure as it was.
    low, high = find_level(complete, "coulomb@0")
    assert low <= 6.0 <= high
    assert high - low < 0.2


@pytest.mark.parametrize("runs", [5, 2])
def test_an_interval_holds_what_differs_by_run_or_by_part_of_few(record, pose, runs):
    """Coulomb friction that changes every three seconds, far slower than the noise."""

    def wander(t, q, v, a, rng):
        levels = rng.normal(0.0, 0.5, int(t[-1] // 3) + 1)
        extra = levels[(t // 3).astype(int)] * np.sign(v[:, 0])
        return np.column_stack([extra, 0.0 * extra])

    model = fit(pose(record(noise=0.1, extra_torque=wander, runs=runs, seed=2)))
    low, high = find_level(model, "coulomb@0")
    assert low <= 6.0 <= high
    # At the other joint nothing differs.
    other = find_level(model, "coulomb@1")
    assert other[0] <= 3.0 <= other[1]
    assert np.ptp(other) < 0.5 < high - low


def test_an_interval_counts_no_more_rows_than_stated(record, pose):
    """It is that of least squares with so many rows, and all of them count where that is wider."""
    model = fit(pose(record(noise=0.2, seed=5)))
    assert not np.any(model.prepared.reversals.width)
    most, runs = 20.0, model.prepared.runs_for("train")
    keep = np.concatenate([run.keep for run in runs])
    normal = model.weak_prior.copy()
    for j in range(2):
        x = np.concatenate(model.columns)[keep[:, j], j]
        normal += most / len(x) * x.T @ x / model.sigma[j] ** 2
    half = 1.96 * np.sqrt(np.diag(np.linalg.inv(normal)))
    few, many, all_rows = (estimate(model, most_rows=rows, conditional=True) for rows in (most, 1e4, np.inf))
    for k, entry in enumerate(model.entries):
        ends = [next(iter(one[k].intervals.values())) for one in (few, many, all_rows)]
        assert np.ptp(ends[0]) == pytest.approx(2.0 * half[k], rel=1e-3), entry.label
        assert ends[1] == ends[2]
        assert np.ptp(ends[2]) < np.ptp(ends[0])
