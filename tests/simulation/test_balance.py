"""The parts of the compiled step by themselves, as the Python they are made of, against hand and numpy."""

from types import SimpleNamespace

import numpy as np
import pytest

from wearscope.effects.base import Plant
from wearscope.simulation import balance, step, terms
from wearscope.simulation.arrays import Gears, Law, make_motion, make_state, make_work
from wearscope.simulation.balance import deflection
from wearscope.simulation.plant import build_gears, build_plant
from wearscope.simulation.terms import Terms, order_terms, pack_terms


@pytest.fixture(autouse=True)
def _as_python(monkeypatch):
    """Functions that compiled code alone can call, as Python that a test can."""
    for module in (balance, step, terms):
        for name, function in list(vars(module).items()):
            if hasattr(function, "py_func"):
                monkeypatch.setattr(module, name, function.py_func)


def make_gears(n, **given):
    """Rigid gears without rotors, but for what is given."""
    zero = np.zeros(n)
    fields = dict.fromkeys(("armature", "compliance", "lost_motion", "mesh_torque"), zero)
    return Gears(**(fields | {"flexible": np.zeros(n, dtype=bool), "tolerance": np.full(n, 1e-6)} | given))


def make_law(count, n, **given):
    """No controller, but for what is given."""
    fields = dict.fromkeys(("feedforward", "position", "speed"), np.zeros((count, n)))
    fields |= {"stiffness": np.zeros(n), "damping": np.zeros(n), "limit": np.full(n, np.inf)}
    return Law(**(fields | given))


def coupled_terms(*coupled):
    """Terms of which no more is asked than which joints they couple."""
    return Terms(**dict.fromkeys(Terms._fields) | {"coupled": np.array(coupled)})


def test_equations_are_solved_as_numpy_does():
    rng = np.random.default_rng(0)
    for n in (1, 2, 5):
        a, b = rng.normal(size=(n, n)) + 5.0 * np.eye(n), rng.normal(size=n)
        a[-1, : n - 1] = 0.0
        wanted = np.linalg.solve(a, b)
        assert balance._solve(a, b)
        np.testing.assert_allclose(b, wanted, rtol=1e-12)
    for pivot in (0.0, -1.0, np.nan):
        assert not balance._solve(np.array([[2.0, 0.0], [0.0, pivot]]), np.ones(2))
    # Singular, though its own entries are positive: nothing is left of the second pivot.
    assert not balance._solve(np.ones((2, 2)), np.ones(2))


def test_slopes_are_those_between_the_last_two_speeds():
    n = 6
    state, work, motion = make_state(n), make_work(n), make_motion(n)
    # As it should be; at rest; its direction new; coupled; hardly moved; as the first, the other way.
    state.mode[:], work.old_mode[:] = (1, 0, 1, 1, 1, -1), (1, 0, -1, 1, 1, -1)
    work.old_speed[:], motion.speed[:] = (2.0, 2.0, 2.0, 2.0, 2.0, -1.0), (2.5, 2.5, 2.5, 2.5, 2.0, -3.0)
    work.old_torque[:], work.high[:] = 10.0, (11.0, 11.0, 11.0, 11.0, 11.0, 4.0)
    balance._learn_slopes(coupled_terms(0, 0, 0, 1, 0, 0), state, work, motion)
    np.testing.assert_array_equal(state.slope, [2.0, np.nan, np.nan, np.nan, np.nan, 3.0])
    np.testing.assert_array_equal(work.old_speed, motion.speed)
    np.testing.assert_array_equal(work.old_torque, work.high)
    np.testing.assert_array_equal(work.old_mode, state.mode)


