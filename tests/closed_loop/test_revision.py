"""What the revision keeps, absorbs and drops: planted truth with forms that contain each other."""

from dataclasses import replace

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection import generic, revision, stepwise
from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Found, Refusal, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.revision import drop_superfluous, is_much, is_refined, revise
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.stepwise import extend, settle
from wearscope.effects.base import load_effect


def find(search, name, joint):
    """A term of some effect as if it had been found."""
    candidate = search.problem.candidate(load_effect(name), joint)
    subset = tuple(int(k) for k in candidate.effect.subsets()[0])
    evidence = weigh(search.assemble(()), candidate, subset, search.policy)
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


@pytest.mark.parametrize("name", ["viscous", "rotor_inertia"])
def test_without_the_errors_of_a_reversal_plain_friction_must_explain_much(record, pose, monkeypatch, name):
    """What other errors of its form can look like is less."""
    declared = ("rigid_body",)
    folder = record(seed=2, declared=declared, robot={"rotor_inertia": None}, runs=3, duration=6.0)
    search = Search(pose(folder), Policy(flips=99))
    found, least = find(search, name, 0), search.policy.large_share
    monkeypatch.setattr(revision, "is_needed", lambda *_: True)
    for share, fitted in ((1.01, 1.01), (0.99, 1.01), (1.01, 0.99)):
        own = replace(found.evidence, share=share * least, fitted=fitted * least)
        monkeypatch.setattr(revision, "weigh", lambda *_, own=own: own)
        assert is_much(search, found.chosen, []) is (name == "viscous" and min(share, fitted) > 1.0)


@pytest.mark.parametrize(
    ("needed", "judged", "drifts", "stays"),
    [
        (True, Refusal.CHANCE, True, True),
        (False, Refusal.NONE, False, True),
        (False, Refusal.CHANCE, False, False),
        (False, Refusal.NONE, True, False),
    ],
)
def test_a_standard_term_that_would_be_taken_again_stays(
    record, pose, monkeypatch, needed, judged, drifts, stays
):
    """What fifths of two runs do not need and whole runs held out ask for is not dropped."""
    names = ("rigid_body", "rotor_inertia", "coulomb")
    search = Search(pose(record(seed=2, declared=names, runs=2, duration=6.0)), Policy(flips=99))
    viscous = find(search, "viscous", 0)
    monkeypatch.setattr(revision, "is_needed", lambda *_: needed)
    monkeypatch.setattr(search, "judge", lambda _: judged)
    monkeypatch.setattr(search, "drifts", lambda *_: drifts)
    assert [f.chosen for f in revise(search, [viscous])] == ([viscous.chosen] if stays else [])


@pytest.mark.parametrize(
    ("name", "drifting", "answer"),
    [
        ("torque_offset", set(), "payload_error"),
        ("torque_offset", {"payload_error"}, "payload_error"),
        ("coulomb_asymmetry", {"payload_error"}, "coulomb_asymmetry"),
        ("coulomb_asymmetry", {"payload_error", "coulomb_asymmetry"}, "payload_error"),
    ],
)
def test_a_load_replaces_what_has_a_part_of_it(record, pose, monkeypatch, name, drifting, answer):
    """A drift that explains only the load speaks against it; one that explains both does not."""
    load = {"mass": 2.0, "moment_x": 0.5, "moment_z": 0.1, "inertia_yy": 0.1}
    search = Search(pose(record([(1, "payload_error", load)], seed=3)), Policy(flips=99))
    part = find(search, name, 1)
    part = Found(part.chosen, replace(part.evidence, p_value=0.001))
    monkeypatch.setattr(revision, "is_needed", lambda *_: True)
    monkeypatch.setattr(search, "drifts", lambda _, e: e.term.effect.name in drifting)
    assert [f.effect.name for f in revise(search, [part])] == [answer]


@pytest.fixture(scope="module")
def balancer(record_at, pose, tmp_path_factory):
    """A data set with a balancer at the last joint, which one more name cannot improve on."""
    planted = [(1, "gravity_counterbalance", {"sine1": 20.0, "cosine1": 8.0})]
    return pose(record_at(tmp_path_factory.mktemp("balancer") / "duo", planted, seed=5, runs=4))


