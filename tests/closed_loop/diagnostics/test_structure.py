"""What is left at a joint: noise with a memory is noise; what repeats or depends on a signal is not."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from folders import fit_problem
from noises import coloured, drift, heavy, slow, white

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.diagnostics.residual_tests import (
    Residual,
    compare_noise,
    compare_runs,
    see_motion,
    see_test_error,
)
from wearscope.closed_loop.diagnostics.structure import judge_joints
from wearscope.closed_loop.inference.answer import Left
from wearscope.closed_loop.inference.policy import Policy

SMALL = {"runs": 4, "duration": 10.0}


def leave(torque):
    """A residual that counts everywhere, of a run of its own."""
    return Residual(SimpleNamespace(file=object()), torque, np.ones(len(torque), dtype=bool))


@pytest.fixture
def judge(record, pose):
    """States of both joints conditional on the declared model, with further torque."""

    def states(extra, seed, **more):
        problem = pose(record(extra_torque=extra, seed=seed, **SMALL, **more))
        model = fit_problem(problem)
        return judge_joints(problem.prepared, model, [], {}, Policy())

    return states


def test_what_the_search_could_not_take_is_structure_with_its_size(record, pose):
    problem = pose(record(seed=62, **SMALL))
    model = fit_problem(problem)
    left = {0: Left(0.64, ["q_a"], "structure in q_a: too few runs")}
    said, other = judge_joints(problem.prepared, model, [], left, Policy())
    assert said.state == "unexplained"
    assert said.unexplained_rms == pytest.approx(0.8 * model.sigma[0], rel=0.1)
    assert said.depends_on == ["q_a"]
    assert other.state == "explained"


@pytest.mark.parametrize("noise", [white, coloured, slow, drift, heavy])
def test_noise_with_a_memory_is_still_noise(judge, noise):
    for state in judge(noise, 60):
        assert (state.state, state.unexplained_rms, state.depends_on) == ("explained", None, []), state


@pytest.mark.parametrize("noise", [coloured, drift])
def test_noise_does_not_repeat_where_the_motion_does(judge, noise):
    assert {state.state for state in judge(noise, 62, repeat=True)} == {"explained"}


@pytest.mark.parametrize(
    ("sizes", "test", "told"),
    [
        # Of one run there is no spread.
        ((1.0,), 1.49, False),
        ((1.0,), 1.51, True),
        # Two that differ by a third would let any other be, by Student's t alone.
        ((1.0, 1.3), 2.9, False),
        ((1.0, 1.3), 2.95, True),
        # Many that hardly differ tell by their spread.
        ((1.0, 1.01, 0.99, 1.0, 1.01, 0.99), 1.49, False),
        ((1.0, 1.01, 0.99, 1.0, 1.01, 0.99), 1.51, True),
        ((1.0, 0.5, 1.0, 2.0, 1.0, 0.7), 4.0, False),
        ((1.0, 0.5, 1.0, 2.0, 1.0, 0.7), 4.6, True),
    ],
)
def test_a_test_error_beyond_that_of_all_training_runs_is_told(sizes, test, told):
    seen = see_test_error([leave(size * np.resize([1.0, -1.0], 50)) for size in sizes], test)
    assert bool(seen) is told
    if told:
        train = np.sqrt(np.mean(np.square(sizes)))
        assert seen[0].share == pytest.approx(min((test / train) ** 2 - 1.0, 1.0))
        assert f"{test / train:.1f} times" in seen[0].reason


def test_a_test_error_is_told_beside_the_noise_of_its_runs():
    rng = np.random.default_rng(4)
    train, test = [rng.standard_normal(900), rng.standard_normal(600)], [3.0 * rng.standard_normal(700)]
    noisier = compare_noise(train, test)
    assert noisier == pytest.approx(3.0, rel=0.1)
    # A model's error that changes with the motion is none of it, nor is less noise more of a model.
    slow = 50.0 * np.sin(np.arange(700) / 100.0)
    assert compare_noise(train, [x + slow for x in test]) == pytest.approx(noisier, rel=0.05)
    assert compare_noise(test, train) == 1.0
    assert compare_noise([np.zeros(9)], test) == 1.0
    runs = [leave(x) for x in train]
    assert not see_test_error(runs, 3.0, noisier) and see_test_error(runs, 3.0)
    # What is told is how much larger it is.
    (seen,) = see_test_error(runs, 9.0, noisier)
    (times,) = re.findall(r"([0-9.]+) times", seen.reason)
    assert float(times) == pytest.approx(9.0, rel=0.05)


def test_a_noisy_test_run_alone_leaves_nothing_unexplained(judge):
    sizes = iter([0.5, 0.5, 0.5, 4.0])

    def louder(t, q, v, a, rng):
        return next(sizes) * rng.standard_normal(q.shape)

    assert {state.state for state in judge(louder, 71)} == {"explained"}


def hum(t, q, v, a, rng):
    return np.outer(2.0 * np.sin(2 * np.pi * 2.1 * t + rng.uniform(0, 6)), [1.0, 0.0])


def square(t, q, v, a, rng):
    """Turns over at moments of its own in every run."""
    return np.outer(5.0 * np.sign(np.sin(2 * np.pi * t / 1.1 + rng.uniform(0, 6))), [1.0, 0.0])


def product(t, q, v, a, rng):
    return np.column_stack([12.0 * q[:, 0] * q[:, 1], 0.0 * t])


def hidden(t, q, v, a, rng):
    """A function of the motion that needs three signals at once."""
    return np.column_stack([6.0 * np.sin(9.0 * q[:, 0] + 5.0 * q[:, 1] + 3.0 * v[:, 1]), 0.0 * t])


@pytest.mark.parametrize("torque", [hum, square])
def test_structure_is_unexplained_beside_a_model_that_lacks_it(judge, torque):
    a, b = judge(torque, 63)
    assert a.state == "unexplained" and a.unexplained_rms > 0.5 and a.reason
    assert (b.state, b.unexplained_rms) == ("explained", None)


def test_structure_of_the_test_run_alone_has_its_size_there(judge):
    """The training runs have next to nothing of it."""
    sizes = iter([0.0, 0.0, 0.0, 3.0])

    def torque(t, q, v, a, rng):
        return np.outer(next(sizes) * np.sqrt(2.0) * np.sin(2 * np.pi * 0.9 * t), [1.0, 0.0])

    a, b = judge(torque, 64)
    assert a.state == "unexplained" and "times the training runs'" in a.reason
    assert a.unexplained_rms == pytest.approx(3.0, rel=0.1)
    assert (b.state, b.unexplained_rms) == ("explained", None)


def test_what_is_periodic_in_time_is_said_with_its_frequency(judge):
    a, _ = judge(hum, 63)
    assert a.depends_on == ["t"]
    (frequency,) = re.findall(r"a line at ([0-9.]+) Hz in time", a.reason)
    assert float(frequency) == pytest.approx(2.1, abs=0.05)
    # All of the sine, and not the noise.
    assert a.unexplained_rms == pytest.approx(2.0 / np.sqrt(2.0), rel=0.15)


@pytest.mark.parametrize(
    ("form", "told"),
    [
        (lambda t, rng: 1.2 * np.sin(2.0 * t + rng.uniform(0.0, 6.0)), r"a line at 0\.3[0-9]* Hz in time"),
        (lambda t, rng: 3.0 * (t > rng.uniform(0.3, 0.7) * t[-1]), "its level shifts at a moment"),
    ],
    ids=["a slow line", "a step"],
)
def test_what_is_within_noise_is_said_where_the_runs_have_it_in_common(judge, form, told):
    def torque(t, q, v, a, rng):
        noise = coloured(t, q, v, a, rng)
        return noise + np.outer(noise[:, 0].std() * form(t, rng), [1.0, 0.0])

    a, b = judge(torque, 63)
    assert (a.state, a.depends_on) == ("unexplained", ["t"])
    assert re.search(told, a.reason)
    assert b.state == "explained"


def test_what_repeats_with_the_motion_is_structure_though_no_signal_tells_it(judge):
    a, b = judge(hidden, 64, repeat=True)
    assert a.state == "unexplained"
    assert b.state == "explained"


def differs(signal):
    """Goes with a signal by a factor of the run's own."""
    factors = iter([2.0, -1.0, 3.0, -2.0, 1.5])

    def torque(t, q, v, a, rng):
        of = {"sign_qd_a": np.sign(v[:, 0]), "qd_a": v[:, 0], "qdd_a": a[:, 0] / 3.0, "": np.ones(len(t))}
        return np.column_stack([next(factors) * of[signal], 0.0 * t])

    return torque


