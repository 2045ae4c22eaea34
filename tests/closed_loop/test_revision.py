"""What the revision keeps, absorbs and drops: planted truth with forms that contain each other."""

import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection.assembly import Chosen
from wearscope.closed_loop.selection.evidence import weigh
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.revision import is_refined
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.base import load_effect


def find(search, name, joint):
    """A term of some effect as if it had been found."""
    candidate = search.problem.candidate(load_effect(name), joint)
    subset = tuple(int(k) for k in candidate.effect.subsets()[0])
    evidence = weigh(search.assemble(()), candidate, subset, search.flips)
    return Found(Chosen(candidate.at(0), subset), evidence)


@pytest.mark.parametrize("declared", [True, False])
def test_a_term_is_refined_where_it_alone_is_a_refining_ones_parent(record, pose, declared):
    """Of an asymmetry, Coulomb friction is the parent: declared, or found; an offset never is."""
    names = ("rigid_body", "rotor_inertia", *(("coulomb", "viscous") if declared else ()))
    search = Search(pose(record(seed=2, declared=names, runs=3, duration=6.0)), Policy(flips=99))
    asymmetry, offset = find(search, "coulomb_asymmetry", 0), find(search, "torque_offset", 0)
    assert is_refined(search, offset, [asymmetry]) is not declared
    if not declared:
        coulomb = find(search, "coulomb", 0)
        assert not is_refined(search, offset, [asymmetry, coulomb])
        assert is_refined(search, coulomb, [asymmetry])
        assert not is_refined(search, coulomb, [find(search, "coulomb_asymmetry", 1)])


@pytest.mark.parametrize(
    ("effect", "values"),
    [
        ("gravity_counterbalance", {"sine1": 40.0, "cosine1": 20.0, "bias": 30.0}),
        ("joint_spring", {"stiffness": 30.0, "preload": 30.0}),
    ],
)
def test_the_torque_at_rest_of_a_spring_is_no_offset(record, effect, values):
    named = [
        (e["joint"], e["effect"]) for e in diagnose(record([(0, effect, values)], seed=3)).verdict["verdict"]
    ]
    assert len(named) == 1
    assert named[0] in (("a", "gravity_counterbalance"), ("a", "joint_spring"))
