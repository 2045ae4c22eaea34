"""Planted effects on a small arm: what is there is named, and nothing else."""

import numpy as np
import pytest
from noises import turning
from scipy.signal import lfilter

from benchmarks.joints import Small
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.problem import Problem

STRIBECK = (0, "stribeck", {"level": 8.0, "speed": 0.3, "exponent": 1.0})
#: More than the share of the coupling's torque that is taken for its form.
SLOW = (0, "stribeck", {"level": 24.0, "speed": 0.3, "exponent": 1.0})
#: A balancer at one joint and a heavier rotor at the other.
DRIVES = [
    (0, "gravity_counterbalance", {"sine1": 10.0, "cosine1": 40.0}),
    (1, "rotor_inertia_error", {"inertia": 0.5}),
]
LOAD = (1, "payload_error", {"mass": 2.0, "moment_x": 0.5, "moment_z": 0.1, "inertia_yy": 0.1})
RIPPLE = (0, "torque_ripple", {"cosine": 300.0, "sine": 0.0, "wavenumber": 15.0})
COUPLING = (0, "cross_coupling", {"coulomb": 400.0, "other": 1})
#: Two effects of which each hides the other: alone each looks like a drift.
HIDDEN = [
    (0, "viscous_asymmetry", {"half_difference": 8.0}),
    (0, "gravity_counterbalance", {"sine1": 6.0, "cosine1": 3.6}),
]
#: What is planted, and options of the recordings.
CASES = {
    "small next to a large ripple": ([STRIBECK, RIPPLE], {"seed": 3, "runs": 4}),
    "small next to a large coupling": ([SLOW, COUPLING], {"seed": 3, "runs": 4}),
    "two that hide each other": (HIDDEN, {"seed": 1, "runs": 3}),
    "two drives": (DRIVES, {"seed": 3}),
    "a load": ([LOAD], {"seed": 3}),
    "a load at its joint": ([(1, "payload_error", {"mass": 2.0})], {"seed": 3}),
    "a load and a drive": ([LOAD, (0, "rotor_inertia_error", {"inertia": 2.0})], {"seed": 3}),
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_planted_is_named_and_nothing_else(record, name_terms, case):
    planted, options = CASES[case]
    assert name_terms(record(planted, **options)) == {(name, joint) for joint, name, _ in planted}


def harden(t, q, v, a, rng):
    """A spring that hardens by a hundredth of its torque."""
    torque = np.zeros_like(q)
    torque[:, 0] = 300.0 * q[:, 0] + 6.0 * np.sign(q[:, 0]) * np.abs(q[:, 0]) ** 1.5
    return torque


def test_the_form_of_a_large_term_is_no_further_term(record, name_terms):
    assert name_terms(record(seed=3, runs=4, extra_torque=harden)) == {("joint_spring", 0)}


def test_a_drift_has_no_name(record, name_terms):
    """A random walk, in which any slow term finds something."""

    def walk(t, q, v, a, rng):
        steps = rng.standard_normal(q.shape) * np.sqrt(t[1] - t[0])
        return 12.0 * np.cumsum(steps, axis=0)

    assert name_terms(record(seed=4, runs=3, extra_torque=walk)) == set()


def turned(*given):
    """Six times the position at which the joint last turned round, which is much of the position."""
    return 6.0 * turning(*given)


def test_what_follows_the_last_turn_has_no_name(record):
    verdict = diagnose(record(extra_torque=turned, seed=73, runs=3, duration=12.0)).verdict
    assert verdict["verdict"] == []
    assert verdict["joints"]["a"]["state"] == "unexplained"
    assert "q_a" in verdict["joints"]["a"]["depends_on"]


def test_a_name_next_to_it_stays(record):
    """A spring that is larger; a balancer is as much like it."""
    planted = [(0, "joint_spring", {"stiffness": 20.0, "preload": 0.0})]
    folder = record(planted, extra_torque=turned, seed=72, runs=3, duration=12.0)
    verdict = diagnose(folder).verdict
    (named,) = verdict["verdict"]
    assert named["joint"] == "a"
    assert named["effect"] in ("joint_spring", "gravity_counterbalance")
    assert verdict["joints"]["a"]["state"] == "unexplained"


def remembered(t, q, v, a, rng):
    """A fine wave of the direction of motion of the last three tenths of a second."""
    keep = np.exp(-(t[1] - t[0]) / 0.3)
    past = lfilter([1.0 - keep], [1.0, -keep], np.sign(v[:, 0]))
    return np.column_stack([3.0 * np.cos(4.0 * np.pi * past), 0.0 * t])


def test_a_fine_past_has_no_name(record):
    folder = record(extra_torque=remembered, noise=0.3, seed=70, runs=4, duration=12.0)
    verdict = diagnose(folder).verdict
    assert [e["effect"] for e in verdict["verdict"] if e["effect"] != "unknown"] == []
    assert verdict["joints"]["a"]["state"] == "unexplained"


def test_names_that_share_what_an_effect_of_unbelievable_size_is_are_none(tmp_path):
    """A joint that bends more than any gear: inertias, an offset and a coupling would share it."""
    folder = tmp_path / "bent"
    (planted,) = Small(27, 2).make(folder)["planted"]
    verdict = diagnose(folder).verdict
    (joint,) = planted["joints"]
    assert [e["effect"] for e in verdict["verdict"] if e["joint"] == joint] == []
    assert verdict["joints"][joint]["state"] == "unexplained"
    assert f"{planted['effect'].replace('_', ' ')} would explain it" in verdict["joints"][joint]["reason"]


def test_a_name_next_to_an_effect_of_unbelievable_size_stays(record, monkeypatch):
    """A gear that is softer than gears are here; what else would share its torque has no name."""
    bounds = Problem.bounds
    stiff = lambda problem, term: (  # noqa: E731
        [(0.0, 1e-6)] if term.effect.name == "joint_elasticity" else bounds(problem, term)
    )
    monkeypatch.setattr(Problem, "bounds", stiff)
    lag = (0, "presliding_hysteresis", {"level": 6.0, "displacement": 0.03})
    folder = record([(0, "joint_elasticity", {"compliance": 4e-4}), lag], seed=8)
    verdict = diagnose(folder).verdict
    assert [(e["joint"], e["effect"]) for e in verdict["verdict"]] == [("a", "presliding_hysteresis")]
    assert verdict["joints"]["a"]["state"] == "unexplained"
    assert "joint elasticity would explain it" in verdict["joints"]["a"]["reason"]
