"""A name stands in every band or, where it is doubtful, goes; what most bands name takes its place."""

from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import conclude, diagnose
from wearscope.closed_loop.selection.answer import find_names, find_names_elsewhere, find_terms, pose_again
from wearscope.closed_loop.selection.bands import (
    Agreed,
    Name,
    Named,
    agree,
    find_standing,
    is_doubtful,
    keep_agreed,
)
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.errors import InputError

POLICY = Policy()
RIPPLE = Name("torque_ripple", 0, doubtful=True)
SPRING = Name("joint_spring", 0, ("gravity_counterbalance",), doubtful=True)
BALANCER = Name("gravity_counterbalance", 0, doubtful=True)
STRIBECK = Name("stribeck", 0, doubtful=True)
VISCOUS = Name("viscous", 1)
STRANGE = Name("unknown", 0, doubtful=True, generic=True, slow=True)
OFFSET = Name("torque_offset", 0, doubtful=True, slow=True)
PAYLOAD = Name("payload_error", None, doubtful=True)


def give(own, *others, higher=(False, True), standing=()):
    """What is left of the names, with those beside, and those that are added, with those beside.

    The first of the others is the lower band, the second the higher one.
    """
    agreed = agree(own, others, higher[: len(others)], standing)
    kept = [(own[i].effect, *beside) for i, beside in zip(agreed.kept, agreed.beside, strict=True)]
    both = zip(agreed.added, agreed.beside_added, strict=True)
    return kept, [(others[b][k].effect, *beside) for (b, k), beside in both]


def test_a_doubtful_name_must_stand_in_the_higher_band():
    assert give([RIPPLE], [RIPPLE], [RIPPLE]) == ([("torque_ripple",)], [])
    assert give([RIPPLE], [], [RIPPLE]) == ([("torque_ripple",)], [])
    assert give([RIPPLE], [RIPPLE], []) == ([], [])
    assert give([RIPPLE], [], []) == ([], [])


def test_a_name_may_stand_beside_what_the_higher_band_gives():
    assert give([VISCOUS, RIPPLE], [], [STRIBECK], standing=[(), (1,)])[0] == [
        ("viscous",),
        ("torque_ripple",),
    ]
    assert give([VISCOUS, RIPPLE], [], [STRIBECK], standing=[(1,), (0,)])[0] == [("viscous",)]


@pytest.mark.parametrize("slow", [STRANGE, OFFSET])
def test_what_noise_with_a_memory_may_be_must_stand_in_the_lower_band(slow):
    assert give([slow], [slow], []) == ([(slow.effect,)], [])
    assert give([slow], [], [slow]) == ([], [])


@pytest.mark.parametrize("name", [RIPPLE, STRANGE])
def test_where_both_others_are_lower_either_will_do(name):
    for others in ([[name], []], [[], [name]]):
        assert give([name], *others, higher=(False, False)) == ([(name.effect,)], [])
    assert give([name], [], [], higher=(False, False)) == ([], [])


def test_a_sure_name_and_what_every_drive_has_stay():
    sure = replace(RIPPLE, doubtful=False)
    assert give([sure, VISCOUS], [], [STRIBECK]) == ([("torque_ripple",), ("viscous",)], [])


def test_where_no_other_band_could_be_asked_all_stays():
    assert give([RIPPLE, VISCOUS]) == ([("torque_ripple",), ("viscous",)], [])


def test_a_name_of_the_set_speaks_for_the_name_from_either_side():
    assert give([SPRING], [BALANCER], [SPRING]) == ([("joint_spring",)], [])
    assert give([BALANCER], [SPRING], [SPRING]) == ([("gravity_counterbalance",)], [])
    assert give([BALANCER], [SPRING], [replace(SPRING, joint=1)]) == ([], [])


def test_what_speaks_for_its_own_name_speaks_for_no_other():
    """A ripple whose set holds the spring stands for nothing where the other band names the spring alone."""
    ripple = replace(RIPPLE, equivalent=("joint_spring",))
    assert give([SPRING, ripple], [SPRING], [SPRING]) == ([("joint_spring",)], [])


def test_what_both_other_bands_name_takes_its_place():
    assert give([RIPPLE], [STRIBECK], [STRIBECK]) == ([], [("stribeck", "torque_ripple")])
    assert give([], [STRIBECK], [STRIBECK]) == ([], [("stribeck",)])
    assert give([STRANGE], [STRIBECK], [STRIBECK]) == ([], [("stribeck",)])


def test_where_each_band_names_another_thing_they_stand_beside_the_name():
    assert give([RIPPLE], [STRIBECK], [SPRING]) == ([("torque_ripple", "stribeck", "joint_spring")], [])


def test_structure_without_a_name_gives_way_to_a_name_of_any_band():
    assert give([STRANGE], [STRIBECK], [SPRING]) == ([], [("stribeck",)])
    assert give([STRANGE], [], [STRIBECK]) == ([], [("stribeck",)])
    assert give([STRANGE], [], [OFFSET]) == ([], [])
    assert give([STRANGE], [STRANGE, STRIBECK], []) == ([("unknown",)], [])
    # Two of them, an offset that both bands name and a law that one does.
    lower = {"higher": (False, False)}
    assert give([STRANGE, STRANGE], [OFFSET, STRIBECK], [OFFSET], **lower) == (
        [], [("torque_offset",), ("stribeck",)],
    )  # fmt: skip


