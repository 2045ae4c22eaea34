"""What a user takes away: two honest statements a joint, and a corrected model that no name makes worse."""

from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from folders import change_runs, fit_problem

from wearscope.closed_loop import corrected
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.diagnostics.error_change import measure_error_change
from wearscope.closed_loop.model.prediction import bootstrap_change
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.closed_loop.posing import pose_problem
from wearscope.effects.base import load_effect
from wearscope.robots.model import load_model

FAST = {"runs": 3, "duration": 8.0}
RIPPLE = {"cosine": 1.0, "sine": 0.8, "wavenumber": 20.0}


def test_a_refuted_name_is_not_in_the_model_and_no_joint_is_worse(record, tmp_path):
    """The ripple of the test run has changed phase: adding it doubles the error there."""
    folder = record([(0, "torque_ripple", RIPPLE)], seed=3, **FAST)
    ripple = lambda q: np.cos(20.0 * q) + 0.8 * np.sin(20.0 * q)  # noqa: E731
    change_runs(folder, lambda x: x.assign(tau_a=x["tau_a"] - 2.0 * ripple(x["q_a"])), use="test")
    found = diagnose(folder)
    (entry,) = found.verdict["verdict"]
    assert (entry["effect"], entry["status"], entry["in_model"]) == ("torque_ripple", "refuted", False)
    joint = found.verdict["joints"]["a"]
    assert joint["rms_after"] == joint["rms_before"] and joint["error"] == "same"
    assert joint["state"] == "unexplained" and "torque ripple" in joint["reason"]
    found.write(tmp_path)
    effects = yaml.safe_load((tmp_path / "model_after.yaml").read_text())["effects"]
    assert "torque_ripple" not in [one["effect"] for one in effects]


@pytest.mark.parametrize(
    ("effect", "joint", "is_kept"),
    [("torque_ripple", 0, True), ("torque_ripple", 1, False), ("payload_error", 1, False)],
)
def test_an_error_that_grows_speaks_against_names_that_act_on_that_joint(
    record, monkeypatch, effect, joint, is_kept
):
    """Bodies are shared: what a name at another joint changes through them is no reason against it."""
    model = fit_problem(pose_problem(record(seed=3, **FAST)))
    grown, interval = np.array([0.0, 5.0]), np.array([[-1.0, 4.0], [1.0, 6.0]])
    monkeypatch.setattr(corrected, "bootstrap_change", lambda *_: (grown, interval))
    term = ModelTerm(load_effect(effect), joint, (10.0,) if effect == "torque_ripple" else (), (0,))
    worse = corrected._find_worse(model.prepared, model, model, {7: term})
    assert worse == ((-1, [], 0.0) if is_kept else (1, [7], 5.0))


def test_a_confirmed_name_makes_the_error_smaller_by_what_it_removes(record):
    found = diagnose(record([(0, "torque_ripple", RIPPLE)], seed=3, **FAST))
    (entry,) = found.verdict["verdict"]
    joint, other = (found.verdict["joints"][name] for name in ("a", "b"))
    assert entry["in_model"] and joint["state"] == "corrected" and joint["error"] == "smaller"
    low, high = joint["error_change_ci95"]
    assert low < joint["error_change_percent"] < high < 0.0
    assert joint["error_change_percent"] == pytest.approx(
        100 * (joint["rms_after"] / joint["rms_before"] - 1)
    )
    assert joint["left_percent"] == pytest.approx(100 * joint["rms_after"] / joint["torque_rms"])
    assert (other["state"], other["error"]) == ("explained", "same")


def test_noise_above_half_of_the_torque_is_not_judged(record):
    """Pure noise, 1.6 times the torque of a joint that carries next to nothing."""
    folder = record(seed=5, **FAST)
    rng = np.random.default_rng(1)
    change_runs(folder, lambda x: x.assign(tau_b=x["tau_b"] + 60.0 * rng.standard_normal(len(x))))
    joint = diagnose(folder).verdict["joints"]["b"]
    assert joint["left_percent"] > 50.0
    assert joint["state"] == "not_judged" and "record" in joint["reason"]


def test_a_declared_friction_that_would_drive_the_motion_is_zero_and_said(record, tmp_path):
    """The torque of joint a lacks its friction and more: the fit alone gives a negative level."""
    folder = record(seed=7, **FAST)
    friction = lambda x: 10.0 * np.sign(np.gradient(x["q_a"], x["t"]))  # noqa: E731
    change_runs(folder, lambda x: x.assign(tau_a=x["tau_a"] - friction(x)))
    found = diagnose(folder)
    (told,) = [note for note in found.verdict["notes"] if "which no machine has" in note]
    assert told.startswith("a: the runs give coulomb level -")
    found.write(tmp_path)
    model = load_model(tmp_path / "model_after.yaml")
    levels = {one.joint: one.parameters["level"] for one in model.effects if one.effect == "coulomb"}
    assert "a" not in levels and levels["b"] == pytest.approx(3.0, abs=0.3)


def test_every_value_of_the_model_lies_in_its_own_interval(record, tmp_path):
    found = diagnose(record([(0, "load_dependent_friction", {"coefficient": 0.1})], seed=4, **FAST))
    found.write(tmp_path)
    told = 0
    for one in yaml.safe_load((tmp_path / "model_after.yaml").read_text())["effects"]:
        for name, (low, high) in one.get("intervals", {}).items():
            assert low <= one["parameters"][name] <= high, (one["effect"], name)
            told += 1
    assert told > 4


def test_a_joint_that_moves_in_few_blocks_has_an_interval_all_the_same():
    """Of eight blocks two count: in one of ten draws none does, which says nothing of the error."""
    rng = np.random.default_rng(4)
    residual = rng.normal(size=(80, 2))
    keep = np.zeros((80, 2), dtype=bool)
    keep[10:30, 0] = True
    change, interval = bootstrap_change([(residual, keep)], [(0.1 * residual, keep)], 10, 0)
    assert change[0] == pytest.approx(-90) and interval[:, 0] == pytest.approx([-90, -90])
    assert np.isnan(change[1]) and np.isnan(interval[:, 1]).all()


@pytest.mark.parametrize(("factor", "error"), [(1.0 - 1e-13, "same"), (0.9, "smaller"), (1.1, "larger")])
def test_an_error_that_differs_by_rounding_is_the_same(factor, error):
    noise = np.random.default_rng(0).standard_normal((400, 1))
    run = SimpleNamespace(use="test", measured=noise, keep=np.ones_like(noise, dtype=bool))
    one = SimpleNamespace(run=run, before=0.0 * noise, after=noise * (1.0 - factor))
    (error_changes,) = measure_error_change(SimpleNamespace(n=1, band=SimpleNamespace(torque=10.0)), [one])
    assert error_changes.error == error