def test_one_correction_balances_what_is_linear():
    """Six joints: moving, moving and coupled, elastic, at rest, elastic at rest, at its motor's limit."""
    rng = np.random.default_rng(3)
    n, h, at = 6, 0.02, 0.007
    root = rng.normal(size=(n, n))
    mass, bias = root @ root.T + np.eye(n), rng.normal(size=n)
    flexible, rest = np.array([0, 0, 1, 0, 1, 0], dtype=bool), np.array([0, 0, 0, 1, 1, 0], dtype=bool)
    armature, compliance = rng.uniform(0.5, 2.0, n), rng.uniform(1e-3, 4e-3, n)
    gears = make_gears(n, armature=armature, flexible=flexible, compliance=compliance, mesh_torque=np.ones(n))
    stiffness, damping = rng.uniform(20.0, 50.0, n), rng.uniform(5.0, 9.0, n)
    limit = np.array([1e9, 1e9, 1e9, 1e9, 1e9, 0.5])
    law = make_law(1, n, stiffness=stiffness, damping=damping, limit=limit)
    drag = np.diag(rng.uniform(1.0, 3.0, n))
    drag[1, [0, 5]] = 0.4, -0.3

    state, work, motion = make_state(n), make_work(n), make_motion(n)
    state.mode[:] = ~rest
    state.v[:], state.y[:] = rng.normal(size=n), np.where(rest, 0.0, 30.0)
    state.slope[:] = np.diag(drag)
    work.jacobian[:] = drag
    work.gap[:], work.give[:] = 1e-3 * rng.normal(size=n), 0.004
    work.ahead[:], work.fed[:], work.wanted[:] = rng.normal(size=n), 20.0 * rng.normal(size=n), 31.0
    work.fed[5] = 1e5
    motion.speed[:] = np.where(rest, 0.0, 29.0)
    motion.acceleration[:] = (motion.speed - state.y) / h
    work.x[:] = np.where(flexible, 28.0, motion.speed)
    scratch = SimpleNamespace(mass_matrix=mass, bias=bias)

    # Links, motors and gears as the module's introduction has them, in speeds x, y and torques g.
    one, none, moving = np.eye(n), np.zeros((n, n)), np.where(rest, 0.0, 1.0)
    free = np.where(limit < 1.0, 0.0, 1.0)
    pulls = drag + np.diag(armature / h + free * (damping + at * stiffness))
    driven = np.where(free > 0.0, work.fed + stiffness * work.ahead + damping * work.wanted, limit)
    give = np.where(flexible, work.give, 1.0)
    system = np.block(
        [
            [mass / h, none, -one],
            [none, moving[:, None] * pulls + np.diag(1.0 - moving), np.diag(moving)],
            [np.diag(-give), np.diag(give), np.diag(np.where(flexible, -compliance, 0.0))],
        ]
    )
    # A rigid joint at rest keeps the speed of its link, which is none: its torque is what that needs.
    known = [
        mass @ state.v / h - bias,
        moving * (driven + armature * state.y / h),
        np.where(flexible, -work.gap, 0.0),
    ]
    x, y, g = np.split(np.linalg.solve(system, np.concatenate(known)), 3)
    assert (y[~rest] > 0.0).all()

    terms = coupled_terms(*np.arange(n) == 1)
    work.high[:] = drag @ motion.speed
    balance._load_links(state, work, motion, scratch, h)
    assert balance._balance(law, gears, state, work, motion, at) > 1.0
    assert balance._correct(gears, terms, state, work, motion, scratch, h, True) == 0
    np.testing.assert_allclose(work.x, x, atol=1e-9 * np.abs(x).max())
    np.testing.assert_allclose(motion.speed, y, atol=1e-9 * np.abs(y).max())
    np.testing.assert_allclose(motion.acceleration, (y - state.y) / h, atol=1e-6)

    work.high[:] = drag @ motion.speed
    balance._load_links(state, work, motion, scratch, h)
    assert balance._balance(law, gears, state, work, motion, at) < 1.0
    np.testing.assert_allclose(motion.load, g, atol=1e-6)
    np.testing.assert_allclose((work.need - work.high)[~rest], 0.0, atol=1e-6)
    # What holds the motors at rest is what the controller gives and the gears do not take.
    held = driven - damping * y - at * stiffness * y - g
    np.testing.assert_allclose(work.need[rest], held[rest], atol=1e-6)
    assert work.motor[5] == 0.5


