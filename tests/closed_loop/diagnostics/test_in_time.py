"""A shift of level, and a line that runs have in common, are told from noise that wanders."""

import numpy as np
import pytest
from scipy import signal

from wearscope.closed_loop.diagnostics.in_time import find_line, fit_shift, hold_waves, make_waves

RATE, ROWS = 20.0, 600
T = np.arange(ROWS) / RATE


def colour(white, persistence):
    """Autoregressive noise of variance one."""
    return signal.lfilter([np.sqrt(1.0 - persistence**2)], [1.0, -persistence], white)


def record(seed, runs, noise, amplitude, frequency):
    rng = np.random.default_rng(seed)
    return [
        noise(rng.standard_normal(ROWS)) + amplitude * np.sin(2.0 * np.pi * (frequency * T + rng.random()))
        for _ in range(runs)
    ]


@pytest.mark.parametrize("frequency", [0.11, 0.22])
def test_a_slow_sine_beneath_noise_is_found_in_all_runs_together(frequency):
    """Three periods and more, of half the noise's power, which no run shows by itself."""
    for seed in range(10):
        runs = record(seed, 4, lambda e: colour(e, 0.7), 1.0, frequency)
        line = find_line(runs, RATE)
        assert line.p_value < 1e-4, seed
        assert line.frequency == pytest.approx(frequency, abs=0.01)
        assert line.share == pytest.approx(1.0 / 3.0, abs=0.12)


def test_a_frequency_of_its_own_in_every_run_is_none_in_common():
    frequencies = [0.13, 0.31, 0.47, 0.67]
    runs = [record(k, 1, lambda e: e, 1.0, f)[0] for k, f in enumerate(frequencies)]
    assert find_line(runs, RATE).share < 0.2


KINDS = {
    "white": lambda e: e,
    "coloured": lambda e: colour(e, 0.95),
    "walk": np.cumsum,
    "smooth": lambda e: colour(colour(e, 0.95), 0.9),
    "ramp": lambda e: 0.02 * np.arange(ROWS) + e,
    "heavy": lambda e: e / np.sqrt(np.random.default_rng(7).chisquare(2, ROWS)),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("runs", [1, 3])
def test_noise_has_no_line(kind, runs):
    found = [find_line(record(seed, runs, KINDS[kind], 0.0, 1.0), RATE) for seed in range(60)]
    assert min(line.p_value for line in found) > 1e-4


def test_the_power_that_a_sine_holds_is_what_least_squares_gives():
    x, frequencies = np.random.default_rng(3).standard_normal(ROWS), np.linspace(0.1, 4.0, 600)
    held = hold_waves(T, x, frequencies)
    for k in (0, 255, 256, 599):
        wave = make_waves(T, frequencies[k])
        left = x - wave @ np.linalg.lstsq(wave, x, rcond=None)[0]
        assert held[k] == pytest.approx(1.0 - left @ left / (x @ x), abs=1e-10)


MOMENTS = np.arange(800) / 20.0


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
        x = 2.0 * (MOMENTS >= 17.0) + 0.5 * colour(rng.standard_normal(len(MOMENTS)), persistence)
        shift = fit_shift(MOMENTS, add_knocks(x, rng) if knocked else x)
        assert shift.deviance > 8.0, seed
        assert shift.time == pytest.approx(17.0, abs=0.8)
        assert shift.size == pytest.approx(2.0, abs=0.8)
        assert 0.3 < shift.share < 0.96


def test_the_deviance_is_what_no_line_with_four_bends_holds_of_a_step():
    """Known answer in white noise: the square of the step less its projection, over the noise's variance."""
    step = 3.0 * (MOMENTS >= 20.0)
    at = np.linspace(0.0, MOMENTS[-1], 6)
    hats = np.column_stack([np.interp(MOMENTS, at, unit) for unit in np.eye(6)])
    left = step - hats @ np.linalg.lstsq(hats, step, rcond=None)[0]
    noise = [np.random.default_rng(k).standard_normal(len(MOMENTS)) for k in range(100)]
    found = [fit_shift(MOMENTS, step + one).deviance for one in noise]
    assert np.median(found) == pytest.approx(left @ left, rel=0.15)


SHIFTLESS = ["white", "coloured", "walk", "wandering", "line", "ramp", "warming", "knocks"]


@pytest.mark.parametrize("kind", SHIFTLESS)
def test_noise_and_what_changes_smoothly_have_no_moment(kind):
    """None of 60 series of each kind has a shift of share 0.2 with the deviance that a joint is asked for."""
    for seed in range(60):
        rng = np.random.default_rng(seed)
        white, other = rng.standard_normal((2, len(MOMENTS)))
        series = {
            "white": white,
            "coloured": colour(white, 0.95),
            "walk": np.cumsum(white),
            "wandering": 0.2 * np.cumsum(white) + other,
            "line": 3.0 * np.sin(2.0 * np.pi * MOMENTS / rng.uniform(8.0, 60.0)) + white,
            "ramp": MOMENTS + white,
            "warming": 10.0 * np.exp(-MOMENTS / 9.0) + white,
            "knocks": add_knocks(white, rng),
        }
        shift = fit_shift(MOMENTS, series[kind])
        assert shift.deviance < 25.0 or shift.share < 0.2, (seed, shift)


def test_a_step_without_noise_is_itself():
    shift = fit_shift(MOMENTS, np.where(MOMENTS >= 12.0, 3.0, 0.0))
    assert shift.time == pytest.approx(12.0, abs=0.2)
    assert shift.size == pytest.approx(3.0)
    assert shift.share == pytest.approx(1.0)


def test_too_little_is_nothing():
    assert find_line([np.ones(600), np.ones(99)], RATE) is None
    assert find_line([], RATE) is None
    assert fit_shift(MOMENTS[:99], np.where(MOMENTS[:99] > 2.0, 1.0, 0.0)) is None
    assert fit_shift(MOMENTS, np.zeros_like(MOMENTS)) is None
