"""Torques of another size, told where the stated body explains little; contacts, which nothing explains."""

import re

import numpy as np
import pytest
from recorded_chain import Bench, chain, rub, torque_of
from urdf_texts import Joint, describe_robot

from wearscope.closed_loop.diagnosis import diagnose


def torque(factors, mass=1.0):
    """Chain of point masses with friction, each joint's torque in a unit of its own."""
    return torque_of(mass, 0.25 * mass, 0.4 * mass, noise=0.02 * mass, times=np.array(factors))


@pytest.mark.parametrize(
    "factors",
    [(1.0, 8.0), *(pytest.param(one, marks=pytest.mark.slow) for one in ((1000.0, 1.0), (0.08, 1.0)))],
)
def test_a_joint_in_another_unit_is_told_with_a_poor_body(tmp_path, factors):
    """The URDF has moments of inertia about the joints and masses that are a third off."""
    bench = Bench(tmp_path, len(factors), seconds=9.0)
    urdf = (tmp_path / "arm.urdf").read_text().replace('mass value="1.2"', 'mass value="1.3"')
    (tmp_path / "arm.urdf").write_text(re.sub(r'i(xx|yy|zz)="1e-05"', r'i\1="0.12"', urdf))
    text = bench.record(torque(factors)).refuse()
    odd = next(k for k, one in enumerate(factors) if one != 1.0)
    said = re.search(r"'tau_j(\d)' is (\S+) times what the rigid body needs", text)
    assert said is not None and int(said[1]) == odd + 1
    assert float(said[2]) == pytest.approx(factors[odd], rel=0.4)


def test_a_torque_in_another_unit_may_be_turned_round_too(tmp_path):
    text = Bench(tmp_path, 1, seconds=9.0).record(torque([-1000.0], mass=1.2)).refuse()
    said = re.search(r"'tau_j1' is (\S+) times what the rigid body needs", text)
    assert said is not None and float(said[1]) == pytest.approx(-1000.0, rel=0.1)
    assert "what is negative is turned round too: give --turn tau_j1;" in text


def test_torques_that_are_too_large_may_be_those_of_positions_in_turns(tmp_path):
    """Next to a spring that the model lacks, a torque's size explains turns as well as turns do."""
    bench = Bench(tmp_path, 2, seconds=9.0, size=0.5)
    bench.record(
        lambda q, v, a, rng, t: torque((1.0, 1.0), mass=1.2)(q, v, a, rng, t) + [[0.0, 2.0]] * (q - 0.3),
        position=lambda q, k: q / (2.0 * np.pi),
    )
    assert "--scale q_j1=6.2832 --scale q_j2=6.2832" in bench.refuse()
    bench.accept("--counts-per-turn", "1")


def test_what_is_said_of_a_turned_torque_in_another_unit_is_enough(tmp_path):
    """Both remedies are printed, and the load's friction of the first joint is then named."""

    def made(q, v, a, rng, t):
        tau = torque((1.0, 1.0), mass=1.2)(q, v, a, rng, t)
        tau[:, 0] += 0.3 * np.abs(chain(q, v, a, 1.2, 0.3)[:, 0]) * np.tanh(v[:, 0] / 0.01)
        return np.array([1.0, -60.0]) * tau

    bench = Bench(tmp_path, 2, seconds=9.0).record(made)
    assert "--torque-constant or --torque-side motor" in (text := bench.refuse())
    assert "what is negative is turned round too: give --turn tau_j2;" in text
    bench.accept("--turn", "tau_j2", "--torque-constant", f"1,{1 / 60}")
    (found,) = diagnose(tmp_path / "d").verdict["verdict"]
    assert (found["joint"], found["effect"]) == ("j1", "load_dependent_friction")
    assert found["parameters"]["coefficient"]["value"] == pytest.approx(0.3, abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "delay"), [(1000.0, 0.04), (-60.0, -0.05)])
