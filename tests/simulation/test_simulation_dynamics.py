"""The compiled bodies, and PyBullet with them, against Pinocchio and MuJoCo."""

from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from wearscope.effects.base import Plant
from wearscope.errors import SimulationError
from wearscope.jobs.study_files import find_sources
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.model import load_model
from wearscope.robots.urdf import parse_urdf, write_link
from wearscope.simulation import step, world
from wearscope.simulation.arrays import Law, make_state
from wearscope.simulation.chain import build_chain, sum_parameters, write_plant_urdf
from wearscope.simulation.dynamics import make_scratch, mass_and_bias
from wearscope.simulation.run import _check_tracking, _compare, run_motion
from wearscope.simulation.world import World, prove_world, pybullet

ROBOTS = Path(__file__).parents[2] / "config" / "robots"


def bodies(arms) -> list[RigidBody]:
    arm = arms.make_arm()
    payload = Payload(3.0, (0.05, -0.1, 0.2), (0.02, 0.003, 0.0, 0.03, 0.0, 0.01))
    shuffled = RigidBody(arm.urdf_text, ["side", "slide", "turn", "lift"], (0.5, 1.0, -9.0), payload)
    models = [load_model(name, ROBOTS) for name in ("medium", "large")]
    return [arm.rigid_body(payload), shuffled, *(m.rigid_body(m.declared_payload) for m in models)]


def test_mass_matrix_and_bias_are_pinocchios(arms):
    rng = np.random.default_rng(1)
    for body in bodies(arms):
        chain, scratch = build_chain(body), make_scratch(body.n)
        for _ in range(5):
            q, v = rng.normal(size=body.n), rng.normal(size=body.n)
            start = rng.normal(size=body.n)
            mass_and_bias(chain, q, v, start, scratch)
            mass, bias, at_start = body.mass_matrix(q), body.bias(q, v), body.bias(q, start)
            assert np.abs(scratch.mass_matrix - mass).max() < 1e-10 * np.abs(mass).max()
            assert np.abs(scratch.bias - bias).max() < 1e-10 * np.abs(bias).max()
            assert np.abs(scratch.start_bias - at_start).max() < 1e-10 * np.abs(at_start).max()


def test_extra_inertials_are_what_their_regressor_says(arms):
    body = arms.make_arm().rigid_body()
    link = np.array([2.5, 0.3, -0.2, 0.4, 0.1, 0.01, 0.2, 0.0, -0.03, 0.15])
    extra = np.outer(np.linspace(0.5, 1.0, body.n), link)
    scratch = make_scratch(body.n)
    rng = np.random.default_rng(2)
    q, v, a = rng.normal(size=(3, body.n))
    mass_and_bias(build_chain(body, extra), q, v, v, scratch)
    added = scratch.mass_matrix @ a + scratch.bias - body.inverse_dynamics(q, v, a)
    regressor = body.inertial_regressor(q, v, a)
    np.testing.assert_allclose(added, regressor @ extra.ravel(), rtol=0, atol=1e-10 * np.abs(added).max())


def test_forward_dynamics_in_pybullet_is_inverse_dynamics(arms):
    with World() as world:
        for body in bodies(arms):
            assert prove_world(world, body, 1e-3) < 1e-9


def test_a_world_holds_one_robot_at_a_time(arms):
    body = arms.make_arm().rigid_body()
    with World() as world:
        for _ in range(3):
            world.load(write_plant_urdf(body), body.names, body.gravity, 1e-3)
            assert pybullet.getNumBodies(physicsClientId=world.client) == 1


def test_self_test_refuses_what_exceeds_its_tolerance(arms, monkeypatch):
    body = arms.make_arm().rigid_body()
    with World() as proven:
        worst = prove_world(proven, body, 1e-3)
        monkeypatch.setattr(world, "SELF_TEST_TOLERANCE", worst)
        assert prove_world(proven, body, 1e-3) == worst > 0.0
        monkeypatch.setattr(world, "SELF_TEST_TOLERANCE", 0.999 * worst)
        with pytest.raises(SimulationError, match="differs from inverse dynamics"):
            prove_world(proven, body, 1e-3)


def test_self_test_finds_what_pybullet_hides(arms, monkeypatch):
    body = arms.make_arm().rigid_body()
    real = World.load

    def damped(self, *arguments):
        import pybullet as pb

        real(self, *arguments)
        pb.changeDynamics(self.body, 0, jointDamping=0.5, physicsClientId=self.client)

    monkeypatch.setattr(World, "load", damped)
    with World() as world, pytest.raises(SimulationError, match="differs from inverse dynamics"):
        prove_world(world, body, 1e-3)


