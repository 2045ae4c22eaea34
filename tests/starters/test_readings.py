"""What a data set's columns are, told from its recordings: the right reading, from CSV to the answer."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import recorded_chain
import yaml
from changed_fields import changed_fields
from click.testing import CliRunner
from folders import change_runs, find_real
from recorded_chain import Bench, chain, hang, pivot, rub, torque_of
from urdf_texts import describe_robot

from wearscope.checking.dataset import check_dataset
from wearscope.cli.main import wearscope
from wearscope.cli.new import _name_option, _read_columns
from wearscope.closed_loop.diagnosis import diagnose


def slow(*numbers):
    """A case like another one here, with other numbers."""
    return pytest.param(*numbers, marks=pytest.mark.slow)


@pytest.mark.parametrize(("n", "turned"), [slow(3, "tau_j1,tau_j3"), (2, "tau_j2")], ids=["3", "2"])
def test_torque_sensors_that_are_turned_are_all_named_and_turned_in_one_call(tmp_path, n, turned):
    signs = np.array([-1.0 if f"tau_j{k + 1}" in turned else 1.0 for k in range(n)])
    bench = Bench(tmp_path, n, mass=0.4 * n)
    bench.record(torque_of(0.4 * n, noise=0.05, times=signs))
    said = re.search(r"give --turn (\S+);", bench.refuse())
    assert said is not None and said[1] == turned
    bench.accept("--turn", turned)


def test_a_torque_that_is_noise_hides_no_sign_of_the_others(tmp_path):
    """As a joint sensor of a light wrist behind the gear."""
    bench = Bench(tmp_path, 3, 2.0, size=0.5, runs=2)
    own = np.array([-1.0, -1.0, 0.0])
    bench.record(lambda q, v, a, rng, t: own * chain(q, v, a, 2.0, 0.3) + rng.normal(0, 0.05, q.shape))
    assert "opposite sign of what the motion needs" in bench.refuse()


@pytest.mark.parametrize(("n", "mass", "friction"), [(2, 4.0, 3.0), slow(2, 0.2, 0.02)])
def test_torque_without_gravity_is_told_and_taken(tmp_path, n, mass, friction):
    bench = Bench(tmp_path, n, mass)
    weight = mass * 0.3 * 9.81
    bench.record(torque_of(mass, friction, friction, noise=0.003 * weight, gravity=0.0))
    text = bench.refuse()
    assert "the torque has no gravity in it; give --reading without_gravity" in text
    bench.accept("--reading", "without_gravity")
    verdict = diagnose(tmp_path / "d").verdict
    assert verdict["verdict"] == []
    assert verdict["torque"] == {f"j{k + 1}": "without_gravity" for k in range(n)}


@pytest.mark.slow
def test_torque_without_gravity_is_told_where_friction_and_drives_make_most_of_it(tmp_path):
    bench = Bench(tmp_path, 3, 2.0, size=0.5, frequencies=(0.05, 0.11, 0.19))
    bench.record(
        lambda q, v, a, rng, t: (
            chain(q, v, a, 2.0, 0.3, gravity=0.0)
            + 40.0 * a
            + rub(v, 20.0, 40.0)
            + rng.normal(0, 0.5, q.shape)
        )
    )
    assert "the torque has no gravity in it" in bench.refuse()
    bench.accept("--reading", "without_gravity")


def behind_filter(torque, lag, rate):
    """A torque behind a filter of first order, by its recursion."""

    def filtered(*given):
        tau = torque(*given)
        out = tau.copy()
        for k in range(1, len(tau)):
            out[k] = out[k - 1] + (1.0 - np.exp(-1.0 / rate / lag)) * (tau[k] - out[k - 1])
        return out

    return filtered


def shifted(torque, delay):
    """A torque that is recorded late."""
    return lambda q, v, a, rng, t: np.column_stack(
        [np.interp(t - delay, t, x) for x in torque(q, v, a, rng, t).T]
    )


@pytest.mark.parametrize(("n", "lag"), [(2, 0.022), (2, 0.0)])
def test_torques_behind_a_filter_are_noted_with_their_lag(tmp_path, n, lag):
    bench = Bench(tmp_path, n, 2.0, size=0.5, rate=200.0, frequencies=(0.21, 0.43, 0.77, 1.31))
    torque = torque_of(2.0, 1.0, 1.0, noise=0.02)
    torque = behind_filter(torque, lag, 200.0) if lag else torque
    told = re.search(r"follow the motion by about (\d+) ms", " ".join(bench.record(torque).accept()))
    assert (float(told[1]) if told else 0.0) == pytest.approx(1000.0 * lag, rel=0.15)


TURN = 0.5 / np.pi


@pytest.mark.parametrize(
    "recorded", [[TURN] * 2, [1.0, 1.0, 2.0], slow([0.6, 1.0]), slow([2.0] * 2), slow([0.25] * 3)]
)
def test_positions_in_turns_or_before_a_gear_are_told_with_their_factor(tmp_path, recorded):
    bench = Bench(tmp_path, len(recorded), 2.0, size=0.5)
    bench.record(torque_of(2.0, 1.0, 1.0, noise=0.02), position=lambda q, k: q * recorded)
    found = dict(re.findall(r"--scale q_j(\d)=([\d.]+)", bench.refuse()))
    for k, one in enumerate(recorded):
        told = 1e-4 if one == TURN else 0.03
        assert float(found.get(str(k + 1), 1.0)) == pytest.approx(1.0 / one, rel=told), k
    bench.accept(*(part for k, one in found.items() for part in ("--scale", f"q_j{k}={one}")))
    assert diagnose(tmp_path / "d").verdict["verdict"] == []


def test_a_joint_turned_round_in_both_columns_is_told_next_to_a_spring(tmp_path):
    """Friction makes much of the torque, and a spring that nobody declared is at another joint."""
    bench = Bench(tmp_path, 3, 2.0)
    sign = np.array([1.0, 1.0, -1.0])

    def torque(q, v, a, rng, t):
        tau = chain(q, v, a, 2.0, 0.3) + rub(v, 3.0, 3.0) + rng.normal(0, 0.05, q.shape)
        tau[:, 0] -= 20.0 * q[:, 0]
        return sign * tau

    text = bench.record(torque, position=lambda q, k: sign * q).refuse()
    assert "give --turn q_j3,tau_j3;" in text


@pytest.mark.parametrize(("n", "angle"), [(2, 1.5708), slow(3, -0.7854)])
def test_gravity_of_a_robot_that_is_mounted_otherwise_is_told_and_taken(tmp_path, n, angle):
    """The recordings are of a chain that hangs; the URDF has its base turned about its y."""
    bench = Bench(tmp_path, n, 2.0)
    bench.record(torque_of(2.0, 0.2, 0.3, noise=0.02))
    turned = '<link name="w"/><joint name="m" type="fixed"><parent link="w"/><child link="base"/>'
    turned += f'<origin rpy="0 {angle} 0"/></joint></robot>'
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf.read_text().replace("</robot>", turned))
    said = re.search(r"give --gravity (\S+?);", bench.refuse())
    assert said is not None
    want = 9.81 * np.array([-np.sin(angle), 0.0, -np.cos(angle)])
    np.testing.assert_allclose([float(one) for one in said[1].split(",")], want, atol=0.3)
    bench.accept("--gravity", said[1])


def test_another_zero_of_the_last_joint_is_told_with_its_rival(tmp_path):
    """A turned last link is a link with its weight elsewhere."""
    bench = Bench(tmp_path, 3, 2.0)
    bench.record(torque_of(2.0, 0.2, 0.3, noise=0.02), position=lambda q, k: q - [0.0, -0.8, np.pi])
    said = re.findall(r"--shift (q_j\d)=(\S+?)[; ]", bench.refuse())
    assert [one for one, _ in said] == ["q_j2", "q_j3"]
    assert [float(one) for _, one in said] == pytest.approx([-0.8, np.pi], abs=0.04)
    (told,) = [line for line in bench.accept("--shift", f"q_j2={said[0][1]}") if "another zero" in line]
    assert told.startswith("perhaps q_j3") and "do not tell it from payload" in told


@pytest.mark.parametrize("zero", [0.25, slow(-0.2)])
def test_a_small_error_of_a_zero_is_told_with_its_size(tmp_path, zero):
    bench = Bench(tmp_path, 3, 2.0, size=0.5)
    bench.record(torque_of(2.0, 0.2, 0.3, noise=0.02), position=lambda q, k: q - [0.0, zero, 0.0])
    ((name, size),) = re.findall(r"--shift (q_j\d)=(\S+?)[; ]", bench.refuse())
    assert name == "q_j2" and float(size) == pytest.approx(zero, abs=0.03)


@pytest.mark.parametrize(("coulomb", "viscous"), [(0.2, 0.3), (8.0, 4.0)])
def test_positions_of_another_zero_are_told_and_taken_though_friction_be_most(tmp_path, coulomb, viscous):
    bench = Bench(tmp_path, 2, 2.0)
    torque = torque_of(2.0, coulomb, viscous, noise=0.02)
    bench.record(torque, position=lambda q, k: q - [0.0, np.pi / 2.0])
    ((name, size),) = re.findall(r"--shift (q_j\d)=(\S+?)[; ]", bench.refuse())
    assert name == "q_j2" and float(size) == pytest.approx(np.pi / 2.0, abs=0.04)
    bench.accept("--shift", f"{name}={size}")


def test_one_joint_in_degrees_makes_the_others_rad_that_were_read_as_degrees(tmp_path):
    bench = Bench(tmp_path, 2, 2.0)
    bench.record(torque_of(2.0, 0.2, 0.3, noise=0.02), position=lambda q, k: q * [1.0, 180.0 / np.pi])
    ((name, size),) = re.findall(r"--scale (q_j\d)=(\S+?)[; ]", bench.refuse())
    assert name == "q_j1" and float(size) == pytest.approx(180.0 / np.pi, rel=1e-4)
    bench.accept("--scale", f"{name}={size}")


@pytest.mark.parametrize(("n", "mass", "friction"), [(1, 0.4, 1.0), (3, 20.0, 0.6)])
def test_torques_without_their_sign_are_told_so(tmp_path, n, mass, friction):
    bench = Bench(tmp_path, n, mass)
    rubs = friction * mass * 0.3 * 9.81
    bench.record(lambda q, v, a, rng, t: np.abs(chain(q, v, a, mass, 0.3) + rub(v, rubs, rubs)))
    names = [f"'tau_j{k + 1}'" for k in range(n)]
    said = f"{', '.join(names[:-1])} and {names[-1]} are" if n > 1 else "'tau_j1' is"
    assert f"{said} never negative, as " in bench.refuse()


def test_one_torque_without_its_sign_among_right_ones_is_told(tmp_path):
    bench = Bench(tmp_path, 2, 2.0)

    def torque(q, v, a, rng, t):
        tau = torque_of(2.0, 2.0, 1.0, noise=0.02)(q, v, a, rng, t)
        tau[:, 1] = np.abs(tau[:, 1])
        return tau

    assert ": 'tau_j2' is never negative, as a torque without sign" in bench.record(torque).refuse()


@pytest.mark.parametrize(("mass", "friction", "lacks"), [(2.0, 0.05, 0.3), slow(0.3, 0.35, 0.2)])
def test_a_shoulder_that_always_carries_its_load_has_its_sign(tmp_path, mass, friction, lacks):
    """The model lacks a ripple that is much of what the torque varies by."""
    bench, weight = Bench(tmp_path, 1, mass, seconds=20.0), mass * 0.3 * 9.81
    lowest = []

    def torque(q, v, a, rng, t):
        tau = chain(q + 1.4, v, a, mass, 0.3) + rub(v, friction * weight, 0.0)
        lowest.append(float((tau + lacks * weight * np.sin(9.0 * (q + 1.4))).min()))
        return tau + lacks * weight * np.sin(9.0 * (q + 1.4))

    notes = bench.record(torque, position=lambda q, k: q + 1.4).accept()
    assert min(lowest) > 0.0 and not any("never negative" in note for note in notes)


@pytest.mark.parametrize(("mass", "friction", "lost"), [(5.0, 0.05, False), (80.0, 1.4, True)])
def test_a_lift_has_its_sign_unless_friction_alone_turns_its_torque(tmp_path, mass, friction, lost):
    bench, weight = Bench(tmp_path, 1, mass, seconds=20.0), mass * 9.81
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf.read_text().replace("revolute", "prismatic").replace("0 -1 0", "0 0 1"))

    def torque(q, v, a, rng, t):
        rubs = rub(v, friction * weight, friction * weight)
        tau = mass * (a + 9.81) + rubs + 0.2 * weight * np.sin(40.0 * q)
        assert lost == (tau.min() < 0.0)
        return np.abs(tau)

    bench.record(torque)
    if lost:
        assert "'tau_j1' is never negative, as a torque without sign" in bench.refuse("--position-unit", "m")
    else:
        notes = bench.accept("--position-unit", "m")
        assert not any("never negative" in note for note in notes)


@pytest.mark.parametrize("zeroed", [True, False])
def test_positions_that_count_from_the_start_of_each_run_are_noted(tmp_path, zeroed):
    bench = Bench(tmp_path, 2, 2.0)
    home = np.array([0.6, -0.5])
    bench.record(
        lambda q, v, a, rng, t: chain(q + home, v, a, 2.0, 0.3) + rub(v, 4.0, 4.0),
        position=lambda q, k: q - q[0] if zeroed else q + home,
    )
    notes = bench.accept(*(("--accept", "zero q_j1", "--accept", "zero q_j2") if zeroed else ()))
    assert any("all positions are 0 at the start of every run" in note for note in notes) == zeroed


def test_zeros_before_a_recording_begins_are_no_zero_of_its_positions(tmp_path):
    bench, home = Bench(tmp_path, 1, 2.0), 1.4
    late = np.arange(int(bench.seconds * bench.rate))[:, None] > bench.rate
    bench.record(
        lambda q, v, a, rng, t: late * (2.4 * chain(q + home, v, a, 2.0, 0.3) + rub(v, 4.0, 4.0)),
        position=lambda q, k: late * (q + home),
    )
    notes = " ".join(bench.accept())
    assert "the rows before it are cut off" in notes and "at the start of every run" not in notes


def test_sizes_of_columns_are_given_in_one_option_or_in_several():
    assert _read_columns("shift", ()) == {}
    both = {"q_a": 1.5, "q_b": -2.0}
    assert (
        both == _read_columns("shift", ("q_a=1.5,q_b=-2",)) == _read_columns("shift", ("q_a=1.5", "q_b=-2"))
    )


def test_torque_of_inertia_alone_has_neither_gravity_nor_friction(tmp_path):
    bench = Bench(tmp_path, 2, 4.0)
    bench.record(torque_of(4.0, noise=0.02, gravity=0.0))
    assert "neither gravity nor friction" in bench.refuse()


@pytest.mark.parametrize(("n", "mass"), [slow(2, 4.0), (1, 1.0)])
def test_torque_behind_the_gear_is_taken_and_said_to_be(tmp_path, n, mass):
    bench = Bench(tmp_path, n, mass)
    bench.record(torque_of(mass, noise=0.004 * mass))
    notes = bench.accept()
    assert any("no friction to be seen in this torque" in note for note in notes)
    verdict = diagnose(tmp_path / "d").verdict
    assert set(verdict["torque"].values()) == {"link"} and verdict["verdict"] == []


@pytest.mark.parametrize("n", [2, slow(3)])
def test_torque_behind_the_gear_lacks_the_rotors_that_are_declared(tmp_path, n):
    """It is no torque of another size, and its positions are not before a gear."""
    bench = Bench(tmp_path, n, 0.5)
    bench.record(torque_of(0.5, noise=0.002)).accept()
    with changed_fields(tmp_path / "d" / "dataset.yaml") as fields:
        fields["declared_effects"] = ["rigid_body", "rotor_inertia", "coulomb", "viscous"]
        fields["robot"]["rotor_inertia"] = [1.0] * n
    found = check_dataset(tmp_path / "d")
    said = [note for note in found.notes if re.search("scale|times what|of this torque|friction to be", note)]
    assert not found.problems and len(said) == 1 and "no friction to be seen in this torque" in said[0]


MOTOR, BELT = (0.17, 0.08, "'tau_j1'.*", 0.1), (0.3, 0.3, "torques at all joints", 0.02)


@pytest.mark.parametrize(
    ("n", "mass", "ratio", "unit", "drive"),
    [
        slow(3, 0.6, 6.33, 1.0, MOTOR), (2, 0.6, 9.0, np.pi / 180, MOTOR),
        (2, 0.6, 1.55, 1.0, BELT), slow(3, 5.0, 0.5, 1.0, BELT),
    ],
)  # fmt: skip
def test_positions_and_torques_before_a_gear_are_told_with_both_factors(
    tmp_path, n, mass, ratio, unit, drive
):
    """Of motors of a leg's joints, read as degrees where they go far; and before belts, all alike."""
    coulomb, viscous, torques, near = drive
    bench = Bench(tmp_path, n, mass, size=0.5, seconds=20.0)
    torque = torque_of(mass, mass * coulomb, mass * viscous, noise=0.01 * mass, times=1.0 / ratio)
    said = bench.record(torque, position=lambda q, k: ratio * unit * q).refuse("--position-unit", "rad")
    found = [float(one) for one in re.findall(r"--scale q_j\d=([\d.]+)", said)]
    assert found == pytest.approx([1.0 / (ratio * unit)] * n, rel=near)
    told = re.search(rf"in addition, {torques} are (\S+) times", said)
    assert told is not None and float(told[1]) == pytest.approx(1.0 / ratio, rel=1.5 * near)


