"""Evaluating changes nothing; shapes are refined; what is asked, in which order, and where it ends."""

from dataclasses import fields

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, weigh
from wearscope.closed_loop.selection.naming import opposes_gravity
from wearscope.closed_loop.selection.offers import list_subsets
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.stepwise import find_standard
from wearscope.closed_loop.selection.whitening import count_kinds
from wearscope.effects.base import load_effect

POLICY = Policy(flips=199)
STRIBECK = [(0, "stribeck", {"level": 8.0, "speed": 0.27, "exponent": 1.0})]


@pytest.fixture(scope="module")
def problem(record_at, pose, tmp_path_factory):
    """A Stribeck effect between two values of the searched grid."""
    return pose(record_at(tmp_path_factory.mktemp("search") / "duo", STRIBECK, seed=3, runs=4, duration=8.0))


@pytest.fixture(scope="module", params=["trusted", "approximate"])
def arm(request, record_at, pose, tmp_path_factory):
    folder = tmp_path_factory.mktemp(request.param) / "duo"
    robot = {"inertials": request.param}
    return pose(record_at(folder, STRIBECK, seed=3, runs=4, duration=6.0, robot=robot))


def weigh_everything(search, turned=False):
    """Evidence on every candidate conditional on the declared model, by effect, joint and subset."""
    search.sigma = search.scale(())
    search.standard_losses = np.zeros((2, len(search.sigma)))
    assembly = search.assemble(())
    offered = search.candidates(assembly, (), range(search.problem.prepared.n))
    made = search.weigh_all(assembly, offered[::-1] if turned else offered)
    assert len(made) > 40
    return {(e.term.effect.name, e.term.joint, e.chosen.subset): e for e in made}


def assert_same_bits(one, other):
    assert set(one) == set(other)
    for key, a in one.items():
        for field in fields(Evidence):
            if field.name == "chosen":
                assert a.term.shape == other[key].term.shape
                continue
            x, y = getattr(a, field.name), getattr(other[key], field.name)
            assert np.array_equal(x, y, equal_nan=not isinstance(x, dict | type(a.refusal))), (
                key,
                field.name,
            )


def test_all_candidates_twice_and_in_reverse_give_the_same_bits(arm):
    first = weigh_everything(Search(arm, POLICY))
    assert_same_bits(first, weigh_everything(Search(arm, POLICY), turned=True))


def test_a_search_that_has_been_used_gives_the_same_bits(problem):
    fresh = weigh_everything(Search(problem, POLICY))
    used = Search(problem, POLICY)
    found = find_named(used)
    assert [(f.effect.name, f.joint) for f in found] == [("stribeck", 0)]
    assert_same_bits(fresh, weigh_everything(used))
    # Nor has it changed what another one is asked.
    assert_same_bits(fresh, weigh_everything(Search(problem, POLICY), turned=True))


def test_evidence_kept_is_evidence_weighed_anew(problem):
    """What is not weighed again conditional on a changed model is what weighing would give."""
    search = Search(problem, POLICY)
    find_named(search)
    kept = dict(search._weighed)
    assert len(kept) > 60
    again = Search(problem, POLICY)
    find_named(again)
    assert {k[3] for k in kept} == {k[3] for k in again._weighed}
    search._weighed.clear()
    fresh = weigh_everything(search)
    search._weighed.clear()
    search._weighed.update(kept)
    assert_same_bits(weigh_everything(search), fresh)


def test_a_shape_is_taken_from_the_grid_to_its_best_value_and_the_significance_kept(problem):
    search = Search(problem, POLICY)
    assembly = search.assemble(())
    (on_grid,) = search.weigh_all(assembly, [problem.candidate(load_effect("stribeck"), 0)])
    assert abs(np.log(on_grid.term.shape[0] / 0.27)) > 0.05
    refined = search.refine(assembly, on_grid)
    assert refined.gain > on_grid.gain
    assert abs(np.log(refined.term.shape[0] / 0.27)) < abs(np.log(on_grid.term.shape[0] / 0.27))
    assert refined.p_value == on_grid.p_value


