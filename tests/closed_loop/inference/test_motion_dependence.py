"""What a residual owes to the motion, now or past, is told from any noise of the same kind."""

import numpy as np
import pytest
from noises import coloured, drift, heavy, slow, turning, white
from scipy import signal

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.held_out import HeldOut
from wearscope.closed_loop.inference.motion_dependence import find_dependence, mix_phases, move
from wearscope.closed_loop.inference.policy import Policy

SMALL = {"runs": 4, "duration": 10.0}


def filter_past(x, t, memory):
    keep = np.exp(-(t[1] - t[0]) / memory)
    return signal.lfilter([1.0 - keep], [1.0, -keep], x)


def fading(t, q, v, a, rng):
    """Friction by the speed of the last two seconds."""
    return np.column_stack([1.5 * np.sign(v[:, 0]) * filter_past(np.abs(v[:, 0]), t, 2.0), 0.0 * t])


def dragging(t, q, v, a, rng):
    """A torque by another joint's position, with a hum of its size."""
    hum = np.sin(2 * np.pi * 3.1 * t + rng.uniform(0, 6))
    return np.column_stack([1.2 * np.sin(2.0 * q[:, 1]) + hum, 0.0 * t])


def hum(t, q, v, a, rng):
    return 2.0 * np.sin(2 * np.pi * 0.7 * t[:, None] + rng.uniform(0, 6, 2))


def knock(t, q, v, a, rng):
    """One in each run."""
    return 12.0 * np.exp(-(((t[:, None] - t[-1] * rng.uniform(0.2, 0.8, 2)) / 0.15) ** 2))


@pytest.fixture
def ask(record, pose, declared_model):
    """What depends on the motion conditional on the declared model, by joint."""

    def depend(extra, seed, **more):
        model = declared_model(pose(record(extra_torque=extra, seed=seed, **more)))
        return find_dependence(model.problem, model.fit, (0, 1), Policy())

    return depend


@pytest.mark.parametrize(
    ("torque", "signal_", "past", "runs"),
    [
        (fading, "qd_a", True, 4),
        (turning, "q_a", True, 4),
        (dragging, "q_b", False, 4),
        (dragging, "q_b", False, 2),
    ],
)
def test_what_follows_the_motion_is_seen_and_its_signals_are_told(ask, torque, signal_, past, runs):
    seen = ask(torque, 71, runs=runs, duration=60.0 if runs == 2 else 15.0)
    assert list(seen) == [0]
    assert signal_ in seen[0].depends_on
    assert seen[0].past == past
    assert 0.1 <= seen[0].share <= 1.0


@pytest.mark.parametrize("noise", [white, coloured, slow, drift, heavy, hum, knock])
@pytest.mark.parametrize("runs", [2, 4])
def test_no_noise_follows_the_motion(ask, noise, runs):
    assert ask(noise, 72, runs=runs, duration=20.0 if runs == 2 else 10.0) == {}


def test_a_memory_is_no_empty_verdict(record):
    """Trees on all signals do not see what depends on the past; a tenth of the variance is enough."""
    joint = diagnose(record(extra_torque=turning, seed=71, runs=4, duration=12.0)).verdict["joints"]["a"]
    assert joint["state"] == "unexplained"
    assert joint["depends_on"] == ["q_a"]
    assert 0.0 < joint["unexplained_rms"] < joint["rms_after"]


def test_surrogates_have_what_a_residual_has_but_its_place_in_time():
    rng = np.random.default_rng(3)
    x = rng.standard_normal(80)
    for y in move(x, 5, rng).T:
        assert np.allclose(np.sort(np.abs(y)), np.sort(np.abs(x)))
        assert not np.allclose(np.abs(y), np.abs(x))
    along = np.linspace(-1.0, 1.0, 80)
    x -= np.polyval(np.polyfit(along, x, 1), along)
    for y in mix_phases(x, 5, rng).T:
        assert np.allclose(np.abs(np.fft.rfft(y))[1:-1], np.abs(np.fft.rfft(x))[1:-1])
        assert not np.allclose(y, x, atol=0.1)
    lines = np.abs(np.polyfit(along, mix_phases(3.0 + 2.0 * along, 4, rng), 1))
    assert np.allclose(lines, [[2.0] * 4, [3.0] * 4])


@pytest.mark.parametrize("runs", [2, 4])
def test_shares_are_those_of_fits_to_the_rows(record, pose, declared_model, runs):
    given = declared_model(pose(record(seed=5, runs=runs, duration=12.0)))
    layout, every = given.problem.layout, 2
    keep = layout.keep[::every, 0]
    rng = np.random.default_rng(0)
    model, further = given.fit.columns(0)[::every], rng.standard_normal((len(keep), 2))
    target = rng.standard_normal((len(keep), 3)) + further[:, :1]
    known, penalty = 0.3 * np.eye(model.shape[1]), 0.7 * np.eye(2)
    sums = HeldOut(layout, every, keep, model, known)
    shares = sums.explain(further, penalty, sums.target(target))
    block = np.zeros(len(layout.keep), dtype=int)
    first = np.concatenate([[0], np.cumsum([len(run.t) for run in given.problem.train])])
    for b, one in enumerate(layout.blocks):
        block[first[one.run] + one.start : first[one.run] + one.stop] = b
    of_row = block[::every]
    losses = np.zeros((2, 2, 3))
    whole = np.ones(len(layout.blocks), dtype=bool)
    for train, test in [*zip(layout.folds.train, layout.folds.test, strict=True), (whole, whole)]:
        for k, (x, hold) in enumerate(
            [(model, known), (np.hstack([model, further]), np.block([[known, np.zeros((len(known), 2))],
             [np.zeros((2, len(known))), penalty]]))]
        ):  # fmt: skip
            fit, held = keep & train[of_row], keep & test[of_row]
            theta = np.linalg.solve(x[fit].T @ x[fit] + hold, x[fit].T @ target[fit])
            losses[int(train is whole), k] += ((target[held] - x[held] @ theta) ** 2).sum(axis=0)
    assert np.allclose(shares, 1.0 - losses[:, 1] / losses[:, 0], atol=1e-5)
