"""What friction, limits and gears do in the step."""

import numpy as np
import pytest
from scipy.integrate import trapezoid
from single_axis import DRIVE, make_axis

from benchmarks.sessions import describe_arm
from wearscope.cycles.base import Reference
from wearscope.errors import SimulationError
from wearscope.robots.model import make_model
from wearscope.simulation.arrays import Law
from wearscope.simulation.balance import deflection, invert_deflection
from wearscope.simulation.plant import build_plant, find_step, make_feedforward, make_law
from wearscope.simulation.run import BLOCK, run_motion
from wearscope.simulation.study import simulate_forward, trace_forward
from wearscope.simulation.terms import pack_terms
from wearscope.simulation.world import World

STRIBECK = {
    "eta0": 10.0, "eta1": 6.0, "eta2": 0.0, "eta3": 0.05, "eta4": 0.0, "eta5": 8.0, "eta6": 0.0, "eta7": 0.2,
    "eta8": 0.002, "eta9": 0.05,
}  # fmt: skip


def coast(model, q, v, steps=1500, dt=1e-3, wear=0.0, torque=None, gravity=True):
    """Run without a controller; `torque` (n,) is applied throughout."""
    n = model.n
    if not gravity:
        model = model.replace(gravity=[0.0, 0.0, 0.0])
    zero = np.zeros((steps, n))
    applied = zero if torque is None else np.tile(torque, (steps, 1))
    law = Law(applied, zero, zero, np.zeros(n), np.zeros(n), np.full(n, 1e3))
    body = model.rigid_body()
    with World() as world:
        return body, run_motion(world, body, build_plant(model), law, dt, 50.0, wear, (q, v))


@pytest.mark.parametrize("kind", ["coulomb", "stribeck", "presliding"])
def test_friction_only_takes_energy_out(arms, kind):
    effects = {
        "coulomb": arms.rub(12.0, 2.0),
        "stribeck": [(j, "friction_wear_temperature", STRIBECK) for j in arms.JOINTS],
        "presliding": [
            *arms.rub(12.0, 2.0),
            *((j, "presliding_hysteresis", {"level": 12.0, "displacement": 0.01}) for j in arms.JOINTS),
        ],
    }[kind]
    model = arms.make_arm(effects)
    still = arms.make_arm()
    v0 = np.array([1.0, -0.8, 0.6, 2.0])
    body, trace = coast(model, np.zeros(4), v0, wear=20.0, gravity=False)
    _, free = coast(still, np.zeros(4), v0, gravity=False)

    def kinetic(trace):
        return np.array(
            [
                0.5 * v @ (body.mass_matrix(q) + np.diag(model.rotor_inertia)) @ v
                for q, v in zip(trace.q[:-1], trace.v, strict=True)
            ]
        )

    energy, conserved = kinetic(trace), kinetic(free)
    drift = np.abs(conserved / conserved[0] - 1.0).max()
    assert drift < 2e-3  # of the integrator alone
    assert np.all(np.diff(energy) <= 1e-4 * energy[0])
    assert energy[-1] < 1e-3 * energy[0]


def test_energy_balance_of_a_driven_arm(arms):
    """Work of motors and gravity less friction's is the change of kinetic energy."""
    friction = 9.0
    model = arms.make_arm(arms.rub(12.0, friction))
    for dt in (4e-3, 1e-3):
        trace, _ = trace_forward(model, arms.swing(1.0, dt), longest_step=dt)
        body = model.rigid_body()
        q, v = trace.q, trace.v
        work = trapezoid(np.sum(trace.torque * v, axis=1), dx=dt)
        heat = trapezoid(np.sum(12.0 * np.abs(v) + friction * v**2, axis=1), dx=dt)
        gravity = trapezoid([body.bias(x, np.zeros(4)) @ u for x, u in zip(q, v, strict=False)], dx=dt)
        inertia = np.diag(model.rotor_inertia)
        kinetic = [0.5 * v[k] @ (body.mass_matrix(q[k]) + inertia) @ v[k] for k in (0, -1)]
        assert abs(work - heat - gravity - (kinetic[1] - kinetic[0])) < 5e-5 * heat


