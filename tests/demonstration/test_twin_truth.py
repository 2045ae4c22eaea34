"""The twin's truth as a robot model: its torques are those that the twin was recorded with."""

import numpy as np
import pytest

from benchmarks.board.motions import make_motion
from wearscope.cycles.base import Reference, required_torque
from wearscope.demonstration.simulated_twin.model import OWN_EFFECTS, make_true_model
from wearscope.demonstration.twin import STEP, TWIN, _friction, _gas_spring, simulate_run
from wearscope.effects.base import Signals, load_effect
from wearscope.robots.model import load_model


def truth(*planted, robot="twin"):
    return {
        "robot": robot,
        "planted": [{"effect": effect, "joint": "axis_2"} for effect in planted],
        "noise_rms": dict.fromkeys(TWIN.joints, 1.0),
    }


@pytest.fixture(scope="module")
def found():
    """A model that the twin's joints have; its own effects are put away."""
    return load_model("medium")


def along(values, effect, q=None, v=None, temperature=None):
    zero = np.zeros(len(q if v is None else v))
    q, v, warmth = (np.reshape(zero if x is None else x, (-1, 1)) for x in (q, v, temperature))
    signals = Signals.along(np.arange(float(len(zero))), v, q, temperature=warmth)
    return load_effect(OWN_EFFECTS[effect]).torque(signals, 0, values)


def test_the_gas_spring_is_the_twin_s():
    q = np.linspace(-1.1, 0.6, 30)
    expected = [_gas_spring(angle)[0] for angle in q]
    np.testing.assert_allclose(along({"force": 1300.0}, "gas_spring_torque", q=q), expected, rtol=1e-12)


def test_the_oil_is_the_twin_s():
    temperature = np.linspace(25.0, 75.0, 11)
    expected = [_friction(TWIN, np.full(6, warmth))[1][1] for warmth in temperature]
    made = along({"slope": TWIN.viscous[1]}, "thinning_oil", v=np.ones(11), temperature=temperature)
    np.testing.assert_allclose(made, expected, rtol=1e-12)


def test_the_model_gives_the_recorded_torque(found):
    """Along the twin's own run, by dynamics and effects that the twin's code does not use."""
    motion = make_motion(TWIN, "fourier", 1, 4.0, 1.0 / STEP)
    run = simulate_run(TWIN, motion, 45.0, "gravity_counterbalance", 1.0)
    model = make_true_model(found, truth("gravity_counterbalance"))
    a = np.gradient(run["v"], 1 / 250.0, axis=0)
    reference = Reference(run["t"], run["q"], run["v"], a)
    made = required_torque(reference, model, 45.0, 0.0, 1.0)
    moving = np.abs(run["v"]) > 0.1 * np.asarray(TWIN.speed)
    miss = np.where(moving, made - run["tau"], 0.0)
    assert np.all(np.sqrt((miss**2).mean(axis=0)) < 0.03 * np.sqrt((run["tau"] ** 2).mean(axis=0)))
    without = required_torque(reference, make_true_model(found, truth()), 45.0, 0.0, 1.0)
    assert np.abs(made - without)[:, 1].max() > 50.0
    assert np.abs(np.delete(made - without, 1, axis=1)).max() < 1e-9


def test_another_robot_s_truth_is_refused(found, refuses):
    refuses(make_true_model, found, truth(robot="arm"))
