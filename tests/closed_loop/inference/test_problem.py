"""What a search asks of a data set: columns along its motion, and sizes that are believed."""

import numpy as np

from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.reversal import REVERSAL
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import load_effect


def test_a_size_that_intake_notes_is_believed_there(record, pose):
    problem = pose(record())
    problem.prepared.noted = {("torque_constant_error", 0): -0.25}
    gain = load_effect("torque_constant_error")
    (low, high), other = (problem.bounds(ModelTerm(gain, joint, (), (0,)))[0] for joint in (0, 1))
    assert low < -0.25
    assert high == 0.15 and other == (-0.15, 0.15)


def test_columns_at_other_joints_are_kept_where_a_reversal_changes(record, pose):
    problem = pose(record())
    today = problem.prepared.reversals
    kept = problem.base
    width = np.where([True, False], today.width + 0.05, np.maximum(today.width, 0.01))
    other = problem.reverse_over(Reversals(np.maximum(today.width, 0.01), today.form))
    both = other.base, other.reverse_over(Reversals(width, today.form)).base
    fresh = Problem(problem.prepared.reverse_over(Reversals(width, today.form)), problem.declared, ())
    changed = {("coulomb", 0), (REVERSAL.name, 0)}
    assert {(term.effect.name, term.joint) for term in kept} >= {("coulomb", 0), ("coulomb", 1)}
    for old, new, made in zip(*both, fresh.base, strict=True):
        for x, y in zip(new.candidate.rows, made.candidate.rows, strict=True):
            np.testing.assert_array_equal(x, y)
        same = (new.effect.name, new.joint) not in changed
        assert (new.candidate is old.candidate) == same, new.effect.name