def test_what_links_and_motors_miss_is_told_over_its_tolerance():
    gears = make_gears(
        1, flexible=np.ones(1, dtype=bool), compliance=np.array([0.1]), mesh_torque=np.ones(1),
        tolerance=np.array([0.5]),
    )  # fmt: skip
    state, work, motion = make_state(1), make_work(1), make_motion(1)
    work.gap[:] = 0.3
    scratch = SimpleNamespace(mass_matrix=np.ones((1, 1)), bias=np.array([5.0]))
    # The gear gives 3 N m, the link needs 5: two are missing, of which half a one may.
    balance._load_links(state, work, motion, scratch, 1.0)
    missing = balance._balance(make_law(1, 1), gears, state, work, motion, 0.0)
    assert missing == pytest.approx(4.0) and work.residual[0] == pytest.approx(-2.0)


def test_a_motor_that_would_turn_comes_to_rest():
    """A push that turns it within the part: at the part's end it rests, by its middle only from rest."""
    for start, ends, speed, turned in ((1.0, True, 0.0, 1), (0.0, False, 0.0, 1), (1.0, False, -9.0, 0)):
        state, work, motion = make_state(1), make_work(1), make_motion(1)
        state.mode[:], state.y[:], state.slope[:] = 1, start, 0.0
        work.need[:], motion.speed[:], work.x[:] = -10.0, 1.0, 1.0
        scratch = SimpleNamespace(mass_matrix=np.ones((1, 1)))
        found = balance._correct(make_gears(1), coupled_terms(0), state, work, motion, scratch, 1.0, ends)
        assert (found, motion.speed[0], work.x[0]) == (turned, speed, speed)
        assert state.mode[0] == motion.sign[0] == 1 - turned


def test_a_slope_that_would_drive_is_bounded_by_half_of_the_inertia():
    """Of 1 kg m^2 of the link and 3 of the rotor, over half a second, a slope of -100 leaves a half."""
    for flexible in (False, True):
        gears = make_gears(
            1, armature=np.array([3.0]), flexible=np.array([flexible]), compliance=np.ones(1),
            mesh_torque=np.ones(1),
        )  # fmt: skip
        state, work, motion = make_state(1), make_work(1), make_motion(1)
        state.mode[:], state.slope[:], state.y[:], motion.speed[:] = 1, -100.0, 50.0, 50.0
        work.need[:], work.stiff[:] = 2.0, 0.0
        scratch = SimpleNamespace(mass_matrix=np.ones((1, 1)))
        balance._correct(gears, coupled_terms(0), state, work, motion, scratch, 0.5, True)
        inertia = 3.0 / 0.5 if flexible else 4.0 / 0.5
        assert motion.speed[0] == pytest.approx(50.0 + 2.0 / (0.5 * inertia))


@pytest.mark.parametrize(("single", "modes"), [(False, [1, -1, 0, 0, 1]), (True, [0, -1, 0, 0, 1])])
def test_motors_beyond_break_away_are_released(single, modes):
    """Beyond by 1 and by 3 N m, within, at the tolerance, and one that moves anyway."""
    state, work, motion = make_state(5), make_work(5), make_motion(5)
    state.mode[4] = 1
    state.slope[:] = 7.0
    work.low[:], work.high[:] = -2.0, 4.0
    work.need[:] = 5.0, -5.0, 3.0, 4.5, 99.0
    gears = make_gears(5, tolerance=np.full(5, 0.5))
    assert balance._release(gears, state, work, motion, single)
    assert state.mode.tolist() == modes and motion.sign.tolist() == [*modes[:4], 0]
    assert np.isnan(state.slope).tolist() == [not single, True, False, False, False]
    work.need[:] = 0.0
    assert not balance._release(gears, state, work, motion, single)


def test_the_first_motor_that_turns_does_so_where_its_speed_is_nil():
    """From 2 to -1 by two thirds of the part, from -1 to 2 by a third; one that begins at rest does not."""
    state, work, motion = make_state(4), make_work(4), make_motion(4)
    state.mode[:] = 1, -1, 1, 1
    state.y[:], end = np.array([2.0, -1.0, 0.0, 3.0]), np.array([-1.0, 2.0, 5.0, 1.0])
    motion.speed[:] = 0.5 * (state.y + end)
    assert balance._find_turn(state, work, motion) == pytest.approx(1.0 / 3.0)
    assert work.turning[0] == 1
    state.mode[1] = 0
    assert balance._find_turn(state, work, motion) == pytest.approx(2.0 / 3.0)
    assert work.turning[0] == 0
    # All but at rest at the end is not turned.
    motion.speed[0] = 0.5 * (2.0 - 1e-5)
    assert balance._find_turn(state, work, motion) == balance.WHOLE


