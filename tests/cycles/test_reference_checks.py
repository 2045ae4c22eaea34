"""What a robot cannot follow is refused with the joint, the time and the limit."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wearscope.cycles.base import Reference, check_reference, load_cycle, required_torque
from wearscope.errors import InputError
from wearscope.robots.model import load_model

ROBOTS = Path(__file__).parents[2] / "config" / "robots"
DURATION = 4.0


@pytest.fixture(scope="module")
def model():
    return load_model("medium", ROBOTS)


def swing(model, joint, amplitude, duration=DURATION, n=2001):
    """One joint to and fro about home, from rest to rest."""
    t = np.linspace(0.0, duration, n)
    w = 2.0 * np.pi / duration
    q = np.tile(model.home_posture, (n, 1))
    v, a = np.zeros_like(q), np.zeros_like(q)
    # sin^3 starts and ends with zero speed and acceleration.
    s, c = np.sin(w * t), np.cos(w * t)
    q[:, joint] += amplitude * s**3
    v[:, joint] = amplitude * 3.0 * w * s**2 * c
    a[:, joint] = amplitude * w**2 * (6.0 * s * c**2 - 3.0 * s**3)
    return Reference(t, q, v, a)


def refusal(reference, model):
    with pytest.raises(InputError) as caught:
        check_reference(reference, model, "mine")
    assert "test-cycle 'mine' on robot 'medium'" in str(caught.value)
    return str(caught.value)


def test_a_gentle_swing_is_accepted(model):
    check_reference(swing(model, 1, 0.3), model)


@pytest.mark.parametrize(
    ("joint", "amplitude", "duration", "said"),
    [
        (
            3,
            3.5,
            12.0,
            "joint 'axis_4' would need the position -3.5 rad at t = 9.000 s, beyond its limit -3.32",
        ),
        (1, 0.5, 1.2, "joint 'axis_2' would need the speed"),
        (2, 0.5, 1.0, "joint 'axis_3' would need the acceleration"),
    ],
)
def test_limits_of_the_motion(model, joint, amplitude, duration, said):
    assert said in refusal(swing(model, joint, amplitude, duration), model)


def limit_torque(model, limit):
    """The robot with another limit of the third joint's torque."""
    drive = model.to_mapping()["drive"]
    limits = drive["torque_limit"]
    return model.replace(drive={**drive, "torque_limit": [*limits[:2], limit, *limits[3:]]})


def test_torque_limit(model):
    said = refusal(swing(model, 2, 0.3), limit_torque(model, 300))
    assert "joint 'axis_3' would need the torque" in said and "beyond its limit 300" in said


def test_heavier_payload_and_worst_friction_count(model):
    reference = swing(model, 2, 0.3)
    worst = max(
        np.abs(required_torque(reference, model, temperature, 50.0, factor))[:, 2].max()
        for temperature in (30.0, 70.0)
        for factor in (0.9, 1.1)
    )
    plain = np.abs(required_torque(reference, model, 50.0, 0.0, 1.0))[:, 2].max()
    assert plain < 0.95 * worst
    check_reference(reference, limit_torque(model, 1.001 * worst))
    assert "axis_3" in refusal(reference, limit_torque(model, 0.999 * worst))


def test_required_torque_adds_rotors_friction_and_balancer():
    model = load_model("large", ROBOTS)
    reference = swing(model, 1, 0.3)
    bare = model.replace(effects=[], drive={})
    still = replace(reference, v=0.0 * reference.v, a=0.0 * reference.a)
    (moving, body), (held, weight) = (
        [required_torque(motion, one, 50.0, 0.0, 1.0) for one in (model, bare)]
        for motion in (reference, still)
    )
    friction = moving - body - model.rotor_inertia * reference.a
    friction[:, 1] -= (held - weight)[:, 1]
    assert np.all(friction[:, 1] * reference.v[:, 1] >= -1e-6)
    assert np.abs(friction[:, 1]).max() > 400.0
    assert np.abs(friction[:, [0, 2, 3, 4, 5]]).max() < 1e-9


def test_malformed_motions(model):
    good = swing(model, 0, 0.3)
    hole = good.q.copy()
    hole[100, 2] = np.nan
    late = good.t.copy()
    late[500:] += 0.1
    fast = good.v.copy()
    fast[:, 0] *= 1.5
    for wrong, said in (
        (replace(good, q=good.q[:, :5]), "q has the shape (2001, 5), not (2001, 6)"),
        (replace(good, q=hole), "q is not finite at t = 0.2 s"),
        (replace(good, t=late), "t does not grow in equal steps"),
        (replace(good, t=good.t[::-1]), "t does not grow in equal steps"),
        (replace(good, v=fast), "v of joint 'axis_1' is not the derivative"),
        (replace(good, a=-good.a), "a of joint 'axis_1' is not the derivative"),
        (replace(good, t=np.zeros(1)), "give at least two instants"),
    ):
        assert said in refusal(wrong, model)
    cut = Reference(good.t[:600], good.q[:600], good.v[:600], good.a[:600])
    assert "joint 'axis_1' moves at the end" in refusal(cut, model)


def test_users_own_cycle_is_a_file(tmp_path, model, refuses):
    path = tmp_path / "mine.py"
    path.write_text(
        "from wearscope.cycles.base import Cycle\n"
        "from wearscope.cycles.motion import MotionPlan\n"
        "def build(model, dwell, step):\n"
        "    plan = MotionPlan(model, dwell, step)\n"
        "    plan.move_to(plan.posture_at([0.5]))\n"
        "    return plan.finish()\n"
        "CYCLE = Cycle('mine', 'One move.', build)\n"
    )
    cycle = load_cycle(str(path))
    reference = cycle.build(model, 0.05, 0.004)
    check_reference(reference, model, cycle.name)
    assert np.ptp(reference.q[:, 0]) > 0.1
    path.write_text("CYCLE = 3\n")
    refuses(load_cycle, str(path))
    with pytest.raises(InputError, match="cycles: there is no 'dance'; choose one of axis_sweeps"):
        load_cycle("dance")
