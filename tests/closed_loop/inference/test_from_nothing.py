"""Whatever is declared, from nothing to the paper's friction: plain friction is named, and nothing else."""

import numpy as np
import pytest
from changed_fields import changed_fields

from wearscope.closed_loop.diagnosis import diagnose

#: What the small arm has at every joint.
TRUTH = {
    "rotor_inertia": ("inertia", [1.5, 0.6]),
    "coulomb": ("level", [6.0, 3.0]),
    "viscous": ("slope", [4.0, 2.0]),
}
UNSTATED = {"rotor_inertia": None}


@pytest.fixture(scope="module")
def declared_whole(record_at, tmp_path_factory):
    """What declaring the standard effects gives on the same runs."""
    folder = record_at(tmp_path_factory.mktemp("whole") / "duo", seed=7, runs=4, duration=8.0)
    return diagnose(folder).verdict


@pytest.mark.parametrize(
    "declared", [[], ["rigid_body"], ["rigid_body", "coulomb"], ["rigid_body", "rotor_inertia"]]
)
def test_plain_friction_is_named_and_nothing_else(record, declared_whole, declared):
    verdict = diagnose(record(declared=declared, robot=UNSTATED, seed=7, runs=4, duration=8.0)).verdict
    wanted = {(joint, name) for joint in "ab" for name in TRUTH if name not in declared}
    assert {(e["joint"], e["effect"]) for e in verdict["verdict"]} == wanted
    for e in verdict["verdict"]:
        parameter, values = TRUTH[e["effect"]]
        found = e["parameters"][parameter]
        low, high = found["ci95"]
        assert found["value"] == pytest.approx(values["ab".index(e["joint"])], rel=0.05)
        assert low < found["value"] < high
        assert e["status"] == "confirmed"
    for joint, whole in declared_whole["joints"].items():
        # Nothing is lost by not declaring it.
        assert verdict["joints"][joint]["rms_after"] < 1.03 * whole["rms_after"]
        assert verdict["joints"][joint]["state"] == "corrected"


def test_one_run_is_enough_for_plain_friction(record):
    verdict = diagnose(record(declared=["rigid_body"], robot=UNSTATED, seed=7, runs=2, duration=8.0)).verdict
    assert {(e["joint"], e["effect"]) for e in verdict["verdict"]} == {(j, n) for j in "ab" for n in TRUTH}


def test_beside_approximate_inertials_nothing_is_lost(record, declared_whole):
    """The first rotor turns with its link about the same axis: the link's inertia takes it over."""
    robot = UNSTATED | {"inertials": "approximate"}
    verdict = diagnose(record(declared=["rigid_body"], robot=robot, seed=7, runs=4, duration=8.0)).verdict
    named = {(e["joint"], e["effect"]) for e in verdict["verdict"]}
    friction = {(joint, name) for joint in "ab" for name in ("coulomb", "viscous")}
    assert friction <= named <= friction | {("a", "rotor_inertia"), ("b", "rotor_inertia")}
    for joint, whole in declared_whole["joints"].items():
        assert verdict["joints"][joint]["rms_after"] < 1.1 * whole["rms_after"]


@pytest.mark.parametrize("declared", [[], ["coulomb"]])
def test_approximate_inertials_are_refitted_whatever_is_declared(record, pose, declared):
    """The contract's `rigid_body` need not be declared for a body that is only nearly known."""
    folder = record(declared=declared, robot=UNSTATED | {"inertials": "approximate"}, seed=7, runs=3)
    problem = pose(folder)
    assert problem.inertial
    (bodies,) = [c for c in problem.base if c.candidate.effect.name == "rigid_body"]
    assert len(bodies.subset) == 20
    with changed_fields(folder / "dataset.yaml") as fields:
        fields["robot"]["inertials"] = "trusted"
    trusted = pose(folder)
    assert not trusted.inertial
    assert not [c for c in trusted.base if c.candidate.effect.name == "rigid_body"]


