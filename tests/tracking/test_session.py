"""From the folder to what is said of each session, with the truth planted."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from changed_fields import changed_fields
from folders import change_runs
from session_machine import HEALTHY

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.model.prediction import refit
from wearscope.effects.base import load_effect
from wearscope.errors import InputError
from wearscope.tracking.changes import plain_term
from wearscope.tracking.reference import add_shown, choose_terms, identify_reference
from wearscope.tracking.session import assess_session, list_entries
from wearscope.tracking.session_names import read_sessions
from wearscope.tracking.session_runs import prepare_runs, read_reference, read_session
from wearscope.tracking.storage import load_reference, save_reference

COULOMB, VISCOUS = 6.0, 4.0
FRICTION = {"coulomb", "viscous", "wear"}


@pytest.fixture(scope="module")
def said(assessments, reference):
    """Entries and what cannot be told, by session."""
    found = {}
    for session, assessment in assessments.items():
        entries = list_entries(assessment, reference)
        found[session] = entries, assessment.cannot_tell
    return found


@pytest.mark.parametrize("session", ["s4", "s5"])
def test_healthy_machine_at_other_temperatures_is_unchanged(said, session):
    assert said[session] == ([], [])


def test_wear_is_named_friction_with_its_size(said):
    entries, _ = said["s6"]
    assert {(entry["joint"], entry["effect"]) for entry in entries} <= {("a", name) for name in FRICTION}
    whole = sum({"coulomb": 1.0, "viscous": 0.6}.get(e["effect"], 0.0) * e["change"] for e in entries)
    assert whole == pytest.approx(0.13 * (COULOMB + 0.6 * VISCOUS) * np.exp(-0.012 * 11.0), rel=0.4)


def test_load_and_wear_are_told_apart_in_one_session(said):
    entries, _ = said["s7"]
    assert {entry["effect"] for entry in entries} <= {*FRICTION, "payload_error"}
    assert FRICTION & {entry["effect"] for entry in entries if entry["joint"] == "a"}
    (mass,) = [entry for entry in entries if entry["parameter"] == "moment_x"]
    assert mass["ci95"][0] < 0.8 * 0.3 < mass["ci95"][1]
    assert mass["unit"] == "kg m" and mass["change"] == pytest.approx(0.24, rel=0.2)


def test_replaced_drive_is_a_gain(said):
    ((entry,), _) = said["s8"]
    assert (entry["joint"], entry["effect"], entry["parameter"]) == ("a", "torque_constant_error", "gain")
    assert entry["ci95"][0] < -0.08 < entry["ci95"][1]
    assert entry["change"] == pytest.approx(-0.08, abs=0.02)


def test_pushes_are_events_and_no_change(write, reference):
    """Two runs with a push of more than the Coulomb friction: no gain, load, offset or wear."""
    folder = write([*HEALTHY, {"temperature": 40.0, "push": (3.7, 8.0)}], len(HEALTHY), seed=3)
    assessment = assess_session(read_sessions(folder), "s4", reference)
    assert assessment.named == [] and assessment.cannot_tell == []
    # A push during which the joint reverses is seen in two parts.
    for run in ("runs/d4r0.parquet", "runs/d4r1.parquet"):
        own = [e for e in assessment.events if e["run"] == run]
        assert own and {e["joint"] for e in own} == {"a"}
        assert all(3.2 < e["t"] and e["t"] + e["seconds"] < 4.2 for e in own)
        assert max(e["size"] for e in own) == pytest.approx(8.0, rel=0.2)


def test_a_change_of_the_machine_is_no_event(assessments):
    assert all(one.events == [] for one in assessments.values())


def test_far_warmer_session_cannot_be_told(said):
    entries, hidden = said["s9"]
    assert entries == []
    assert len(hidden) == 2 and all("by wear or by its temperature:" in text for text in hidden)
    assert "the reference at 25 to 47" in hidden[0] and "Measure healthy sessions" in hidden[0]


def test_use_of_a_later_run_does_not_matter(assessments, reference, machine, tmp_path):
    other = shutil.copytree(machine, tmp_path / "duo")
    with changed_fields(other / "dataset.yaml") as fields:
        (run,) = (one for one in fields["runs"] if one["file"] == "runs/d6r0.parquet")
        assert run["use"] == "test"
        run["use"] = "train"
    one, two = assessments["s6"], assess_session(read_sessions(other), "s6", reference)
    assert [c.key for c in one.named] == [c.key for c in two.named] and one.named
    for change in one.named:
        np.testing.assert_array_equal(one.fit.values[change.key], two.fit.values[change.key])


def test_reference_survives_its_file(sessions, assessments, reference, tmp_path):
    path = tmp_path / "reference.npz"
    save_reference(path, reference, [{"session": "s0"}])
    again, records = load_reference(path)
    assert records == [{"session": "s0"}]
    one, two = assessments["s7"], assess_session(sessions, "s7", again)
    assert [c.key for c in one.named] == [c.key for c in two.named] and one.named
    assert one.cannot_tell == two.cannot_tell
    for change in one.named:
        np.testing.assert_allclose(one.fit.values[change.key], two.fit.values[change.key], rtol=1e-9)
    save_reference(tmp_path / "again.npz", again, records)
    assert (tmp_path / "again.npz").read_bytes() == path.read_bytes()


def test_file_that_is_no_reference_is_refused(tmp_path):
    (tmp_path / "reference.npz").write_text("nothing")
    with pytest.raises(InputError, match=r"reference\.npz: is no reference.*track again"):
        load_reference(tmp_path / "reference.npz")


def test_without_a_thermometer_friction_cannot_be_told_but_a_load_can(write):
    days = [{}, {}, {}, {"wear": 0.15}, {"mass": 0.8}]
    sessions = read_sessions(write(days, 3, thermometer=False))
    reference, _ = identify_reference(sessions)
    worn, loaded = (assess_session(sessions, session, reference) for session in ("s3", "s4"))
    assert worn.named == []
    (text,) = worn.cannot_tell
    assert text.startswith("The friction of a changed by +1")
    assert "records no temp_a. Record it" in text
    assert [c.effects for c in loaded.named] == [["payload_error"]] and loaded.cannot_tell == []


def test_an_unknown_temperature_may_change_all_of_a_joint_s_friction(sessions, reference):
    """Else its other parts tell wear from temperature, which acts on them as well."""
    structure, term = reference.structure, plain_term(load_effect("stribeck"), 0)
    structure = replace(
        structure,
        entries=(*structure.entries, term),
        theta=np.append(structure.theta, 1.5 * np.ones(len(term.subset))),
        temperature=np.full(structure.n, np.nan),
    )
    signals = structure.operate(prepare_runs(read_session(sessions, "s5"), structure.frame)[0][0])
    own = [
        entry.columns(signals)[:, 0] @ structure.theta[span]
        for entry, span in zip(structure.entries, structure.spans, strict=True)
        if entry.joint == 0 and entry.effect.is_friction
    ]
    friction, columns = np.sum(own, axis=0), structure.unrecorded_columns(signals)[:, 0]
    left = friction - columns @ np.linalg.lstsq(columns, friction, rcond=None)[0]
    assert len(own) > 2 and np.abs(left).max() < 1e-9 * np.abs(friction).max()


def test_what_all_healthy_sessions_show_belongs_to_the_machine(write):
    """A spring that the closed loop had left out would be a change in a session that shows it better."""
    folder = write([*HEALTHY, {}], len(HEALTHY))
    change_runs(folder, lambda table: table.assign(tau_a=table["tau_a"] + 0.6 * table["q_a"]))
    diagnosis = diagnose(read_reference(read_sessions(folder)))
    model = choose_terms(diagnosis)
    less = refit(model, [entry for entry in model.entries if entry.effect.name != "joint_spring"])
    found = add_shown(diagnosis, less)
    assert [(e.joint, e.effect.name) for e in found.entries[len(less.entries) :]] == [(0, "joint_spring")]
    assert len(add_shown(diagnosis, found).entries) == len(found.entries)


def test_one_healthy_session_is_enough_and_assumes_its_scatter(write):
    sessions = read_sessions(write([{}, {}, {"wear": 0.2}], 1, runs=3))
    reference, _ = identify_reference(sessions)
    quiet, worn = (assess_session(sessions, session, reference) for session in ("s1", "s2"))
    assert quiet.named == []
    assert {change.kind for change in worn.named} == {"friction"}