@pytest.mark.parametrize("signal", ["sign_qd_a", "qd_a", "qdd_a", ""])
def test_what_differs_from_run_to_run_is_said(record, signal):
    """No run tells of another one then, and no name holds it: but it is no noise either."""
    verdict = diagnose(record(extra_torque=differs(signal), seed=68, runs=5, duration=16.0)).verdict
    joint = verdict["joints"]["a"]
    assert joint["state"] == "unexplained"
    assert "differs from run to run" in joint["reason"]
    # Friction that differs makes the reversal look wide, over which the direction is like the speed.
    alike = [["qd_a"], ["sign_qd_a"]]
    assert joint["depends_on"] in (alike if signal == "qd_a" else [[signal] if signal else []])
    assert joint["unexplained_rms"] > 0.5
    assert verdict["joints"]["b"]["state"] == "explained"


def test_halves_of_runs_tell_what_differs_from_a_drift():
    rng = np.random.default_rng(5)
    speed = [np.sin(np.arange(400) / 9.0 + k) for k in range(4)]
    noise = [rng.standard_normal(400) for _ in range(4)]
    factors = [3.0, -2.0, 0.5, 1.0]

    def compare(torques):
        made = [np.column_stack([np.ones_like(v), v / v.std()]) for v in speed]
        return compare_runs(list(zip(made, torques, strict=True)))

    shares, p_values = compare([level + x for level, x in zip(factors, noise, strict=True)])
    assert shares[0] == pytest.approx(3.17 / 4.56, abs=0.03) and p_values[0] < 1e-4
    assert p_values[1] > 0.01
    slopes = [k * v / v.std() + x for k, v, x in zip(factors, speed, noise, strict=True)]
    shares, p_values = compare(slopes)
    assert shares[1] == pytest.approx(3.17 / 4.56, abs=0.03) and p_values[1] < 1e-3
    assert compare(noise)[0].max() < 0.02
    walks = [compare(list(x.cumsum(axis=1))) for x in rng.standard_normal((200, 4, 400))]
    # A walk's means differ as much, but so do its halves.
    assert np.median([shares[0] for shares, _ in walks]) > 0.2
    assert np.mean([p_values < 0.005 for _, p_values in walks], axis=0).max() <= 0.01
    assert compare_runs([(np.ones((400, 1)), noise[0]), (np.ones((1, 1)), noise[1][:1])])[1] == [1.0]


