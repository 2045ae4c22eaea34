"""The bounded fit is the plain one where no bound holds, and SciPy's non-negative one where all do."""

import numpy as np
import pytest
from scipy import optimize

from wearscope.closed_loop.intake.filtering import Band, rows, thin
from wearscope.closed_loop.intake.rough_model import (
    RoughRun,
    bridge_rest,
    fit_bounded,
    fit_rough,
    predict_rough,
)

#: Common filter of recordings at 100 Hz.
BAND = Band(rate=100.0, motion=10.0, torque=5.0)


def draw(seed, scale=1.0):
    rng = np.random.default_rng(seed)
    x = rng.normal(size=(300, 5)) * [1.0, 30.0, 0.1, 5.0, 1.0]
    return x, scale * (x @ [1.0, 0.3, -2.0, 0.5, -1.0] + 0.1 * rng.normal(size=300))


@pytest.mark.parametrize("seed", range(5))
def test_without_bounds_it_is_least_squares(seed):
    x, y = draw(seed)
    left, theta = fit_bounded(x, y, np.full(5, -np.inf), np.full(5, np.inf))
    np.testing.assert_allclose(theta, fit_rough([x], [y]), rtol=1e-9)
    assert left == pytest.approx(float(np.sum((y - x @ theta) ** 2)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e6])
def test_with_all_bounds_at_zero_it_is_the_non_negative_fit(seed, scale):
    x, y = draw(seed, scale)
    left, theta = fit_bounded(x, y, np.zeros(5), np.full(5, np.inf))
    expected, norm = optimize.nnls(x, y)
    np.testing.assert_allclose(theta, expected, rtol=1e-6, atol=1e-9 * scale)
    assert left == pytest.approx(norm**2, rel=1e-9)


@pytest.mark.parametrize("seed", range(20))
def test_columns_that_say_the_same_leave_what_one_of_them_leaves(seed):
    """As the inertia of a slide and its rigid body do: no rounding decides what is left."""
    x, y = draw(seed)
    lower = np.array([0.0, -np.inf, -np.inf, -np.inf, -np.inf])
    same = np.column_stack([x, 0.37 * x[:, 1], x[:, 2] - 2.0 * x[:, 3]])
    upper = np.full(7, np.inf)
    left, theta = fit_bounded(same, y, np.append(lower, [-np.inf, -np.inf]), upper)
    alone = fit_bounded(x, y, lower, upper[:5])[0]
    assert left == pytest.approx(alone, rel=1e-9)
    assert float(np.sum((y - same @ theta) ** 2)) == pytest.approx(alone, rel=1e-9)


def test_columns_that_are_collinear_or_nil_have_an_end():
    x, y = draw(0)
    x = np.column_stack([x, x[:, 0], np.zeros(300)])
    left, theta = fit_bounded(x, 1e-5 * y, np.zeros(7), np.full(7, np.inf))
    assert np.isfinite(theta).all() and left >= 0.0


def test_prediction_is_fitted_on_train_runs_only():
    rng = np.random.default_rng(1)
    none = np.zeros((200, 1), dtype=bool)

    def make(use, gain):
        known, a, v = rng.normal(size=(3, 200, 1))
        tau = gain * known + 0.2 * a + 3.0 * np.sign(v) + 0.5 * v + 1.0
        return RoughRun(use, np.arange(200.0), known, a, np.sign(v), v, tau, none, none)

    runs = [make("train", 1.0), make("train", 1.0), make("test", 7.0)]
    first, _, test = predict_rough(runs, inner=False)
    np.testing.assert_allclose(first, runs[0].tau, atol=1e-9)
    np.testing.assert_allclose(test, runs[2].tau - 6.0 * runs[2].known, atol=1e-9)


def test_what_holds_a_joint_at_rest_is_replaced_by_what_it_would_need_without():
    """Static friction of any size at rest leaves no trace; a joint that never rests keeps its torque."""
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 8.0, 0.01)
    v = np.column_stack([np.where(np.abs(np.sin(t)) > 0.4, np.sin(t), 0.0), 1.0 + 0.5 * np.cos(t)])
    a, load = np.gradient(v, 0.01, axis=0), np.column_stack([np.cos(t), np.sin(3 * t)])
    rest = v == 0.0
    need = load + 0.2 * a + 3.0 * np.where(rest, 0.0, np.sign(v)) + 0.5 * v + 1.0
    tau = need + np.where(rest, rng.uniform(-3.0, 3.0, v.shape), 0.0)
    bridges = bridge_rest(tau - load, load, a, v, rest, BAND)
    assert list(bridges) == [0]
    np.testing.assert_allclose(bridges[0].predict(tau - load)[:, 0], (need - load)[rest[:, 0], 0], atol=1e-9)
    # A joint that rests throughout shows nothing to put in its place.
    assert not bridge_rest(tau - load, load, a, 0.0 * v, np.ones_like(rest), BAND)


def sweep():
    """Times, rest, speed and acceleration (N, 1) of a joint that moves and then rests."""
    t = np.arange(0.0, 10.0, 0.01)[:, None]
    rest = t > 5.0
    return t, rest, np.where(rest, 0.0, np.sin(3.0 * t)), np.where(rest, 0.0, 3.0 * np.cos(3.0 * t))


def test_regressors_that_are_alike_in_motion_are_alike_across_rests():
    """An offset and friction that differs by direction show one torque in motion, and another at rest."""
    t, rest, v, a = sweep()
    tau = 0.2 * a + np.sign(v)
    (bridge,) = bridge_rest(tau, np.cos(t), a, v, rest, BAND).values()
    held = tau + np.where(rest, 0.7, 0.0)
    for one, other in ((np.ones_like(t), np.where(rest, 0.0, 1.0)), (tau, held)):
        one, other = (thin(x, BAND) + bridge.change(x) for x in (one, other))
        in_motion = ~rest[rows(BAND, len(t)), 0]
        np.testing.assert_allclose(one[in_motion], other[in_motion], atol=1e-9)
        assert np.abs(one[~in_motion] - other[~in_motion]).max() > 0.5


def test_a_rest_is_bridged_though_the_joint_alone_moves_no_load():
    """In a sweep a flange's rigid-body torque is round-off: no factor of it may be fitted there."""
    t, rest, v, a = sweep()
    rng = np.random.default_rng(1)
    known = np.where(rest, 1e-3 * np.sin(7.0 * t), 1e-10 * rng.standard_normal(t.shape))
    held = np.where(rest, 0.4, 0.0)
    tau = known + 0.02 * a + 0.5 * np.sign(v) + 0.1 * v + held + 1e-3 * rng.standard_normal(v.shape)
    (bridge,) = bridge_rest(tau - known, known, a, v, rest, BAND).values()
    np.testing.assert_allclose(bridge.predict(tau - known), 0.0, atol=2e-3)


def test_a_rest_is_bridged_though_the_joint_alone_moves_its_load_as_a_rotor_would():
    """About an upright axis the load of a joint that moves alone is inertia times its own acceleration.

    Its factor cannot be told from a rotor's there, but the load that others' motion puts on it at rest can.
    """
    t, rest, v, a = sweep()
    rng = np.random.default_rng(2)
    known = np.where(rest, 5.0 * np.sin(7.0 * t), 2.0 * a + 1e-4 * rng.standard_normal(v.shape))
    tau = known + 0.7 * a + 3.0 * np.sign(v) + 0.2 * rng.standard_normal(v.shape)
    (bridge,) = bridge_rest(tau - known, known, a, v, rest, BAND).values()
    assert np.abs(bridge.predict(tau - known)).max() < 0.3 * np.abs(known[rest]).max()