def test_a_gear_s_torque_is_taken_ahead_by_how_hard_it_is():
    """Its frequency is that of two inertias on a spring: dt (w dt)^2/(1 + (w dt)^2)."""
    for rotor, link, compliance, dt in ((0.5, 2.0, 1e-3, 1e-3), (3.0, 0.2, 1e-6, 4e-3)):
        spring = np.array([[1.0, -1.0], [-1.0, 1.0]]) / compliance
        square = np.linalg.eigvals(np.diag([1.0 / rotor, 1.0 / link]) @ spring).max() * dt**2
        gears = make_gears(1, armature=np.array([rotor]), compliance=np.array([compliance]))
        scratch = SimpleNamespace(mass_matrix=np.array([[link]]))
        assert balance._look_ahead(gears, scratch, 0, dt) == pytest.approx(dt * square / (1.0 + square))


@pytest.mark.parametrize("k", [0, 1, 3])
def test_a_part_begins_where_its_accelerations_lead(k):
    """References that grow evenly are met between their rows, at the first and the last one too."""
    n, dt, at, h, length = 4, 0.01, 0.004, 0.003, 0.006
    rows = np.arange(4)[:, None] * np.ones(n)
    law = make_law(4, n, feedforward=5.0 + 3.0 * rows, position=1.0 + 2.0 * dt * rows, speed=2.0 + 7.0 * rows)
    state, work, motion = make_state(n), make_work(n), make_motion(n)
    state.mode[:] = 1, -1, 0, 1
    state.q[:], state.gap[:], state.v[:], state.y[:] = 0.3, 0.02, 2.0, (2.5, -1.0, 0.0, 2.5)
    state.a[:], state.a_motor[:], state.a_before[:] = 4.0, (50.0, 600.0, 5.0, 50.0), 20.0
    gears = make_gears(
        n, armature=np.full(n, 2.0), flexible=np.array([0, 0, 0, 1], dtype=bool), compliance=np.full(n, 1e-4)
    )
    mass = np.arange(16.0).reshape(4, 4) + 1.0
    scratch = SimpleNamespace(mass_matrix=mass, bias=np.full(n, 0.5))
    balance._begin(law, state, work, motion, gears, scratch, k, at, h, length, dt)
    np.testing.assert_allclose(work.fed, 5.0 + 3.0 * (k + at / dt))
    reference = 1.0 + 2.0 * dt * k + (2.0 + 7.0 * k) * at
    np.testing.assert_allclose(work.wanted, 2.0 + 7.0 * (k + at / dt))
    np.testing.assert_allclose(work.ahead, reference - 0.32)
    np.testing.assert_allclose(motion.position, 0.32 + at * state.y)
    # Accelerations go on as before: 50 after 20 is 80; one that would turn the motor leaves its speed.
    np.testing.assert_allclose(motion.speed, [2.5 + h * 80.0, -1.0, 0.0, 2.5 + h * 80.0])
    np.testing.assert_allclose(motion.acceleration, [80.0, 0.0, 0.0, 80.0])
    np.testing.assert_allclose(work.x, [2.5 + h * 80.0, -1.0, 0.0, 2.0 + h * 4.0])
    balance._load_links(state, work, motion, scratch, h)
    np.testing.assert_allclose(motion.load, 0.5 + mass @ (work.x - 2.0) / h)
    # At a steady slip the gear's deflection is that at the part's middle, and by its time ahead later.
    ahead = balance._look_ahead(gears, scratch, 3, dt)
    middle = at - h + 0.5 * length
    assert work.gap[3] + work.give[3] * 0.5 == pytest.approx(0.02 + (middle + ahead) * 0.5)
    # Where the slip changes evenly over h, half of the part's length of the change has come to pass.
    assert work.give[3] == pytest.approx(ahead * length / h)