def test_joint_under_break_away_stays_exactly_still(arms):
    model = arms.make_arm(arms.rub(12.0, 0.0))
    q = np.array([0.1, 0.2, 0.1, 0.3])
    for share in (0.999, -0.999):
        _, trace = coast(model, q, np.zeros(4), 300, torque=None, gravity=False)
        assert np.array_equal(trace.q, np.tile(q, (301, 1)))
        held = np.full(4, share * 12.0)
        _, trace = coast(model, q, np.zeros(4), 300, torque=held, gravity=False)
        assert np.array_equal(trace.q, np.tile(q, (301, 1)))
    _, trace = coast(model, q, np.zeros(4), 300, torque=np.full(4, 12.0 * 1.001), gravity=False)
    assert np.all(trace.q[-1] > q)


def test_break_away_level_counts_with_wear(arms):
    model = arms.make_arm([(j, "friction_wear_temperature", STRIBECK) for j in arms.JOINTS])
    q, torque = np.zeros(4), np.full(4, 18.0)
    _, new = coast(model, q, np.zeros(4), 200, torque=torque, gravity=False)
    _, worn = coast(model, q, np.zeros(4), 200, torque=torque, gravity=False, wear=50.0)
    assert np.all(new.q[-1] > 0.0)  # 16 N m hold it
    assert np.array_equal(worn.q[-1], q)  # 26 N m do


def test_coasting_joint_stops_and_stays(arms):
    model = arms.make_arm(arms.rub(12.0, 0.0))
    _, trace = coast(model, np.zeros(4), np.array([0.3, 0.2, 0.2, 0.3]), 2000, gravity=False)
    assert np.all(trace.v[-500:] == 0.0)


@pytest.mark.parametrize("drag", [10.0, 1e3, 1e5])
def test_a_driven_joint_with_drag_comes_to_its_terminal_speed(arms, drag):
    """m dv/dt = T - c v^2 from rest: v = sqrt(T/c) tanh(t sqrt(T c)/m), which may take a tenth of a step."""
    stuck = [(j, "coulomb", {"level": 1e5}) for j in arms.JOINTS[:3]]
    model = arms.make_arm([*stuck, ("side", "quadratic_viscous", {"curvature": drag})])
    body, trace = coast(model, np.zeros(4), np.zeros(4), 400, torque=np.full(4, 1000.0), gravity=False)
    assert np.all(trace.v[:, :3] == 0.0)
    inertia = body.mass_matrix(np.zeros(4))[3, 3] + model.rotor_inertia[3]
    final, rate = np.sqrt(1000.0 / drag), np.sqrt(1000.0 * drag) / inertia
    wanted = final * np.tanh(rate * 1e-3 * np.arange(len(trace.v)))
    settled = rate * 1e-3 * np.arange(len(trace.v)) > 5.0
    assert np.abs(trace.v[:, 3] - wanted)[settled].max() < 5e-3 * final
    if rate < 100.0:
        assert np.abs(trace.v[:, 3] - wanted).max() < 1e-3 * final
    assert trace.v[-1, 3] == pytest.approx(final, rel=1e-4)


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_friction_of_most_of_the_load_balances(share):
    """Without gravity the load is the link's inertia: it adds friction to a start, and to a stop."""
    link, rotor = 0.02 + 3.0 * 0.1**2, 0.01
    friction = {"coefficient": share, "speed": 1.0}
    model = make_axis(("load_dependent_friction", friction), drive=DRIVE | {"rotor_inertia": [rotor]})
    for torque, start, added in ((0.3, 0.0, share), (-0.05, 1.0, -share)):
        trace = coast(model, np.zeros(1), np.array([start]), 200, torque=[torque], gravity=False)[1]
        acceleration = torque / (rotor + link * (1.0 + added))
        np.testing.assert_allclose(trace.v[:, 0], start + acceleration * trace.t, rtol=1e-3, atol=1e-5)


def test_a_step_takes_effects_at_the_time_of_its_balance(arms):
    """What fades with time slows the first half step by what it is at its middle, a quarter of a step on."""
    fading = {"coulomb_drift": 100.0, "viscous_drift": 0.0, "time_constant": 1e-3}
    models = arms.make_arm([("side", "warm_up_drift", fading)]), arms.make_arm()
    (body, slowed), (_, free) = (coast(m, np.zeros(4), np.ones(4), 5, gravity=False) for m in models)
    mass = body.mass_matrix(np.zeros(4))
    # PyBullet gets the change of the links' momentum over a whole step.
    change = 1e-3 * np.linalg.solve(mass, slowed.applied[0] - free.applied[0])
    momentum = (mass + np.diag(models[0].rotor_inertia)) @ change
    np.testing.assert_allclose(momentum / 0.5e-3, [0.0, 0.0, 0.0, -100.0 * np.exp(-0.25)], atol=1e-3)


