"""A line that runs have in common is told from noise that wanders."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from wearscope.closed_loop.diagnostics.in_time import see_lines
from wearscope.closed_loop.inference.lines import find_common_line, find_line, hold_waves, make_waves
from wearscope.closed_loop.inference.policy import Policy

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
        assert all(find_line(x, RATE).share == 0.0 for x in runs)
        line = find_common_line(runs, RATE)
        assert line.p_value < 1e-4, seed
        assert line.frequency == pytest.approx(frequency, abs=0.01)
        assert line.share == pytest.approx(1.0 / 3.0, abs=0.12)


def test_a_frequency_of_its_own_in_every_run_is_none_in_common():
    frequencies = [0.13, 0.31, 0.47, 0.67]
    runs = [record(k, 1, lambda e: e, 1.0, f)[0] for k, f in enumerate(frequencies)]
    assert find_common_line(runs, RATE).share < 0.2


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
    found = [find_common_line(record(seed, runs, KINDS[kind], 0.0, 1.0), RATE) for seed in range(60)]
    assert min(line.p_value for line in found) > 1e-4


def test_too_little_is_nothing():
    assert find_common_line([np.ones(600), np.ones(100)], RATE) is None
    assert find_common_line([], RATE) is None


@pytest.mark.parametrize("hidden", [True, False])
def test_a_sine_is_seen_where_rows_that_count_show_it(hidden):
    """Knocks of twenty times its size, in rows that do not count, are all that the whole record shows."""
    rng = np.random.default_rng(3)
    time = np.arange(2000) / 200.0
    train, own, keep, full = [], [], [], []
    for _ in range(2):
        wave = 0.1 * np.sin(2.0 * np.pi * (0.64 * time + rng.random()))
        far = np.zeros(len(time))
        for at in rng.choice(len(time) - 150, 6, replace=False):
            far[at : at + 120] += rng.choice([-2.0, 2.0])
        noise = 0.04 * rng.standard_normal(len(time))
        counts = far == 0.0
        full.append(noise + (wave if hidden else 0.0) + far)
        train.append(SimpleNamespace(t=time[::8]))
        own.append(full[-1][::8])
        keep.append(counts[::8])
    seen = see_lines(full, train, own, keep, 200.0, 20.0, 1, Policy())
    if not hidden:
        assert seen == []
        return
    assert find_common_line(full, 200.0).p_value > 1e-3
    assert "a line at 0.6" in seen[0].reason and seen[0].share > 0.2
    # No torque that is compared below half a hertz has it.
    assert see_lines(full, train, own, keep, 200.0, 0.5, 1, Policy()) == []


def test_the_power_that_a_sine_holds_is_what_least_squares_gives():
    x, frequencies = np.random.default_rng(3).standard_normal(ROWS), np.linspace(0.1, 4.0, 600)
    held = hold_waves(T, x, frequencies)
    for k in (0, 255, 256, 599):
        wave = make_waves(T, frequencies[k])
        left = x - wave @ np.linalg.lstsq(wave, x, rcond=None)[0]
        assert held[k] == pytest.approx(1.0 - left @ left / (x @ x), abs=1e-10)
