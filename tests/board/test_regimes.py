"""The regimes: a Latin hypercube over every axis, parts that never meet, machines that could exist."""

import numpy as np
import pinocchio as pin
import pytest

from benchmarks.board.draw_machines import FAMILIES, draw_machine
from benchmarks.board.outside import KINDS as OUTSIDE_KINDS
from benchmarks.board.outside import OUTSIDE
from benchmarks.board.regimes import (
    CHOICES,
    COMPLETE,
    HELD_OUT,
    MOST_VALUES,
    RANGES,
    SHORTEST,
    choose_levels,
    draw_axes,
    list_cases,
)


@pytest.fixture(scope="module")
def cases():
    return {part: list_cases(part, 120, 5) for part in ("development", "held_out")}


def test_every_axis_is_spread_evenly():
    axes = draw_axes("development", 100, 0)
    for name, (low, high, _) in RANGES.items():
        share = np.log([a[name] for a in axes]) - np.log(low)
        bins = np.floor(100 * share / np.log(high / low) + 1e-9).astype(int)
        assert sorted(bins) == list(range(100)), name
    for name in CHOICES:
        levels = choose_levels(name, "development")
        whole = sum(levels.values())
        for level, weight in levels.items():
            count = sum(a[name] == level for a in axes)
            assert abs(count - 100 * weight / whole) < 2.0, (name, level)


def test_equal_seeds_give_equal_cases_and_other_parts_and_seeds_others(cases):
    again = list_cases("development", 120, 5)
    assert [c.name for c in again] == [c.name for c in cases["development"]]
    names = {c.name for c in cases["development"]} | {c.name for c in cases["held_out"]}
    assert len(names) == 240
    seeds = {c.seed for c in cases["development"]} & {c.seed for c in cases["held_out"]}
    assert not seeds
    assert not names & {c.name for c in list_cases("development", 120, 0)}


def test_held_out_families_are_never_in_development(cases):
    hidden_outside = {name for kind in HELD_OUT["outside"] for name in OUTSIDE_KINDS[kind]}
    seen = {"machine": set(), "motion": set(), "noise": set(), "outside": set()}
    for part in ("development", "held_out"):
        for case in cases[part]:
            drawn = {
                "machine": {case.axes["machine"]},
                "motion": {plan.kind for plan in case.recipe.plans},
                "noise": {case.recipe.noise},
                "outside": {p.effect for p in case.planted if p.effect in OUTSIDE},
            }
            hidden = {**HELD_OUT, "outside": hidden_outside}
            for axis, values in drawn.items():
                if part == "development":
                    assert not values & set(hidden[axis]), (axis, case.number)
                seen[axis] |= values
    for axis in ("machine", "motion", "noise"):
        assert set(HELD_OUT[axis]) <= seen[axis], axis
    assert hidden_outside & seen["outside"]


def test_outside_kinds_are_all_outside_effects():
    assert sorted(name for names in OUTSIDE_KINDS.values() for name in names) == sorted(OUTSIDE)


def test_nulls_are_a_fifth_and_hold_nothing(cases):
    for part in cases.values():
        nulls = [case for case in part if case.axes["plants"] == "null"]
        assert len(nulls) == pytest.approx(0.2 * len(part), abs=1)
        for case in nulls:
            assert case.planted == ()
            assert case.axes["declared"] in COMPLETE and case.axes["inertials"] != "wrong"
    kinds = {case.recipe.noise for case in cases["held_out"] if not case.planted}
    assert len(kinds) >= 5


def test_undeclared_friction_is_planted_and_declared_friction_is_not(cases):
    for case in cases["development"]:
        standard = {p.effect for p in case.planted if p.amplitude is not None}
        declared = set(case.recipe.declared)
        assert not standard & declared
        if "friction_wear_temperature" not in declared and "coulomb" not in declared:
            assert "coulomb" in standard
        assert not {p.effect for p in case.planted} & (declared - {"torque_offset"})


def test_no_case_is_larger_than_allowed(cases):
    for case in [*cases["development"], *cases["held_out"]]:
        recipe = case.recipe
        values = len(case.machine.joints) * recipe.rate * recipe.duration * len(recipe.plans)
        assert recipe.duration >= SHORTEST - 0.11
        assert values <= MOST_VALUES * 1.001
        uses = [plan.use for plan in recipe.plans]
        assert "train" in uses and "test" in uses
        tests = {plan.trajectory for plan in recipe.plans if plan.use == "test"}
        assert not tests & {plan.trajectory for plan in recipe.plans if plan.use == "train"}


def test_unknown_part_is_refused(refuses):
    refuses(list_cases, "tuned", 10, 0)


@pytest.mark.parametrize("family", FAMILIES)
def test_drawn_machines_could_exist(family):
    for seed in range(8):
        machine = draw_machine(family, np.random.default_rng(seed))
        model = pin.buildModelFromXML(machine.urdf)
        assert model.nv == len(machine.joints) == len(machine.rotor_inertia)
        data = model.createData()
        for inertia in list(model.inertias)[1:]:
            moments = np.linalg.eigvalsh(inertia.inertia)
            # the triangle inequality of a real body's moments about its centre
            assert inertia.mass > 0 and moments[0] > 0 and moments[2] <= moments[0] + moments[1] + 1e-12
        mass = pin.crba(model, data, np.asarray(machine.centre))
        assert np.all(np.linalg.eigvalsh(np.triu(mass) + np.triu(mass, 1).T) > 0)
        assert min(*machine.coulomb, *machine.viscous, *machine.rotor_inertia, np.inf) > 0
        units = {machine.torque_unit(j) for j in range(len(machine.joints))}
        assert units == {"scara": {"N", "N m"}, "slide": {"N"}}.get(family, {"N m"})


def test_light_wrists_have_next_to_no_gravity_torque():
    for seed in range(5):
        machine = draw_machine("light_wrist", np.random.default_rng(seed))
        model = pin.buildModelFromXML(machine.urdf)
        data = model.createData()
        rng = np.random.default_rng(1)
        gravity = np.array(
            [
                pin.computeGeneralizedGravity(model, data, rng.uniform(-2, 2, model.nq)).copy()
                for _ in range(50)
            ]
        )
        rms = np.sqrt(np.mean(gravity**2, axis=0))
        assert np.all(rms[-2:] < 0.2 * np.asarray(machine.coulomb)[-2:])


def test_number_of_joints_can_be_asked_for_and_unknown_families_are_refused(refuses):
    for joints in range(1, 8):
        assert len(draw_machine("serial", np.random.default_rng(0), joints).joints) == joints
    refuses(draw_machine, "crane", np.random.default_rng(0))
