"""A step of about the noise's size is told from noise that wanders."""

import numpy as np
import pytest
from scipy import signal

from wearscope.closed_loop.diagnostics.jumps import fit_shift

T = np.arange(800) / 20.0


def colour(white, persistence):
    """Autoregressive noise of variance one."""
    return signal.lfilter([np.sqrt(1.0 - persistence**2)], [1.0, -persistence], white)


def add_knocks(x, rng):
    x = x.copy()
    for at in rng.integers(20, len(x) - 20, 3):
        x[at : at + 3] += rng.choice([-8.0, 8.0])
    return x


@pytest.mark.parametrize("persistence", [0.0, 0.7])
@pytest.mark.parametrize("knocked", [False, True])
def test_a_step_within_the_noise_is_found_with_its_moment_and_size(persistence, knocked):
    for seed in range(10):
        rng = np.random.default_rng(seed)
        x = 2.0 * (T >= 17.0) + 0.5 * colour(rng.standard_normal(len(T)), persistence)
        shift = fit_shift(T, add_knocks(x, rng) if knocked else x)
        assert shift.deviance > 8.0, seed
        assert shift.time == pytest.approx(17.0, abs=0.8)
        assert shift.size == pytest.approx(2.0, abs=0.8)
        assert 0.3 < shift.share < 0.96


def test_the_deviance_is_what_no_line_with_four_bends_holds_of_a_step():
    """Known answer in white noise: the square of the step less its projection, over the noise's variance."""
    step = 3.0 * (T >= 20.0)
    at = np.linspace(0.0, T[-1], 6)
    hats = np.column_stack([np.interp(T, at, unit) for unit in np.eye(6)])
    left = step - hats @ np.linalg.lstsq(hats, step, rcond=None)[0]
    noise = [np.random.default_rng(k).standard_normal(len(T)) for k in range(100)]
    found = [fit_shift(T, step + one).deviance for one in noise]
    assert np.median(found) == pytest.approx(left @ left, rel=0.15)


KINDS = ["white", "coloured", "walk", "wandering", "line", "ramp", "warming", "knocks"]


@pytest.mark.parametrize("kind", KINDS)
def test_noise_and_what_changes_smoothly_have_no_moment(kind):
    """None of 60 series of each kind has a shift of share 0.2 with the deviance that a joint is asked for."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        white, other = rng.standard_normal((2, len(T)))
        series = {
            "white": white,
            "coloured": colour(white, 0.95),
            "walk": np.cumsum(white),
            "wandering": 0.2 * np.cumsum(white) + other,
            "line": 3.0 * np.sin(2.0 * np.pi * T / rng.uniform(8.0, 60.0)) + white,
            "ramp": T + white,
            "warming": 10.0 * np.exp(-T / 9.0) + white,
            "knocks": add_knocks(white, rng),
        }
        shift = fit_shift(T, series[kind])
        assert shift.deviance < 25.0 or shift.share < 0.2, (seed, shift)


def test_too_little_is_nothing():
    assert fit_shift(T[:99], np.where(T[:99] > 2.0, 1.0, 0.0)) is None
    assert fit_shift(T, np.zeros_like(T)) is None


def test_a_step_without_noise_is_itself():
    shift = fit_shift(T, np.where(T >= 12.0, 3.0, 0.0))
    assert shift.time == pytest.approx(12.0, abs=0.2)
    assert shift.size == pytest.approx(3.0)
    assert shift.share == pytest.approx(1.0)
