"""Traits of a recording that come together, that the motions do not tell apart, and that are of some runs."""

import re
import shutil

import numpy as np
import pytest
from recorded_chain import Bench, chain, rub, torque_of


@pytest.mark.parametrize(("n", "joint"), [(2, 1), pytest.param(3, 2, marks=pytest.mark.slow)])
def test_a_sign_and_a_zero_are_told_in_one_sentence_and_taken(tmp_path, n, joint):
    bench, one = Bench(tmp_path, n, 2.0, size=0.5), np.arange(n) == joint
    bench.record(
        torque_of(2.0, 0.2, 0.3, noise=0.02, times=np.where(one, -1.0, 1.0)),
        position=lambda q, k: q - 1.5708 * one,
    )
    said = bench.refuse()
    turn, shift = re.search(r"give --turn (\S+);", said), re.search(r"give --shift q_j(\d)=(\S+?)[; ]", said)
    assert turn is not None and turn[1] == f"tau_j{joint + 1}"
    assert shift is not None and int(shift[1]) == joint + 1
    assert float(shift[2]) == pytest.approx(1.5708, abs=0.02)
    bench.accept("--turn", turn[1], "--shift", f"q_j{shift[1]}={shift[2]}")


@pytest.mark.parametrize(("n", "turned"), [(2, 0), (3, 2)], ids=["alone", "2 of 3"])
def test_a_mount_and_a_zero_of_a_planar_arm_are_told_as_alike(tmp_path, n, turned):
    """The first joint's zero turns all of the arm about gravity, as the mount does."""
    bench, joints = Bench(tmp_path, n, 2.0, size=0.5), np.arange(1, n + 1)
    torque = torque_of(2.0, 0.2, 0.3, noise=0.02, times=np.where(joints == turned, -1.0, 1.0))
    bench.record(torque, position=lambda q, k: q - 1.5708 * (joints == 1))
    said = bench.refuse()
    assert "which these motions do not tell from it" in said
    assert "give --shift q_j1=1.571" in said and "give --gravity -9.81,0,0" in said
    assert re.findall(r"give --turn (\S+);", said) == ([f"tau_j{turned}"] if turned else [])
    bench.accept("--shift", "q_j1=1.571", *(["--turn", f"tau_j{turned}"] if turned else []))
    codes = re.findall(r"--accept '([^']*)'", said)
    assert {"zero q_j1", "sign gravity"} <= set(codes)


@pytest.mark.parametrize(("mass", "loaded"), [(1.5, (1,)), pytest.param(0.8, (0, 2), marks=pytest.mark.slow)])
def test_a_payload_of_some_runs_is_told_with_its_runs(tmp_path, mass, loaded):
    bench, run = Bench(tmp_path, 3, size=0.5, seconds=12.0, runs=4), iter(range(4))

    def torque(q, v, a, rng, t):
        masses = np.full(3, 1.2)
        masses[-1] += mass if next(run) in loaded else 0.0
        return chain(q, v, a, masses, 0.3) + rub(v, 0.3, 0.5) + rng.normal(0, 0.02, q.shape)

    told = [note for note in bench.record(torque).accept() if note.startswith("a payload")]
    assert len(told) == 1
    low, high = (float(one) for one in re.search(r"\((\S+) to (\S+) kg\)", told[0]).groups())
    assert low < mass < high and high - low < 0.5 * mass
    files = re.search(r"better in (.*?)\. If", told[0])
    assert files is not None and files[1] == ", ".join(f"runs/run{k}.parquet" for k in loaded)
    line = re.search(r"payload: {mass: (\S+), com: \[(.*?)\]}", told[0])
    assert line is not None and float(line[1]) == pytest.approx(mass, rel=0.15)
    com = line[2].replace(" ", "")
    given = [word for k in loaded for word in ("--payload-of", f"run{k}.csv={line[1]},{com}")]
    shutil.rmtree(tmp_path / "d")
    assert not [note for note in bench.accept(*given) if note.startswith("a payload")]


@pytest.mark.parametrize("at", [0.3, pytest.param(-0.4, marks=pytest.mark.slow)])
def test_friction_that_depends_on_the_position_is_no_wrong_column(tmp_path, at):
    """Damping that changes along the way looks like a weight's torque that comes early or late."""
    bench = Bench(tmp_path, 1, size=0.5)

    def torque(q, v, a, rng, t):
        damping = 0.4 * np.maximum(0.0, 1.0 + 1.2 * (q - at))
        return chain(q, v, a, 1.2, 0.3) + rub(v, 0.1, damping) + rng.normal(0, 0.01, q.shape)

    assert not [note for note in bench.record(torque).accept() if note.startswith("perhaps")]


def test_another_zero_of_a_single_joint_is_told_with_the_balancer_that_explains_as_much(tmp_path):
    bench = Bench(tmp_path, 1, size=0.7)
    bench.record(torque_of(1.2, 0.1, 0.1, noise=0.01), position=lambda q, k: q - 1.0)
    (told,) = [note for note in bench.accept() if note.startswith("perhaps")]
    found = re.search(r"shifted: {q_j1: (\S+)}", told)
    assert found is not None and float(found[1]) == pytest.approx(1.0, abs=0.03)
    assert "these motions do not tell it from balancer at j1" in told


def test_a_fault_of_all_columns_is_told_though_one_torque_holds_what_no_reading_explains(tmp_path):
    bench = Bench(tmp_path, 4, size=0.4)

    def torque(q, v, a, rng, t):
        tau = torque_of(1.2, 0.2, 0.3, noise=0.02)(q, v, a, rng, t)
        tau[:, 3] += 0.5 * tau[:, 3].std() * np.sin(5.0 * t + rng.uniform(0.0, 6.28))
        return tau[np.maximum(np.arange(len(t)) - 4, 0)]

    assert "the torque channels come 8" in bench.record(torque).refuse()
