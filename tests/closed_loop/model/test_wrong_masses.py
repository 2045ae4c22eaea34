"""Masses that are wrong where they are trusted have a name of their own, and no drive is blamed."""

import pytest
from folders import PLANS

from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Planted, Recipe
from wearscope.closed_loop.diagnostics.loads import MASSES
from wearscope.closed_loop.run import close_loop

SHORT = {"duration": 8.0, "rate": 125.0, "plans": PLANS}
BODIES = {"payload_error", "inertial_error"}


def close_on(folder, planted, seed, **changed):
    generate_dataset(folder / "d1", "arm3", planted, seed, Recipe(**SHORT, **changed))
    return close_loop(folder / "d1", folder / "out", light=True)


def test_wrong_masses_under_trusted_are_named_as_such(tmp_path):
    verdict = close_on(tmp_path, [], 31, inertia_error=0.1, approximate=False)
    assert verdict["verdict"], "errors of 10 % of every mass must be seen"
    for entry in verdict["verdict"]:
        assert {entry["effect"], *entry["equivalent"]} & BODIES, entry
    for joint in verdict["joints"].values():
        assert joint["rms_after"] < 1.03 * joint["rms_before"]
    assert min(j["rms_after"] / j["rms_before"] for j in verdict["joints"].values()) < 0.5


def test_wrong_masses_are_asked_for_where_nothing_is_declared(tmp_path):
    """A rigid body that nobody declared is in the model all the same, with the masses that are trusted."""
    verdict = close_on(tmp_path, [], 31, inertia_error=0.1, approximate=False, declared=())
    assert all(BODIES & {e["effect"], *e["equivalent"]} for e in verdict["verdict"])
    assert verdict["verdict"]


def test_the_same_masses_under_approximate_are_refitted_without_a_name(tmp_path):
    verdict = close_on(tmp_path, [], 31, inertia_error=0.1, approximate=True)
    assert verdict["verdict"] == [] and not verdict["far_links"]


@pytest.mark.parametrize(("size", "far"), [(6.0, False), (250.0, True)])
def test_a_drive_s_inertia_that_links_could_hold_is_told_of_the_links(tmp_path, size, far):
    """At the first joint no motion tells the two apart; the links' usual error says when to doubt them."""
    planted = [Planted("rotor_inertia_error", "waist", size)]
    verdict = close_on(tmp_path / "arm", planted, 31, inertia_error=0.05, approximate=True)
    told = [note for note in verdict["notes"] if note.startswith(MASSES)]
    assert ["waist" in note and "drive's inertia" in note for note in told] == [True] * far
    assert ("waist" in verdict["far_links"]) == far
    assert not [e for e in verdict["verdict"] if e["status"] == "confirmed"]


def test_a_fault_is_found_beside_wrong_masses(tmp_path):
    """Each on a machine of its own, with the fault, bodies, and nothing else; of six, one may have more."""
    exact = 0
    for seed in range(33, 39):
        planted = [Planted("viscous_asymmetry", "elbow", 8.0)]
        verdict = close_on(tmp_path / str(seed), planted, seed, inertia_error=0.05, approximate=False)
        named = [(e["joint"], {e["effect"], *e["equivalent"]}) for e in verdict["verdict"]]
        assert any(joint == "elbow" and "viscous_asymmetry" in names for joint, names in named)
        exact += all("viscous_asymmetry" in names or names & BODIES for _, names in named)
    assert exact >= 5


def test_a_slide_s_wrong_mass_is_the_same_as_another_inertia_of_its_drive(tmp_path):
    """Only acceleration moves a horizontal slide's torque, so each body has one value there."""
    planted = [Planted("inertial_error", "slide", 6.0)]
    generate_dataset(tmp_path / "d1", "stage", planted, 3, Recipe(**SHORT, approximate=False))
    (entry,) = close_loop(tmp_path / "d1", tmp_path / "out", light=True)["verdict"]
    assert {"inertial_error", "payload_error", "rotor_inertia_error"} <= {
        entry["effect"],
        *entry["equivalent"],
    }
