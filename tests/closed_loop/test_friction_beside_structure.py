"""Beside structure that goes with a joint's speed, plain friction has what of it it can."""

import numpy as np
import pytest

from wearscope.closed_loop.selection.evidence import weigh
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.generic import (
    GenericTerms,
    _coarsen,
    _evaluate,
    _scale,
    list_levels,
    measure_generic,
    share_with_friction,
)
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search

#: Of the recorded arm's first joint [N m, N m s/rad].
COULOMB, VISCOUS = 6.0, 4.0


@pytest.fixture
def hump(record, pose):
    """Search on a joint with a hump of friction at a speed, and the spline of speed and direction there."""

    def make(viscous):
        def torque(t, q, v, a, rng):
            bump = 8.0 * np.exp(-(((np.abs(v[:, 0]) - 2.5) / 0.15) ** 2)) * np.sign(v[:, 0])
            return np.column_stack([bump - (1.0 - viscous) * VISCOUS * v[:, 0], 0.0 * t])

        declared = ("rigid_body", "rotor_inertia")
        problem = pose(record(seed=5, declared=declared, extra_torque=torque, runs=4, duration=12.0))
        search = Search(problem, Policy())
        terms = GenericTerms(problem.prepared, problem.joined)
        finest = max(
            (c for c in terms.roughly(0) if c.shapes[0][:3] == (1.0, 0.0, 1.0) and c.shapes[0][5] < 0.0),
            key=lambda c: c.count,
        )
        candidate = _scale(terms.exactly(0, finest.shapes[0]), search.sigma[0])
        own = weigh(search.assemble([]), candidate, tuple(range(candidate.count)), search.policy)
        return search, [Found(own.chosen, own)]

    return make


def level(search, found, name):
    """Coefficient of a term at the first joint."""
    assembly = search.assemble(found, standard=True)
    spans = zip(assembly.chosen, assembly.spans, strict=True)
    (span,) = [s for c, s in spans if c.candidate.effect.name == name and c.candidate.joint == 0]
    return float(assembly.theta[span][0])


def test_what_every_joint_has_is_taken_from_a_spline_that_holds_it(hump):
    search, spline = hump(viscous=1.0)
    found = share_with_friction(search, spline, [0])
    assert {f.effect.name for f in found} == {"unknown", "coulomb", "viscous"}
    assert level(search, found, "coulomb") == pytest.approx(COULOMB, rel=0.3)
    # A part of the hump is in it: the smallest spline is not the sparsest.
    assert level(search, found, "viscous") == pytest.approx(VISCOUS, rel=0.5)
    search.sigma = search.scale(found)
    alone, beside = search.assemble(spline), search.assemble(found)
    assert measure_generic(beside, 0) < 0.5 * measure_generic(alone, 0)
    assert measure_generic(beside, 1) == 0.0


def test_friction_by_which_a_spline_is_no_smaller_goes(hump):
    search, spline = hump(viscous=0.0)
    beside = search.assemble(spline, standard=True)
    (viscous,) = [c for c in search.candidates(beside, spline, [0]) if c.effect.name == "viscous"]
    own = weigh(beside, viscous, (0,), search.policy)
    found = share_with_friction(search, [*spline, Found(own.chosen, own)], [0])
    assert {f.effect.name for f in found} == {"unknown", "coulomb"}
    assert level(search, found, "coulomb") == pytest.approx(COULOMB, rel=0.3)


def test_without_structure_nothing_changes(hump):
    search, _ = hump(viscous=1.0)
    assert share_with_friction(search, [], [0, 1]) == []


def test_products_of_a_coarser_spline_are_those_of_its_own_columns(record, pose):
    search = Search(pose(record(seed=5, runs=2, duration=8.0)), Policy())
    terms, assembly = GenericTerms(search.problem.prepared, search.problem.joined), search.assemble([])
    finest = next(c for c in terms.roughly(0) if len(list_levels(c.shapes[0])) > 1)
    sums = assembly.sum_products(finest)
    for level in list_levels(finest.shapes[0]):
        shape = np.array([*finest.shapes[0][:-1], level])
        own = terms._wrap(0, shape, [_evaluate(terms.effect, terms.thinned, 0, shape)])
        made, expected = _coarsen(sums, finest, level, 0.5), assembly.sum_products(_scale(own, 0.5))
        for name in ("cross", "gram", "score", "penalty"):
            np.testing.assert_allclose(
                getattr(made, name), getattr(expected, name), rtol=1e-6, atol=1e-6, err_msg=name
            )