def test_run_is_refused_where_pybullet_arrives_elsewhere(arms, monkeypatch):
    model, reference = arms.make_arm(arms.rub()), arms.swing(0.2)
    real = World.advance
    monkeypatch.setattr(World, "advance", lambda self, torques: real(self, torques * 1.001))
    with pytest.raises(SimulationError, match="PyBullet arrives at"):
        simulate_open_loop(model, reference.q[0], np.zeros((50, 4)), 1e-3)


def test_pybullet_may_differ_by_a_ten_millionth_of_one_and_what_there_is(arms):
    state = make_state(2)
    state.q[:], state.v[:] = (-9.0, 0.0), (0.0, 4.0)
    q, v = state.q.copy(), state.v.copy()
    for place, joint, most in ((q, 0, 1e-6), (q, 1, 1e-7), (v, 0, 1e-7), (v, 1, 5e-7)):
        there = place[joint]
        for off in (0.99 * most, -0.99 * most):
            place[joint] = there + off
            _compare(q, v, state, ["a", "b"], 0.0)
        for off in (1.01 * most, -1.01 * most, np.nan):
            place[joint] = there + off
            with pytest.raises(SimulationError, match=f"of joint '{'ab'[joint]}'"):
                _compare(q, v, state, ["a", "b"], 0.0)
        place[joint] = there


def test_a_motor_has_lost_its_reference_half_a_radian_off_if_it_has_one():
    row = np.zeros((2, 2))
    law = Law(row, np.array([[9.0, 9.0], [1.0, 0.0]]), row, np.array([3.0, 0.0]), np.zeros(2), np.zeros(2))
    for q in (0.51, 1.49):
        _check_tracking(np.array([q, 7.0]), law, 1, ["a", "b"], 0.0)
    for q in (0.5, 1.5, np.nan):
        with pytest.raises(SimulationError, match=r"joint 'a' is .* off its reference"):
            _check_tracking(np.array([q, 0.0]), law, 1, ["a", "b"], 0.0)
    with pytest.raises(SimulationError, match="joint 'b'"):
        _check_tracking(np.array([1.0, np.nan]), law, 1, ["a", "b"], 0.0)


def test_a_link_without_mass_is_told(arms, refuses):
    body = arms.make_arm().rigid_body()
    extra = np.zeros((4, 10))
    for mass, fits in ((-7.99, True), (-8.0, False), (-9.0, False)):
        extra[2, 0] = mass
        if fits:
            assert sum_parameters(body, extra)[2, 0] == pytest.approx(8.0 + mass)
            continue
        refuses(sum_parameters, body, extra)


def test_pybullet_gets_the_payload_on_the_last_link_and_all_else_as_it_was(arms):
    model = arms.make_arm()
    for body in (model.rigid_body(), model.rigid_body(model.declared_payload)):
        text = write_plant_urdf(body).replace('lower="1.0" upper="-1.0"', 'lower="-1.0" upper="1.0"')
        bare, plant = parse_urdf(body.urdf_text()), parse_urdf(text)
        assert list(plant.links) == list(bare.links)
        assert [joint.name for joint in plant.joints] == [joint.name for joint in bare.joints]
        last = next(joint.child for joint in bare.joints if joint.name == body.names[-1])
        assert text.count('lower="-1.0" upper="1.0"') == body.n
        for name, link in plant.links.items():
            if name != last:
                assert write_link(link) == write_link(bare.links[name])
        pinned = pin.buildModelFromXML(text)
        inertia = pinned.inertias[pinned.getJointId(body.names[-1])]
        assert inertia.toDynamicParameters() == pytest.approx(sum_parameters(body)[-1], abs=1e-12)


def simulate_open_loop(model, q, torques, dt, plant=None):
    """Apply motor torques as they are, from rest; returns the trace."""
    if plant is None:
        plant = Plant(model.n)
        plant.armature = model.rotor_inertia
    n, count = model.n, len(torques)
    zero = np.zeros((count, n))
    law = Law(torques, zero, zero, np.zeros(n), np.zeros(n), np.full(n, np.inf))
    body = model.rigid_body(model.declared_payload)
    with World() as world:
        return run_motion(world, body, plant, law, dt, 50.0, 0.0, (q, np.zeros(n)))


DURATION = 0.32


def push(model, t):
    """Torque (n,) at a time."""
    rng = np.random.default_rng(3)
    size, rate, phase = rng.normal(size=model.n), rng.uniform(5.0, 20.0, model.n), rng.uniform(0, 6, model.n)
    return np.array([30.0, 120.0, 60.0, 5.0]) * size * np.cos(rate * t + phase)