@pytest.mark.parametrize(
    ("n", "mass", "factor", "size"),
    [(2, 2.0, 0.5, 0.45), slow(4, 10.0, 2.0, 0.45), slow(3, 20.0, 1.0, 0.45), (2, 3.0, 1.0, 0.7)],
)
def test_a_scale_of_positions_is_told_although_a_balancer_is_missing(tmp_path, n, mass, factor, size):
    bench, weight = Bench(tmp_path, n, mass, size=size, seconds=20.0), mass * 0.3 * 9.81

    def torque(q, v, a, rng, t):
        tau = chain(q, v, a, mass, 0.3) + rub(v, 0.2 * weight, 0.2 * weight)
        tau[:, 0] -= 0.45 * n * (n + 1) * weight * np.sin(q[:, 0])
        tau[:, 1] += weight * np.sin(5.0 * q[:, 1])
        return tau + rng.normal(0, 0.01 * weight, q.shape)

    bench.record(torque, position=lambda q, k: factor * q)
    if factor == 1.0:
        assert not any("multiplied by" in note for note in bench.accept("--position-unit", "rad"))
        return
    found = re.findall(r"--scale q_j\d=([\d.]+)", bench.refuse("--position-unit", "rad"))
    assert [float(one) for one in found] == pytest.approx([1.0 / factor] * n, rel=0.05)