def test_a_mean_of_one_sign_in_every_run_is_no_noise():
    rng = np.random.default_rng(3)
    slow = [np.cumsum(rng.standard_normal(400)) / 20.0 for _ in range(4)]
    slow = [x - x.mean() for x in slow]

    def see(means):
        runs = [leave(x + mean) for x, mean in zip(slow, means, strict=False)]
        return see_motion(runs[:2], runs[2:], [])

    assert see([0.0] * 4) == []
    (seen,) = see([0.8] * 4)
    assert "0.8 in every run" in seen.reason and 0.2 < seen.share < 1.0
    # Of either sign, or of two runs, it may be a drift's.
    assert see([0.8, -0.8, 0.8, 0.8]) == []
    assert see([0.8, 0.8]) == []


@pytest.mark.parametrize("torque", [square, hidden])
def test_structure_is_named_unknown_or_said_to_be_left(record, torque):
    """Never an empty verdict where there is a residual of many times the noise."""
    folder = record(extra_torque=torque, seed=65, repeat=True, **SMALL)
    verdict = diagnose(folder).verdict
    names = {(e["joint"], e["effect"]) for e in verdict["verdict"]}
    assert names <= {("a", "unknown")}
    joint = verdict["joints"]["a"]
    assert names or joint["state"] == "unexplained"
    if joint["state"] == "unexplained":
        assert joint["unexplained_rms"] > 0.0
    assert verdict["joints"]["b"]["state"] == "explained"


def test_a_product_of_two_positions_is_named_with_both(record):
    verdict = diagnose(record(extra_torque=product, seed=66, **SMALL)).verdict
    (entry,) = verdict["verdict"]
    assert (entry["joint"], entry["effect"]) == ("a", "unknown")
    assert set(entry["depends_on"]) == {"q_a", "q_b"}
    assert verdict["joints"]["a"]["rms_after"] < 0.5 * verdict["joints"]["a"]["rms_before"]


def test_of_one_run_names_that_fit_worse_than_a_signal_are_no_names(record):
    """Position times speed, which no name has: not a load's friction and a coupling that share it badly."""

    def product(t, q, v, a, rng):
        return np.column_stack([4.0 * q[:, 0] * v[:, 0], np.zeros_like(t)])

    verdict = diagnose(record(seed=1, extra_torque=product, runs=2, duration=40.0)).verdict
    assert verdict["verdict"] == []
    assert verdict["joints"]["a"]["state"] == "unexplained"