def test_structure_without_a_name_in_the_higher_band_speaks_against_no_name_of_the_lower_one():
    assert give([RIPPLE], [RIPPLE], [STRANGE]) == ([("torque_ripple",)], [])
    assert give([RIPPLE, SPRING], [SPRING], [STRANGE]) == ([("joint_spring",)], [])
    assert give([RIPPLE], [RIPPLE], [replace(STRANGE, joint=1)]) == ([], [])
    assert give([RIPPLE], [RIPPLE], [STRIBECK]) == ([], [])
    assert give([STRANGE], [], [STRANGE]) == ([], [])


def test_of_another_joint_nothing_takes_a_place_and_of_the_whole_robot_it_does():
    there = replace(STRIBECK, joint=1)
    assert give([RIPPLE], [there], [there]) == ([], [("stribeck",)])
    assert give([RIPPLE], [PAYLOAD], [PAYLOAD]) == ([], [("payload_error", "torque_ripple")])


def test_one_other_band_alone_adds_nothing():
    assert give([], [STRIBECK]) == ([], [])
    assert give([RIPPLE], [STRIBECK]) == ([("torque_ripple", "stribeck")], [])


@pytest.mark.parametrize("own", list(permutations([RIPPLE, SPRING, VISCOUS])))
def test_neither_the_order_of_names_nor_of_bands_matters(own):
    others = [[VISCOUS, SPRING, STRIBECK], [STRIBECK, VISCOUS, SPRING]]
    for each, higher in ((others, (False, True)), (others[::-1], (True, False))):
        kept, added = give(own, *each, higher=higher)
        assert sorted(kept) == [("joint_spring",), ("viscous",)]
        assert added == [("stribeck", "torque_ripple")]


@pytest.fixture(scope="module")
def loaded(record_at, tmp_path_factory):
    """Joint a's friction grows with its load, and joint b has a small spring."""
    folder = tmp_path_factory.mktemp("bands") / "duo"
    planted = [
        (0, "load_dependent_friction", {"coefficient": 0.08}),
        (1, "joint_spring", {"stiffness": 1.2, "rest": 0.1}),
    ]
    return record_at(folder, planted, seed=4)


def cut_off_at(problem, factor):
    """The problem with a common cut-off that says to be a factor higher than it is."""
    band = replace(problem.prepared.band, torque=factor * problem.prepared.band.torque)
    problem.prepared = replace(problem.prepared, band=band)
    return problem


def searches(pose, folder, policy=POLICY):
    search = Search(pose(folder), policy)
    return search, find_names(search)


def test_a_name_that_another_band_does_not_give_goes_and_what_it_hid_comes_back(loaded, pose):
    search, own = searches(pose, loaded)
    spring = next(k for k, f in enumerate(own.found) if f.effect.name == "joint_spring")
    assert {f.effect.name for f in own.found} == {"load_dependent_friction", "joint_spring"}
    share = own.found[spring].evidence.share
    doubting = Search(search.problem, Policy(beyond_doubt=min(0.999, share + 0.001)))
    less = Named([f for k, f in enumerate(own.found) if k != spring], [[]], {}, 2.0 * own.cutoff)
    kept, notes = keep_agreed(doubting, own, [own, less])
    assert [f.effect.name for f in kept.found] == ["load_dependent_friction"]
    assert len(kept.equivalent) == 1
    (note,) = notes
    assert note.startswith("joint_spring at b, named at a common cut-off of")
    assert f"{2.0 * own.cutoff:.3g} Hz): it does not count" in note
    same, none = keep_agreed(doubting, own, [own, own])
    assert same is own
    assert none == []


def test_what_gains_beside_another_band_s_names_stands_there(loaded, pose):
    """The band that lacks the spring for few blocks would hold it; one in which it is there stands anyway."""
    search, own = searches(pose, loaded)
    spring = next(k for k, f in enumerate(own.found) if f.effect.name == "joint_spring")
    doubting = Search(search.problem, Policy(beyond_doubt=0.9999))
    every = frozenset(range(len(own.found)))
    assert find_standing(doubting, own, own.found) == every
    assert find_standing(doubting, own, [f for k, f in enumerate(own.found) if k != spring]) == every
    few = Search(search.problem, Policy(beyond_doubt=0.9999, fewest_blocks=1e9))
    assert find_standing(few, own, own.found) == every
    weak = Search(search.problem, Policy(beyond_doubt=0.9999, material_share=0.9999))
    assert find_standing(weak, own, own.found) == frozenset()
    sure = Search(search.problem, Policy(beyond_doubt=1e-6))
    assert find_standing(sure, own, own.found) == frozenset()