def test_torque_limit_holds_and_is_reached(arms):
    limit = [200.0, 260.0, 200.0, 200.0]
    reference = arms.swing(1.0)
    free = simulate_forward(arms.make_arm(arms.rub()), reference)
    peak = np.abs(free.tau).max(axis=0)
    assert peak[1] > 260.0
    model = arms.make_arm(arms.rub(), drive={"rotor_inertia": [6.0, 8.0, 5.0, 1.0], "torque_limit": limit})
    limited = simulate_forward(model, reference)
    assert np.abs(limited.tau[:, 1]).max() == 260.0
    assert np.all(np.abs(limited.tau) <= np.array(limit))


def test_motor_too_weak_is_told(arms):
    model = arms.make_arm(
        arms.rub(), drive={"rotor_inertia": [6.0, 8.0, 5.0, 1.0], "torque_limit": [20.0, 20.0, 20.0, 20.0]}
    )
    with pytest.raises(SimulationError, match=r"joint 'lift' is .* off its reference at t = .*too weak"):
        simulate_forward(model, arms.swing(1.5))


def test_halving_the_step_changes_the_torque_little(arms):
    model = arms.make_arm(arms.rub(12.0, 9.0))
    coarse, fine = (
        trace_forward(model, arms.swing(1.5), longest_step=dt)[0].torque[::every]
        for dt, every in ((1e-3, 2), (5e-4, 4))
    )
    off = np.sqrt(np.mean((coarse - fine) ** 2, axis=0))
    assert np.all(off < 0.01 * np.sqrt(np.mean(fine**2, axis=0)))


@pytest.mark.parametrize("lost_motion", [0.0, 1e-3])
def test_gear_law_and_its_inverse(lost_motion):
    for torque in (0.0, 1e-6, 0.3, 5.0, 300.0, -7.0, -4e3):
        gap = deflection(torque, 1e-6, lost_motion, 8.0)
        assert invert_deflection(gap, 1e-6, lost_motion, 8.0) == pytest.approx(torque, rel=1e-9, abs=1e-12)


@pytest.fixture
def links(monkeypatch):
    """Positions of the links, each time that PyBullet is read."""
    read, real = [], World.read_state

    def read_state(world):
        q, v = real(world)
        read.append(q)
        return q, v

    monkeypatch.setattr(World, "read_state", read_state)
    return read


def test_static_load_bends_the_gear_by_its_compliance(arms, links):
    compliance = 2e-5
    model = arms.make_arm([*arms.rub(), ("lift", "joint_elasticity", {"compliance": compliance})])
    reference = arms.stand()
    trace, _ = trace_forward(model, reference)
    link = links[-1][1]
    load = model.rigid_body().bias(np.array([*reference.q[0, :1], link, *reference.q[0, 2:]]), np.zeros(4))[1]
    assert abs(load) > 50.0
    assert trace.q[-1, 1] - link == pytest.approx(compliance * load, rel=1e-6)
    # The others stand without bending.
    assert np.array_equal(trace.q[-1, [0, 2, 3]], reference.q[0, [0, 2, 3]])