def test_a_small_motion_tells_no_factor_of_positions_next_to_another_of_torques(tmp_path):
    bench = Bench(tmp_path, 1, 2.0, size=0.6, seconds=20.0)
    bench.record(torque_of(2.0, 1.2, 1.2, noise=0.02, times=0.5), position=lambda q, k: 2.0 * q)
    told = " ".join(bench.accept("--position-unit", "rad"))
    assert "perhaps 'q_j1' fits the URDF where multiplied by" in told or "perhaps 'tau_j1'" in told


@pytest.mark.parametrize(("n", "mass", "factor"), [(1, 0.5, 0.29), slow(3, 20.0, 3.5), (2, 4.0, 3.7)])
def test_torques_nearly_four_times_too_large_or_small_are_noted(tmp_path, n, mass, factor):
    bench, rubs = Bench(tmp_path, n, mass), 0.5 * mass
    bench.record(torque_of(mass, rubs, rubs, times=factor))
    told = re.search(r"all joints are (\S+) times what the stated bodies", " ".join(bench.accept()))
    assert told is not None and float(told[1]) == pytest.approx(factor, rel=0.03)


@pytest.mark.parametrize(
    ("mass", "share", "falls"),
    [(1.6, 0.30, False), (1.6, 0.35, True), slow(12.0, 0.2, False), slow(0.3, 0.45, True)],
)
def test_friction_of_the_load_is_no_delay(tmp_path, mass, share, falls):
    def torque(q, v, a, rng, t):
        load = chain(q, v, a, mass, 0.3)
        slip = 0.3 + 0.7 * np.exp(-np.abs(v)) if falls else 1.0
        own = rub(v, 0.003 * mass, 0.03 * mass)
        return (
            load + share * slip * np.abs(load) * np.tanh(v / 0.05) + own + rng.normal(0, 0.01 * mass, v.shape)
        )

    Bench(tmp_path, 1, mass, size=0.6, rate=180.0, runs=4).record(torque).accept()


