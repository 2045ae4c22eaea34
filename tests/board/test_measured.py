"""What separates a record from the true model along the measured motion; what it holds of a jump."""

import numpy as np
import pytest
from folders import plan

from benchmarks.board.features import smooth
from benchmarks.board.generate import generate_dataset, make_setting
from benchmarks.board.machines import Body, find_machine
from benchmarks.board.measured import sample, separate
from benchmarks.board.motions import make_motion
from benchmarks.board.physics import Active, Structural, behave
from benchmarks.board.recipe import Planted, Recipe
from wearscope.demonstration.twin import quantise

PLANS = plan(("fourier", 30.0), ("points", 30.0), ("sweep", 30.0))
RATE, OVER = 100.0, 4
MACHINE = find_machine("arm3")
DECLARED = ("rigid_body", "rotor_inertia", "coulomb", "viscous")
RECIPE = Recipe(rate=RATE, oversampling=OVER, duration=12.0, plans=PLANS, declared=DECLARED, reversal=0.01)


def find_separation(actives=(), resolution=0.0, noise=0.0):
    """Separation of one run and the noise of its torque, both in the common band."""
    setting = make_setting(MACHINE, 1, RECIPE, DECLARED)
    body = Body(MACHINE.urdf, MACHINE.gravity, MACHINE.payload_mass, MACHINE.payload_com)
    motion = make_motion(MACHINE, "fourier", 3, 12.0, RATE * OVER, (), 1.0)
    behaviour = behave(setting, motion, np.full_like(motion.q, 30.0), actives, body)
    rng = np.random.default_rng(0)
    q, tau = behaviour.q[::OVER], behaviour.tau[::OVER]
    error = noise * np.sqrt(np.mean(tau**2, axis=0)) * rng.normal(size=tau.shape)
    if resolution:
        q = quantise(q, np.full(q.shape[1], resolution), rng)
    left = separate(setting, body, motion, behaviour, actives, OVER, q, tau + error)
    return smooth(left, RATE), smooth(error, RATE)


@pytest.mark.parametrize("kind", [None, "torque_constant_error", "time_delay", "payload_error"])
def test_without_noise_of_the_positions_it_is_the_torques_noise(kind):
    sizes = {"torque_constant_error": 0.05, "time_delay": 0.004, "payload_error": 0.3}
    detail = {"shift": 0.0, "sign": 1.0}
    actives = [Active(Structural(kind, 1, detail), sizes[kind])] if kind else []
    left, noise = find_separation(actives, noise=0.003)
    beyond = np.sqrt(np.mean((left - noise) ** 2, axis=0) / np.mean(noise**2, axis=0))
    assert np.all(beyond < 0.3)


def test_noise_of_the_positions_is_in_it_by_the_inertia():
    resolution = 1e-4
    left, _ = find_separation(resolution=resolution)
    body = Body(MACHINE.urdf, MACHINE.gravity, MACHINE.payload_mass, MACHINE.payload_com)
    setting = make_setting(MACHINE, 1, RECIPE, DECLARED)
    still = np.tile(np.asarray(MACHINE.centre), (1, 1))
    push = np.zeros_like(still)
    push[0, 0] = 1.0
    inertia = (body.torque(still, 0 * still, push) - body.torque(still, 0 * still, 0 * still))[0, 0]
    inertia += setting.rotor[0]
    # half a count of white noise and rounding, twice differentiated, below 20 Hz
    density = 2 * resolution**2 * (0.25 + 1 / 12) / RATE
    expected = inertia * np.sqrt(density * (2 * np.pi) ** 4 * 20.0**5 / 5)
    assert np.sqrt(np.mean(left[:, 0] ** 2)) == pytest.approx(expected, rel=0.5)


def find_sizes(folder, step):
    recipe = Recipe(
        duration=12.0, plans=PLANS, rate=RATE, oversampling=OVER, encoder_step=step, noise_level=0.003
    )
    plants = [Planted("backlash", "waist", 4.0), Planted("torque_offset", "elbow", 4.0)]
    truth = generate_dataset(folder / "d1", "arm3", plants, 2, recipe)
    return {entry["effect"]: entry["findable_size"] for entry in truth["planted"]}


def test_noise_of_the_positions_hides_a_lost_motion_and_no_offset(tmp_path):
    fine, coarse = find_sizes(tmp_path / "fine", 1e-7), find_sizes(tmp_path / "coarse", 5e-5)
    assert coarse["backlash"] > 3 * fine["backlash"]
    assert coarse["torque_offset"] < 1.2 * fine["torque_offset"]


def test_a_record_holds_no_more_of_a_jump_than_it_can_tell():
    """A slow record of lone peaks would make much of them by chance; below its band both are the same."""
    t = np.arange(0.0, 20.0, 1 / 400.0)
    jump = np.gradient(np.gradient(np.sign(np.sin(2 * np.pi * 0.37 * t + 0.2)), t), t)[:, None]

    def size(x, rate):
        return np.sqrt(np.mean(smooth(x, rate) ** 2))

    whole = size(jump, 400.0)
    assert size(sample(jump, 50.0, 8), 50.0) == pytest.approx(whole, rel=0.25)
    assert size(jump[::8], 50.0) > 2 * whole