def test_another_unit_and_a_delay_are_told_at_once(tmp_path, factor, delay):
    def made(q, v, a, rng, t):
        tau = torque((factor, 1.0), mass=1.2)(q, v, a, rng, t)
        return np.column_stack([np.interp(t - delay, t, x) for x in tau.T])

    bench = Bench(tmp_path, 2, seconds=12.0, frequencies=(0.5, 1.1, 1.9, 2.7))
    text = bench.record(made).refuse()
    said = re.search(r"come (\d+) ms (late|early) .* in addition, 'tau_j1' is (\S+) times", text)
    assert said is not None
    assert int(said[1]) == pytest.approx(1000 * abs(delay), abs=3)
    assert said[2] == ("late" if delay > 0 else "early")
    assert float(said[3]) == pytest.approx(factor, rel=0.1)


def test_a_strong_spring_is_no_other_mount_and_no_other_unit(tmp_path):
    bench = Bench(tmp_path, 1, size=0.5, seconds=9.0)
    weight = 1.2 * 0.3 * 9.81
    bench.record(
        lambda q, v, a, rng, t: chain(q, v, a, 1.2, 0.3) + rub(v, 0.1, 0.1) - 2.5 * weight * (q + 0.4)
    ).accept()


def test_a_leg_that_walks_is_refused(tmp_path):
    """A foot's force on half of the time acts on all joints, and no joint has it for its own."""
    bench = Bench(tmp_path, 3, seconds=9.0, frequencies=(0.4, 0.9, 1.3))

    def walk(q, v, a, rng, t):
        angle = np.cumsum(q, axis=1)
        down = 60.0 * (np.sin(2 * np.pi * 0.7 * t + rng.uniform(0, 6)) > 0) * (1.0 + 0.3 * np.sin(9.0 * t))
        along = np.cumsum((0.3 * np.sin(angle))[:, ::-1], axis=1)[:, ::-1]
        return torque((1.0, 1.0, 1.0))(q, v, a, rng, t) - along * down[:, None]

    assert "as where the base moves or something is touched" in bench.record(walk).refuse()


@pytest.mark.parametrize(("mass", "factor"), [(60.0, -1000.0), (3.0, -12.0)])
def test_a_factor_is_not_shared_with_a_drive_that_moves_as_its_body_does(tmp_path, mass, factor):
    """A level slide: the drive's inertia and the carriage's need the same force."""
    bench = Bench(tmp_path, 1, seconds=9.0, frequencies=(0.5, 1.1, 1.9))
    (tmp_path / "arm.urdf").write_text(
        describe_robot(Joint("j1", "1 0 0", mass, kind="prismatic", limits="-2 2 900 9"))
    )
    bench.record(
        lambda q, v, a, rng, t: factor * mass * (a + rub(v, 2.0, 1.0) + rng.normal(0, 0.05, q.shape))
    )
    said = re.search(r"'tau_j1' is (\S+) times what the rigid body needs", bench.refuse())
    assert said is not None and float(said[1]) == pytest.approx(factor, rel=0.03)


def test_a_stop_of_a_slide_is_no_balancer_with_a_spring_against_it(tmp_path):
    """A cushion from 70 mm on: its force depends on the position, and a balancer turns."""
    bench = Bench(tmp_path, 1, seconds=12.0, frequencies=(0.4, 0.9, 1.3))
    (tmp_path / "arm.urdf").write_text(
        describe_robot(Joint("j1", "1 0 0", 40.0, kind="prismatic", limits="-2 2 9000 9"))
    )

    def press(q, v, a, rng, t):
        cushion = 1e3 * np.maximum(q - 0.5 * q.max(), 0.0)
        return 40.0 * a + rub(v, 30.0, 20.0) + cushion + rng.normal(0, 0.5, q.shape)

    bench.record(press)
    bench.accept()
    diagnosis = diagnose(tmp_path / "d")
    assert {e["effect"] for e in diagnosis.verdict["verdict"]} == {"unknown"}
    assert "gravity_counterbalance" not in set(diagnosis.candidates["effect"])