def yield_first(v, coulomb, way, rate):
    """Friction that builds up over a way after each reversal (Dahl), step by step and implicit."""
    z = np.zeros_like(v)
    for k in range(1, len(v)):
        z[k] = (z[k - 1] + v[k] / rate / way) / (1.0 + np.abs(v[k]) / rate / way)
    return coulomb * z


@pytest.mark.parametrize(("n", "way", "late"), [(3, 3e-4, 0.0), slow(2, 1e-3, 0.0), (2, 3e-4, 0.04)])
def test_friction_that_builds_up_after_a_reversal_is_no_delay(tmp_path, n, way, late):
    """A gear's teeth yield before they slip. A true delay next to it has its own size."""

    def torque(q, v, a, rng, t):
        own = yield_first(v, 1.5, way, 200.0) + 0.5 * v + rng.normal(0, 0.02, v.shape)
        return chain(q, v, a, 1.2, 0.3) + own

    bench = Bench(tmp_path, n, 1.2, size=0.5, rate=200.0, runs=4)
    bench.record(shifted(torque, late) if late else torque)
    if late:
        told = re.search(r"come (\S+) ms late", bench.refuse())
        assert told is not None and float(told[1]) == pytest.approx(1000.0 * late, abs=4.0)
    else:
        assert "follow the motion" not in " ".join(bench.accept())


