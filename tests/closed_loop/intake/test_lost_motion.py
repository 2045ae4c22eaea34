"""The moment at which a gear takes up its lost motion, from the torque along the motor's motion."""

import numpy as np
import pytest

from wearscope.closed_loop.intake.filtering import Band, low_pass
from wearscope.closed_loop.intake.lost_motion import choose_lost_motion_cutoffs
from wearscope.effects.base import Signals
from wearscope.effects.signals import differentiate

RATE = 200.0
BAND = Band(RATE, 18.0, 6.0)


def swing(frequencies, gap=0.0, noise=0.0, seconds=60.0):
    """Signals of a joint of unit inertia, and the torque through its gear (N,)."""
    t = np.arange(int(seconds * RATE)) / RATE
    gear = sum(np.sin(2 * np.pi * f * t + 3.0 * f) / len(frequencies) for f in frequencies)
    ahead = 0.5 * gap * np.tanh(gear / 0.1)
    ahead += noise * np.random.default_rng(0).normal(size=len(t))
    ahead = low_pass(ahead[:, None], BAND.motion, RATE)
    load = gear[:, None] + differentiate(differentiate(ahead, RATE), RATE)
    still = np.zeros_like(load)
    return Signals(t, still, still, still, still, load, still, still), gear


def find_agreement(load, gear):
    """Correlation, below the common cut-off, of the twice differentiated jumps of two torques (N,)."""
    jumps = np.column_stack([np.tanh(x / 0.1) for x in (load, gear)])
    torque = low_pass(differentiate(differentiate(jumps, RATE), RATE), BAND.torque, RATE)
    return np.corrcoef(torque[100:-100].T)[0, 1]


@pytest.mark.parametrize("frequencies", [(0.3, 0.7), (1.1, 4.3), (0.9, 5.7)])
def test_a_jump_is_taken_up_when_the_load_reverses_however_fast_that_is(frequencies):
    signals, gear = swing(frequencies, gap=1e-4, noise=2e-6)
    (cutoff,) = choose_lost_motion_cutoffs([signals], BAND)
    assert find_agreement(low_pass(signals.load, cutoff, RATE)[:, 0], gear) > 0.9


def test_half_the_common_cut_off_leaves_out_a_load_that_is_faster():
    signals, gear = swing((1.1, 4.3))
    assert find_agreement(low_pass(signals.load, BAND.torque / 2, RATE)[:, 0], gear) < 0.6


def test_noise_of_the_positions_lowers_the_cut_off_where_the_load_is_slow():
    (quiet,) = choose_lost_motion_cutoffs([swing((0.3, 0.7), noise=1e-7)[0]], BAND)
    (noisy,) = choose_lost_motion_cutoffs([swing((0.3, 0.7), noise=2e-4)[0]], BAND)
    assert quiet == noisy == BAND.torque / 2
    (fast,) = choose_lost_motion_cutoffs([swing((0.3, 5.0), noise=1e-5)[0]], BAND)
    assert fast > BAND.torque / 2


def test_each_joint_has_its_own():
    slow, _ = swing((0.3, 0.7))
    fast, _ = swing((0.9, 5.7))
    both = np.column_stack([slow.load, fast.load])
    still = np.zeros_like(both)
    joined = Signals(slow.t, still, still, still, still, both, still, still)
    cutoffs = choose_lost_motion_cutoffs([joined, joined], BAND)
    assert cutoffs[0] < cutoffs[1] <= BAND.gear
