"""Temperature, change points and trends against truth that is drawn."""

import numpy as np
import pytest

from wearscope.tracking.structure import SLOPE, temperature_features
from wearscope.tracking.trend import find_segments, find_since, fit_trend, leave_healthy


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
        trend = fit_trend(values, np.full(12, 0.01), 0.3)
        _, first, last = trend.left
        inside.append((trend.low <= 0.02 <= trend.high, first <= 15.0 - 11.0 <= last))
    assert (np.mean(inside, axis=0) > 0.9).all()
    assert fit_trend(np.arange(3.0), np.ones(3), 0.3) is None


def test_sessions_until_a_limit_are_those_of_the_line_and_none_are_told_of_one_that_may_not_rise():
    errors = np.full(6, 0.01)
    rising = 0.02 * np.arange(6) + 1e-4 * np.array([1, -1, 1, -1, 1, -1])
    left, first, last = fit_trend(rising, errors, 0.3).left
    assert left == pytest.approx(10.0, abs=0.2) and first < left < last
    assert fit_trend(rising, errors, 0.05).left[0] < 0.0  # it is there already
    assert np.isnan(fit_trend(-rising, errors, 0.3).left).all()
