"""Design points: factors, seeds, bytes, refusals, the recording and its file."""

import hashlib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from calls import call_python

from wearscope.cycles.base import Reference, load_cycle
from wearscope.errors import InputError, SimulationError
from wearscope.robots.model import load_model
from wearscope.robots.numbers import Number
from wearscope.simulation.recording import Recording, read_recording, write_recording
from wearscope.simulation.run import Trace
from wearscope.simulation.sensors import check_rate, find_stride, lag_torque, record, seed_of
from wearscope.simulation.study import (
    KEPT,
    Conditions,
    Simulator,
    make_conditions,
    refine_reference,
    simulate_forward,
    simulate_point,
    simulate_points,
)
from wearscope.storage import tables

ROBOTS = Path(__file__).parents[2] / "config" / "robots"


@pytest.fixture(scope="module")
def medium():
    return load_model("medium", ROBOTS)


def first_seconds(reference, seconds):
    kept = round(seconds / (reference.t[1] - reference.t[0])) + 1
    return Reference(*(x[:kept] for x in (reference.t, reference.q, reference.v, reference.a)))


@pytest.fixture(scope="module")
def move(medium):
    return first_seconds(load_cycle("point_to_point").build(medium, 0.05, 1e-3), 2.0)


def rms(x):
    return np.sqrt(np.mean(np.square(x), axis=0))


def test_every_factor_bites(medium, move):
    cycle = load_cycle("point_to_point")
    later = first_seconds(cycle.build(medium, 0.075, 1e-3), 2.0)
    nominal = simulate_point(medium, move, Conditions())
    noise = medium.torque_noise
    changes = {
        "f": (move, Conditions(wear=(50.0, 0.0, 0.0)), 0),
        "w1": (move, Conditions(wear=(0.0, 50.0, 0.0)), 1),
        "w2": (move, Conditions(wear=(0.0, 0.0, 50.0)), 2),
        "w3": (move, Conditions(temperature=70.0), 0),
        "w4": (later, Conditions(), 0),
        "w5": (move, Conditions(payload_mass_error=-0.1), 1),
    }
    for factor, (reference, conditions, axis) in changes.items():
        moved = simulate_point(medium, reference, conditions)
        change = rms(moved.tau - nominal.tau)
        assert change[axis] > 0.5 * noise[axis], factor


def test_wear_changes_the_torque_as_eq_17_says(medium, move):
    """The motion yields a little, so that the torque changes by not quite all of it."""
    nominal, worn = (simulate_point(medium, move, Conditions(wear=(f,))) for f in (0.0, 50.0))
    values = medium.effects[0].parameters
    fast = nominal.qd[:, 0] > 0.5
    assert np.sum(fast) > 30
    wear = 50.0 * (
        values["eta7"] * np.exp(-nominal.qd[fast, 0] / (values["eta8"] * 50.0))
        + values["eta9"] * nominal.qd[fast, 0]
    )
    change = (worn.tau - nominal.tau)[fast, 0]
    assert np.mean(change) == pytest.approx(np.mean(wear), rel=0.1)


def test_true_payload_is_the_declared_one_over_one_plus_the_error(medium):
    with Simulator(medium) as simulator:
        body, declared = simulator.body(0.25), simulator.declared
    assert body.payload.mass == pytest.approx(declared.payload.mass / 1.25)
    assert body.payload.com == declared.payload.com


def test_kept_payloads_are_those_of_new_ones(arms):
    """More payloads than are kept, each twice, in one simulator and each in one of its own."""
    model = arms.make_arm(payload={"mass": 9.0, "com": [0.0, 0.0, -0.2]})
    reference = arms.swing(0.1)
    errors = [0.01 * k for k in range(KEPT + 2)] * 2
    with Simulator(model) as simulator:
        kept = [digest(simulator.run(reference, Conditions(payload_mass_error=e), 1)) for e in errors]
        assert simulator.body(errors[-1]) is simulator.body(errors[-1])
        assert len(simulator._bodies) <= KEPT
        heavier = simulator.machine(((Number("payload.mass"), 12.0),))
        assert simulator.body(errors[-1], heavier).payload.mass == pytest.approx(12.0 / (1.0 + errors[-1]))
    anew = [digest(simulate_point(model, reference, Conditions(payload_mass_error=e), 1)) for e in errors]
    assert kept == anew
    assert len(set(kept)) == KEPT + 2


