"""A term beside which plain friction would be negative takes its place in a form that fits another one."""

from dataclasses import replace

import numpy as np
import pytest

from wearscope.closed_loop.model.candidates import make_candidate
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.evidence import Refusal, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.shape_fit import refine
from wearscope.effects.base import load_effect

POLICY = Policy(flips=199)
BELIEVED = [(-np.inf, np.inf)] * 3


def weigh_shape(search, name, shape):
    """Evidence on a term of joint 0 with a shape beside the declared model, with a p-value of zero."""
    assembly = search.assemble(())
    candidate = make_candidate(load_effect(name), 0, search.problem.prepared, np.array([shape]))
    return assembly, replace(weigh(assembly, candidate, (0,), POLICY), p_value=0.0)


def friction_beside(assembly, e):
    """Level of Coulomb friction of joint 0 in a fit of the model and the term together."""
    rows = [*assembly.chosen, e.chosen]
    keep = assembly.layout.keep[:, 0]
    at = [c for c in rows if 0 in c.candidate.joints]
    columns = np.column_stack([c.rows[c.candidate.joints.index(0)] for c in at])[keep]
    first = [i for i, c in enumerate(at) for _ in c.subset]
    theta = np.linalg.lstsq(columns, assembly.target[keep, 0], rcond=None)[0]
    return next(theta[k] for k, i in enumerate(first) if at[i].candidate.effect.name == "coulomb")


def start(pose, folder):
    """A search that has not begun, in residual variances of the declared model."""
    search = Search(pose(folder), POLICY)
    search.sigma = search.scale(())
    return search


@pytest.fixture
def quadratic(record, pose):
    """Search over a data set whose joint 0 has a drag with the square of speed."""
    return start(pose, record([(0, "quadratic_viscous", {"curvature": 6.0})], seed=4))


def test_a_wide_stribeck_in_the_place_of_a_drag_overturns_coulomb_friction(quadratic):
    fastest = float(np.abs(quadratic.problem.at_rows("v")[:, 0]).max())
    assembly, wide = weigh_shape(quadratic, "stribeck", (fastest, 1.0))
    assert friction_beside(assembly, wide) < 0.0
    assert wide.share > 0.5
    assert wide.overturns
    assert rule.judge(wide, POLICY, BELIEVED, 0.0, True) is Refusal.BOUNDS
    # Were it not for the friction, it would be taken; the drag itself leaves the friction as it is.
    assert rule.judge(replace(wide, overturns=False), POLICY, BELIEVED, 0.0, True) is Refusal.NONE
    assembly, drag = weigh_shape(quadratic, "quadratic_viscous", ())
    assert friction_beside(assembly, drag) > 0.0
    assert not drag.overturns
    # From a narrower one the best shape is one that overturns; what was believable stays.
    narrow = weigh_shape(quadratic, "stribeck", (0.1 * fastest, 1.0))[1]
    assert not narrow.overturns
    assert refine(quadratic.problem, assembly, narrow, POLICY).overturns
    assert quadratic.refine(assembly, narrow) is narrow


def test_a_stribeck_that_is_there_leaves_friction_as_it_is(record, pose):
    search = start(pose, record([(0, "stribeck", {"level": 3.0, "speed": 0.3})], seed=4))
    assembly, own = weigh_shape(search, "stribeck", (0.3, 1.0))
    assert friction_beside(assembly, own) > 0.0
    assert own.share > 0.5
    assert not own.overturns