def test_a_step_into_a_gear_s_teeth_is_halved_until_its_torque_is_as_said():
    """From the middle of its play a motor leaps to where the teeth, a thousand times as hard, take hold."""
    gears = make_gears(
        1, flexible=np.ones(1, dtype=bool), compliance=np.array([1e-6]), lost_motion=np.array([2e-3]),
        mesh_torque=np.array([1.0]), tolerance=np.array([1e-3]),
    )  # fmt: skip
    state, work, motion = make_state(1), make_work(1), make_motion(1)
    work.give[:], work.stiff[:], work.change[:] = 1.0, 1.0 / (1e-6 + 1e-3), 8e-3
    share = balance._shorten(gears, state, work, motion)
    torque = np.linspace(0.0, 1e4, 2_000_001)
    gap = deflection.py_func(torque, 1e-6, 2e-3, 1.0)

    def goes_beyond(part):
        said = part * 8e-3 * work.stiff[0]
        return np.interp(part * 8e-3, gap, torque) - said > 3.0 * said + 1e-3

    assert share in (0.5, 0.25, 0.125, 0.0625)
    assert goes_beyond(2.0 * share) and not goes_beyond(share)
    assert balance._shorten(gears._replace(lost_motion=np.zeros(1)), state, work, motion) == 1.0


def finish(start, length, h, lasting=True, mode=1, limit=np.inf, flexible=True):
    """A part in which a motor goes from 1 to 1 + 4 h, its link from 2 to 2 + 3 h."""
    state, work, motion = make_state(1), make_work(1), make_motion(1)
    state.mode[:], state.q[:], state.gap[:] = mode, 0.3, 0.02
    state.y[:], state.v[:], motion.speed[:], work.x[:] = 1.0, 2.0, 1.0 + 4.0 * h, 2.0 + 3.0 * h
    state.a_motor[:], work.speed[:], work.torque[:], work.motor[:] = 7.0, np.nan, np.nan, 11.0
    row = np.ones((1, 1))
    law = make_law(
        1, 1, feedforward=5.0 * row, position=0.4 * row, speed=2.0 * row, stiffness=np.array([100.0]),
        damping=np.array([10.0]), limit=np.array([limit]),
    )  # fmt: skip
    gears = make_gears(1, flexible=np.array([flexible]))
    step._finish_part(law, gears, state, work, motion, 0, length, h, start, lasting)
    return state, work


def test_a_part_is_finished_by_going_on_evenly():
    state, work = finish(start=-0.25, length=0.5, h=0.25)
    assert (state.y[0], state.v[0]) == (3.0, 3.5)
    assert (state.a_motor[0], state.a_before[0], state.a[0]) == (4.0, 7.0, 3.0)
    # At t_k, half way, the speed is 2, and the controller's torque 5 + 100 (0.4 - 0.32) + 10 (2 - 2).
    assert work.speed[0] == 2.0 and work.torque[0] == pytest.approx(13.0)
    _, work = finish(start=-0.375, length=0.5, h=0.25)
    assert work.speed[0] == 2.5 and work.torque[0] == pytest.approx(8.0)
    assert finish(start=-0.25, length=0.5, h=0.25, limit=12.0)[1].torque[0] == 12.0
    # Its end asked for, at t_k: the torque that was balanced there.
    _, work = finish(start=-0.5, length=0.5, h=0.5)
    assert (work.speed[0], work.torque[0]) == (3.0, 11.0)
    for start in (0.1, -0.6):
        assert np.isnan(finish(start=start, length=0.5, h=0.5)[1].speed[0])
    # Too short a part says nothing of accelerations; a motor that turned is at rest; a rigid link follows.
    assert finish(-0.25, 0.5, 0.25, lasting=False)[0].a_motor[0] == 7.0
    turned, _ = finish(-0.25, 0.5, 0.25, mode=-1)
    assert (turned.y[0], turned.mode[0]) == (0.0, 0)
    assert finish(-0.25, 0.5, 0.25, mode=0)[0].y[0] == 0.0
    assert finish(-0.25, 0.5, 0.25, flexible=False)[0].v[0] == 3.0