def dwell(rng, t, n, size, frequencies):
    """Moves between places, with a rest after each, as `recorded_chain.move` takes them."""
    part, rest, parts = 1.2, 0.5, int(t[-1] / 1.7) + 1
    places = size * rng.uniform(-2.0, 2.0, (parts + 1, n))
    k = np.minimum((t / (part + rest)).astype(int), parts - 1)
    s = np.clip((t - k * (part + rest)) / part, 0.0, 1.0)[:, None]
    way = places[k + 1] - places[k]
    q = places[k] + way * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    v = way / part * 30.0 * s**2 * (1.0 - s) ** 2
    return q, v, way / part**2 * 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s)


@pytest.mark.parametrize("viscous", [4.0, slow(8.0)])
def test_a_delay_is_no_filter_where_joints_rest(tmp_path, monkeypatch, viscous):
    """The torque is at rest later than the positions are; a coarse encoder makes the rests longer."""
    monkeypatch.setattr(recorded_chain, "move", dwell)

    def torque(q, v, a, rng, t):
        own = yield_first(v, 1.0, 3e-4, 50.0) + viscous * v
        return chain(q, v, a, 1.2, 0.3) + own + rng.normal(0, 0.05, v.shape)

    bench = Bench(tmp_path, 2, 1.2, size=0.3, runs=4, seconds=20.0)
    bench.record(shifted(torque, 0.08), position=lambda q, k: np.round(q / 3e-3) * 3e-3)
    told = re.search(r"come (\S+) ms late", bench.refuse())
    assert told is not None and float(told[1]) == pytest.approx(80.0, abs=6.0)


def test_joints_that_move_in_turn_are_all_weighed(tmp_path, monkeypatch):
    """A speed column of another unit is told, as one of all joints that move at once is."""
    n = 6

    def take_turns(rng, t, n, size, frequencies):
        own = np.minimum(n * t / t[-1], n - 1).astype(int)[:, None] == np.arange(n)
        way = t[-1] / n
        s = (t[:, None] - np.arange(n) * way) / way
        q, v, a = (size * x for x in move_there_and_back(np.clip(s, 0.0, 1.0), way))
        return q, v * own, a * own

    monkeypatch.setattr(recorded_chain, "move", take_turns)
    bench = Bench(tmp_path, n, size=0.5, seconds=36.0).record(
        torque_of(1.2, 0.3, 0.4, noise=0.02), speed=60.0
    )
    assert "column 'qd_j1' is 60 times the slope of 'q_j1'" in bench.refuse()