@pytest.fixture
def beside_balancer(balancer):
    return Search(balancer, Policy(flips=99))


@pytest.fixture(scope="module")
def plain(record_at, pose, tmp_path_factory):
    """A data set of which the declared model lacks nothing."""
    folder = tmp_path_factory.mktemp("plain") / "duo"
    return pose(record_at(folder, seed=2, runs=3, duration=6.0))


@pytest.mark.parametrize("name", ["payload_error", "coulomb_asymmetry"])
def test_a_name_goes_beside_what_explains_it(beside_balancer, name):
    """Of the whole robot or of a joint; what is kept stays, and so does what is at another joint."""
    search = beside_balancer
    whole, other = find(search, "gravity_counterbalance", 1), find(search, "coulomb_asymmetry", 0)
    found = [find(search, name, 1), whole, other]
    assert drop_superfluous(search, found, {1}, {id(whole.chosen)}) == [whole, other]
    assert drop_superfluous(search, found, set(), set()) == found


@pytest.mark.parametrize(
    ("asked_again", "grown", "settled"),
    [
        ("ab", "ab", "ab"),
        # Conditional on all others it is not needed; alone the weights of the smaller model ask for it.
        ("a", "ab", "a"),
        # Another one has its place.
        ("ac", "ac", "ac"),
        ("a", "ac", "ac"),
    ],
)
def test_what_is_dropped_and_taken_again_is_not_needed(
    beside_balancer, monkeypatch, asked_again, grown, settled
):
    search = beside_balancer
    names = {"a": "gravity_counterbalance", "b": "coulomb_asymmetry", "c": "viscous_asymmetry"}
    terms = {key: find(search, name, 1) for key, name in names.items()}

    def make(keys):
        return [terms[key] for key in keys]

    def answer(found, first, then):
        return make(first) if found == make("ab") else make(then)

    monkeypatch.setattr(stepwise, "revise", lambda _, found: answer(found, asked_again, settled))
    monkeypatch.setattr(stepwise, "extend", lambda _, found: answer(found, grown, grown))
    assert settle(search, make("ab")) == make(settled)


def test_names_beside_one_that_gave_way_are_asked_again(beside_balancer, monkeypatch):
    """Two doubted names of a joint, and structure that explains both."""
    search = beside_balancer
    names = [find(search, name, 1) for name in ("coulomb_asymmetry", "viscous_asymmetry")]
    whole = find(search, "gravity_counterbalance", 1)
    assert all(f.evidence.share < Policy().beyond_doubt for f in names)
    monkeypatch.setattr(generic, "weigh_generic", lambda *_: [whole.evidence])
    (left,) = generic.doubt(search, None, names)
    assert left.evidence is whole.evidence


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


def test_plain_friction_that_was_hidden_is_asked_for_before_what_refines_it(record, pose):
    """A drag that was missing together with something larger is a drag, and no curve of the speed."""
    planted = [(0, "torque_ripple", {"cosine": 30.0, "sine": 0.0, "wavenumber": 20.0})]
    folder = record(planted, seed=5, declared=["rigid_body", "rotor_inertia", "coulomb"])
    told: list[str] = []
    search = Search(pose(folder), Policy(), told.append)
    search.standard_losses = np.tile(search.scale(()) ** 2 * len(search.problem.target), (2, 1))
    found = extend(search, [])
    own = [f.effect.name for f in found if f.joint == 0]
    assert own == ["torque_ripple", "viscous"]
    assert "viscous@0: needed in addition to what was found" in told


def test_an_offset_that_a_large_ripple_hid_is_found_beside_it(record, pose):
    """A ten-thousandth of the ripple's power, many times the noise of so many rows."""
    planted = [
        (0, "torque_ripple", {"cosine": 300.0, "sine": 0.0, "wavenumber": 20.0}),
        (0, "torque_offset", {"offset": 4.0}),
    ]
    search = Search(pose(record(planted, seed=5)), Policy())
    assert {(f.effect.name, f.joint) for f in find_named(search)} == {
        ("torque_ripple", 0),
        ("torque_offset", 0),
    }