def test_a_name_that_the_other_bands_give_is_fitted_in_the_own_one(loaded, pose):
    search, own = searches(pose, loaded)
    spring = next(k for k, f in enumerate(own.found) if f.effect.name == "joint_spring")
    less = Named(
        [f for k, f in enumerate(own.found) if k != spring],
        [names for k, names in enumerate(own.equivalent) if k != spring],
        {},
        own.cutoff,
    )
    elsewhere = find_names_elsewhere(search, own, search.problem, pose_again)
    kept, notes = keep_agreed(search, less, elsewhere)
    assert [f.effect.name for f in kept.found] == ["load_dependent_friction", "joint_spring"]
    assert notes[0].startswith("joint_spring at b, not named at a common cut-off of")
    # Of this band's rows, not of those of the band that gave it.
    again, there = kept.found[-1], own.found[spring]
    assert len(again.chosen.rows[0]) == len(there.chosen.rows[0])
    assert again.evidence.beta == pytest.approx(there.evidence.beta, rel=0.02)


def test_a_doubtful_generic_term_that_some_band_gives_leaves_its_joint_unexplained(record, pose):
    """Structure that is there, in a form on which bands do not agree."""
    folder = record(
        [], seed=6, extra_torque=lambda t, q, v, a, rng: np.c_[9.0 * np.sin(2.5 * q[:, 1]), 0 * t]
    )
    search, own = searches(pose, folder)
    own = replace(own, left={})
    assert [(f.effect.name, f.joint) for f in own.found] == [("unknown", 0)]
    assert is_doubtful(own.found[0], POLICY)
    none, same = Named([], [], {}, 0.5 * own.cutoff), replace(own, cutoff=2.0 * own.cutoff)
    kept, _ = keep_agreed(search, own, [same, none])
    assert kept.found == []
    assert list(kept.left) == [0]
    gone, _ = keep_agreed(search, own, [none, none])
    assert gone.left == {}
    answer = replace(find_terms(Search(pose(folder), Policy(octaves=0.0))), found=[], equivalent=[])
    state = conclude(search, replace(answer, left=kept.left)).states[0]
    assert state.state == "unexplained"


def test_bands_are_asked_where_a_name_is_doubtful_and_only_there(loaded, pose):
    asked = []
    posed = [pose_again(pose(loaded), 2**-0.5), cut_off_at(pose(loaded), 2**0.5)]

    def count(problem, widened):
        asked.append(widened)
        return posed[widened > 1.0]

    sure = find_terms(Search(pose(loaded), Policy(beyond_doubt=1e-6)), count)
    assert asked == []
    doubtful = find_terms(Search(pose(loaded), Policy(beyond_doubt=0.9999)), count)
    assert asked == pytest.approx([2**-0.5, 2**0.5])
    none = find_terms(Search(pose(loaded), Policy(beyond_doubt=0.9999, octaves=0.0)), count)
    assert len(asked) == 2
    names = [sorted(f.effect.name for f in answer.found) for answer in (sure, doubtful, none)]
    assert names == [["joint_spring", "load_dependent_friction"]] * 3


def test_where_the_motion_is_not_known_further_up_a_lower_cut_off_is_asked(loaded, pose):
    """The positions' noise limits this data set's band to the cut-off that is chosen."""
    search = Search(pose(loaded), POLICY)
    chosen = search.problem.prepared.band
    assert pose_again(search.problem, 2**0.5).prepared.band.torque < 2**0.25 * chosen.torque
    own = Named([], [], {}, chosen.torque)
    lower = find_names_elsewhere(search, own, search.problem, pose_again)
    assert [named.cutoff / chosen.torque for named in lower] == pytest.approx([2**-0.5, 0.5])


def test_a_cut_off_that_the_runs_are_too_short_for_is_left_out(loaded, pose):
    told = []
    search = Search(pose(loaded), POLICY, told.append)

    def refuse(problem, widened):
        raise InputError("too short for a 2 Hz filter; record longer.")

    assert find_names_elsewhere(search, Named([], [], {}, 4.0), search.problem, refuse) == []
    assert told[-1] == "too short for a 2 Hz filter; record longer."


def test_what_is_sure_is_not_doubtful_nor_what_every_drive_has(loaded, pose):
    _, own = searches(pose, loaded)
    for f in own.found:
        high, low = (Found(f.chosen, replace(f.evidence, share=share)) for share in (0.71, 0.69))
        assert (is_doubtful(high, POLICY), is_doubtful(low, POLICY)) == (False, True)


def test_the_verdict_notes_what_stands_in_one_band_alone(loaded, monkeypatch):
    """Where another band gives nothing at all, doubtful names go, and the verdict says so."""
    empty = Named([], [], {}, 9.0)
    monkeypatch.setattr("wearscope.closed_loop.selection.answer.find_names_elsewhere", lambda *_: [empty])
    verdict = diagnose(loaded, Policy(beyond_doubt=0.9999)).verdict
    assert [e["effect"] for e in verdict["verdict"]] == []
    assert sum("it does not count" in note for note in verdict["notes"]) == 2


def test_agreed_is_frozen():
    with pytest.raises(AttributeError):
        agree([], [], []).kept = [1]
    assert agree([], [], []) == Agreed([], [], [], [])