def test_backlash_lets_the_link_go_through_its_play(arms, links):
    play = 4e-3
    model = arms.make_arm([*arms.rub(), ("turn", "backlash", {"lost_motion": play, "mesh_torque": 5.0})])
    reference = arms.swing(2.0)
    trace, _ = trace_forward(model, reference)
    motor = trace.q[BLOCK::BLOCK, 0]
    gap = motor - np.array(links)[-len(trace.t) // BLOCK :, 0][: len(motor)]
    assert np.ptp(gap) == pytest.approx(play, rel=0.05)
    assert np.abs(gap).max() < 0.52 * play


def test_coupled_terms_are_found(arms):
    coupling = {"viscous": 6.0, "coulomb": 9.0, "inertia": 3.0, "other": 1.0}
    _, terms = pack_terms(build_plant(arms.make_arm([*arms.rub(), ("slide", "cross_coupling", coupling)])))
    assert terms.coupled.tolist() == [False, False, True, False]


def test_feedforward_leaves_friction_out_unless_asked(arms):
    spring = ("turn", "joint_spring", {"stiffness": 60.0, "preload": 5.0})
    model, reference = arms.make_arm([*arms.rub(12.0, 9.0), spring]), arms.swing(0.5)
    body, plant = model.rigid_body(), build_plant(model)
    rigid = body.inverse_dynamics(reference.q, reference.v, reference.a) + plant.armature * reference.a
    rigid[:, 0] += 60.0 * reference.q[:, 0] + 5.0
    plain = make_feedforward(model, body, plant, reference)
    np.testing.assert_allclose(plain, rigid, atol=1e-9)
    rubbed = make_feedforward(model, body, plant, reference, friction=True)
    np.testing.assert_allclose(rubbed - rigid, 12.0 * np.sign(reference.v) + 9.0 * reference.v, atol=1e-9)


def test_gains_go_with_the_inertia_and_the_stated_bandwidth(arms):
    model = arms.make_arm(controller={"bandwidth_hz": 4.0, "damping": 0.7})
    reference = arms.stand()
    body, plant = model.rigid_body(), build_plant(model)
    law = make_law(model, reference, np.zeros_like(reference.q), body, plant.armature, model.torque_limit)
    inertia = np.diag(body.mass_matrix(reference.q[0])) + model.rotor_inertia
    omega = 2.0 * np.pi * 4.0
    np.testing.assert_allclose(law.stiffness, omega**2 * inertia)
    np.testing.assert_allclose(law.damping, 1.4 * omega * inertia)
    assert find_step(reference.t) == 1e-3


def test_the_controller_s_inertia_is_the_mean_along_the_motion_and_its_speeds_are_means_over_two_steps(arms):
    model, reference = arms.make_arm(), arms.swing(0.5)
    body, plant = model.rigid_body(), build_plant(model)
    law = make_law(model, reference, np.zeros_like(reference.q), body, plant.armature, model.torque_limit)
    some = [int(k * (len(reference.q) - 1) / 24) for k in range(25)]
    inertia = sum(np.diag(body.mass_matrix(reference.q[k])) for k in some) / 25.0 + model.rotor_inertia
    # 5 Hz, damped critically, where the model says nothing.
    np.testing.assert_allclose(law.stiffness, (10.0 * np.pi) ** 2 * inertia)
    np.testing.assert_allclose(law.damping, 20.0 * np.pi * inertia)
    for k in (1, 250, 498):
        np.testing.assert_allclose(law.speed[k], (reference.q[k + 1] - reference.q[k - 1]) / 2e-3)
    np.testing.assert_allclose(law.speed[[0, -1]], reference.v[[0, -1]])


def test_a_clock_grows_in_equal_steps(refuses):
    assert find_step([0.0, 0.5, 1.0]) == 0.5
    for t in ([0.0, 1.0], [0.0, 0.0, 0.0], [2.0, 1.0, 0.0], [0.0, 1.0, 3.0]):
        refuses(find_step, t)


@pytest.mark.parametrize("rotor", [0.0, 5.0])
@pytest.mark.parametrize(
    "effects",
    [
        {"backlash": {"lost_motion": 1e-4, "mesh_torque": 2.0}},
        {"backlash": {"lost_motion": 3e-3, "mesh_torque": 2.0}, "joint_elasticity": {"compliance": 1e-7}},
        {"joint_elasticity": {"compliance": 1e-10}},
    ],
)
def test_hard_gears_balance_with_and_without_a_rotor(arms, effects, rotor):
    """Play that ends hard, and a gear that is all but rigid: no step fails or rings beyond what is needed."""
    bent = [("lift", name, values) for name, values in effects.items()]
    drive = {"rotor_inertia": [6.0, rotor, 5.0, 1.0]}
    model, rigid = (arms.make_arm([*arms.rub(), *more], drive=drive) for more in (bent, []))
    reference = arms.swing(1.5)
    trace, stiff = trace_forward(model, reference)[0], trace_forward(rigid, reference)[0]
    assert np.abs(trace.torque).max() < 1.5 * np.abs(stiff.torque).max()
    if effects.get("joint_elasticity", {}).get("compliance") == 1e-10:
        off = trace.torque[50:] - stiff.torque[50:]
        assert np.sqrt(np.mean(off**2)) < 0.01 * np.sqrt(np.mean(stiff.torque**2))


@pytest.mark.parametrize("lost_motion", [0.0, 2e-3])
def test_what_pybullet_gets_is_told_by_effect(arms, lost_motion):
    """The shares add up to the torque applied, at rest and through reversals; each is its effect's."""
    bent = [("lift", "backlash", {"lost_motion": lost_motion, "mesh_torque": 20.0})] if lost_motion else []
    model = arms.make_arm([*arms.rub(12.0, 9.0), *bent])
    held = arms.stand(2.0, 4e-3)
    t = np.maximum(held.t - 0.2, 0.0)[:, None]
    size, rate = np.array([0.3, 0.2, 0.1, 0.3]), np.array([3.0, 5.0, 7.0, 11.0])
    angle, moves = rate * t, t > 0.0
    v, a = size * rate * np.sin(angle), size * rate**2 * np.cos(angle) * moves
    reference = Reference(held.t, held.q + size * (1.0 - np.cos(angle)), v, a)
    trace, _ = trace_forward(model, reference, by_effect=True)
    shares = trace.shares
    assert set(shares) == {"motor", "rotor", "bias", "coulomb", "viscous"}
    made = shares["motor"] - shares["rotor"] + shares["bias"] - shares["coulomb"] - shares["viscous"]
    size = np.abs(trace.applied).max(axis=0)
    off = np.abs(made - trace.applied) / size
    # What is left of the speed of a motor that comes to rest, at most 1e-4 of its change, is dropped.
    assert np.max(off) < 5e-4 and np.quantile(off, 0.95) < 1e-6
    # Away from reversals, where the step's mean is what its middle has.
    turns = np.any(np.diff(np.sign(trace.v), axis=0, prepend=0.0) != 0.0, axis=1)
    moving = ~np.convolve(turns, np.ones(5), "same").astype(bool) & np.all(trace.v != 0.0, axis=1)
    assert np.mean(moving) > 0.5
    np.testing.assert_allclose(shares["coulomb"][moving], 12.0 * np.sign(trace.v[moving]))
    np.testing.assert_allclose(shares["viscous"][moving], 9.0 * trace.v[moving], atol=1e-9)
    rest = np.all(trace.v[:40] == 0.0, axis=1)
    assert rest.all()
    assert np.all(np.abs(shares["coulomb"][:40]) < 12.0) and np.all(shares["viscous"][:40] == 0.0)
    # Without being asked, nothing is told, and nothing else changes.
    plain, _ = trace_forward(model, reference)
    assert plain.shares is None
    np.testing.assert_array_equal(plain.torque, trace.torque)


@pytest.mark.parametrize("seed", range(4))
def test_load_friction_of_two_neighbours_balances_along_a_motion(seed):
    """Each one's load moves with the other's acceleration, which slopes against one speed do not tell."""
    rng, n, share = np.random.default_rng(seed), 4, 0.3
    entries = [
        {"joint": f"j{k}", "effect": "load_dependent_friction", "parameters": {"coefficient": share}}
        for k in (2, 3)
    ]
    urdf = describe_arm((0.4, 0.35, 0.2, 0.12), (6.0, 4.0, 1.5, 0.8), ["0 1 0"] * n, raised=0.0)
    fields = {"name": "chain", "urdf": "chain.urdf", "joints": [f"j{k + 1}" for k in range(n)]}
    model = make_model({**fields, "effects": entries}, urdf)
    t = np.arange(2000) * 1e-3
    q, v, a = np.zeros((3, len(t), n))
    for frequency in (0.23, 0.41, 0.7):
        w, phase = 2.0 * np.pi * frequency, rng.uniform(0.0, 6.28, n)
        size, angle = rng.normal(0.0, 0.2, n), w * t[:, None] + phase
        q, v, a = q + size * np.sin(angle), v + size * w * np.cos(angle), a - size * w**2 * np.sin(angle)
    trace, _ = trace_forward(model, Reference(t, q, v, a))
    count = len(trace.torque)
    q, v = trace.q[:count], trace.v[:count]
    load = model.rigid_body().inverse_dynamics(q, v, np.gradient(v, 1e-3, axis=0))
    friction = share * np.abs(load) * np.sign(v) * np.array([0.0, 1.0, 1.0, 0.0])
    moves = np.all(np.abs(v) > 0.02, axis=1)
    missed = (trace.torque - load - friction)[moves][5:-5]
    assert np.sqrt(np.mean(missed**2, axis=0)) == pytest.approx(np.zeros(n), abs=0.02 * np.abs(load).max())
