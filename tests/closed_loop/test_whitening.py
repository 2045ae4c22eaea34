"""Drifts of the torque channels do not pass for effects, and effects are found beside drifts."""

import shutil

import numpy as np
import pytest

from wearscope.closed_loop.selection.rule import TraceOptions
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.regression import Entry
from wearscope.closed_loop.diagnosis import find_prismatic
from wearscope.closed_loop.selection.evidence import Scorer, make_flips
from wearscope.closed_loop.selection.search import Tracer
from wearscope.closed_loop.selection.whitening import drift_p_value, find_filter
from wearscope.effects.base import load_effect


def walk(t, q, v, a, rng):
    """Torque that walks at random in every run, with twice the noise of 1 N m and 0.5 N m."""
    steps = np.cumsum(rng.standard_normal(q.shape), axis=0)
    return np.array([2.0, 1.0]) * steps / steps.std(axis=0)


def trace_beside(folder) -> Tracer:
    return Tracer(prepare(read_dataset(folder, find_prismatic)), TraceOptions())


@pytest.mark.parametrize("persistence", [0.0, 0.5, 0.95, 0.99])
def test_filtered_series_is_white(persistence):
    rng = np.random.default_rng(1)
    series = []
    for _ in range(4):
        x = np.zeros(800)
        for i, e in enumerate(rng.standard_normal(800)):
            x[i] = persistence * x[i - 1] + e
        series.append(x)
    taps = find_filter(series, 40)
    assert taps[0] == 1.0
    assert len(taps) == 41
    left = np.concatenate([np.convolve(x, taps)[41:800] for x in series])
    correlation = [np.mean(left[k:] * left[:-k]) / np.mean(left**2) for k in range(1, 20)]
    assert np.abs(correlation).max() < 0.15
    # A white series stays as it is; a walk loses what it remembers, to what is new in it.
    assert left.var() < 1.1


def test_silence_is_left_alone():
    assert find_filter([np.zeros(100)] * 3, 5).tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]


def test_slow_effects_are_not_significant_beside_a_walk(record):
    """p-values of effects that are not there: small ones are rare, where block by block they are frequent."""
    beside, plain = [], []
    for seed in range(4):
        folder = record(seed=seed, extra_torque=walk)
        tracer = trace_beside(folder)
        shutil.rmtree(folder)
        flips = make_flips(999, len(tracer.blocks), seed)
        scorer = Scorer(tracer.before, tracer.folds, flips)
        for family in tracer.families:
            if family.effect.name not in ("gravity_counterbalance", "joint_spring", "viscous_asymmetry"):
                continue
            subset = family.effect.subsets()[0]
            regressors = tracer.before.correlate(family.columns, family.joint, family.count)
            scored = scorer.score_regressors(family, regressors.select(subset), subset)
            plain.append((1 + np.sum(scored.flips >= scored.odds)) / 1000)
            beside.append(drift_p_value(tracer.before, scored.entry, flips))
    beside, plain = np.array(beside), np.array(plain)
    assert len(beside) >= 20
    assert np.mean(plain < 0.01) > 0.2
    assert np.mean(beside < 0.01) <= 0.1
    assert beside.min() > 1e-4


def test_an_effect_is_significant_beside_a_walk(record):
    folder = record([(0, "stribeck", {"level": 3.0, "speed": 0.3})], seed=3, extra_torque=walk)
    tracer = trace_beside(folder)
    effect = load_effect("stribeck")
    shapes = effect.shapes(tracer.joined, 0)
    shape = tuple(shapes[np.argmin(np.abs(np.log(shapes[:, 0] / 0.3)))])
    assert drift_p_value(tracer.before, Entry(effect, 0, shape, (0,)), tracer.flips) < 1e-4


def test_an_offset_is_not_told_from_the_levels_of_a_walk(record):
    """Four runs whose levels happen to agree are four numbers, not as many as they have blocks."""

    def levels(t, q, v, a, rng):
        ramp = np.sin(np.pi * t / t[-1] - 0.5 * np.pi)
        return np.column_stack([3.0 + 3.0 * ramp, 0.0 * ramp])

    folder = record(seed=4, extra_torque=levels)
    tracer = trace_beside(folder)
    offset = Entry(load_effect("torque_offset"), 0, (), (0,))
    assert drift_p_value(tracer.before, offset, tracer.flips) > 0.5


def test_runs_that_each_show_an_effect_agree(record):
    """Sizes that differ between runs have a small t over four runs, and yet none is in doubt."""
    tracer = trace_beside(record(seed=5))
    scorer = Scorer(tracer.before, tracer.folds, tracer.flips)
    run = tracer.folds.parts
    rng = np.random.default_rng(6)
    own = np.ones(len(run))

    def test(sizes, noise):
        score = own * np.array(sizes)[run] + noise * rng.standard_normal(len(run))
        mean = score.mean()
        return scorer._test_runs(score - mean * own, own, mean * len(run))

    assert test([1.0, 0.4, 1.9, 0.7], 0.1) == 0.0
    assert test([1.0, 0.4, 1.9, 0.0], 0.1) > 0.01
    assert test([1.0, 0.4, 1.9, -0.4], 0.1) > 0.01
    assert test([1.0, 0.4, 1.9, 0.7], 4.0) > 0.01
    assert test([1.0, 1.0, 1.0, 1.0], 0.1) == 0.0
