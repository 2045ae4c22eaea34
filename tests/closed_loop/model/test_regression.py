"""The block sums of a fitted model give what plain least squares on the rows gives; blocks and folds."""

import numpy as np
import pytest
from folders import fit_problem

from wearscope.closed_loop.model.blocks import make_blocks, make_folds
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import load_effect


@pytest.fixture(scope="module")
def problem(record_at, pose, tmp_path_factory):
    folder = tmp_path_factory.mktemp("regression") / "duo"
    planted = [(0, "stribeck", {"level": 6.0, "speed": 0.3})]
    return pose(record_at(folder, planted, seed=1, runs=4, duration=8.0))


@pytest.fixture(scope="module")
def model(problem):
    return fit_problem(problem)


def weighted_rows(model: Regression):
    x, y = [], []
    for d, target, w in zip(model.columns, model.target, model.weights, strict=True):
        x.append((d * w[:, :, None]).reshape(-1, d.shape[2]))
        y.append((target * w).reshape(-1))
    return np.concatenate(x), np.concatenate(y)


def test_solution_is_weighted_least_squares(model):
    x, y = weighted_rows(model)
    expected = np.linalg.lstsq(x, y, rcond=None)[0]
    np.testing.assert_allclose(model.solve(), expected, rtol=1e-6)


def test_adding_the_effect_that_made_the_data_leaves_only_noise(problem, model):
    term = ModelTerm(load_effect("stribeck"), 0, (0.3, 1.0), (0,))
    after = refit(model, [*model.entries, term])
    assert after.solve()[-1] == pytest.approx(6.0, rel=0.03)
    size = [np.std(np.concatenate(one.residuals(one.solve()))[:, 0]) for one in (after, model)]
    assert size[0] < 0.6 * size[1]


def test_folds_hold_out_runs_and_leave_gaps_in_a_single_run(problem):
    folds = problem.layout.folds
    assert folds.by_run and folds.test.shape[0] == 3
    assert not (folds.train & folds.test).any()
    single = [b for b in problem.layout.blocks if b.run == 0]
    folds = make_folds(single, ["one.csv"])
    assert not folds.by_run
    assert folds.test.sum(axis=0).tolist() == [1] * len(single)
    for train, test in zip(folds.train, folds.test, strict=True):
        edge = np.flatnonzero(test)
        for neighbour in (edge[0] - 1, edge[-1] + 1):
            if 0 <= neighbour < len(single):
                assert not train[neighbour]


def test_pieces_of_one_recording_are_held_out_together(problem):
    folds = make_folds(problem.layout.blocks, ["a.csv", "b.csv", "a.csv"])
    run = np.array([b.run for b in problem.layout.blocks])
    assert folds.by_run and len(folds.test) == 2
    held = folds.test[folds.test[:, run == 0].any(axis=1)]
    assert len(held) == 1
    np.testing.assert_array_equal(held[0], np.isin(run, [0, 2]))


def test_blocks_cover_every_row_once(problem):
    for r, run in enumerate(problem.train):
        rows = np.concatenate(
            [np.arange(b.start, b.stop) for b in make_blocks(problem.prepared) if b.run == r]
        )
        np.testing.assert_array_equal(rows, np.arange(len(run.t)))


def test_sums_by_block_are_those_of_its_rows_and_unpacked_rows_those_of_the_runs(problem):
    layout = problem.layout
    x = np.arange(1.0, len(problem.target) + 1)
    start = np.cumsum([0, *(len(run.t) for run in problem.train)])
    expected = [x[start[b.run] + b.start : start[b.run] + b.stop].sum() for b in layout.blocks]
    assert layout.sum_blocks(x).tolist() == expected
    assert [len(part) for part in layout.unpack(x)] == [len(run.t) for run in problem.train]
