"""The rule, on evidence made by hand."""

import numpy as np
import pytest

from wearscope.effects.base import load_effect
from wearscope.tracking.changes import Change
from wearscope.tracking.changes import plain_term as term
from wearscope.tracking.decision import Judged, name_changes
from wearscope.tracking.inference import Estimate


def change(name, joint=0, friction=False, present=True, effects=None):
    terms = tuple(term(load_effect(effect), joint) for effect in effects or [name])
    return Change(name, joint, terms, friction, present, 0)


COULOMB = change("coulomb", friction=True)
VISCOUS = change("viscous", friction=True)
BOTH = change("friction", friction=True, effects=["coulomb", "viscous"])
GAIN = change("torque_constant_error", present=False)
OTHER = change("torque_offset", joint=1, present=False)
EVERY = [COULOMB, VISCOUS, BOTH, GAIN, OTHER]


def ask_of(alone, left=None):
    """Evidence by name alone (p, gain), and of pairs (what, beside) where it is another one."""

    def ask(one, beside):
        p, gain = alone.get(one.name, (1.0, 0.0))
        for other in beside:
            p, gain = (left or {}).get((one.name, other.name), (p, gain))
        m = one.count
        return Judged(Estimate(one, np.ones(m), np.eye(m), np.eye(m), np.zeros((m, m)), gain, 0.1), p)

    return ask


def names(found):
    return [(one.change.name, one.equivalent) for one in found]


def test_nothing_is_named_by_chance():
    # One in a hundred over five that are asked: 0.002 each.
    assert name_changes(EVERY, ask_of({"coulomb": (0.0021, 50.0)}), 0.01) == []
    assert names(name_changes(EVERY, ask_of({"coulomb": (0.0019, 50.0)}), 0.01)) == [("coulomb", ())]


def test_the_simpler_of_two_that_explain_the_same_is_named():
    alone = {"coulomb": (1e-9, 100.0), "friction": (1e-9, 101.0)}
    left = {("friction", "coulomb"): (0.5, 1.0), ("coulomb", "friction"): (0.9, 0.0)}
    assert names(name_changes(EVERY, ask_of(alone, left), 0.01)) == [("coulomb", ("viscous",))]


def test_friction_comes_before_a_gain_that_explains_the_same():
    alone = {"friction": (1e-9, 100.0), "torque_constant_error": (1e-9, 120.0)}
    left = {
        ("torque_constant_error", "friction"): (0.4, 1.0),
        ("friction", "torque_constant_error"): (0.3, 1.0),
    }
    found = name_changes(EVERY, ask_of(alone, left), 0.01)
    assert names(found) == [("friction", ("torque_constant_error",))]


def test_what_another_change_does_not_explain_is_not_equivalent():
    alone = {"friction": (1e-9, 50.0), "torque_constant_error": (1e-9, 500.0)}
    left = {
        ("torque_constant_error", "friction"): (1e-6, 400.0),
        ("friction", "torque_constant_error"): (0.3, 1.0),
    }
    assert names(name_changes(EVERY, ask_of(alone, left), 0.01)) == [("torque_constant_error", ())]


def test_changes_at_two_joints_are_both_named():
    alone = {"coulomb": (1e-9, 100.0), "torque_offset": (1e-9, 80.0)}
    assert {n for n, _ in names(name_changes(EVERY, ask_of(alone), 0.01))} == {"coulomb", "torque_offset"}


def test_what_another_change_takes_over_is_dropped():
    # The gain looked best at first, but is nothing conditional on the friction that is named after it.
    alone = {"torque_constant_error": (1e-9, 200.0), "torque_offset": (1e-9, 100.0)}
    left = {("torque_constant_error", "torque_offset"): (0.6, 0.0)}
    assert names(name_changes(EVERY, ask_of(alone, left), 0.01)) == [("torque_offset", ())]


def test_change_too_small_to_matter_is_not_named():
    def ask(one, beside):
        judged = ask_of({"coulomb": (1e-9, 100.0)})(one, beside)
        return Judged(
            Estimate(one, judged.estimate.value, np.eye(1), np.eye(1), np.zeros((1, 1)), 100.0, 0.019),
            judged.p_value,
        )

    assert name_changes([COULOMB], ask, 0.01) == []


@pytest.mark.parametrize("level", [0.05, 0.01])
def test_level_is_that_of_the_session(level):
    p = level / len(EVERY)
    assert name_changes(EVERY, ask_of({"torque_offset": (p * 1.01, 9.0)}), level) == []
    assert len(name_changes(EVERY, ask_of({"torque_offset": (p * 0.99, 9.0)}), level)) == 1