def test_an_offset_gives_way_to_what_is_more_than_one(record, pose):
    """A spring that a large coupling hides: the offset that comes first is a part of it."""
    planted = [
        (0, "cross_coupling", {"coulomb": 250.0, "other": 1}),
        (0, "joint_spring", {"stiffness": 20.0, "preload": 40.0}),
    ]
    folder = record(planted, seed=5)
    told: list[str] = []
    found = find_named(Search(pose(folder), Policy(), told.append))
    assert "torque_offset@0: needed in addition to what was found" in told
    names = {f.effect.name for f in found if f.joint == 0}
    assert "torque_offset" not in names
    assert names & {"joint_spring", "gravity_counterbalance"}


def test_an_offset_beside_a_large_coupling_stays(record, pose):
    planted = [
        (0, "cross_coupling", {"coulomb": 250.0, "other": 1}),
        (0, "torque_offset", {"offset": 40.0}),
    ]
    found = find_named(Search(pose(record(planted, seed=5)), Policy()))
    assert {f.effect.name for f in found} == {"cross_coupling", "torque_offset"}


def test_both_frictions_of_one_coupling_are_one_name(record, pose):
    planted = [(0, "cross_coupling", {"coulomb": 60.0, "viscous": 40.0, "other": 1})]
    (found,) = find_named(Search(pose(record(planted, seed=6)), Policy()))
    assert found.effect.name == "cross_coupling"
    assert [found.effect.coefficients[k].name for k in found.chosen.subset] == ["viscous", "coulomb"]


def test_what_is_small_beside_a_wrong_mass_is_no_part_of_it(record, pose):
    """A rigid body is followed exactly: what a curve removes is held against what the load leaves."""
    planted = [
        (0, "payload_error", {"mass": 16.0, "moment_x": 8.0}),
        (1, "stribeck", {"level": 1.5, "speed": 0.3, "exponent": 2.0}),
    ]
    load, curve = find_named(Search(pose(record(planted, seed=5)), Policy()))
    assert (load.effect.name, curve.effect.name, curve.joint) == ("payload_error", "stribeck", 1)
    assert curve.evidence.whole == pytest.approx(curve.evidence.share, rel=1e-9)


def test_a_standard_term_is_held_against_what_the_standard_model_leaves(record, pose):
    """A weight, which an offset has most of, is of the standard model's loss, not of the rest."""
    planted = [(0, "payload_error", {"mass": 16.0, "moment_x": 8.0})]
    search = Search(pose(record(planted, seed=5)), Policy())
    found = find_named(search)
    beside = search.assemble(found, standard=True)
    offset, spring = (find(search, name, 1).chosen for name in ("torque_offset", "joint_spring"))
    own = [weigh(beside, c.candidate, c.subset, search.policy) for c in (offset, spring)]
    losses, standard = search.find_losses_given_bodies(beside)[0, 1], search.standard_losses[0, 1]
    assert losses < 1e-3 * standard
    scale = search.sigma[1] ** 2
    wholes = [e.whole for e in search.compare_whole(beside, own)]
    expected = [own[0].gains[1] * scale / standard, own[1].gains[1] * scale / losses]
    assert wholes == pytest.approx(expected)


@pytest.mark.parametrize(
    ("judged", "fitted", "stays"),
    [
        (Refusal.NONE, 1.01, True),
        (Refusal.NONE, 0.99, False),
        (Refusal.NONE, -0.1, False),
        (Refusal.CHANCE, 2.0, False),
    ],
)
def test_a_name_that_gains_on_held_out_rows_alone_is_not_needed(plain, monkeypatch, judged, fitted, stays):
    """Conditional on a spline that gain is the spline's penalty; what matters is in `material_share`."""
    search = Search(plain, Policy(flips=99))
    name = find(search, "load_dependent_friction", 0)
    own = replace(name.evidence, share=0.3, fitted=fitted * search.policy.material_share)
    monkeypatch.setattr(search, "weigh_again", lambda *_: own)
    monkeypatch.setattr(search, "judge", lambda _: judged)
    assert drop_superfluous(search, [name], {0}, set()) == ([name] if stays else [])
