"""Each effect is named in data that it made, and its parameter lies within its own interval."""

import json

import numpy as np
import pytest

from wearscope.closed_loop.run import close_loop
from wearscope.effects.unknown import COARSE

#: What an interval leaves out, of the value: the exponent of a concave law is taken from a grid.
LOOSE = {"concave_viscous": 0.1}
PLANTED = {
    "stribeck": {"level": 8.0, "speed": 0.3, "exponent": 1.0},
    "coulomb_asymmetry": {"half_difference": 3.0},
    "viscous_asymmetry": {"half_difference": 3.0},
    "quadratic_viscous": {"curvature": 4.0},
    "concave_viscous": {"level": 15.0, "exponent": 0.5},
    "load_dependent_friction": {"coefficient": 0.08},
    "temperature_dependent_friction": {
        "coulomb_slope": -0.2,
        "viscous_slope": -0.1,
        "reference": 38.8,
        "rate": 0.04,
    },
    "warm_up_drift": {"coulomb_drift": 4.0, "time_constant": 6.0},
    "presliding_hysteresis": {"level": 6.0, "displacement": 0.03},
    "joint_elasticity": {"compliance": 1e-4},
    "torque_ripple": {"cosine": 2.0, "sine": 1.5, "wavenumber": 30.0},
    "joint_spring": {"stiffness": 8.0, "preload": 1.0},
    "gravity_counterbalance": {
        "sine1": 6.0,
        "cosine1": -9.0,
        "pretension": 15.0,
        "angle": 0.5,
        "ratio": 0.25,
    },
    "payload_error": {"mass": 0.4, "moment_x": 0.3, "moment_z": -0.1},
    "rotor_inertia_error": {"inertia": 0.3},
    "torque_constant_error": {"gain": 0.06},
    "time_delay": {"delay": 0.006},
    "cross_coupling": {"viscous": 3.0, "other": 1.0},
    "torque_offset": {"offset": 3.0},
}
#: Effects that this motion cannot tell apart, by physics.
SAME = {"torque_offset": {"coulomb_asymmetry"}, "coulomb_asymmetry": {"torque_offset"}}


@pytest.mark.parametrize("name", PLANTED)
def test_effect_is_named_and_its_parameter_within_its_interval(record, tmp_path, name):
    joint = 1 if name == "payload_error" else 0
    folder = record([(joint, name, PLANTED[name])], seed=3)
    verdict = close_loop(folder, tmp_path / "out", light=True)
    entry = verdict["verdict"][0]
    assert {entry["effect"], *entry["equivalent"]} & ({name} | SAME.get(name, set())), verdict["verdict"]
    assert len(verdict["verdict"]) == 1, [e["effect"] for e in verdict["verdict"]]
    if entry["effect"] == name:
        for key, found in entry["parameters"].items():
            low, high = found["ci95"]
            # Twenty effects with one to four parameters each: a 95 % interval is widened to 99.9 %.
            middle, half = found["value"], 1.7 * (high - low) / 2
            error = abs(PLANTED[name].get(key, 0.0) - middle)
            assert error <= half + LOOSE.get(name, 0.02) * abs(middle), (key, found)
    after = verdict["joints"]["a"]["rms_after"]
    assert after < 1.3 * verdict["joints"]["a"]["rms_before"]
    assert json.loads((tmp_path / "out" / "verdict.json").read_text()) == verdict


@pytest.mark.slow
def test_a_delay_that_makes_a_sixth_of_the_error_is_named(record, tmp_path):
    verdict = close_loop(record([(0, "time_delay", {"delay": 0.003})], seed=3), tmp_path / "out", light=True)
    assert [(e["joint"], e["effect"]) for e in verdict["verdict"]] == [("a", "time_delay")]


@pytest.mark.parametrize("seed", [10, 11])
def test_nothing_is_named_where_the_declared_model_suffices(record, tmp_path, seed):
    assert close_loop(record(seed=seed, runs=3), tmp_path / "out", light=True)["verdict"] == []


def test_structure_outside_the_vocabulary_is_called_unknown(record, tmp_path):
    def friction_by_position(t, q, v, a, rng):
        return np.column_stack([5 * np.sin(3 * q[:, 0]) * np.sign(v[:, 0]), 0 * t])

    folder = record(extra_torque=friction_by_position, seed=4, runs=4, duration=8.0)
    verdict = close_loop(folder, tmp_path / "out", light=True)
    assert [e["effect"] for e in verdict["verdict"]] == ["unknown"]
    assert verdict["verdict"][0]["depends_on"] == ["q_a", "sign_qd_a"]
    assert verdict["joints"]["a"]["rms_after"] < 0.4 * verdict["joints"]["a"]["rms_before"]


def test_bump_at_one_place_is_described_with_its_signal_and_many_heights(record, tmp_path):
    def sticking_spot(t, q, v, a, rng):
        return np.column_stack([12 * np.exp(-(((q[:, 0] - 0.2) / 0.08) ** 2)) * np.sign(v[:, 0]), 0 * t])

    verdict = close_loop(record(extra_torque=sticking_spot, seed=4), tmp_path / "out", light=True)
    assert [(e["joint"], e["effect"]) for e in verdict["verdict"]] == [("a", "unknown")]
    entry = verdict["verdict"][0]
    assert entry["depends_on"] == ["q_a", "sign_qd_a"]
    assert entry["fixed"]["knots"] == len(entry["parameters"]) > COARSE
    assert verdict["joints"]["a"]["rms_after"] < 0.6 * verdict["joints"]["a"]["rms_before"]


def test_smooth_structure_is_described_with_few_heights(record, tmp_path):
    def product(t, q, v, a, rng):
        return np.column_stack([4 * q[:, 0] * v[:, 0], 0 * t])

    folder = record(extra_torque=product, seed=4, runs=3, duration=8.0)
    verdict = close_loop(folder, tmp_path / "out", light=True)
    assert [e["effect"] for e in verdict["verdict"]] == ["unknown"]
    assert len(verdict["verdict"][0]["parameters"]) <= COARSE


@pytest.mark.parametrize("seed", [30, 31])
def test_drifting_bias_is_not_called_unknown(record, tmp_path, seed):
    def walk(t, q, v, a, rng):
        return np.cumsum(rng.normal(size=(len(t), 2)), axis=0) * 0.05

    folder = record(extra_torque=walk, seed=seed, runs=3)
    verdict = close_loop(folder, tmp_path / "out", light=True)["verdict"]
    assert "unknown" not in [e["effect"] for e in verdict]


def test_a_ripple_is_named_from_one_run(record, tmp_path):
    planted = [(0, "torque_ripple", {"cosine": 3.0, "sine": 2.0, "wavenumber": 30.0})]
    verdict = close_loop(record(planted, seed=5, runs=2), tmp_path / "out", light=True)
    (entry,) = verdict["verdict"]
    assert (entry["joint"], entry["effect"], entry["status"]) == ("a", "torque_ripple", "confirmed")
    for name, value in planted[0][2].items():
        low, high = entry["parameters"][name]["ci95"]
        assert low <= value <= high or entry["parameters"][name]["value"] == pytest.approx(value, rel=0.1)