def test_gears_are_soft_where_they_give_or_have_play():
    """Play alone is given a thousandth of its half at the largest torque, so that its law has an inverse."""
    plant = Plant(3)
    plant.compliance[:], plant.lost_motion[:], plant.armature[:] = (0.0, 1e-5, 0.0), (0.0, 0.0, 4e-3), 2.0
    gears = build_gears(plant, np.array([100.0, 200.0, 50.0]))
    assert gears.flexible.tolist() == [False, True, True]
    np.testing.assert_allclose(gears.compliance, [0.0, 1e-5, 4e-8])
    np.testing.assert_allclose(gears.tolerance, [1e-5, 2e-5, 5e-6])
    np.testing.assert_allclose(gears.lost_motion, plant.lost_motion)


def pack(arms, effects):
    """Rows, in a list of Python's, and numbers of the effects of the small robot."""
    plant = build_plant(arms.make_arm(effects))
    return [term.row for term in order_terms(plant)], pack_terms(plant)[1]


def evaluate(arms, effects, mode, slope):
    """Torques of effects on both sides, slopes and what they couple, at speeds of 0.5 after 0.3 in 0.1 s."""
    rows, packed = pack(arms, effects)
    motion, n = make_motion(4), 4
    motion.speed[:], motion.acceleration[:], motion.sign[:] = 0.5, 2.0, mode
    low, high, jacobian, slope = np.zeros(n), np.zeros(n), np.full((n, n), 99.0), np.full(n, slope)
    terms.evaluate_terms(
        rows, packed, np.array(mode), np.full(n, 0.3), slope, jacobian, np.zeros((n, n)), motion, low, high,
        0.0, 0.1, np.full(n, 50.0), np.zeros(n),
    )  # fmt: skip
    return low, high, slope, jacobian, motion


def test_torques_and_slopes_of_effects_are_those_of_their_laws(arms):
    """12 N m and 3 v^2 at "turn", 9 v, 4 v_other and 2 a_other at "slide", 12 and 5 N m at rest at "side"."""
    effects = [
        ("turn", "coulomb", {"level": 12.0}),
        ("turn", "quadratic_viscous", {"curvature": 3.0}),
        ("slide", "viscous", {"slope": 9.0}),
        ("slide", "cross_coupling", {"viscous": 4.0, "coulomb": 0.0, "inertia": 2.0, "other": 0.0}),
        ("side", "coulomb", {"level": 12.0}),
        ("side", "torque_offset", {"offset": 5.0}),
    ]
    for direction in (1, -1):
        low, high, slope, jacobian, motion = evaluate(arms, effects, [direction, 1, 1, 0], np.nan)
        np.testing.assert_allclose(high, [12.0 * direction + 0.75, 0.0, 4.5 + 2.0 + 4.0, 17.0])
        np.testing.assert_allclose(low, [12.0 * direction + 0.75, 0.0, 10.5, -7.0])
        np.testing.assert_allclose(slope[:3], [3.0, 0.0, 9.0], atol=1e-5)
        # An acceleration is the change of speed over the step.
        np.testing.assert_allclose(jacobian[2], [4.0 + 2.0 / 0.1, 0.0, 9.0, 0.0], atol=1e-5)
        assert motion.sign.tolist() == [direction, 1, 1, 0] and (motion.speed == 0.5).all()
        np.testing.assert_allclose(motion.acceleration[:3], 2.0)
    # A slope that is known is left, but for one of a joint that others drive.
    slope = evaluate(arms, effects, [1, 1, 1, 1], 7.0)[2]
    np.testing.assert_allclose(slope, [7.0, 7.0, 9.0, 7.0], atol=1e-5)


