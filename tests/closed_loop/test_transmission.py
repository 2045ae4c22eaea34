"""Soft gears: the torque through them, their compliance near resonance, lost motion; and sharp reversals."""

import numpy as np
import pytest

from wearscope.attribution_board.generate import generate_dataset
from wearscope.attribution_board.recipe import Planted, Recipe
from wearscope.closed_loop.model.prediction import predict_full, refit
from wearscope.closed_loop.selection.rule import TraceOptions
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.regression import Entry
from wearscope.closed_loop.run import close_loop, find_prismatic
from wearscope.closed_loop.selection.search import Tracer
from wearscope.closed_loop.model.joint_flexibility import find_held, softness, solve_transmission
from wearscope.effects.base import load_effect


def prepared_of(folder):
    return prepare(read_dataset(folder, find_prismatic))


def soft_model(prepared, joint=0):
    tracer = Tracer(prepared, TraceOptions(flips=19))
    return refit(
        tracer.before, [*tracer.before.entries, Entry(load_effect("joint_elasticity"), joint, (), (0,))]
    )


def test_compliance_near_resonance_is_found_in_spite_of_torque_noise(record):
    compliance = 6e-4
    prepared = prepared_of(record([(0, "joint_elasticity", {"compliance": compliance})], seed=5))
    model = soft_model(prepared)
    theta = model.solve()
    run = prepared.runs_for("train")[0]
    swing = softness(model, theta, run)[0] * (2 * np.pi * prepared.band.torque) ** 2
    assert swing > 1.0, "the case must have the link swing within the band"
    assert list(find_held(model)) == [len(model.entries) - 1]
    assert theta[-1] == pytest.approx(compliance, rel=0.04)


def test_solved_torque_is_that_of_the_link(record):
    prepared = prepared_of(record([(0, "joint_elasticity", {"compliance": 8e-5})], seed=5, noise=0.0))
    model = soft_model(prepared)
    theta = model.solve()
    assert not model.held
    run = prepared.runs_for("test")[0]
    solved = solve_transmission(model, theta, run)
    off = run.reduce(run.tau - predict_full(model, theta, run))[:, 0]
    rigid = refit(model, model.entries[:-1])
    before = run.reduce(run.tau - predict_full(rigid, rigid.solve(), run))[:, 0]
    assert np.std(off) < 0.3 * np.std(before)
    assert np.std(solved[:, 0] - run.signals.load[:, 0]) > 0
    assert run.signals.transmitted is None


def test_lost_motion_is_named_and_measured(tmp_path):
    # The small arm's load never changes sign; the board's does.
    truth = generate_dataset(
        tmp_path / "arm", "arm3", [Planted("backlash", "elbow", 6.0)], 11, Recipe(duration=12.0)
    )
    verdict = close_loop(tmp_path / "arm", tmp_path / "out", light=True)
    assert [(e["joint"], e["effect"]) for e in verdict["verdict"]] == [("elbow", "backlash")]
    found = verdict["verdict"][0]["parameters"]["lost_motion"]["value"]
    assert found == pytest.approx(truth["planted"][0]["parameters"]["gap"]["value"], rel=0.25)
    joint = verdict["joints"]["elbow"]
    assert joint["rms_after"] < joint["rms_before"]


@pytest.mark.parametrize("width", [0.0, 0.004])
def test_width_of_the_friction_reversal_is_found(record, width):
    def smoother(t, q, v, a, rng):
        return 20.0 * (np.tanh(v / width) - np.sign(v)) if width else 0.0 * v

    folder = record([(0, "coulomb", {"level": 14.0}), (1, "coulomb", {"level": 17.0})], extra_torque=smoother)
    run = prepared_of(folder).runs[0]
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
