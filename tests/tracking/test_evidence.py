"""Fits, scatter and the score of sets of changes, on sessions whose truth is drawn."""

import numpy as np
import pytest
from session_machine import write_machine

from wearscope.tracking.evidence import (
    PRIOR_FRICTION,
    Evidence,
    condition,
    invert,
    measure_scatter,
    prior_scatter,
)
from wearscope.tracking.rows import make_rows, scatter_columns
from wearscope.tracking.session import point_parameters, weigh_point
from wearscope.tracking.session_names import read_sessions
from wearscope.tracking.session_runs import prepare_runs, read_session
from wearscope.tracking.structure import Belief


@pytest.fixture(scope="module")
def rows(reference, tmp_path_factory):
    """Rows of an unchanged session."""
    folder = write_machine(tmp_path_factory.mktemp("evidence") / "duo", [{}, {}], 1, seed=5)
    runs, _ = prepare_runs(read_session(read_sessions(folder), "s1"), reference.structure.frame)
    return [make_rows(reference.structure, run) for run in runs]


def replace_target(reference, rows, rng, change=0.0, scatter=(0.0,) * 10):
    """The rows with a target of the model's own: what is known, white noise, and what is planted."""
    s, made = reference.structure, []
    for r in rows:
        target = r.columns @ reference.belief.mean + s.scales.noise * rng.standard_normal(r.target.shape)
        target += scatter_columns(s, r) @ np.asarray(scatter)
        target[:, 0] += change * r.run.reduce(r.signals.sign)[:, 0]
        made.append(type(r)(**{**vars(r), "target": target}))
    return made


def friction(evidence):
    return next(c for c in evidence.changes if c.key == "coulomb@0")


def test_intervals_cover_a_planted_change(reference, rows):
    inside = []
    for seed in range(40):
        evidence = reference.weigh(replace_target(reference, rows, np.random.default_rng(seed), 0.7))
        fit = evidence.fit([friction(evidence)])
        ((value,), (error,)) = fit.values["coulomb@0"], fit.error(friction(evidence))
        inside.append(abs(value - 0.7) <= 2.0 * error)
    assert np.mean(inside) >= 0.9


def test_score_falls_by_the_cost_of_what_is_not_there_and_rises_with_what_is(reference, rows):
    made = [
        replace_target(reference, rows, np.random.default_rng(k), change) for k, change in ((1, 0), (2, 2.0))
    ]
    calm, worn = (reference.weigh(one) for one in made)
    gains = [e.compare(e.fit(()), e.fit([friction(e)])) for e in (calm, worn)]
    assert gains[0] < -3.0 and gains[1] > 20.0
    assert worn.compare(worn.fit([friction(worn)]), worn.fit(())) == pytest.approx(-gains[1])


def test_a_smaller_false_alarm_rate_asks_for_more(reference, rows):
    made = replace_target(reference, rows, np.random.default_rng(3), 1.0)
    one, other = (reference.weigh(made, level) for level in (0.01, 0.0001))
    gains = [e.compare(e.fit(()), e.fit([friction(e)])) for e in (one, other)]
    assert gains[0] - gains[1] == pytest.approx(np.log(100.0))


def test_smallest_change_is_where_the_score_becomes_positive(reference, rows):
    evidence = reference.weigh(replace_target(reference, rows, np.random.default_rng(4)))
    size = evidence.smallest(evidence.fit(()), friction(evidence), np.ones(1))
    for factor, seen in ((0.5, False), (2.0, True)):
        made = replace_target(reference, rows, np.random.default_rng(4), factor * size)
        own = reference.weigh(made)
        assert (own.compare(own.fit(()), own.fit([friction(own)])) > 0.0) == seen


def test_scatter_of_healthy_sessions_is_found_and_one_that_is_none_keeps_its_prior(reference, rows):
    s, rng = reference.structure, np.random.default_rng(0)
    known = Belief(reference.belief.mean, np.zeros_like(reference.belief.covariance))
    planted = np.zeros(10)
    planted[0] = 0.08
    for size, low, high in ((1.0, 0.05, 0.1), (0.0, 0.0, PRIOR_FRICTION)):
        made = [
            replace_target(reference, rows, rng, 0.0, size * planted * rng.normal(size=10)) for _ in range(12)
        ]
        found = measure_scatter(s, [Evidence(s, (), known, np.ones(10), m) for m in made], made)
        assert low < found[0] <= high
    assert prior_scatter(s).shape == (10,)


def test_noise_with_memory_is_worth_fewer_rows(reference, rows):
    evidence = reference.weigh(rows)
    rng = np.random.default_rng(6)
    white = rng.standard_normal(len(evidence.y))
    slow = np.convolve(rng.standard_normal(len(white) + 80), np.ones(80), "valid")[: len(white)]
    assert evidence.blocks.find_design_effect(white) < 2.0
    assert evidence.blocks.find_design_effect(slow) > 10.0
    assert evidence.rows(slow, 0) < evidence.rows(white, 0) <= 250.0


def test_a_point_is_weighed_from_its_moment_and_inertia():
    """Of one joint only the moments in its plane and one inertia show: together they give a mass."""
    mass, place = 0.5, np.array([0.45, 0.0, 0.1])
    truth = point_parameters(mass, place)
    shown = np.zeros((3, 10))
    shown[[0, 1, 2], [1, 3, 6]] = 1.0
    information = shown.T @ np.diag(1.0 / np.array([0.004, 0.004, 0.003]) ** 2) @ shown
    prior = np.full(10, 1.0)
    covariance = invert(information + np.diag(prior))
    value = covariance @ information @ truth
    found, low, high, where = weigh_point(value, covariance, prior, 1.0)
    assert low <= mass <= high and high < 0.6 and found == pytest.approx(mass, rel=0.1)
    np.testing.assert_allclose(where[[0, 2]], place[[0, 2]], atol=0.05)
    # Without the inertia the mass is only known to be at least the moment over the reach.
    information[6, 6] = 0.0
    covariance = invert(information + np.diag(prior))
    _, low, high, _ = weigh_point(covariance @ information @ truth, covariance, prior, 0.6)
    assert 0.7 * np.hypot(0.225, 0.05) / 0.6 < low < mass and high > 2.0 * mass


def test_a_body_that_was_taken_away_has_a_negative_mass():
    truth = -point_parameters(0.8, np.array([0.2, 0.05, 0.0]))
    covariance = 1e-8 * np.eye(10)
    mass, low, high, place = weigh_point(truth, covariance, np.full(10, 1e-6), 1.0)
    assert low <= -0.8 <= high < 0.0 and mass == pytest.approx(-0.8, rel=0.05)
    np.testing.assert_allclose(place, [0.2, 0.05, 0.0], atol=0.02)


def test_conditioning_is_that_of_normal_variables():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(4, 4))
    covariance, known = root @ root.T, np.array([False, True, False, True])
    left = condition(covariance, known)
    expected = np.linalg.inv(np.linalg.inv(covariance)[np.ix_(~known, ~known)])
    np.testing.assert_allclose(left[np.ix_(~known, ~known)], expected, rtol=1e-6)
    assert not left[known].any() and not left[:, known].any()
