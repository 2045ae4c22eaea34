"""Names of single joints in the place of one of the whole robot, whose many parameters follow them all."""

import numpy as np
import pytest

from wearscope.closed_loop.selection.evidence import Found, Refusal
from wearscope.closed_loop.selection.naming import name_terms
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.single_joints import (
    count_parameters,
    predicts_as_well,
    prefer_single_joints,
)

#: A balancer at one joint and a heavier rotor at the other.
DRIVES = [
    (0, "gravity_counterbalance", {"sine1": 10.0, "cosine1": 40.0}),
    (1, "rotor_inertia_error", {"inertia": 0.5}),
]
#: A load at the last link that nobody told of, at its end or where it acts on the other joint alone.
LOADS = [{"mass": 2.0, "moment_x": 0.5, "moment_z": 0.1, "inertia_yy": 0.1}, {"mass": 2.0}]


@pytest.fixture
def search(record, pose):
    """A search, and the best name of the whole robot conditional on the declared model."""

    def make(planted, name, **more):
        made = Search(pose(record(planted, seed=3, **more)), Policy())
        assembly = made.assemble([])
        losses = np.nansum(assembly.joint_losses, axis=0) * made.sigma**2
        made.standard_losses = np.array([losses, losses])
        offered = [c for c in made.candidates(assembly, [], [1]) if c.effect.name == name]
        weighed = [e for e in made.weigh_all(assembly, offered) if e.refusal is Refusal.NONE]
        best = max(weighed, key=lambda e: e.gain)
        return made, [Found(best.chosen, best)]

    return make


def test_what_two_drives_do_is_not_named_wrong_masses(search):
    made, found = search(DRIVES, "inertial_error")
    single = prefer_single_joints(made, found)
    assert sorted((f.joint, f.effect.name) for f in single) == [(j, name) for j, name, _ in DRIVES]
    assert count_parameters(single) < count_parameters(found)
    # What was asked on the way is in the table of candidates.
    assert {row["effect"] for row in made.rows if row["taken"]} == {name for _, name, _ in DRIVES}
    # What many parameters follow a little closer does not come back, but may be listed with a name.
    assert not any(c.effect.per_robot for c in made.candidates(made.assemble([]), [], [1]))
    assert any(c.effect.per_robot for c in made.list_rivals(made.assemble([]), [], [1], every=True))
    named, _ = name_terms(made, single)
    assert not any(f.effect.per_robot for f in named)


@pytest.mark.parametrize("load", LOADS, ids=["at its end", "at its joint"])
def test_a_load_stays_one(search, load):
    """Nothing of what was asked in its place is left behind."""
    made, found = search([(1, "payload_error", load)], "payload_error")
    sigma, rows, problem = made.sigma.copy(), len(made.rows), made.problem
    assert prefer_single_joints(made, found) is found
    assert made.problem is problem and len(made.rows) == rows and not made.full and not made.left_out
    np.testing.assert_array_equal(made.sigma, sigma)


@pytest.mark.parametrize("load", LOADS, ids=["at its end", "at its joint"])
def test_a_load_is_not_named_wrong_masses_of_all_links(search, load):
    made, found = search([(1, "payload_error", load)], "inertial_error")
    assert [f.effect.name for f in prefer_single_joints(made, found)] == ["payload_error"]
    assert made.left_out == {"inertial_error"}


def test_a_load_and_a_drive_are_not_named_wrong_masses(search):
    """All links' masses follow both; single joints alone do not follow the load."""
    made, found = search(
        [(1, "payload_error", LOADS[0]), (0, "rotor_inertia_error", {"inertia": 2.0})], "inertial_error"
    )
    fewer = prefer_single_joints(made, found)
    assert sorted(f.effect.name for f in fewer) == ["payload_error", "rotor_inertia_error"]


def test_what_predicts_worse_than_noise_is_refused(search):
    """A model without one of two drives, against the one with both."""
    made, found = search(DRIVES, "inertial_error")
    single = prefer_single_joints(made, found)
    assert predicts_as_well(made, single, made, single)
    for one in single:
        assert not predicts_as_well(made, single, made, [one])
