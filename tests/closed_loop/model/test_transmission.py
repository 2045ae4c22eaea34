"""Soft gears: the torque through them, their compliance near resonance, lost motion; and sharp reversals."""

from dataclasses import replace

import numpy as np
import pytest
from folders import fit_problem

from benchmarks.board.draw_machines import draw_machine
from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Planted, Recipe, RunPlan
from benchmarks.board.regimes import list_cases
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.intake.filtering import low_pass
from wearscope.closed_loop.model import joint_flexibility
from wearscope.closed_loop.model.joint_flexibility import (
    bending_torque,
    is_solvable,
    rigid_link_torque,
    softness,
    solve_gears,
)
from wearscope.closed_loop.model.prediction import predict_full, refit
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.closed_loop.run import close_loop
from wearscope.effects.base import load_effect


@pytest.fixture
def soft_model(record, pose):
    """Model with a compliance at the first joint, fitted to data that one made."""

    def make(compliance, noise=1.0):
        folder = record([(0, "joint_elasticity", {"compliance": compliance})], seed=5, noise=noise)
        problem = pose(folder)
        model = fit_problem(problem)
        soft = ModelTerm(load_effect("joint_elasticity"), 0, (), (0,))
        return refit(model, [*model.entries, soft])

    return make


def test_compliance_near_resonance_is_found_in_spite_of_torque_noise(soft_model):
    model = soft_model(6e-4)
    theta = model.solve()
    run = model.prepared.runs_for("train")[0]
    soft = softness(model, theta, run.signals)
    assert soft[0] * (2 * np.pi * run.band.torque) ** 2 > 1.0, "the link must swing within the band"
    assert not is_solvable(soft, run.band)[0]
    assert list(model.held) == [len(model.entries) - 1]
    assert theta[-1] == pytest.approx(6e-4, rel=0.04)


def test_solved_torque_is_that_of_the_link(soft_model):
    model = soft_model(8e-5, noise=0.0)
    theta = model.solve()
    assert not model.held
    run = model.prepared.runs_for("test")[0]
    solved = solve_gears(model, theta, run)
    off = run.reduce(run.tau - predict_full(model, theta, run))[:, 0]
    rigid = refit(model, model.entries[:-1])
    before = run.reduce(run.tau - predict_full(rigid, rigid.solve(), run))[:, 0]
    assert np.std(off) < 0.3 * np.std(before)
    assert np.std(solved[:, 0] - run.signals.load[:, 0]) > 0
    assert run.signals.transmitted is None
    assert solve_gears(rigid, rigid.solve(), run) is None


@pytest.mark.parametrize(("times", "least"), [(1.0, 1e-3), (5.0, 0.02)])
def test_a_torque_is_solved_where_corrections_run_away(soft_model, monkeypatch, times, least):
    """They would miss 6 %, as where the mean inertia is none that the link has in most postures."""
    damped = joint_flexibility.take_out_swing
    monkeypatch.setattr(joint_flexibility, "take_out_swing", lambda stiff: times * damped(stiff))
    model = soft_model(8e-5, noise=0.0)
    theta = model.solve()
    run = model.prepared.runs_for("test")[0]
    solved = solve_gears(model, theta, run)
    rigid = low_pass(rigid_link_torque(model, theta, run.signals), run.band.gear, run.band.rate)
    bent = bending_torque(model, theta, replace(run.signals, transmitted=solved))
    missed = rigid + low_pass(bent, run.band.gear, run.band.rate) - solved
    below = low_pass(missed, run.band.torque, run.band.rate)[200:-200, 0]
    assert np.std(below) < least * np.std(solved[:, 0])


def test_prediction_along_the_motion_does_not_see_the_recorded_torque(soft_model):
    """What is predicted must not hold the noise of what it is compared with."""
    model = soft_model(6e-4)
    theta = model.solve()
    run = model.prepared.runs_for("test")[0]
    before = predict_full(model, theta, run)
    run.tau += np.random.default_rng(0).standard_normal(run.tau.shape)
    np.testing.assert_array_equal(predict_full(model, theta, run), before)


def lost_motion_of(folder, bounded, seconds):
    """Verdict on the board's arm, whose load changes sign as the small arm's never does; the planted gap."""
    recipe = Recipe(duration=seconds, bounded=bounded)
    truth = generate_dataset(folder / "arm", "arm3", [Planted("backlash", "elbow", 6.0)], 11, recipe)
    return close_loop(folder / "arm", folder / "out", light=True), truth["planted"][0]["parameters"]["gap"]


def test_lost_motion_is_named_and_measured(tmp_path):
    verdict, gap = lost_motion_of(tmp_path, bounded=True, seconds=8.0)
    assert [(e["joint"], e["effect"]) for e in verdict["verdict"]] == [("elbow", "backlash")]
    assert verdict["verdict"][0]["parameters"]["lost_motion"]["value"] == pytest.approx(
        gap["value"], rel=0.25
    )
    joint = verdict["joints"]["elbow"]
    assert joint["rms_after"] < joint["rms_before"]


