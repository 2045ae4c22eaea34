"""Estimates, scatter and trends against truth that is drawn."""

import numpy as np
import pytest
from scipy import stats

from wearscope.effects.base import load_effect
from wearscope.tracking.changes import Change, plain_term
from wearscope.tracking.inference import Belief, Estimate, SessionRows, estimate_change, make_sample
from wearscope.tracking.scatter import PRIOR_FRICTION, Scatter, measure_scatter
from wearscope.tracking.temperature import SLOPE, temperature_features
from wearscope.tracking.trend import find_segments, find_since, fit_trend, leave_healthy


def one(name="coulomb", joint=0):
    return Change(name, joint, (plain_term(load_effect(name), joint),), True, True, 0)


def draw_rows(rng, change, belief_sd, rows=400, block=20):
    """A session of one change and a nuisance that is known to `belief_sd`; noise equal within blocks."""
    z, c = rng.normal(size=(2, rows, 1))
    c = 0.6 * z + 0.8 * c
    noise = np.repeat(rng.normal(size=rows // block), block) + 0.3 * rng.normal(size=rows)
    target = (z[:, 0] * change + c[:, 0] * belief_sd * rng.normal()) + noise
    starts = np.arange(0, rows, block)
    return SessionRows(target, c, np.zeros((rows, 0)), z, z / np.sqrt(rows), starts)


@pytest.mark.parametrize("belief_sd", [0.0, 0.4, 30.0])
def test_intervals_cover_the_change_whatever_is_known_of_the_nuisance(belief_sd):
    change = one()
    belief = Belief(np.zeros(1), np.array([[belief_sd**2]]))
    inside = []
    for seed in range(400):
        rows = draw_rows(np.random.default_rng(seed), 0.7, belief_sd)
        estimate = estimate_change(make_sample(rows, [change], belief, np.zeros(10)), change)
        half = stats.t.ppf(0.975, 19) * np.sqrt(estimate.noise[0, 0])
        inside.append(abs(estimate.value[0] - 0.7) <= half)
    assert 0.92 <= np.mean(inside) <= 0.985


def test_nuisance_that_nobody_knows_is_estimated_and_one_that_is_known_is_not():
    change = one()
    rng = np.random.default_rng(3)
    rows = draw_rows(rng, 1.0, 0.0)
    ordinary = np.linalg.lstsq(np.column_stack([rows.columns, rows.base]), rows.target, rcond=None)[0][0]
    alone = np.linalg.lstsq(rows.columns, rows.target, rcond=None)[0][0]
    for variance, expected in ((1e8, ordinary), (0.0, alone)):
        sample = make_sample(rows, [change], Belief(np.zeros(1), np.array([[variance]])), np.zeros(10))
        assert estimate_change(sample, change).value[0] == pytest.approx(expected, rel=1e-4)


def draw_healthy(rng, sessions, joints, scatter, noise=0.002):
    """Estimates of healthy sessions of joints whose friction scatters; the friction is one."""
    found = []
    for _ in range(sessions):
        values = rng.normal(size=joints) * np.hypot(scatter, noise)
        found.append(
            {
                f"coulomb@{j}": Estimate(
                    one(joint=j), values[[j]], np.array([[noise**2]]), np.eye(1), np.zeros((1, 1)), 1.0, 1.0
                )
                for j in range(joints)
            }
        )
    return found


def test_scatter_is_found_and_its_prior_gives_way_to_sessions():
    rng = np.random.default_rng(1)
    assert measure_scatter(draw_healthy(rng, 40, 6, 0.03), 6).friction == pytest.approx(0.03, rel=0.15)
    assert measure_scatter(draw_healthy(rng, 40, 6, 0.0), 6).friction < 0.002
    assert measure_scatter([], 6).friction == PRIOR_FRICTION
    assert measure_scatter(draw_healthy(rng, 1, 6, 0.0), 6).friction == PRIOR_FRICTION


@pytest.mark.parametrize(("sessions", "scatter"), [(3, 0.01), (5, 0.02), (3, 0.0)])
def test_healthy_sessions_are_called_changed_at_the_stated_rate(sessions, scatter):
    alarms = []
    for seed in range(400):
        rng = np.random.default_rng([seed, sessions])
        known = measure_scatter(draw_healthy(rng, sessions, 4, scatter), 4)
        later = draw_healthy(rng, 1, 4, scatter)[0]
        alarms.append(min(known.p_value(e) for e in later.values()) * len(later) <= 0.05)
    assert np.mean(alarms) <= 0.08


def test_joint_that_scatters_more_than_the_others_is_given_its_own():
    rng = np.random.default_rng(0)
    healthy = draw_healthy(rng, 8, 6, 0.005)
    for estimates in healthy:
        e = estimates["coulomb@2"]
        estimates["coulomb@2"] = Estimate(
            e.change, 12.0 * e.value, e.noise, e.shares, e.prior, e.gain, e.torque
        )
    scatter = measure_scatter(healthy, 6)
    assert scatter.inflation["coulomb@2"] > 5.0 * max(
        scatter.inflation[f"coulomb@{j}"] for j in (0, 1, 3, 4, 5)
    )


def test_p_value_is_that_of_student_for_one_parameter():
    scatter = Scatter(0.0, 0.0, {}, 12.0, 3)
    e = Estimate(one(), np.array([2.0]), np.array([[1.0]]), np.eye(1), np.zeros((1, 1)), 1.0, 1.0)
    assert scatter.p_value(e) == pytest.approx(2 * stats.t.sf(2.0, 12))
    assert scatter.width(e)[0] == pytest.approx(stats.t.ppf(0.975, 12))


def test_features_of_temperature_make_the_squared_exponential_kernel():
    warmth = np.array([20.0, 35.0, 41.0, 60.0])
    x = temperature_features(warmth, 35.0) / (SLOPE * 25.0)
    r = (warmth - 35.0) / 25.0
    kernel = np.exp(-0.5 * (r[:, None] - r[None]) ** 2)
    at_mean = np.exp(-0.5 * r**2)
    # Without the constant function, which the reference's friction is.
    bell = np.outer(at_mean - 1, at_mean - 1) - np.outer(at_mean, at_mean)
    np.testing.assert_allclose(x @ x.T, kernel + bell, atol=2e-3)
    np.testing.assert_array_equal(x[1], 0.0)


def test_step_is_one_change_point_and_noise_is_none():
    rng = np.random.default_rng(5)
    step = np.repeat([0.0, 0.1], [6, 5]) + 0.01 * rng.normal(size=11)
    np.testing.assert_array_equal(find_segments(step, np.full(11, 0.01)), np.repeat([0, 1], [6, 5]))
    several = [find_segments(0.01 * rng.normal(size=10), np.full(10, 0.01)).max() for _ in range(200)]
    assert np.mean(np.array(several) > 0) < 0.1


def test_change_points_are_those_of_ruptures():
    import ruptures

    rng = np.random.default_rng(7)
    for length in (2, 9, 40):
        for _ in range(20):
            values = 3.0 * np.cumsum(rng.random(length) < 0.2) + rng.normal(size=length)
            search = ruptures.Pelt(model="l2", min_size=1, jump=1).fit(values[:, None])
            ends = search.predict(pen=3.0 * np.log(length))[:-1]
            expected = np.searchsorted(ends, np.arange(length), side="right")
            np.testing.assert_array_equal(find_segments(values, np.ones(length)), expected)


def test_session_without_an_estimate_belongs_to_the_one_before():
    values = np.array([0.0, 0.0, np.nan, 5.0, 5.0])
    np.testing.assert_array_equal(find_segments(values, np.full(5, 0.1)), [0, 0, 0, 1, 1])


def test_since_goes_back_over_sessions_that_count_or_are_of_the_same_level():
    counting = [False, False, True, True]
    assert find_since(counting, [0, 0, 1, 1], 3) == 2
    assert find_since(counting, [0, 1, 1, 1], 3) == 1
    assert find_since([True, False, True], [0, 1, 2], 2) == 2


def test_since_does_not_go_back_over_sessions_on_the_healthy_level():
    # A change too small for a change point: it counts from where it is named.
    segments = leave_healthy(np.zeros(6, dtype=int), 2)
    assert find_since([False, False, False, True], segments, 3) == 3
    segments = leave_healthy(np.array([0, 0, 0, 1, 1, 1]), 2)
    assert find_since([False, False, False, True], segments, 3) == 1


def test_trend_is_found_with_an_interval_that_covers_it():
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(200):
        values = 0.02 * np.arange(12) + 0.01 * rng.normal(size=12)
        trend = fit_trend(values, np.full(12, 0.01))
        inside.append(trend.low <= 0.02 <= trend.high)
    assert np.mean(inside) > 0.9
    assert fit_trend(np.arange(3.0), np.ones(3)) is None