def aba_end(model, q):
    """Where Pinocchio's articulated-body algorithm with armature arrives, by Runge-Kutta."""
    body = model.rigid_body(model.declared_payload)
    pinned = pin.buildModelFromXML(write_plant_urdf(body).replace('lower="1.0" upper="-1.0"', ""))
    order = [pinned.joints[pinned.getJointId(name)].idx_v for name in model.joints]
    pinned.armature = np.empty(model.n)
    pinned.armature[order] = model.rotor_inertia
    data = pinned.createData()
    x, v = np.empty(model.n), np.zeros(model.n)
    x[order] = q

    def rate(x, v, tau):
        return v, pin.aba(pinned, data, x, v, tau)

    def torque(t):
        tau = np.empty(model.n)
        tau[order] = push(model, t)
        return tau

    dt = 1e-3
    for t in np.arange(round(DURATION / dt)) * dt:
        k1 = rate(x, v, torque(t))
        k2 = rate(x + 0.5 * dt * k1[0], v + 0.5 * dt * k1[1], torque(t + 0.5 * dt))
        k3 = rate(x + 0.5 * dt * k2[0], v + 0.5 * dt * k2[1], torque(t + 0.5 * dt))
        k4 = rate(x + dt * k3[0], v + dt * k3[1], torque(t + dt))
        x = x + dt / 6.0 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        v = v + dt / 6.0 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
    return x[order], v[order]


def mujoco_end(model, q, friction):
    """Where MuJoCo arrives with joint armature and damping, by Runge-Kutta at 0.1 ms."""
    body = model.rigid_body(model.declared_payload)
    text = write_plant_urdf(body).replace('lower="1.0" upper="-1.0"', "").replace("<limit  ", "<limit ")
    head, tail = text.split("?>\n")[1].split(">", 1)
    text = f'{head}><mujoco><compiler fusestatic="false" balanceinertia="false"/></mujoco>{tail}'
    spec = mujoco.MjModel.from_xml_string(text)
    spec.opt.timestep, spec.opt.integrator = 1e-4, mujoco.mjtIntegrator.mjINT_RK4
    spec.opt.gravity[:] = body.gravity
    data = mujoco.MjData(spec)
    order = [spec.joint(name).dofadr[0] for name in model.joints]
    spec.dof_armature[order] = model.rotor_inertia
    spec.dof_damping[order] = friction
    data.qpos[order] = q
    for _ in range(round(DURATION / spec.opt.timestep)):
        data.qfrc_applied[order] = push(model, data.time + 0.5 * spec.opt.timestep)
        mujoco.mj_step(spec, data)
    return data.qpos[order].copy(), data.qvel[order].copy()


def errors_by_step(model, q, end, plant=None):
    found = []
    for dt in (4e-3, 2e-3, 1e-3):
        torques = np.array([push(model, t) for t in np.arange(round(DURATION / dt) + 1) * dt])
        trace = simulate_open_loop(model, q, torques, dt, plant)
        found.append(max(np.abs(trace.q[-2] - end[0]).max(), np.abs(trace.v[-1] - end[1]).max()))
    return found


def test_against_pinocchio_aba_with_armature(arms):
    model, q = arms.make_arm(), np.array([0.1, 0.2, 0.1, 0.3])
    errors = errors_by_step(model, q, aba_end(model, q))
    assert errors[0] < 2e-3
    # Second order: half the step, a quarter of the error.
    assert errors[1] < 0.27 * errors[0] and errors[2] < 0.27 * errors[1]


def test_against_mujoco_with_armature_and_damping(arms):
    slope = 25.0
    model = arms.make_arm([(j, "viscous", {"slope": slope}) for j in arms.JOINTS])
    from wearscope.simulation.plant import build_plant

    q = np.array([0.1, 0.2, 0.1, 0.3])
    errors = errors_by_step(model, q, mujoco_end(model, q, slope), build_plant(model))
    assert errors[0] < 2e-3
    assert errors[1] < 0.27 * errors[0] and errors[2] < 0.27 * errors[1]


def test_compiled_step_is_looked_up_by_all_its_sources(monkeypatch, tmp_path):
    """Numba's cache knows only the file of the cached function; a change elsewhere must not be missed."""
    modules = {
        Path(name).stem for name in find_sources(step.__file__) if Path(name).parent.name == "simulation"
    }
    # It imports no name of `arrays`, but is compiled for what stands there.
    assert (modules | {"arrays"}) - {"__init__", "errors"} == set(step.SOURCES)
    before = step._stamp_sources()
    for name in step.SOURCES:
        (tmp_path / f"{name}.py").write_text(Path(step.__file__).with_name(f"{name}.py").read_text())
    monkeypatch.setattr(step, "__file__", str(tmp_path / "step.py"))
    assert step._stamp_sources() == before
    with open(tmp_path / "terms.py", "a") as file:
        file.write("# changed")
    assert step._stamp_sources() != before
