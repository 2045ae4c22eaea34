"""The block sums give what plain least squares on the rows gives."""

import numpy as np
import pytest

from wearscope.closed_loop.model.blocks import make_blocks, make_folds
from wearscope.closed_loop.selection.rule import TraceOptions
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.regression import (
    Entry,
    Regression,
    block_scores,
    cross_validate_family,
    partial_fit,
)
from wearscope.closed_loop.diagnosis import find_prismatic
from wearscope.closed_loop.selection.search import Tracer
from wearscope.effects.base import load_effect


@pytest.fixture
def tracer(record):
    folder = record([(0, "stribeck", {"level": 6.0, "speed": 0.3})], seed=1, runs=4, duration=8.0)
    return Tracer(prepare(read_dataset(folder, find_prismatic)), TraceOptions(flips=99))


def weighted_rows(model: Regression, extra: list[np.ndarray] | None = None):
    x, y, run = [], [], []
    for r, (d, target, w) in enumerate(zip(model.columns, model.target, model.weights, strict=True)):
        full = d if extra is None else np.concatenate([d, extra[r]], axis=2)
        x.append((full * w[:, :, None]).reshape(-1, full.shape[2]))
        y.append((target * w).reshape(-1))
        run.append(np.full(y[-1].size, r))
    return np.concatenate(x), np.concatenate(y), np.concatenate(run)


def family_and_columns(tracer: Tracer):
    family = next(f for f in tracer.families if f.effect.name == "quadratic_viscous" and f.joint == 0)
    full = []
    for x in family.columns:
        padded = np.zeros((len(x), 2, 1))
        padded[:, 0] = x
        full.append(padded)
    return family, full


def test_solution_is_weighted_least_squares(tracer):
    x, y, _ = weighted_rows(tracer.before)
    expected = np.linalg.lstsq(x, y, rcond=None)[0]
    np.testing.assert_allclose(tracer.before.solve(), expected, rtol=1e-6)
    np.testing.assert_allclose(
        tracer.before.losses(tracer.before.solve()).sum(), ((y - x @ expected) ** 2).sum(), rtol=1e-8
    )


def test_family_beside_the_model_is_the_joint_fit(tracer):
    family, full = family_and_columns(tracer)
    model = tracer.before
    fit = partial_fit(model, model.correlate(family.columns, 0, 1))
    x, y, _ = weighted_rows(model, full)
    theta = np.linalg.lstsq(x, y, rcond=None)[0]
    before = model.losses(model.solve()).sum()
    np.testing.assert_allclose(fit.beta[0, 0], theta[-1], rtol=1e-4)
    np.testing.assert_allclose(fit.gain[0], before - ((y - x @ theta) ** 2).sum(), rtol=1e-4)


def test_held_out_losses_are_those_of_runs_left_out(tracer):
    family, full = family_and_columns(tracer)
    model = tracer.before
    losses = cross_validate_family(model, model.correlate(family.columns, 0, 1), tracer.folds)
    x, y, run = weighted_rows(model, full)
    block_run = np.array([b.run for b in model.blocks])
    for r in range(3):
        theta = np.linalg.lstsq(x[run != r], y[run != r], rcond=None)[0]
        expected = ((y - x @ theta)[run == r] ** 2).sum()
        np.testing.assert_allclose(losses[block_run == r].sum(), expected, rtol=1e-4)


def test_scores_of_a_fitted_family_sum_to_zero_and_feel_the_residual(tracer):
    family, _ = family_and_columns(tracer)
    model = tracer.before
    regressors = model.correlate(family.columns, 0, 1)
    fit = partial_fit(model, regressors)
    scores = block_scores(model, regressors, fit.beta)
    assert np.abs(scores.sum(axis=0)).max() < 1e-3 * np.abs(scores).max()
    alone = block_scores(model, regressors).sum(axis=0)
    np.testing.assert_allclose(alone[0], fit.inner[0] @ fit.beta[0], rtol=1e-4)
    assert np.abs(scores).max() > 0


def test_adding_the_effect_that_made_the_data_leaves_only_noise(tracer):
    entry = Entry(load_effect("stribeck"), 0, (0.3, 1.0), (0,))
    after = tracer.fit([entry])
    assert after.solve()[-1] == pytest.approx(6.0, rel=0.03)
    fresh = after.cross_validate_joints(tracer.folds)[0]
    assert fresh < 0.35 * tracer.declared[0]


def test_folds_hold_out_runs_and_leave_gaps_in_a_single_run(tracer):
    assert tracer.folds.by_run and tracer.folds.test.shape[0] == 3
    assert not (tracer.folds.train & tracer.folds.test).any()
    single = [b for b in tracer.blocks if b.run == 0]
    folds = make_folds(single)
    assert not folds.by_run
    assert folds.test.sum(axis=0).tolist() == [1] * len(single)
    for train, test in zip(folds.train, folds.test, strict=True):
        edge = np.flatnonzero(test)
        for neighbour in (edge[0] - 1, edge[-1] + 1):
            if 0 <= neighbour < len(single):
                assert not train[neighbour]


def test_blocks_cover_every_row_once(tracer):
    for r, run in enumerate(tracer.prepared.runs_for("train")):
        rows = np.concatenate(
            [np.arange(b.start, b.stop) for b in make_blocks(tracer.prepared) if b.run == r]
        )
        np.testing.assert_array_equal(rows, np.arange(len(run.t)))


def test_p_values_are_about_uniform_on_noise(record, tmp_path):
    values = []
    for seed in range(12):
        folder = record(seed=50 + seed, runs=3, duration=6.0)
        tracer = Tracer(prepare(read_dataset(folder, find_prismatic)), TraceOptions(flips=199))
        scored = tracer.score_all(tracer.before, tracer.families)
        values.append(min(s.p_block for s in scored))
        folder.rename(tmp_path / f"done{seed}")
    # The smallest of all candidates' family-wise p-values is uniform where nothing is there.
    assert np.mean(values) > 0.2
    assert np.sum(np.array(values) < 0.01) <= 3
