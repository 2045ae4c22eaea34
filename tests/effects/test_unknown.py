"""The empirical term: its levels nest, and its heights are the spline's values at the knots."""

import numpy as np
import pytest

from wearscope.effects.base import Signals, load_effect
from wearscope.effects.unknown import COARSE, LEVELS, PRODUCT, TAPER, coarsen


def signals_along(x: np.ndarray) -> Signals:
    q = x[:, None]
    v = np.gradient(x)[:, None]
    zero = np.zeros_like(q)
    return Signals(np.arange(len(x)) * 0.01, q, v, zero, np.sign(v), zero, zero + 30.0, zero)


def spline(low: float, high: float, knots: int) -> np.ndarray:
    """Shape of a spline over the joint's own position."""
    return np.array([0, 0, 0, low, high, -1, 0, 0, 1, knots], dtype=float)


@pytest.mark.parametrize("fewer", LEVELS[:-1])
def test_coarse_hat_functions_are_sums_of_fine_ones(fewer):
    effect = load_effect("unknown")
    signals = signals_along(np.linspace(-1.0, 1.0, 200))
    knots = LEVELS[-1]
    fine = effect.columns(signals, 0, spline(-1.0, 1.0, knots))
    coarse = effect.columns(signals, 0, spline(-1.0, 1.0, fewer))
    np.testing.assert_allclose(fine @ coarsen(knots, fewer), coarse[:, :fewer], atol=1e-12)
    assert not coarse[:, fewer:].any()


def test_torque_is_interpolated_between_heights_and_fades_outside():
    heights = {f"height{k}": float(k**2) for k in range(5)}
    values = {**heights, "low": -1.0, "high": 1.0, "knots": 5.0}
    inside = np.array([-1.0, -0.5, -0.25, 0.0, 0.75, 1.0])
    torque = load_effect("unknown").torque(signals_along(inside), 0, values)
    np.testing.assert_allclose(torque, np.interp(inside, np.linspace(-1, 1, 5), np.arange(5.0) ** 2))
    outside = 1.0 + 0.5 * np.array([0.5, 1.0, TAPER, 9.0])
    torque = load_effect("unknown").torque(signals_along(outside), 0, values)
    np.testing.assert_allclose(torque, 16.0 * np.array([0.75, 0.5, 0.0, 0.0]))


def test_only_the_joint_s_own_position_and_speed_and_time_are_tried_finely():
    x = np.sin(np.linspace(0.0, 20.0, 500))
    shapes = load_effect("unknown").shapes(signals_along(x), 0)
    single = shapes[shapes[:, 5] < 0]
    fine = single[single[:, 9] > COARSE]
    assert {(int(s[0]), int(s[2])) for s in fine} == {(0, 0), (0, 1), (1, 0), (1, 1), (5, 0), (5, 1)}
    pairs = shapes[shapes[:, 5] >= 0]
    assert set(pairs[:, 9]) == {PRODUCT}
    # A signal that does not vary is no signal: the load and the temperature are constant here.
    assert not {3, 4} & {int(code) for code in shapes[:, [0, 5]].ravel()}