def test_a_counterbalance_takes_gravity_off_a_joint_that_has_any(record, pose):
    problem = pose(record(runs=3, duration=6.0))
    search = Search(problem, POLICY)
    body = problem.train[0].signals.rigid_body
    still = np.zeros((1, 2))
    lift = float(body.inverse_dynamics(still, still, still)[0, 0])
    assembly = search.assemble(())

    def opposes(name, size):
        candidate = problem.candidate(load_effect(name), 0)
        e = weigh(assembly, candidate, (0, 1), search.policy)
        object.__setattr__(e, "beta", np.array([0.0, size]))
        return opposes_gravity(problem, e)

    assert opposes("gravity_counterbalance", -0.5 * lift)
    assert not opposes("gravity_counterbalance", 0.5 * lift)
    assert not opposes("joint_spring", -0.5 * lift)
    for run in problem.train:
        run.signals.rigid_body = body.with_gravity([0.0, 9.81, 0.0])
    assert not opposes("gravity_counterbalance", -0.5 * lift)
    assert not opposes("gravity_counterbalance", 0.5 * lift)


def test_an_effect_is_asked_for_only_beside_its_parents(record, pose):
    problem = pose(record(declared=["rigid_body"], robot={"rotor_inertia": None}, runs=3, duration=6.0))
    search = Search(problem, POLICY)
    plain = {c.effect.name for c in search.candidates(search.assemble(()), (), (0,))}
    standard = find_standard(search)
    assert {f.effect.name for f in standard} == {"rotor_inertia", "coulomb", "viscous"}
    more = {c.effect.name for c in search.candidates(search.assemble(standard), standard, (0,))}
    with_parents = {e.name for e in problem.effects if e.parents}
    assert with_parents and not plain & with_parents
    assert {"quadratic_viscous", "stribeck"} <= more
    assert not more & {"rotor_inertia", "coulomb", "viscous"}


def test_of_a_single_run_only_the_plainest_forms_are_asked_for():
    effect = load_effect("gravity_counterbalance")
    alone, several = list_subsets(effect, by_run=False), list_subsets(effect, by_run=True)
    assert set(alone) < set(several)
    assert not any(set(a) < set(b) for a in alone for b in alone)


def test_every_candidate_of_every_step_is_recorded(problem):
    search = Search(problem, POLICY)
    find_named(search)
    rows = [row for row in search.rows if row["step"] == 1]
    assert {row["joint"] for row in rows} == {"a", "b"}
    taken = [row for row in rows if row["taken"]]
    assert {(row["joint"], row["effect"]) for row in taken} == {("a", "stribeck")}
    assert all(row["reason"] for row in rows)
    assert all(np.isfinite(row["cv_gain"]) and 0.0 < row["p_value"] <= 1.0 for row in rows)


def test_the_most_terms_of_a_joint_are_said_when_they_are_reached(record):
    """Two effects at a joint, and room for one: the verdict says that there may be more."""
    planted = [
        (0, "stribeck", {"level": 10.0, "speed": 0.3, "exponent": 1.0}),
        (0, "torque_ripple", {"cosine": 1.0, "sine": 0.8, "wavenumber": 20.0}),
    ]
    folder = record(planted, seed=3, runs=4, duration=8.0)
    whole = diagnose(folder, Policy(flips=199)).verdict
    assert {e["effect"] for e in whole["verdict"]} == {"stribeck", "torque_ripple"}
    assert whole["stopped"] == []
    verdict = diagnose(folder, Policy(flips=199, most_terms=1)).verdict
    assert [e["effect"] for e in verdict["verdict"] if e["effect"] != "unknown"] == ["stribeck"]
    (said,) = verdict["stopped"]
    assert said.startswith("a: ") and "(1)" in said
    assert verdict["rule"] == Policy(flips=199, most_terms=1).model_dump()
    assert verdict["version"]


def test_the_same_seed_gives_the_same_verdict_and_zero_is_a_seed(record):
    folder = record(STRIBECK, seed=3, runs=2, duration=5.0)
    one, other = (diagnose(folder, Policy(flips=99, seed=0)).verdict for _ in range(2))
    assert one == other and one["rule"]["seed"] == 0


def test_a_chosen_form_has_the_columns_of_its_subset(problem):
    candidate = problem.candidate(load_effect("gravity_counterbalance"), 0)
    own = Chosen(candidate.at(0), (1,)).rows[0]
    np.testing.assert_array_equal(own, candidate.rows[0][:, [1]])


def test_what_every_drive_has_is_asked_among_its_own(record, pose):
    """Of all names, one in so many passes by chance; of rotor inertia, Coulomb and viscous, one in three."""
    search = Search(pose(record(declared=["rigid_body"])), POLICY)
    for name in ("rotor_inertia", "coulomb", "viscous"):
        assert count_kinds(search.problem, load_effect(name), 0) == 3, name
    for name in ("torque_offset", "stribeck"):
        assert count_kinds(search.problem, load_effect(name), 0) == len(search.problem.effects) > 20, name