def move_there_and_back(s, way):
    """Position, speed and acceleration of a move to 1 and back, over the share s of the time `way` [s]."""
    w = 2.0 * np.pi
    q = 0.5 * (1.0 - np.cos(w * s))
    return q, 0.5 * w / way * np.sin(w * s), 0.5 * (w / way) ** 2 * np.cos(w * s)


def ripple(q, size):
    """Torque over the joint's own turn, which intake's fit has not."""
    return size * (np.sin(9.0 * q) + np.cos(13.0 * q))


@pytest.mark.parametrize(
    ("n", "size", "delay"),
    [(2, 1.2, 0.04), slow(3, 3.0, -0.05), slow(2, 1.2, 0.0), (1, 0.0, -0.06), (1, 0.0, 0.035)],
)
def test_a_delay_is_told_although_the_model_lacks_much(tmp_path, n, size, delay):
    """What the ripple leaves is more than what the delay does."""
    frequencies = (0.21, 0.43, 0.77, 1.1) if size else (0.5, 1.1, 1.9, 2.7)
    bench = Bench(tmp_path, n, size=0.5 if size else 0.3, frequencies=frequencies)
    bench.record(shifted(lambda q, *given: torque_of(1.2, 0.4, 0.3)(q, *given) + ripple(q, size), delay))
    if not delay:
        bench.accept("--accept", "unrelated tau")
        return
    told = re.search(r"come (\d+) ms (late|early)", bench.refuse())
    assert told is not None and told[2] == ("late" if delay > 0 else "early")
    assert abs(int(told[1]) - 1000 * abs(delay)) <= 6


@pytest.mark.parametrize(("n", "lag"), [(2, 0.05), slow(2, 0.08)])
def test_torques_behind_a_slow_filter_are_told_as_such(tmp_path, n, lag):
    bench = Bench(tmp_path, n, size=0.5, rate=100.0, frequencies=(0.21, 0.43, 0.77, 1.1))
    said = bench.record(behind_filter(torque_of(1.2, 0.4, 0.3, noise=0.05), lag, 100.0)).refuse()
    told = re.search(r"smoothed over about (\d+) ms, as behind a low-pass filter", said)
    assert told is not None and int(told[1]) == pytest.approx(1000.0 * lag, rel=0.15)


def test_every_line_of_a_refusal_is_taken(tmp_path):
    """Two refusals of one data set: what each prints is given, and in the end it is taken."""
    early = shifted(torque_of(1.0, 0.1, 0.3, noise=0.02), -0.06)
    bench = Bench(tmp_path, 1, 1.0, runs=4, seconds=20.0, frequencies=(0.5, 1.1, 1.9, 2.7))
    bench.record(lambda *given: np.clip(early(*given), -2.0, 2.0))
    options: list[str] = []
    for _ in range(5):
        done = bench.take(*options)
        if done.exit_code == 0:
            break
        codes = re.findall(r"--accept '([^']*)'", str(done.exception))
        assert codes
        options = [word for code in codes for word in ("--accept", code)]
    assert done.exit_code == 0 and options


def test_a_line_with_several_codes_is_one_that_the_command_takes():
    told = 'd: late; if it is right as it is, write "accept: [clipped tau_a, late tau]" in dataset.yaml.'
    assert _name_option(told).endswith("give --accept 'clipped tau_a' --accept 'late tau'.")


@pytest.mark.parametrize("order", [(1, 2, 0), (2, 0, 1)])
def test_joints_in_another_order_are_told_with_options_that_name_all_columns(tmp_path, order):
    masses, order = np.array([2.0, 1.2, 0.5]), list(order)

    def torque(q, v, a, rng, t):
        return (chain(q, v, a, masses, 0.3) + rub(v, 0.2, 0.1) + rng.normal(0, 0.02, q.shape))[:, order]

    bench = Bench(tmp_path, 3, 1.0, size=0.6)
    (tmp_path / "arm.urdf").write_text(
        describe_robot(*(pivot(f"j{k + 1}", -0.3 if k else 0, m, -0.3) for k, m in enumerate(masses)))
    )
    told = bench.record(torque, position=lambda q, k: q[:, order]).refuse()
    where = [order.index(k) + 1 for k in range(3)]
    lists = [",".join(f"{kind}{k}" for k in where) for kind in ("q", "tau")]
    assert f"give --position '{lists[0]}' --torque '{lists[1]}'" in told
    bench.accept("--position", lists[0], "--torque", lists[1])


@pytest.mark.parametrize("rates", [(183, 187, 191), slow((20, 21, 22))])
def test_rates_of_one_recorder_are_brought_to_one(tmp_path, rates):
    def clock(k):
        rng = np.random.default_rng(k)
        return np.cumsum(rng.uniform(0.7, 1.3, 14 * rates[k]) / rates[k])

    bench = Bench(tmp_path, 1, 0.8, size=0.6).record(torque_of(0.8, 0.3, 0.1, noise=0.02), clock)
    assert any("Hz and brought to" in note for note in bench.accept())