def test_lost_motion_is_found_where_the_motor_jumps_across_it(tmp_path):
    """Along the motor's motion the load holds the jump twice differentiated, and reverses three times."""
    plans = tuple(RunPlan("train" if k < 3 else "test", "fourier", k, 25.0) for k in range(4))
    recipe = Recipe(duration=15.0, noise_level=0.003, plans=plans, bounded=False)
    generate_dataset(tmp_path / "arm", "arm6", [Planted("backlash", "j2", 3.0)], 1, recipe)
    verdict = diagnose(tmp_path / "arm").verdict
    assert [(e["joint"], e["effect"], e["status"]) for e in verdict["verdict"]] == [
        ("j2", "backlash", "confirmed")
    ]
    assert verdict["events"] == []


def test_a_gear_for_small_loads_is_named_though_softer_than_those_for_large_ones(tmp_path):
    """Below 200 N m/rad, the softest strain wave gears that are sold, at loads of half a N m."""
    plans = tuple(RunPlan("train" if k < 3 else "test", "fourier", k, 25.0) for k in range(4))
    recipe = Recipe(duration=12.0, noise_level=0.004, plans=plans, bounded=True)
    machine = draw_machine("light_wrist", np.random.default_rng(2), 3)
    truth = generate_dataset(tmp_path / "arm", machine, [Planted("joint_elasticity", "j1", 6.0)], 1, recipe)
    compliance = truth["planted"][0]["parameters"]["compliance"]["value"]
    assert compliance > 5e-3
    (entry,) = diagnose(tmp_path / "arm").verdict["verdict"]
    assert (entry["joint"], entry["effect"], entry["status"]) == ("j1", "joint_elasticity", "confirmed")
    assert entry["parameters"]["compliance"]["value"] == pytest.approx(compliance, rel=0.05)


def test_a_lost_motion_beyond_belief_is_no_payload(tmp_path):
    verdict, _ = lost_motion_of(tmp_path, bounded=False, seconds=12.0)
    assert {e["effect"] for e in verdict["verdict"]} <= {"backlash", "unknown"}


@pytest.mark.parametrize("width", [0.0, 0.004])
def test_width_of_the_friction_reversal_is_found(record, pose, width):
    def smoother(t, q, v, a, rng):
        return 20.0 * (np.tanh(v / width) - np.sign(v)) if width else 0.0 * v

    folder = record([(0, "coulomb", {"level": 14.0}), (1, "coulomb", {"level": 17.0})], extra_torque=smoother)
    run = pose(folder).prepared.runs[0]
    sign, v = run.signals.sign, run.signals.v
    inside = (np.abs(v) > 1e-4) & (np.abs(v) < 0.05)
    assert inside.any(axis=0).all()
    for j in range(2):
        here = inside[:, j] & (sign[:, j] != 0)
        share = np.abs(sign[here, j]).min()
        if width == 0.0:
            assert share == 1.0
        else:
            guess = np.median(np.abs(v[here, j]) / np.arctanh(np.minimum(np.abs(sign[here, j]), 1 - 1e-9)))
            assert 0.5 * width < guess < 2.0 * width


NOISES = pytest.mark.parametrize("noise", [1.0, 8.0], ids=["one_percent", "ten_percent"])


@NOISES
def test_a_compliance_that_is_there_is_named(record, tmp_path, noise):
    """In a torque noise of 1 % and of 10 % of the joint's torque; its measured torque is no evidence."""
    planted = [(0, "joint_elasticity", {"compliance": 2e-4 if noise == 1.0 else 5e-4})]
    folder = record(planted, seed=5, noise=noise)
    verdict = close_loop(folder, tmp_path / "with", light=True)["verdict"]
    assert [(e["joint"], e["effect"]) for e in verdict] == [("a", "joint_elasticity")]


@pytest.mark.slow
@NOISES
def test_a_compliance_that_is_not_there_is_not_named(record, tmp_path, noise):
    assert close_loop(record(seed=5, noise=noise), tmp_path / "without", light=True)["verdict"] == []


def test_a_link_that_swings_below_the_common_cut_off_tells_of_its_gear(tmp_path):
    """At 2.3 Hz of 4: about a stiffer gear such a link answers the other way round, as no compliance does."""
    case = list_cases("development", 40, 271)[18]
    assert any(p.effect == "joint_elasticity" for p in case.planted)
    truth = generate_dataset(tmp_path / "d1", case.machine, case.planted, case.seed, case.recipe)
    done = diagnose(tmp_path / "d1")
    named = {entry["effect"]: entry for entry in done.verdict["verdict"]}
    assert set(named) == {"joint_elasticity", "coulomb_asymmetry"}
    assert {entry["status"] for entry in named.values()} == {"confirmed"}
    (gear,) = [p["parameters"]["compliance"] for p in truth["planted"] if p["effect"] == "joint_elasticity"]
    run = done.prepared.runs_for("train")[0]
    soft = softness(done.after, done.after.solve(), run.signals)
    assert soft[0] * (2 * np.pi * run.band.torque) ** 2 > 2.0
    estimated = named["joint_elasticity"]["parameters"]["compliance"]["value"]
    assert estimated == pytest.approx(gear["value"], rel=0.5)