def test_controller_knows_only_the_declared_payload(arms):
    reference = arms.swing(0.5)
    errors = []
    for declared, error in ((9.0, 0.0), (8.1, -0.1)):
        model = arms.make_arm(payload={"mass": declared, "com": [0.0, 0.0, -0.2]})
        recording = simulate_point(model, reference, Conditions(payload_mass_error=error))
        errors.append(rms(recording.q - reference.q[::4])[3])
    # The same 9 kg are carried; who believes in 8.1 kg is pulled down by the rest.
    assert errors[0] < 1e-4
    assert errors[1] > 10.0 * errors[0]
    with Simulator(model) as simulator:
        simulator.run(reference, Conditions(), None)
        law = simulator._law(reference)[0]
        simulator.run(reference, Conditions(payload_mass_error=-0.1), None)
        assert simulator._law(reference)[0] is law


def test_noise_has_the_stated_size_and_its_seed(medium, move):
    clean = simulate_point(medium, move)
    one, again, other = (simulate_point(medium, move, seed=seed_of(0, "medium", k)) for k in (1, 1, 2))
    assert np.array_equal(one.tau, again.tau)
    assert not np.array_equal(one.tau, other.tau)
    noise = one.tau - clean.tau
    np.testing.assert_allclose(noise.std(axis=0), medium.torque_noise, rtol=0.15)
    # Seed 0 is a seed, and one of its own.
    zero = simulate_point(medium, move, seed=0)
    assert not np.array_equal(zero.tau, clean.tau)


def test_seeds_depend_on_the_identity_alone():
    states = [
        seed_of(r, *i).generate_state(2).tolist() for r, i in ((0, "ab"), (0, "ba"), (1, "ab"), (0, "abc"))
    ]
    assert len({tuple(s) for s in states}) == 4
    assert seed_of(0, "a", "b").generate_state(1)[0] != seed_of(0, "ab").generate_state(1)[0]
    assert seed_of(3, "x", 7).generate_state(1).tolist() == seed_of(3, "x", 7).generate_state(1).tolist()


def digest(recording: Recording) -> str:
    arrays = (recording.t, recording.q, recording.qd, recording.tau)
    return hashlib.sha256(b"".join(x.tobytes() for x in arrays)).hexdigest()


POINTS = [Conditions((10.0 * k,), 40.0 + k, 0.02 * k) for k in range(3)]


def test_order_and_chunks_change_no_byte(medium, move):
    points = [(move, conditions, seed_of(0, k)) for k, conditions in enumerate(POINTS)]
    together = [digest(r) for r in simulate_points(medium, points)]
    backwards = [digest(r) for r in simulate_points(medium, points[::-1])][::-1]
    alone = [digest(simulate_point(medium, *points[1]))]
    assert together == backwards
    assert alone == together[1:2]


def test_another_process_writes_the_same_bytes(medium, move, tmp_path):
    program = f"""
from pathlib import Path
from wearscope.cycles.base import Reference, load_cycle
from wearscope.robots.model import load_model
from wearscope.simulation.recording import write_recording
from wearscope.simulation.sensors import seed_of
from wearscope.simulation.study import Conditions, simulate_point
model = load_model("medium", Path({str(ROBOTS)!r}))
r = load_cycle("point_to_point").build(model, 0.05, 1e-3)
move = Reference(r.t[:2001], r.q[:2001], r.v[:2001], r.a[:2001])
recording = simulate_point(model, move, Conditions((10.0,), 41.0, 0.02), seed_of(0, 1))
write_recording({str(tmp_path / "b.parquet")!r}, recording, model.joints)
"""
    assert call_python("-c", program).returncode == 0
    recording = simulate_point(medium, move, POINTS[1], seed_of(0, 1))
    write_recording(tmp_path / "a.parquet", recording, medium.joints)
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()


def test_failed_point_does_not_end_the_chunk(medium, move):
    away = Reference(move.t, move.q + 3.0, move.v, move.a)
    results = list(
        simulate_points(medium, [(move, Conditions(), 0), (away, Conditions(), 1), (move, Conditions(), 0)])
    )
    assert isinstance(results[1], SimulationError)
    assert "leaves its limits" in str(results[1])
    assert digest(results[0]) == digest(results[2])


def test_points_that_fit_no_robot_are_refused(medium, move, refuses):
    cases = [
        (move, Conditions(wear=(1.0, 2.0, 3.0, 4.0))),
        (move, Conditions(payload_mass_error=-1.0)),
        (move, Conditions(temperature=20.0)),
        (Reference(move.t, move.q[:, :5], move.v, move.a), Conditions()),
        (Reference(move.t**2, move.q, move.v, move.a), Conditions()),
    ]
    with Simulator(medium) as simulator:
        for reference, conditions in cases:
            refuses(simulator.run, reference, conditions, None)