def test_recordings_of_several_rates_are_averaged_to_the_lowest(tmp_path):
    def torque(q, v, a, rng, t):
        tau = chain(q, v, a, 0.8, 0.3) + rub(v, 0.3, 0.1)
        return tau + 0.3 * np.abs(chain(q, v, a, 0.8, 0.3)) * np.tanh(v / 0.01) + rng.normal(0, 0.02, q.shape)

    rates = (400.0, 100.0, 250.0)
    bench = Bench(tmp_path, 1, 0.8, size=0.6)
    notes = bench.record(torque, lambda k: np.arange(14 * rates[k]) / rates[k]).take().output
    assert "sample rate: 100 Hz" in notes and "400 Hz, averaged to 100 Hz" in notes
    (found,) = diagnose(tmp_path / "d").verdict["verdict"]
    assert found["effect"] == "load_dependent_friction" and found["status"] == "confirmed"
    assert found["parameters"]["coefficient"]["value"] == pytest.approx(0.3, abs=0.02)
    assert "give --rate 100, or leave it out" in str(bench.take("--name", "e", "--rate", "250").exception)


@pytest.mark.parametrize(("far", "unit"), [slow(7.9, 1.0), (8.5, 1.0), (8.5, 180 / np.pi)])
def test_a_data_set_has_one_unit(tmp_path, far, unit):
    """One of the recordings goes further than a turn: all are in rad, or all in degrees."""

    def reach(q, k):
        return unit * q / np.abs(q).max() * (far if k == 2 else 2.9)

    bench = Bench(tmp_path, 1, 0.6, seconds=20.0)
    # Torques are of no matter to the unit: the columns are asked before they are.
    bench.record(torque_of(0.6), position=reach)
    done = bench.take("--accept", "unrelated tau")
    text = done.output + str(done.exception)
    assert ("as deg, by their size" in text) == (unit != 1.0)


def test_a_joint_without_limits_says_nothing_about_the_unit(tmp_path):
    """A wheel turns twice as far as two turns in one of the recordings; the arm stays within a radian."""
    bench = Bench(tmp_path, 2, 0.6, seconds=20.0)
    urdf = tmp_path / "arm.urdf"
    arm, wheel = urdf.read_text().rsplit('type="revolute"', 1)
    urdf.write_text(f'{arm}type="continuous"{wheel}')

    def roll(q, k):
        return q * [1.0, (26.0 if k == 2 else 3.0) / np.abs(q[:, 1]).max()]

    bench.record(torque_of(0.6), position=roll)
    done = bench.take("--accept", "unrelated tau")
    text = done.output + str(done.exception)
    assert "positions are taken as rad" in text and "deg" not in text


@pytest.mark.parametrize("toggles", [False, True])
@pytest.mark.parametrize(("count", "tick"), [(3.83e-4, 0.0134), slow(8e-5, 0.002)])
def test_a_joint_that_rests_does_not_count(tmp_path, toggles, count, tick):
    bench = Bench(tmp_path, 2, 0.5, size=0.2, rate=50.0)

    def torque(q, v, a, rng, t):
        moves = np.column_stack([q[:, 0], 0 * t]), np.column_stack([v[:, 0], 0 * t])
        tau = chain(*moves, np.column_stack([a[:, 0], 0 * t]), 0.5, 0.3) + rub(moves[1], 0.4, 0.3)
        tau[:, 1] = np.where(np.arange(len(t)) % 97 < 60, -tick, -3 * tick)
        return np.round(tau / tick) * tick

    def hold(q, k):
        rest = np.full(len(q), -127 * count)
        if toggles:
            rest[120 + 10 * k :] -= count
        return np.column_stack([np.round(q[:, 0] / count) * count, rest])

    bench.record(torque, position=hold).accept()


def test_a_gripper_that_holds_one_position_and_one_torque_is_taken(tmp_path):
    bench = Bench(tmp_path, 2, 0.5)

    def torque(q, v, a, rng, t):
        still = np.column_stack([x[:, 0] for x in (q, v, a)])
        tau = chain(*(np.column_stack([x, 0 * t]) for x in still.T), 0.5, 0.3) + rub(v, 0.2, 0.3)
        return np.column_stack([tau[:, 0] + rng.normal(0, 0.01, len(t)), 0 * t + 0.0065])

    bench.record(torque, position=lambda q, k: np.column_stack([q[:, 0], 0 * q[:, 0]])).accept()


def test_joints_that_the_columns_have_are_proposed_and_found(tmp_path):
    bench = Bench(tmp_path, 3, 0.5)
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf.read_text().replace('name="j', 'name="arm_'))
    hang(urdf, "finger", -0.3, "l3")
    bench.record(torque_of(0.5, 0.1, 0.1))
    for k in range(3):
        file = tmp_path / f"run{k}.csv"
        head, rest = file.read_text().split("\n", 1)
        head = head.replace("tau", "effort_arm_").replace("q", "position_arm_")
        file.write_text(head + "\n" + rest)
    plain = urdf.read_text()
    hang(urdf, "wheel", 0.2, "base")
    assert "--joints arm_1,arm_2,arm_3" in bench.refuse()
    urdf.write_text(plain)
    text = bench.take("--joints", "arm_1,arm_2").output
    assert "position: position_arm_1 to position_arm_2" in text
    shutil.rmtree(tmp_path / "d", ignore_errors=True)
    done = bench.take()
    assert done.exit_code == 0 and "finger: left out, as a hand behind arm_3" in done.output


