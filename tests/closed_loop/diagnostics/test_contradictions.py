"""Runs in which a torque acts from outside contradict the others; noise and drifts do not."""

import numpy as np
import pytest
from folders import fit_problem

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.diagnostics.contradictions import find_contradictions


def in_runs(torque, where):
    """A torque in some of the runs."""
    number = iter(range(99))
    return lambda t, q, v, a, rng: torque(t, q, v, a, rng) if next(number) in where else 0.0 * q


def pull(t, q, v, a, rng):
    """A hand that pulls the first joint to an angle, for seconds at a time."""
    there = np.clip(3.0 * np.sin(2.0 * np.pi * t / 5.0), 0.0, 1.0)
    return np.column_stack([-30.0 * there * (q[:, 0] - 1.0), 0.0 * t])


def drag(t, q, v, a, rng):
    """A hand that slows the second joint down."""
    return np.column_stack([0.0 * t, -25.0 * (np.sin(t) > 0.0) * np.tanh(v[:, 1])])


@pytest.mark.parametrize(("torque", "joint", "where"), [(pull, "a", (1,)), (drag, "b", (1, 2))])
def test_runs_with_a_torque_from_outside_are_named_and_nothing_is_confirmed(record, torque, joint, where):
    folder = record(extra_torque=in_runs(torque, where), seed=9, runs=5, duration=12.0)
    verdict = diagnose(folder).verdict
    assert verdict["contradictory_runs"] == [f"runs/r{k}.parquet" for k in where]
    assert verdict["joints"][joint]["state"] == "unexplained"
    assert "contradict each other" in verdict["joints"][joint]["reason"]
    assert not any(e["status"] == "confirmed" for e in verdict["verdict"] if e["joint"] == joint)


def louder(t, q, v, a, rng):
    return 6.0 * rng.standard_normal(q.shape)


def drift(t, q, v, a, rng):
    return 0.1 * np.cumsum(rng.standard_normal(q.shape), axis=0)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(
    ("torque", "where"),
    [(None, ()), (louder, (1,)), (drift, range(5)), (pull, (1,)), (drag, (1, 2))],
    ids=["white", "louder", "drift", "pull", "drag"],
)
def test_noise_is_no_contradiction_and_a_torque_from_outside_is_one(record, pose, torque, where, seed):
    extra = None if torque is None else in_runs(torque, where)
    problem = pose(record(extra_torque=extra, seed=seed, runs=5, duration=10.0))
    model = fit_problem(problem)
    found = find_contradictions(model)
    joint = {pull: 0, drag: 1}.get(torque)
    told = {j: [f"runs/r{k}.parquet" for k in where] for j in [joint] if j is not None}
    assert {j: sorted(one.files) for j, one in found.items()} == told


def test_equal_delays_of_joints_are_the_recorder_s(record):
    delay = 0.006
    planted = [(joint, "time_delay", {"delay": delay}) for joint in (0, 1)]
    verdict = diagnose(record(planted=planted, seed=4, runs=4, duration=8.0)).verdict
    assert verdict["time_delay"]["joints"] == ["a", "b"]
    assert verdict["time_delay"]["seconds"] == pytest.approx(delay, abs=0.001)
    assert {(e["joint"], e["effect"]) for e in verdict["verdict"]} == {
        ("a", "time_delay"),
        ("b", "time_delay"),
    }


def test_a_delay_of_one_joint_is_its_own(record):
    planted = [(0, "time_delay", {"delay": 0.006})]
    verdict = diagnose(record(planted=planted, seed=4, runs=4, duration=8.0)).verdict
    assert verdict["time_delay"] is None
