"""Cut-off of the torque whose reversals tell when a gear takes up its lost motion.

The rigid-body torque along the motor's motion holds two things that the gear does not carry. One is the
second derivative of the jump across the lost motion, which makes this torque reverse several times where the
gear does once. The other is position noise, which grows with the square of the frequency. A low cut-off
removes both. Too low a cut-off also removes a fast load, and the torque then reverses at other times than the
gear.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from scipy import signal

from wearscope.closed_loop.intake.filtering import Band, low_pass
from wearscope.effects.base import Signals
from wearscope.effects.signals import differentiate

#: Cut-offs that are tried, over the common cut-off.
_TRIED = 2.0 ** np.arange(-1.0, 1.01, 0.25)
#: Largest timing error of a reversal, times the common cut-off's angular frequency, that hardly changes the
#: jump's torque below that cut-off. Its correlation with the true torque falls by half this number's square.
_EARLY = 0.2
#: Highest frequency that the motion filter leaves unchanged, over its cut-off.
_UNTOUCHED = 0.7


def choose_lost_motion_cutoffs(runs: Sequence[Signals], band: Band) -> np.ndarray:
    """Cut-off (n,) [Hz] of the torque whose reversals tell when each gear takes up its lost motion.

    It is the lowest cut-off at which neither the load above it nor the noise below it shifts the reversals
    much; where there is none, the one that shifts them least.

    Parameters
    ----------
    runs : sequence of Signals
        Of the training runs, at `Band.rate`.
    band : Band
    """
    tried = np.unique(np.minimum(_TRIED * band.torque, band.gear))
    size = sum(len(run.t) for run in runs)
    slope, lost = np.zeros((2, len(tried), runs[0].load.shape[1]))
    for run in runs:
        whole = low_pass(run.load, band.gear, band.rate)
        for k, cutoff in enumerate(tried):
            slow = low_pass(run.load, cutoff, band.rate)
            lost[k] += np.sum((whole - slow) ** 2, axis=0) / size
            slope[k] += np.sum(differentiate(slow, band.rate) ** 2, axis=0) / size
    noise = tried[:, None] ** 5 / 5.0 * _bound_noise(runs, band)
    shift = np.maximum(lost - (noise[-1] - noise), 0.0) + noise
    early = np.sqrt(shift / np.maximum(slope, 1e-300)) * 2 * np.pi * band.torque
    enough = early <= _EARLY
    return np.asarray(tried[np.where(enough.any(axis=0), enough.argmax(axis=0), early.argmin(axis=0))])


def _bound_noise(runs: Sequence[Signals], band: Band) -> np.ndarray:
    """Upper bound (n,) of the density of twice differentiated noise, over f^4, from the loads' spectrum."""
    length = min(int(4 * band.rate), *(len(run.t) for run in runs))
    frequency = np.fft.rfftfreq(length, 1.0 / band.rate)
    density = np.zeros((len(frequency), runs[0].load.shape[1]))
    for run in runs:
        density += len(run.t) * signal.welch(run.load, band.rate, nperseg=length, axis=0)[1]
    density /= sum(len(run.t) for run in runs)
    edges = band.torque * 2.0 ** np.arange(-1.0, 8.0, 0.5)
    least = np.full(density.shape[1], np.inf)
    for low, high in pairwise(edges[edges <= _UNTOUCHED * band.motion]):
        within = (frequency >= low) & (frequency < high)
        if within.any():
            least = np.minimum(least, density[within].mean(axis=0) / np.mean(frequency[within] ** 4))
    return np.where(np.isfinite(least), least, 0.0)