def test_conditions_of_natural_levels(refuses):
    kinds = {"f": "wear", "w1": "wear", "w3": "temperature", "w4": "dwell", "w5": "payload_mass_error"}
    levels = {"f": 12.5, "w1": 25.0, "w3": 60.0, "w4": 50.0, "w5": -5.0}
    assert make_conditions(levels, kinds) == Conditions((12.5, 25.0), 60.0, -0.05)
    refuses(make_conditions, {"x": 1.0}, {"x": "mood"})


def made_trace(dt=1e-3, count=400):
    t = np.arange(count) * dt
    grid = np.arange(count + 1)[:, None] * dt
    q = np.hstack([np.sin(3.0 * grid), grid**2])
    v = np.hstack([3.0 * np.cos(3.0 * grid), 2.0 * grid])[:-1]
    return Trace(t, q, v, np.column_stack([np.cos(20.0 * t), 5.0 * t]), 0.0 * v)


def test_sensors_quantise_delay_and_scale():
    dt, zero = 1e-3, np.zeros(2)
    trace = made_trace(dt)
    ideal = record(trace, dt, 250.0, zero, zero, zero, zero, None)
    np.testing.assert_array_equal(ideal.t, trace.t[::4])
    np.testing.assert_array_equal(ideal.tau, trace.torque[::4])
    np.testing.assert_allclose(ideal.qd[:, 0], 3.0 * np.cos(3.0 * ideal.t), atol=1e-12)
    real = record(
        trace, dt, 250.0, np.array([1e-3, 0.0]), zero, np.array([0.1, 0.0]), np.array([0.0, 0.01]), None
    )
    steps = real.q[:, 0] / 1e-3
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert np.abs(real.q[:, 0] - ideal.q[:, 0]).max() <= 0.5e-3
    np.testing.assert_array_equal(real.q[:, 1], ideal.q[:, 1])
    # The drive takes the speed from encoder steps 2 ms apart, whatever the simulation's step.
    steps = real.qd[:, 0] / (1e-3 / 2e-3)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    assert np.abs(real.qd[:, 0] - ideal.qd[:, 0]).max() <= 0.5
    np.testing.assert_allclose(real.qd[:, 1], ideal.qd[:, 1], atol=1e-12)
    np.testing.assert_allclose(real.tau[:, 0], 1.1 * ideal.tau[:, 0])
    np.testing.assert_allclose(real.tau[3:, 1], 5.0 * (ideal.t[3:] - 0.01), atol=1e-12)
    # A negative delay leads.
    lead = lag_torque(trace.torque, np.array([0.0, -0.01]), dt)
    np.testing.assert_allclose(lead[:-10, 1], 5.0 * (trace.t[:-10] + 0.01), atol=1e-12)


def test_sample_rate_must_be_whole_steps(refuses):
    assert find_stride(1e-3, 250.0) == 4
    refuses(find_stride, 1e-3, 300.0)
    # Within a millionth of it; and as often as there are steps, but no more.
    assert find_stride(1e-3 * (1.0 + 0.9e-6), 250.0) == 4 and find_stride(1e-3, 1000.0) == 1
    for dt, rate in ((1e-3 * (1.0 + 1.1e-6), 250.0), (1e-3 * (1.0 - 1.1e-6), 250.0), (1e-3, 2000.0)):
        refuses(find_stride, dt, rate)
    check_rate(1e-3, 1000.0 * (1.0 + 0.9e-6))
    refuses(check_rate, 1e-3, 1000.0 * (1.0 + 1.1e-6))


def test_what_lies_between_steps_is_on_lines_and_a_position_on_a_cubic():
    """Of a position t^3 the cubic through positions and speeds is exact; 150 a second are 6.67 ms apart."""
    t = np.arange(101) * 1e-3
    trace = Trace(t[:-1], t[:, None] ** 3, 3.0 * t[:-1, None] ** 2, 5.0 * t[:-1, None], 0.0)
    none = np.zeros(1)
    found = record(trace, 1e-3, 150.0, none, none, none, none, None)
    np.testing.assert_allclose(found.t, np.arange(15) / 150.0)
    np.testing.assert_allclose(found.q[:, 0], found.t**3, atol=1e-15)
    np.testing.assert_allclose(found.tau[:, 0], 5.0 * found.t, atol=1e-12)
    np.testing.assert_allclose(found.qd[:, 0], np.interp(found.t, t, 3.0 * t**2), atol=1e-12)


