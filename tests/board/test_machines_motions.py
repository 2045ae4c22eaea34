"""The board's machines and exact motions: derivatives, limits, repeats."""

import ast
from pathlib import Path

import numpy as np
import pytest

import benchmarks.board
from benchmarks.board.machines import MACHINES, Body, find_machine
from benchmarks.board.motions import KINDS, make_motion


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("kind", KINDS)
def test_speed_and_acceleration_are_derivatives(name, kind):
    machine = MACHINES[name]
    motion = make_motion(machine, kind, 3, 8.0, 1000.0)
    for lower, upper in ((motion.q, motion.v), (motion.v, motion.a)):
        slope = (lower[2:] - lower[:-2]) * 500.0
        assert np.abs(slope - upper[1:-1]).max() < 2e-4 * np.abs(upper).max() + 1e-9
    assert np.all(np.abs(motion.v[[0, -1]]) < 1e-12)


@pytest.mark.parametrize("name", MACHINES)
@pytest.mark.parametrize("kind", KINDS)
def test_motion_stays_within_the_limits(name, kind):
    machine = MACHINES[name]
    motion = make_motion(machine, kind, 5, 12.0, 500.0)
    assert np.all(np.abs(motion.q - machine.centre).max(axis=0) <= np.asarray(machine.reach) * 1.001)
    assert np.all(np.abs(motion.v).max(axis=0) <= np.asarray(machine.speed) * 1.16)
    assert np.all(np.abs(motion.a).max(axis=0) <= np.asarray(machine.acceleration) * 1.16)
    assert np.all(np.ptp(motion.q, axis=0) > 0.1 * np.asarray(machine.reach))


def test_motion_repeats_with_its_seed_only():
    machine = MACHINES["arm3"]
    first, again, other = (make_motion(machine, "points", s, 6.0, 250.0).q for s in (0, 0, 1))
    assert np.array_equal(first, again)
    assert not np.allclose(first, other)


def test_a_locked_joint_stays_and_the_others_move_as_they_did():
    machine = MACHINES["arm3"]
    free, locked = (make_motion(machine, "points", 1, 6.0, 250.0, x) for x in ((), ("elbow",)))
    assert np.all(locked.q[:, 2] == machine.centre[2])
    assert not locked.v[:, 2].any()
    assert np.array_equal(free.q[:, :2], locked.q[:, :2])


def test_a_sweep_has_constant_speed_and_reversals():
    motion = make_motion(MACHINES["stage"], "sweep", 2, 16.0, 500.0)
    v, a = motion.v[:, 0], motion.a[:, 0]
    steady = (np.abs(a) < 1e-9) & (np.abs(v) > 1e-3)
    assert steady.mean() > 0.2
    moving = np.sign(v[np.abs(v) > 1e-4])
    assert np.sum(np.diff(moving) != 0) >= 4


def test_body_torque_of_the_stage_is_mass_times_acceleration():
    machine = MACHINES["stage"]
    body = Body(machine.urdf, machine.gravity, 0.0, (0.0, 0.0, 0.0))
    motion = make_motion(machine, "fourier", 1, 4.0, 100.0)
    assert np.allclose(body.torque(motion.q, motion.v, motion.a), 62.0 * motion.a, atol=1e-9)


def test_payload_adds_its_weight():
    machine = MACHINES["arm3"]
    bare = Body(machine.urdf, machine.gravity, 0.0, (0.0, 0.0, 0.0))
    laden = Body(machine.urdf, machine.gravity, 2.0, (0.3, 0.0, 0.0))
    pose, still = np.zeros((1, 3)), np.zeros((1, 3))
    more = laden.torque(pose, still, still) - bare.torque(pose, still, still)
    # stretched along x, the load hangs 0.3 m from the elbow and 0.75 m from the shoulder; y turns it down
    assert np.allclose(more, [[0.0, -2 * 9.81 * 0.75, -2 * 9.81 * 0.3]])


def test_unknown_machine_is_refused(refuses):
    refuses(find_machine, "r2d2")


def test_the_generator_shares_no_code_with_the_tracer():
    for file in Path(benchmarks.board.__path__[0]).glob("*.py"):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            for name in names:
                allowed = (
                    "benchmarks.board",
                    "wearscope.designs",
                    "wearscope.demonstration",
                    "wearscope.errors",
                    "wearscope.storage.tables",
                )
                # What closes the loop on a folder, or asks for advice on it, is no part of the generator.
                lazily = (file.name, name) in (
                    ("board.py", "wearscope.closed_loop.run"),
                    ("sessions.py", "wearscope.tracking.run"),
                )
                lazily |= file.name == "advice.py" and name.startswith(
                    ("wearscope.closed_loop", "wearscope.cycles")
                )
                assert not name.startswith("wearscope") or name.startswith(allowed) or lazily, (file, name)
