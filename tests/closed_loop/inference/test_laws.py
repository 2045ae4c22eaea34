"""Friction laws and reversals: what rises smoothly from rest is no wide reversal with another law."""

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.answer import find_terms
from wearscope.closed_loop.inference.laws import fit_law, is_law
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.reversal import is_wide
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.effects.base import load_effect
from wearscope.effects.vocabulary import list_effects


def eyring(level, speed):
    """Torque at joint a of a lubricant after Eyring, which is none of the vocabulary's forms."""

    def torque(t, q, v, a, rng):
        return np.column_stack([level * np.arcsinh(v[:, 0] / speed), np.zeros(len(t))])

    return torque


@pytest.mark.parametrize(
    ("level", "speed", "seed"),
    [(8.0, 0.15, 0), (15.0, 0.15, 2), (15.0, 0.4, 3), (2.0, 0.1, 0)],
    ids=["hidden by a wide reversal", "as a Stribeck curve", "hidden, large", "hidden but for a twentieth"],
)
def test_a_law_of_another_form_that_rises_smoothly_from_rest_is_concave(record, level, speed, seed):
    diagnosis = diagnose(record([], seed=seed, extra_torque=eyring(level, speed)))
    named = [(e["joint"], e["effect"], e["status"]) for e in diagnosis.verdict["verdict"]]
    assert named == [("a", "concave_viscous", "confirmed")]
    assert diagnosis.verdict["joints"]["a"]["state"] == "corrected"
    assert not is_wide(diagnosis.prepared, 0)


OWN = """
import numpy as np
from wearscope.effects.base import Effect, Parameter


def columns(signals, joint, shape):
    beyond = np.maximum(np.abs(signals.v[:, joint]) - shape[0], 0.0)
    return (beyond * signals.sign[:, joint])[:, None]


EFFECT = Effect(
    name="dead_zone", form="slope max(abs(v) - edge, 0) sign(v)", source="a test", regressors=columns,
    coefficients=(Parameter("slope", "{torque} s/{position}"),), depends_on=("qd_{joint}",),
    shape=(Parameter("edge", "{position}/s", lower=0.0, default=0.5),), parents=("viscous",),
    search=lambda signals, joint: np.array([[0.0], [0.5], [1.0]]),
)
"""


def test_an_own_law_whose_shape_may_be_nothing_is_compared_too(record, tmp_path):
    (tmp_path / "own.py").write_text(OWN)
    folder = record([], seed=2, extra_torque=eyring(15.0, 0.15))
    diagnosis = diagnose(folder, effects=[tmp_path / "own.py"])
    assert [(e["joint"], e["effect"]) for e in diagnosis.verdict["verdict"]] == [("a", "concave_viscous")]
    assert "dead_zone" in set(diagnosis.candidates["effect"])


def smooth(width, stribeck=0.0):
    """Torque that makes the generator's abrupt friction at joint a a smooth one, with a Stribeck curve."""

    def torque(t, q, v, a, rng):
        v = v[:, 0]
        friction = (6.0 + stribeck * np.exp(-((v / 0.5) ** 2))) * np.tanh(v / width)
        return np.column_stack([friction - 6.0 * np.sign(v), np.zeros(len(t))])

    return torque


def test_friction_that_does_reverse_over_a_wide_speed_is_given_no_law(record):
    diagnosis = diagnose(record([], seed=5, runs=3, extra_torque=smooth(0.4)))
    assert is_wide(diagnosis.prepared, 0)
    assert diagnosis.verdict["verdict"] == []


def test_a_law_that_is_there_stays_with_its_reversal(record, pose):
    answer = find_terms(pose(record([], seed=6, runs=3, extra_torque=smooth(0.05, stribeck=8.0))), Policy())
    laws = [(f.term.effect.name, f.term.joint) for f in answer.found if is_law(f.term.effect)]
    assert laws == [("stribeck", 0)]
    assert answer.problem.prepared.reversals.width[0] == pytest.approx(0.05, rel=0.2)