def test_a_gripper_in_the_urdf_has_no_numbered_column(tmp_path):
    bench = Bench(tmp_path, 2, 0.5)
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf.read_text().replace('name="j', 'name="arm'))
    hang(urdf, "finger", -0.3, "l2")
    bench.record(torque_of(0.5, 0.1, 0.1))
    done = bench.take()
    assert done.exit_code == 0 and "finger: left out, as a hand behind arm2" in done.output
    shutil.rmtree(tmp_path / "d", ignore_errors=True)
    thumb = '<link name="t"/><joint name="thumb" type="revolute"><parent link="l2"/><child link="t"/>'
    thumb += '<limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="finger"/></joint></robot>'
    urdf.write_text(urdf.read_text().replace("</robot>", thumb))
    done = bench.take()
    assert done.exit_code == 0 and "finger: left out and locked at 0, as other joints follow" in done.output
    assert yaml.safe_load((tmp_path / "d/dataset.yaml").read_text())["robot"]["joints"] == ["arm1", "arm2"]


def test_sessions_payloads_and_tests_by_options(tmp_path):
    bench = Bench(tmp_path, 1, 1.0, size=0.5, runs=4)
    bench.record(torque_of(1.0, 0.1, 0.1, noise=0.01))
    bench.accept(
        "--test", "run2.csv", "--test", "run3.csv", "--session", "run1.csv=monday",
        "--payload-of", "run0.csv=0.001,0,0,-0.1",
    )  # fmt: skip
    text = (tmp_path / "d" / "dataset.yaml").read_text()
    assert text.count("use: test") == 2 and "session: monday" in text
    assert "run0.parquet, use: train, payload: {mass: 0.001, com: [0, 0, -0.1]}" in text


def test_a_torque_that_does_not_count(tmp_path):
    """The second joint moves the first one's load; its own torque is nonsense and takes no part."""
    Bench(tmp_path, 2, 1.0).record(torque_of(1.0, 0.2, 0.2, noise=0.02)).accept()
    file = tmp_path / "d" / "dataset.yaml"
    file.write_text(file.read_text() + "torque: {j2: none}\n")
    change_runs(tmp_path / "d", lambda table: table.drop(columns="tau_j2"))
    found = diagnose(tmp_path / "d")
    assert found.verdict["torque"] == {"j1": "motor", "j2": "none"}
    assert found.verdict["verdict"] == []
    assert [note for note in found.verdict["notes"] if "j2" in note] == [
        "j2: torque does not count, as 'torque: none' says."
    ]
    file.write_text(file.read_text().replace("{j2: none}", "none"))
    assert any("'none' at every joint" in one for one in check_dataset(tmp_path / "d").problems)


def test_friction_of_an_axis_without_its_sign_is_told(tmp_path):
    folder = Path(shutil.copytree(find_real("emps"), tmp_path / "d", copy_function=shutil.copyfile))
    folder.chmod(0o755)
    (folder / "runs").chmod(0o755)
    change_runs(folder, lambda table: table.assign(tau_slide=table["tau_slide"].abs()))
    (problem,) = check_dataset(folder).problems
    assert "'tau_slide' is never negative, as a torque without sign" in problem


def test_a_double_pendulum_with_an_idle_joint_is_taken(tmp_path):
    place = find_real("double_pendulum")
    files = [str(file) for file in sorted(place.glob("*.csv"))]
    options = ["--urdf", str(place / "acrobot.urdf"), "--name", "d", "--in", str(tmp_path)]
    done = CliRunner().invoke(wearscope, ["new", "dataset", *files, *options])
    assert done.exit_code == 0, done.output
    assert any("is not driven" in note for note in check_dataset(tmp_path / "d").notes)


def spoil(folder, run, change):
    """Change the columns (N, 1 + 2 n) of one recording: time, positions, torques."""
    file = folder / f"run{run}.csv"
    header = file.read_text().splitlines()[0]
    np.savetxt(
        file, change(np.loadtxt(file, delimiter=",", skiprows=1)), "%.8g", ",", header=header, comments=""
    )


@pytest.mark.parametrize("push", [0.0, 1.5])
def test_one_wrong_run_is_told_with_a_remedy_of_its_own(tmp_path, push):
    """No reading of all runs explains it; another run may be pushed, which its reading need not suit."""
    bench = Bench(tmp_path, 2, 1.2).record(torque_of(1.2, 0.1, 0.1, noise=0.02))
    spoil(tmp_path, 1, lambda x: x * [1, 1, 1, 1, -1])
    spoil(tmp_path, 2, lambda x: x + np.outer(np.sin(0.9 * x[:, 0]) ** 2, [0, 0, 0, push, 0]))
    said = bench.refuse()
    assert "run1.csv: column 'tau_j2' has the opposite sign" in said
    assert "correct this run's file, or leave the run out;" in said and "--turn" not in said
