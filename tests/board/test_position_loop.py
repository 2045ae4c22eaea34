"""A disturbance inside the position loop, against known answers and a forward integration."""

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

from benchmarks.board.draw_machines import draw_machine
from benchmarks.board.generate import generate_dataset
from benchmarks.board.machines import MACHINES, Body
from benchmarks.board.motions import Motion, make_motion
from benchmarks.board.position_loop import DAMPING, react
from benchmarks.board.recipe import Recipe, RunPlan

BANDWIDTH = 6.0
OMEGA = 2 * np.pi * BANDWIDTH


def stage():
    machine = MACHINES["stage"]
    body = Body(machine.urdf, machine.gravity, 0.0, (0.0, 0.0, 0.0))
    return machine, body, 62.0 + machine.rotor_inertia[0]


def test_a_constant_force_shifts_the_stage_by_force_over_stiffness():
    machine, body, mass = stage()
    motion = make_motion(machine, "fourier", 1, 5.0, 500.0)
    moved = react(body, np.asarray(machine.rotor_inertia), motion, np.full_like(motion.q, 7.0), BANDWIDTH)
    assert np.allclose(motion.q - moved.q, 7.0 / (mass * OMEGA**2))
    assert np.allclose(moved.v, motion.v) and np.allclose(moved.a, motion.a)


def test_no_disturbance_leaves_the_reference():
    machine = MACHINES["arm3"]
    body = Body(machine.urdf, machine.gravity, machine.payload_mass, machine.payload_com)
    motion = make_motion(machine, "points", 2, 6.0, 500.0)
    moved = react(body, np.asarray(machine.rotor_inertia), motion, np.zeros_like(motion.q), BANDWIDTH)
    for name in ("q", "v", "a"):
        assert np.allclose(getattr(moved, name), getattr(motion, name))


def test_the_loop_is_what_forward_integration_gives():
    machine, body, mass = stage()
    step = 1 / 1000
    t = np.arange(3000) * step
    still = np.zeros((len(t), 1))
    motion = Motion(t, still + 0.1, still, still)
    rng = np.random.default_rng(0)
    force = np.repeat(rng.normal(size=150), 20)[:, None] * 50.0
    force -= force.mean()
    moved = react(body, np.asarray(machine.rotor_inertia), motion, force, BANDWIDTH)

    def law(time, state):
        # M q'' = u - d with u = M (kp e + kd e'), e = 0.1 - q
        position, speed = state
        push = force[min(int(time / step + 1e-9), len(force) - 1), 0]
        return [speed, OMEGA**2 * (0.1 - position) - 2 * DAMPING * OMEGA * speed - push / mass]

    state, out = np.array([0.1, 0.0]), []
    for i in range(0, len(t), 20):
        held = solve_ivp(law, (t[i], t[i] + 20 * step - 1e-12), state, rtol=1e-9, atol=1e-12)
        out.append(state)
        state = held.y[:, -1]
    out = np.array(out)
    assert np.allclose(moved.q[::20, 0], out[:, 0], atol=1e-7 + 1e-4 * np.ptp(out[:, 0]))
    assert np.allclose(moved.v[::20, 0], out[:, 1], atol=1e-6 + 1e-4 * np.ptp(out[:, 1]))


def test_speed_and_acceleration_are_derivatives_of_the_position():
    machine = draw_machine("ur", np.random.default_rng(1))
    body = Body(machine.urdf, machine.gravity, 0.0, (0.0, 0.0, 0.0))
    motion = make_motion(machine, "fourier", 3, 4.0, 2000.0)
    slow = np.sin(2 * np.pi * 1.5 * motion.t)[:, None] * np.asarray(machine.coulomb)
    moved = react(body, np.asarray(machine.rotor_inertia), motion, slow, BANDWIDTH)
    step = motion.t[1] - motion.t[0]
    for lower, upper in ((moved.q, moved.v), (moved.v, moved.a)):
        numeric = np.gradient(lower, step, axis=0)[5:-5]
        assert np.abs(numeric - upper[5:-5]).max() < 3e-3 * np.abs(upper).max()
    assert np.abs(moved.q - motion.q).max() > 1e-4


def test_the_disturbance_is_all_that_inverse_dynamics_leaves(tmp_path):
    """The recorded torque less the machine's own along the motion that happened is the disturbance."""
    plans = (RunPlan("train", "fourier", 0, 30.0), RunPlan("test", "sweep", 1, 30.0))
    recipe = Recipe(
        noise="coloured", noise_level=0.03, duration=6.0, loop_bandwidth=8.0, plans=plans, encoder_step=1e-9
    )
    truth = generate_dataset(tmp_path / "d1", "arm3", [], 2, recipe)
    signals = truth["signals"]

    for number in (0, 1):
        rows = signals["run"] == number
        table = pd.read_parquet(tmp_path / "d1" / "runs" / f"r{number + 1}.parquet")
        for joint in truth["joints"]:
            left = table[f"tau_{joint}"] - signals[f"clean_{joint}"][rows]
            assert np.allclose(left, signals[f"noise_{joint}"][rows])
            rms = np.sqrt(np.mean(signals[f"noise_{joint}"][rows] ** 2))
            assert rms == pytest.approx(truth["noise_rms"][joint], rel=0.35)
    # fed back: the recorded positions differ from those of the same seed without a loop
    open_loop = Recipe(noise="coloured", noise_level=0.03, duration=6.0, plans=plans, encoder_step=1e-9)
    generate_dataset(tmp_path / "d2", "arm3", [], 2, open_loop)
    a, b = (pd.read_parquet(tmp_path / d / "runs" / "r1.parquet")["q_elbow"] for d in ("d1", "d2"))
    assert 1e-5 < np.abs(a - b).max() < 0.1