@pytest.mark.parametrize("warm", [True, False], ids=["temperature", "no_temperature"])
def test_the_friction_of_the_paper_contains_plain_friction(record, declared_whole, warm):
    declared = ["rigid_body", "rotor_inertia", "friction_wear_temperature"]
    verdict = diagnose(record(declared=declared, seed=7, runs=4, duration=8.0, warm=warm)).verdict
    assert verdict["verdict"] == []
    for joint, whole in declared_whole["joints"].items():
        assert verdict["joints"][joint]["rms_after"] < 1.1 * whole["rms_after"]


def test_a_joint_without_friction_is_given_none(record):
    """Its own friction is taken off the first joint: what is not there is not named."""

    def free(t, q, v, a, rng):
        return np.column_stack([-6.0 * np.sign(v[:, 0]) - 4.0 * v[:, 0], 0.0 * t])

    folder = record(declared=["rigid_body", "rotor_inertia"], extra_torque=free, seed=7, runs=3, duration=8.0)
    named = {(e["joint"], e["effect"]) for e in diagnose(folder).verdict["verdict"]}
    assert named == {("b", "coulomb"), ("b", "viscous")}


def test_richer_friction_comes_after_its_simple_parents(record):
    planted = [(0, "stribeck", {"level": 8.0, "speed": 0.3, "exponent": 1.0})]
    folder = record(planted, declared=["rigid_body"], robot=UNSTATED, seed=7, runs=3, duration=8.0)
    named = {(e["joint"], e["effect"]) for e in diagnose(folder).verdict["verdict"]}
    assert named == {(j, n) for j in "ab" for n in TRUTH} | {("a", "stribeck")}


def test_friction_that_falls_steeply_is_no_negative_viscous_friction(record):
    """Coulomb friction, the fall and viscous friction hide each other: none of them can be told alone."""

    def fall(t, q, v, a, rng):
        size = 8.0 * np.exp(-((v[:, 1] / (0.3 * np.abs(v[:, 1]).max())) ** 2)) * np.sign(v[:, 1])
        return np.column_stack([0.0 * t, size - TRUTH["viscous"][1][1] * v[:, 1]])

    folder = record(declared=["rigid_body"], robot=UNSTATED, extra_torque=fall, seed=8, runs=4, duration=8.0)
    verdict = diagnose(folder).verdict
    named = {e["effect"]: e["parameters"] for e in verdict["verdict"] if e["joint"] == "b"}
    assert set(named) == {"coulomb", "rotor_inertia", "stribeck"}
    assert named["coulomb"]["level"]["value"] == pytest.approx(3.0, rel=0.1)
    low, high = named["stribeck"]["level"]["ci95"]
    assert 4.0 < low < 8.0 < high < 13.0


FORMS = {
    "algebraic": lambda x: x / np.sqrt(1 + x**2),
    "arctangent": lambda x: np.arctan(np.pi * x / 2) * 2 / np.pi,
}


@pytest.mark.parametrize(("form", "width"), [("algebraic", 0.06), ("arctangent", 0.02)])
@pytest.mark.parametrize("share", [0.0, 0.03])
def test_weak_viscous_friction_is_told_from_the_form_of_a_reversal(record, form, width, share):
    """Errors of a reversal's width and form have most of what 2 % of Coulomb friction adds with speed."""
    level, slope = TRUTH["coulomb"][1], TRUTH["viscous"][1]

    def change(t, q, v, a, rng):
        return level * (FORMS[form](v / width) - np.sign(v)) - (1.0 - share) * np.array(slope) * v

    declared = ["rigid_body", "rotor_inertia"]
    folder = record(declared=declared, extra_torque=change, noise=0.05, seed=1, runs=4, duration=12.0)
    named = {(e["joint"], e["effect"]) for e in diagnose(folder).verdict["verdict"]}
    there = ("coulomb", "viscous") if share else ("coulomb",)
    assert named == {(joint, name) for joint in "ab" for name in there}
