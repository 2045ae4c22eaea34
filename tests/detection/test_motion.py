"""What counts as the same motion: waits do not, other ways and other speeds do."""

import numpy as np
import pytest

from wearscope.detection.recordings import cut_rests, tell_difference
from wearscope.detectors.base import Batch

RATE = 100.0


def make_batch(seconds=6.0, size=(1.0, 0.4), shift=0.0, wait=0.0, pause=0.0, noise=0.0) -> Batch:
    """Two joints, there and back, from rest to rest, with a wait before and a pause half way."""
    t = np.arange(round(seconds * RATE)) / RATE
    s = 2 * np.pi * t / seconds
    q = np.column_stack([size[0] * np.sin(s) ** 2 * np.sign(np.sin(s)), size[1] * (1 - np.cos(s))]) + shift
    times = np.ones(len(t), dtype=int)
    times[[0, len(t) // 2]] += round(wait * RATE), round(pause * RATE)
    q = np.repeat(q, times, axis=0)
    q = q + noise * np.random.default_rng(3).standard_normal(q.shape)
    return Batch(np.arange(len(q)) / RATE, q, np.gradient(q, 1 / RATE, axis=0), np.zeros_like(q), RATE)


@pytest.mark.parametrize(
    "other", [{}, {"wait": 2.0}, {"pause": 0.7}, {"shift": 0.01}, {"seconds": 6.1}, {"noise": 1e-6}]
)
def test_the_same_motion_is_recognised(other):
    assert tell_difference(cut_rests(make_batch()), cut_rests(make_batch(**other)), ["a", "b"]) is None


@pytest.mark.parametrize(
    ("other", "told"),
    [
        ({"size": (1.0, 0.6)}, "joint 'b'"),
        ({"size": (-1.0, 0.4)}, "joint 'a'"),
        ({"shift": 0.3}, "of its range away"),
        ({"seconds": 7.0}, "slower, by"),
        ({"seconds": 5.0}, "faster, by"),
    ],
)
def test_another_motion_is_told_with_the_joint_or_the_speed(other, told):
    assert told in tell_difference(cut_rests(make_batch()), cut_rests(make_batch(**other)), ["a", "b"])


def test_rests_at_both_ends_are_cut():
    plain, waited = cut_rests(make_batch()), cut_rests(make_batch(wait=3.0))
    assert abs(len(plain.t) - len(waited.t)) <= 2


def test_a_recording_at_rest_is_refused():
    still = np.zeros((100, 2))
    with pytest.raises(ValueError, match="no joint moves"):
        cut_rests(Batch(np.arange(100) / RATE, still, still, still, RATE))