@pytest.mark.slow
def test_a_law_that_a_wrong_reversal_had_made_unbelievable_is_found_with_the_right_one(record):
    diagnosis = diagnose(record([], seed=7, extra_torque=smooth(0.05, stribeck=8.0)))
    (entry,) = diagnosis.verdict["verdict"]
    assert (entry["joint"], entry["effect"], entry["status"]) == ("a", "stribeck", "confirmed")
    assert entry["parameters"]["level"]["value"] == pytest.approx(8.0, rel=0.1)
    assert entry["parameters"]["speed"]["value"] == pytest.approx(0.5, rel=0.1)
    assert diagnosis.prepared.reversals.width[0] == pytest.approx(0.05, rel=0.15)


def test_shape_and_width_are_recovered_together(record, pose, declared_model):
    """Though neither is near where the fit begins, nor was the width that the model had."""
    planted = {"level": 12.0, "exponent": 0.42, "speed": 0.6}
    folder = record([(0, "concave_viscous", planted)], seed=4, noise=0.02, extra_torque=smooth(0.03))
    problem = pose(folder)
    wrong = problem.prepared.reversals.width.copy()
    wrong[0] = 0.5
    model = declared_model(problem.reverse_over(Reversals.over(wrong)))
    prepared = model.problem.prepared
    law = load_effect("concave_viscous")
    fitted = fit_law(prepared, model.fit, 0, None, law, law.shapes(model.problem.joined, 0))
    assert fitted is not None
    shape, reversals = fitted
    assert shape == pytest.approx([0.42, 0.6], rel=0.05)
    assert reversals.width[0] == pytest.approx(0.03, rel=0.1)
    assert reversals.width[1] == prepared.reversals.width[1]


@pytest.mark.parametrize(
    ("name", "follow"),
    [("coulomb_asymmetry", lambda v: np.abs(np.tanh(v / 0.05))), ("torque_offset", np.ones_like)],
)
def test_only_the_reversals_tell_friction_that_differs_by_direction_from_an_offset(
    record, name_terms, name, follow
):
    """Each with the reversal that suits it: the width that fits best with the other one is another."""

    def torque(t, q, v, a, rng):
        added = smooth(0.05)(t, q, v, a, rng)
        added[:, 0] += 20.0 * follow(v[:, 0])
        return added

    assert name_terms(record(seed=6, runs=3, extra_torque=torque)) == {(name, 0)}


def test_a_law_that_fits_far_worse_wherever_it_starts_is_not_fitted(record, pose):
    problem = pose(record([(0, "stribeck", {"level": 20.0, "speed": 0.3})], seed=7, runs=3))
    model = find_terms(problem, Policy()).model
    (stribeck,) = [t for t in model.terms if is_law(t.effect)]
    law = load_effect("coulomb_asymmetry")
    shapes = law.shapes(model.problem.joined, 0)
    assert fit_law(model.problem.prepared, model.fit, 0, stribeck, law, shapes) is None


def test_a_reversal_that_is_tried_at_one_joint_is_that_of_a_trial_at_all(record, pose):
    """At its joint the same to the last bit, at the other one as it was."""
    prepared = pose(record([], seed=8, runs=2, extra_torque=smooth(0.05))).prepared
    other = Reversals.over(np.array([0.2, 0.3]))
    for one, every in zip(prepared.try_reversals(other, 0), prepared.try_reversals(other), strict=True):
        np.testing.assert_array_equal(one.signals.sign[:, 0], every.signals.sign[:, 0])
        assert np.ptp(every.signals.sign[:, 1] - one.signals.sign[:, 1]) > 0.1
    for one, run in zip(prepared.try_reversals(other, 0), prepared.runs_for("train"), strict=True):
        np.testing.assert_array_equal(one.signals.sign[:, 1], run.signals.sign[:, 1])


def test_laws_are_those_of_the_own_speed_that_not_every_drive_has():
    laws = {effect.name for effect in list_effects() if is_law(effect)}
    assert laws == {
        "stribeck", "coulomb_asymmetry", "viscous_asymmetry", "quadratic_viscous", "concave_viscous",
    }  # fmt: skip
