"""A delay is a shift of the torque channel, in fractions of a sample, of any size, declared or not."""

import numpy as np
import pytest
from folders import change_runs, fit_problem
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.model.prediction import predict_reduced, refit
from wearscope.closed_loop.posing import pose_problem
from wearscope.effects.base import Signals, load_effect

DECLARED = ("rigid_body", "rotor_inertia", "coulomb", "viscous", "time_delay")


def delay_channels(folder, delays):
    def change(table):
        t = table["t"].to_numpy()
        for joint, delay in delays.items():
            torque = CubicSpline(t, table[f"tau_{joint}"])
            table[f"tau_{joint}"] = torque(np.clip(t - delay, t[0], t[-1]))
        # The ends have no torque of their own.
        return table.iloc[20:-20]

    change_runs(folder, change)
    return folder


@pytest.mark.parametrize(
    "delays", [{"a": -0.0400, "b": 0.0123}, {"a": 0.0617, "b": -0.0008}, {"a": 0.0, "b": 0.0271}]
)
def test_declared_delays_are_found_and_leave_the_noise(record, delays):
    """Of two joints, early and late, on the grid of samples (5 ms) and off it."""
    folder = record(seed=11, declared=DECLARED, runs=3, duration=8.0)
    problem = pose_problem(delay_channels(folder, delays))
    model = fit_problem(problem)
    model = refit(model, model.entries)
    found = {e.entry.label: e for e in estimate(model) if e.entry.effect.name == "time_delay"}
    for j, joint in enumerate("ab"):
        one = found[f"time_delay@{j}"]
        low, high = one.intervals["delay"]
        assert one.values["delay"] == pytest.approx(delays[joint], abs=1e-3)
        assert low < one.values["delay"] < high and high - low < 4e-3
    # Noise of 1 and 0.5 N m at 200 Hz, of which the common filter leaves a part.
    left = np.concatenate(model.residuals(model.solve())).std(axis=0)
    share = np.sqrt(2 * problem.prepared.band.torque / 200.0)
    assert np.all(left < 1.5 * share * np.array([1.0, 0.5]) + 0.1)


def test_one_recorder_has_one_delay_also_at_a_joint_whose_friction_lags(record):
    """Friction that builds up late looks like a late channel; the other joint tells the recorder's delay."""

    def lag(t, q, v, a, rng):
        keep = np.exp(-(t[1] - t[0]) / 0.15)
        late = lfilter([1.0 - keep], [1.0, -keep], np.sign(v[:, 1]))
        return np.column_stack([0.0 * t, 2.5 * (late - np.sign(v[:, 1]))])

    folder = record(seed=11, declared=DECLARED, runs=3, duration=8.0, extra_torque=lag)
    problem = pose_problem(delay_channels(folder, {"a": 0.04, "b": 0.04}))
    assert problem.prepared.dataset.delays == pytest.approx((0.04, 0.04), abs=2e-3)


def test_a_delay_moves_the_channel_of_the_effect_itself():
    """No derivative: a delay of half a period turns a sine round."""
    t = np.arange(0.0, 4.0, 0.01)
    torque = np.sin(2 * np.pi * t)[:, None]
    zero = np.zeros_like(torque)
    signals = Signals(t, zero, zero, zero, zero, zero, zero, zero, torque=torque)
    change = load_effect("time_delay").torque(signals, 0, {"delay": 0.5})
    inside = (t > 0.6) & (t < 3.4)
    np.testing.assert_allclose((torque[:, 0] + change)[inside], -torque[inside, 0], atol=1e-6)


def test_undeclared_delays_leave_what_is_left_without_them(record):
    delays = {"a": -0.0231, "b": 0.0219}
    folder = record(seed=11)
    plain = diagnose(folder).verdict
    delay_channels(folder, delays)
    problem = pose_problem(folder)
    late = diagnose(folder)
    named = {entry["joint"]: entry for entry in late.verdict["verdict"]}
    assert {(joint, entry["effect"]) for joint, entry in named.items()} == {(j, "time_delay") for j in delays}
    for joint, delay in delays.items():
        low, high = named[joint]["parameters"]["delay"]["ci95"]
        assert low <= delay <= high < low + 4e-3
        assert named[joint]["status"] == "confirmed" and named[joint]["in_model"]
        now, then = (verdict["joints"][joint] for verdict in (late.verdict, plain))
        assert now["rms_after"] < 1.1 * then["rms_after"]
        # The error before is that of the recordings as they are.
        left = fit_problem(problem)
        (test,) = problem.prepared.runs_for("test")
        j = problem.prepared.dataset.joints.index(joint)
        own = (test.measured - predict_reduced(left, left.solve(), test))[test.keep[:, j], j]
        assert now["rms_before"] == pytest.approx(np.sqrt(np.mean(own**2)), rel=0.1)
        share = 1.0 - (now["rms_after"] / now["rms_before"]) ** 2
        assert named[joint]["error_reduction"] == pytest.approx(share, abs=0.02)
    (entry,) = [e for e in late.models["before"].effects if e.effect == "time_delay"][:1]
    assert entry.parameters["delay"] == pytest.approx(0.0, abs=1e-6)
    assert not entry.intervals
