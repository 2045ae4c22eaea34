"""The width of a friction's reversal is that of the machine, and no other friction is taken for it."""

import numpy as np
import pytest

from wearscope.closed_loop.intake.filtering import Band
from wearscope.closed_loop.intake.reversals import choose_reversal_widths
from wearscope.closed_loop.intake.rough_model import RoughRun

RATE = 250.0
BAND = Band(RATE, 30.0, 10.0)
T = np.arange(int(16 * RATE)) / RATE
MOVING = np.array([True])


def draw_runs(friction, seed, noise=0.01, count=4):
    """Runs of a pendulum with its own friction law over speed; and the largest speed."""
    rng = np.random.default_rng(seed)
    runs = []
    for _ in range(count):
        q, v, a = np.zeros((3, len(T)))
        for k in range(1, 9):
            w, size, phase = 0.8 * k * rng.uniform(0.8, 1.2), rng.normal() / k, rng.uniform(0, 6)
            q += size * np.sin(w * T + phase)
            v += size * w * np.cos(w * T + phase)
            a -= size * w**2 * np.sin(w * T + phase)
        runs.append((q, v, a))
    top = max(np.abs(v).max() for _, v, _ in runs)
    made = []
    for q, v, a in runs:
        known = 20.0 * np.sin(q) + 2.0 * a
        tau = known + 0.4 * a + 3.0 * v + friction(v, top, q)
        tau = tau + noise * tau.std() * rng.normal(size=len(T))
        none = np.zeros((len(T), 1), dtype=bool)
        columns = (x[:, None] for x in (known, a, np.sign(v), v, tau))
        made.append(RoughRun("train", T, *columns, none, none))
    return made, top


def share(friction, seed, **options):
    runs, top = draw_runs(friction, seed, **options)
    return choose_reversal_widths(runs, MOVING, BAND)[0] / top


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("width", [5e-3, 0.03])
def test_a_planted_width_is_recovered(width, seed):
    found = share(lambda v, top, q: 8.0 * np.tanh(v / (width * top)), seed)
    assert width / 1.5 < found < 1.5 * width


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("width", [0.0, 2e-4])
def test_a_reversal_within_a_sample_is_sharp(width, seed):
    """A joint crosses 0.02 % of its top speed in a fraction of a sample: nothing tells it from at once."""
    found = share(lambda v, top, q: 8.0 * (np.tanh(v / (width * top)) if width else np.sign(v)), seed)
    assert found < 1e-3


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("speed", [0.01, 0.03, 0.1])
def test_friction_that_grows_towards_rest_keeps_its_sharp_reversal(speed, seed):
    def stribeck(v, top, q):
        return np.sign(v) * (6.0 + 5.0 * np.exp(-(np.abs(v / (speed * top)) ** 1.3)))

    assert share(stribeck, seed) < 3e-3


def test_a_joint_that_rests_has_no_width():
    runs, _ = draw_runs(lambda v, top, q: 8.0 * np.sign(v), 0)
    assert choose_reversal_widths(runs, np.array([False]), BAND)[0] == 0.0