def test_recording_file(medium, move, tmp_path):
    recording = simulate_point(medium, move, seed=3)
    path = tmp_path / "deep" / "point.parquet"
    write_recording(path, recording, medium.joints, medium.position_units, medium.torque_units)
    assert tables.read_units(path) == {"t": "s", "q": "rad", "qd": "rad/s", "tau": "N m"}
    table = pq.read_table(path)
    assert table.column_names == ["t", "joint", "q", "qd", "tau"]
    assert table.num_rows == recording.q.size and pq.ParquetFile(path).num_row_groups == 1
    back = read_recording(path, medium.joints)
    np.testing.assert_array_equal(back.t, recording.t)
    np.testing.assert_array_equal(back.q, recording.q)
    np.testing.assert_allclose(back.qd, recording.qd, rtol=1e-6, atol=1e-9)
    assert np.abs(back.tau - recording.tau).max() < 1e-3 * medium.torque_noise.min()
    turned = read_recording(path, medium.joints[::-1])
    np.testing.assert_array_equal(turned.q, recording.q[:, ::-1])
    with pytest.raises(InputError, match="holds the joints axis_1"):
        read_recording(path, ["a", "b"])
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InputError, match="not a whole Parquet file"):
        read_recording(path)
    with pytest.raises(InputError, match="no such file"):
        read_recording(tmp_path / "none.parquet")


def test_units_of_mixed_joints_are_named(arms, tmp_path):
    model = arms.make_arm(arms.rub())
    recording = simulate_forward(model, arms.swing(0.1))
    write_recording(tmp_path / "x.parquet", recording, model.joints, model.position_units, model.torque_units)
    assert tables.read_units(tmp_path / "x.parquet")["tau"] == "turn: N m, lift: N m, slide: N, side: N m"


def test_forward_simulation_follows_a_coarse_measured_motion(arms):
    model = arms.make_arm(arms.rub())
    coarse = arms.swing(1.0, 4e-3)
    recording = simulate_forward(model, coarse)
    np.testing.assert_allclose(recording.t, coarse.t, atol=1e-12)
    assert np.abs(recording.q - coarse.q).max() < 5e-3
    # A clock that starts elsewhere and was stored in single precision changes nothing.
    clock = (coarse.t + 7.0).astype(np.float32).astype(float)
    late = Reference(clock, coarse.q, coarse.v, coarse.a)
    np.testing.assert_allclose(simulate_forward(model, late).tau, recording.tau, atol=1e-2)


def test_forward_simulation_tells_models_apart_under_one_controller(arms, refuses):
    lacking = arms.make_arm(arms.rub())
    sprung = arms.make_arm([*arms.rub(), ("turn", "joint_spring", {"stiffness": 80.0})])
    reference = arms.swing(1.0)
    before = simulate_forward(lacking, reference, declared=lacking)
    after = simulate_forward(sprung, reference, declared=lacking)
    change = (after.tau - before.tau)[100:, 0]
    np.testing.assert_allclose(change, 80.0 * after.q[100:, 0], atol=0.1 * 80.0 * 0.6)
    refuses(simulate_forward, lacking, reference, declared=load_model("medium", ROBOTS))


def test_temperature_may_change_over_a_run(arms):
    heat = ("turn", "temperature_dependent_friction", {"coulomb_slope": 1.0, "reference": 40.0})
    model = arms.make_arm([*arms.rub(), heat])
    reference = arms.swing(0.4, 2e-3)
    rise = np.linspace(40.0, 60.0, len(reference.t))[:, None] * np.ones(4)
    cold, warm = (simulate_forward(model, reference, temperature=x) for x in (40.0, rise))
    change = (warm.tau - cold.tau)[:, 0] * np.sign(cold.qd[:, 0])
    moving = np.abs(cold.qd[:, 0]) > 0.3
    np.testing.assert_allclose(change[moving], (rise[:, 0] - 40.0)[moving], atol=1.5)


def test_refined_reference_is_the_motion(arms):
    fine, coarse = arms.swing(0.5, 1e-3), arms.swing(0.5, 4e-3)
    refined = refine_reference(coarse, 1e-3)
    count = len(refined.t)
    for key, atol in (("q", 1e-10), ("v", 1e-7), ("a", 1e-4)):
        np.testing.assert_allclose(getattr(refined, key), getattr(fine, key)[:count], atol=atol)
    assert refine_reference(fine, 1e-3) is fine