@pytest.mark.parametrize(("n", "joint", "factor"), [(2, 1, 1.4), (3, 0, 0.7)])
def test_a_torque_constant_that_is_off_is_noted(tmp_path, n, joint, factor):
    factors = np.where(np.arange(n) == joint, factor, 1.0)
    notes = " ".join(Bench(tmp_path, n, seconds=9.0).record(torque(factors, mass=1.2)).accept())
    said = re.search(r"torques at j(\d) are (\S+) times what the stated bodies need", notes)
    assert said is not None and int(said[1]) == joint + 1
    assert float(said[2]) == pytest.approx(factor, rel=0.15)


@pytest.mark.parametrize(("n", "factor"), [(3, 0.72), (2, 1.4)])
def test_a_factor_of_all_torques_is_noted_and_limits_the_verdict(tmp_path, n, factor):
    """Masses that may differ hide a common factor from each joint by itself, and refitted ones take it."""
    bench = Bench(tmp_path, n, seconds=9.0).record(torque([factor] * n, mass=1.2))
    said = re.search(r"torques at all joints are (\S+) times", " ".join(bench.accept()))
    assert said is not None and float(said[1]) == pytest.approx(factor, rel=0.1)
    told = diagnose(tmp_path / "d").verdict["torque_factors"]
    assert told == {f"j{k + 1}": pytest.approx(factor, rel=0.1) for k in range(n)}


@pytest.mark.parametrize(("n", "mass", "told"), [(3, 1.2, False), (2, 1.8, True)])
def test_masses_that_are_all_off_are_no_torque_constant(tmp_path, n, mass, told):
    """Masses and torque constants that are off alike cannot be told apart, which is said."""
    notes = Bench(tmp_path, n, seconds=9.0).record(torque([1.0] * n, mass=mass)).accept()
    assert any("times what the stated bodies need" in one for one in notes) == told


def test_a_spring_that_the_model_lacks_is_no_torque_constant(tmp_path):
    bench = Bench(tmp_path, 1, seconds=9.0, size=0.8)
    bench.record(
        lambda q, v, a, rng, t: (
            chain(q, v, a, 1.2, 0.3) + rub(v, 0.4, 0.4) + 5.0 * (q - 0.5) + rng.normal(0, 0.03, q.shape)
        )
    )
    assert not any("times what the stated bodies need" in one for one in bench.accept())


@pytest.mark.slow
def test_a_mount_on_a_wall_is_told_next_to_currents(tmp_path):
    bench = Bench(tmp_path, 3, seconds=9.0)
    turned = '<link name="w"/><joint name="m" type="fixed"><parent link="w"/><child link="base"/>'
    turned += '<origin rpy="0 1.5708 0"/></joint></robot>'
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(urdf.read_text().replace("</robot>", turned))
    factors = np.array([0.08, 0.08, 0.12])
    text = bench.record(torque(factors, mass=1.2)).refuse()
    # Of a chain in one plane another zero of the first joint is the same as another mount.
    said = re.search(r"give --(?:gravity (\S+?),0,(\S+?)|shift q_j1=(\S+?));", text)
    assert said is not None, text
    angle = float(said[3]) if said[3] else np.arctan2(-float(said[1]), -float(said[2]))
    assert abs(angle) == pytest.approx(np.pi / 2.0, abs=0.12)
    line = ("--shift", f"q_j1={said[3]}") if said[3] else ("--gravity", f"{said[1]},0,{said[2]}")
    text = bench.refuse(*line)
    sizes = re.search(r"are ([\d., ]+) times what the rigid body needs", text)
    assert sizes is not None
    np.testing.assert_allclose([float(one) for one in sizes[1].split(",")], factors, rtol=0.15)
