"""Copies are found among many runs, wherever they start; the same motion recorded again is none."""

import numpy as np
import pytest

from wearscope.closed_loop.intake.recording import Run
from wearscope.closed_loop.intake.repeats import find_copies, sign_run

RATE = 100.0


def make_runs(count, seed, same_motion):
    rng = np.random.default_rng(seed)
    t = np.arange(3000) / RATE
    made = []
    for k in range(count):
        own = np.random.default_rng(seed if same_motion else [seed, k])
        q = sum(own.normal(size=2) / i * np.sin(i * t[:, None] + own.uniform(0, 6, 2)) for i in range(1, 8))
        tau = 10 * np.sin(q) + np.gradient(q, axis=0) * RATE
        tau = tau + 0.01 * tau.std() * rng.normal(size=q.shape)
        made.append(Run(f"{k}", "train", t, q + 1e-5 * rng.normal(size=q.shape), tau, None, None, None))
    return made


def search(runs):
    return find_copies([sign_run(run, RATE) for run in runs], lambda i, k: True, lambda i: runs[i])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("same_motion", [False, True])
def test_runs_recorded_apart_are_no_copies(seed, same_motion):
    assert search(make_runs(20, seed, same_motion)) is None


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("same_motion", [False, True])
def test_a_trimmed_and_rounded_copy_is_found_among_many(seed, same_motion):
    rng = np.random.default_rng(seed)
    runs = make_runs(20, seed, same_motion)
    start = int(rng.integers(0, 1500))
    copy = runs[4].cut(start, start + int(rng.integers(700, 1500)))
    copy.q, copy.tau = np.round(copy.q, 4), np.round(copy.tau, 3)
    runs.insert(12, copy)
    assert search(runs) == (4, 12)


def test_pairs_that_do_not_matter_are_left_alone():
    runs = make_runs(4, 0, False)
    runs.append(runs[1].cut(0, 2000))
    signatures = [sign_run(run, RATE) for run in runs]
    assert find_copies(signatures, lambda i, k: False, lambda i: runs[i]) is None
