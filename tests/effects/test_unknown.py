"""The empirical term: its levels nest, and its heights are the spline's values at the knots."""

import numpy as np
import pytest

from wearscope.effects.base import Signals, load_effect
from wearscope.effects.unknown import COARSE, LEVELS, PRODUCT, TAPER, coarsen


def signals_along(x: np.ndarray) -> Signals:
    return Signals.along(np.arange(len(x)) * 0.01, np.gradient(x)[:, None], x[:, None], temperature=30.0)


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
    # What is tried may be: as many heights as there are coefficients.
    parameters = load_effect("unknown").shape
    assert (shapes >= [p.lower for p in parameters]).all() and (shapes <= [p.upper for p in parameters]).all()
    assert parameters[-1].upper == len(load_effect("unknown").coefficients) == fine[:, 9].max() == 33
    # A signal that does not vary is no signal: the load and the temperature are constant here.
    assert not {3, 4} & {int(code) for code in shapes[:, [0, 5]].ravel()}


def ask_row(shape: np.ndarray, q: float, v: float = 0.5, other: float = 0.0) -> np.ndarray:
    """A row over 33 places of joint 0 of two, with three more behind it that are not the effect's."""
    row, still = load_effect("unknown").row, np.zeros(2)
    out = np.full(36, 7.0)
    position, speed = np.array([q, other]), np.array([v, 0.0])
    row(0, 0.0, 0.01, np.sign(speed), position, speed, *[still] * 4, shape, still, still, out[:33])
    assert (out[33:] == 7.0).all(), "what is not the effect's was written"
    return out[:33]


@pytest.mark.parametrize("knots", LEVELS)
def test_at_a_knot_its_own_hat_is_one_and_all_others_are_zero(knots):
    for k, x in enumerate(np.linspace(-0.6, 1.4, knots)):
        expected = np.zeros(33)
        expected[k] = 1.0
        np.testing.assert_allclose(ask_row(spline(-0.6, 1.4, knots), x), expected, atol=1e-9)


def test_hats_are_multiplied_with_the_direction_or_the_speed():
    for modulator, factor in ((0, 1.0), (1, -1.0), (2, -0.5)):
        shape = spline(-1.0, 1.0, 5)
        shape[2] = modulator
        expected = np.zeros(33)
        expected[2:4] = factor * np.array([0.75, 0.25])
        np.testing.assert_allclose(ask_row(shape, 0.125, v=-0.5), expected, atol=1e-12)


def test_a_product_is_bilinear_between_its_knots_and_fades_on_each_side():
    # Knots at -1, -0.5, ... 1 of the joint's own position and at 0, 1, ... 4 of the other one's.
    shape = np.array([0, 0, 0, -1.0, 1.0, 0, 1, 0.0, 4.0, PRODUCT])
    heights = np.add.outer(2.0 * np.arange(5), 3.0 * np.arange(5)) + np.outer(np.arange(5), np.arange(5))
    for x, y in ((-0.9, 0.3), (0.1, 2.6), (0.8, 3.9), (1.0, 4.0), (-1.0, 0.0)):
        i, k = (x + 1.0) / 0.5, y
        got = ask_row(shape, x, other=y)[:PRODUCT] @ heights.ravel()
        assert got == pytest.approx(2.0 * i + 3.0 * k + i * k, abs=1e-12)
    # Half a knot beyond one end, a whole one beyond the other: three quarters and a half are left.
    assert ask_row(shape, 1.25, other=5.0)[:PRODUCT] @ heights.ravel() == pytest.approx(36.0 * 0.75 * 0.5)
