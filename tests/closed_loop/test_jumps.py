"""Jumps in time are told from noise, whatever its memory."""

import numpy as np
import pytest

from wearscope.closed_loop.diagnostics.jumps import find_jumps

T = np.arange(0.0, 40.0, 0.05)


def colour(white, persistence):
    """Autoregressive noise of variance one."""
    x = np.zeros_like(white)
    for k in range(1, len(white)):
        x[k] = persistence * x[k - 1] + np.sqrt(1.0 - persistence**2) * white[k]
    return x


@pytest.mark.parametrize("persistence", [0.0, 0.9])
@pytest.mark.parametrize("at", [11.0, 31.7])
def test_a_step_is_found_with_its_time_and_size(persistence, at):
    noise = colour(np.random.default_rng(3).standard_normal(len(T)), persistence)
    jumps = find_jumps(T, np.where(at < T, 2.0, -1.0) + 0.2 * noise)
    assert jumps.time == pytest.approx(at, abs=0.2)
    assert jumps.size == pytest.approx(3.0, abs=0.3)
    assert 0.9 < jumps.share < 1.0


def test_a_square_wave_is_found():
    wave = np.sign(np.sin(2.0 * np.pi * T / 4.3 + 1.0))
    jumps = find_jumps(T, 2.0 * wave + 0.2 * np.random.default_rng(4).standard_normal(len(T)))
    assert abs(jumps.size) == pytest.approx(4.0, abs=0.3)
    assert np.abs(T[1:][np.diff(wave) != 0.0] - jumps.time).min() < 0.2


@pytest.mark.parametrize("kind", ["white", "coloured", "walk", "line", "ramp", "warming", "heavy"])
def test_noise_and_what_changes_smoothly_keep_no_levels(kind):
    """None of 25 series of each kind, though sixteen levels hold a walk or a ramp well."""
    for seed in range(25):
        white = np.random.default_rng(seed).standard_normal(len(T))
        series = {
            "white": white,
            "coloured": colour(white, 0.95),
            "walk": np.cumsum(white),
            "line": np.sin(2.0 * np.pi * T / 5.3) + 0.05 * white,
            "ramp": T + 0.5 * white,
            "warming": np.exp(-T / 9.0) + 0.02 * white,
            "heavy": np.random.default_rng(seed).standard_t(2, len(T)),
        }
        assert find_jumps(T, series[kind]) is None, seed


def test_too_little_is_nothing():
    assert find_jumps(T[:99], np.where(T[:99] > 2.0, 1.0, 0.0)) is None
    assert find_jumps(T, np.zeros_like(T)) is None