def test_effects_share_what_holds_a_motor_at_rest(arms):
    """From -8 to 16 N m of two effects 8 are two thirds of the way, where the level of 12 gives 4."""
    two = [("coulomb", {"level": 12.0}), ("coulomb_asymmetry", {"half_difference": 4.0})]
    effects = [(joint, name, values) for joint in ("turn", "side") for name, values in two]
    rows, packed = pack(arms, [*effects, ("lift", "torque_offset", {"offset": 5.0})])
    shares, need = np.full(5, 100.0), np.array([8.0, 5.0, 0.0, 0.0])
    motion, mode = make_motion(4), np.array([0, 0, 0, -1])
    terms.share_out(rows, packed, mode, motion, need, shares, 0.5, 0.0, 0.1, np.zeros(4), np.zeros(4))
    np.testing.assert_allclose(shares, 100.0 + 0.5 * np.array([4.0, 4.0, 5.0, -12.0, 4.0]))
    assert motion.sign[:3].tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(
    ("trusts", "pace", "evaluations"),
    [
        # Iterates that close in so fast that one correction leaves far less than the tolerance.
        (True, (1e-12, 0.0), 1),
        # Terms that remember, or are coupled; a rate that may not be enough; one that is too old.
        (False, (1e-12, 0.0), 2),
        (True, (1e-3, 0.0), 2),
        (True, (1e-12, 49.0), 1),
        (True, (1e-12, 50.0), 2),
    ],
)
def test_a_part_is_balanced_in_one_correction_and_looked_at_again_unless_that_is_sure(
    monkeypatch, trusts, pace, evaluations
):
    """An inertia of 3 with a drag of 5 v under 70 N m from a speed of 2: v = 2 + h (70 - 5 v)/3."""
    asked = []

    def evaluate(rows, terms, mode, before, slope, jacobian, inertia, motion, low, high, *_):
        asked.append(float(motion.speed[0]))
        low[:] = high[:] = 5.0 * motion.speed

    monkeypatch.setattr(balance, "evaluate_terms", evaluate)
    state, work, motion = make_state(1), make_work(1), make_motion(1)
    state.mode[:], state.slope[:], state.pace[:] = 1, 5.0, pace
    state.v[:], state.y[:], h = 2.0, 2.0, 0.1
    law = make_law(1, 1, feedforward=np.full((1, 1), 70.0))
    gears = make_gears(1, armature=np.ones(1))
    scratch = SimpleNamespace(mass_matrix=np.full((1, 1), 2.0), bias=np.zeros(1))
    share = balance.balance_part(
        None, coupled_terms(0), law, gears, state, work, motion, scratch, 0, 0.0, h, 0.0, 0.2, 0, 0, trusts,
        False,
    )  # fmt: skip
    assert share == balance.WHOLE
    wanted = (2.0 + h * 70.0 / 3.0) / (1.0 + h * 5.0 / 3.0)
    assert motion.speed[0] == pytest.approx(wanted, rel=1e-12)
    np.testing.assert_allclose(asked, [2.0, wanted][:evaluations])
    # How often a rate was trusted since it was last looked at.
    assert state.pace[1] == (pace[1] + 1.0 if evaluations == 1 else 0.0)


@pytest.mark.parametrize("loaded", [True, False])
def test_a_slope_that_the_load_made_is_asked_for_again(monkeypatch, loaded):
    """A load that changes next to a small change of speed looks like a slope at which nothing moves."""

    def evaluate(rows, terms, mode, before, slope, jacobian, inertia, motion, low, high, *_):
        low[:] = high[:] = 5.0 * motion.speed
        slope[np.isnan(slope)] = 5.0

    monkeypatch.setattr(balance, "evaluate_terms", evaluate)
    state, work, motion = make_state(1), make_work(1), make_motion(1)
    state.mode[:], state.slope[:], state.v[:], state.y[:], h = 1, 1e12, 2.0, 2.0, 0.1
    law = make_law(1, 1, feedforward=np.full((1, 1), 70.0))
    scratch = SimpleNamespace(mass_matrix=np.full((1, 1), 2.0), bias=np.zeros(1))
    share = balance.balance_part(
        None, coupled_terms(0)._replace(loaded=np.array([loaded])), law, make_gears(1, armature=np.ones(1)),
        state, work, motion, scratch, 0, 0.0, h, 0.0, 0.2, 0, 0, False, False,
    )  # fmt: skip
    assert share == (balance.WHOLE if loaded else balance.NO_BALANCE)
    if loaded:
        assert motion.speed[0] == pytest.approx((2.0 + h * 70.0 / 3.0) / (1.0 + h * 5.0 / 3.0), rel=1e-12)
