"""Ripples of few periods over a joint's range, where a curve may pose as one, and with an unknown torque."""

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.policy import Policy
from wearscope.effects.torque_ripple import FEWEST_PERIODS

POLICY = Policy(flips=199)


def test_a_ripple_of_two_periods_over_the_range_is_named(record):
    planted = [(0, "torque_ripple", {"cosine": 3.0, "sine": 2.0, "wavenumber": 5.0})]
    diagnosis = diagnose(record(planted, seed=5, runs=4, duration=8.0, warm=False), POLICY)
    periods = 5.0 * np.ptp(diagnosis.problem.joined.q[:, 0]) / (2.0 * np.pi)
    assert 1.5 < periods < 2.0
    (entry,) = diagnosis.verdict["verdict"]
    assert (entry["joint"], entry["effect"], entry["status"]) == ("a", "torque_ripple", "confirmed")
    found = {name: parameter["value"] for name, parameter in entry["parameters"].items()}
    assert found == pytest.approx(planted[0][2], rel=0.05)


def test_a_bump_at_one_position_is_no_ripple(record):
    """A wave of few periods takes most of it away; a curve of the position takes all."""

    def bump(t, q, v, a, rng):
        return np.column_stack([10.0 * np.exp(-((q[:, 0] / 0.4) ** 2)), 0.0 * t])

    folder = record(extra_torque=bump, seed=4, runs=3, duration=8.0, warm=False)
    (entry,) = diagnose(folder, POLICY).verdict["verdict"]
    assert (entry["joint"], entry["effect"], entry["status"]) == ("a", "unknown", "confirmed")


def test_a_ripple_that_unknown_structure_hides_is_named_beside_it(record):
    """In its place that structure, which is larger, removes far more: what a ripple leaves of it."""
    planted = [(0, "torque_ripple", {"cosine": 1.5, "sine": 1.0, "wavenumber": 20.0})]

    def drag(t, q, v, a, rng):
        return np.column_stack([8.0 * q[:, 0] * v[:, 0], 0.0 * t])

    folder = record(planted, extra_torque=drag, seed=5, runs=5, duration=8.0, warm=False)
    named = {entry["effect"]: entry for entry in diagnose(folder, POLICY).verdict["verdict"]}
    assert set(named) == {"torque_ripple", "unknown"}
    found = {name: parameter["value"] for name, parameter in named["torque_ripple"]["parameters"].items()}
    assert found == pytest.approx(planted[0][2], rel=0.05)


def test_a_ripple_has_the_fewest_periods_that_its_effect_states(record):
    """A slower wave may be a curve of the position, as a spring's or a balancer's."""

    def curve(t, q, v, a, rng):
        return np.column_stack([10.0 * np.sin(3.4 * q[:, 0] + 0.5), 0.0 * t])

    diagnosis = diagnose(record(extra_torque=curve, seed=5, runs=4, duration=8.0, warm=False), POLICY)
    waves = [t for t in diagnosis.answer.model.terms if t.effect.name == "torque_ripple"]
    periods = np.array([t.model_term.shape[0] for t in waves]) * np.ptp(diagnosis.problem.joined.q[:, 0])
    assert len(waves) and np.all(periods >= 2.0 * np.pi * FEWEST_PERIODS * (1.0 - 1e-9))
