"""A spectral line: a torque that is periodic in time."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal

#: A spectral line stands out of its neighbours' median by this factor: chance gives it once in 1e4 runs.
_LINE, _NEIGHBOURS = 40.0, 41
#: Fewest periods of it in a run.
_PERIODS = 8
#: Highest peaks that are compared with what lies below them.
_PEAKS = 20
#: Shortest residual that is looked at [rows].
_LEAST_ROWS = 512


@dataclass(frozen=True)
class Line:
    """The highest line of a spectrum.

    Attributes
    ----------
    frequency : float
        [Hz]
    share : float
        Of the residual's power that it holds; zero where it does not stand out of its neighbours.
    """

    frequency: float
    share: float


def find_line(x: np.ndarray, rate: float) -> Line | None:
    """The line that stands out most of a residual's spectrum; None where there is too little of it.

    Parameters
    ----------
    x : ndarray (N,)
        Residual of a run, before the common filter.
    rate : float
        [Hz]
    """
    if len(x) < _LEAST_ROWS:
        return None
    window = signal.windows.hann(len(x))
    power = np.abs(np.fft.rfft((x - x.mean()) * window)) ** 2
    around = ndimage.median_filter(power, _NEIGHBOURS, mode="nearest")
    first = _PERIODS
    ratio = power[first:] / np.maximum(around[first:], 1e-300)
    for k in first + np.argsort(-ratio)[:_PEAKS]:
        # Noise with a memory has more power below than the median of both sides says.
        below = float(np.median(power[k // 2 : k - 2])) if k > 4 else float(power[1])
        ratio[k - first] = power[k] / max(around[k], below, 1e-300)
    k = first + int(np.argmax(ratio))
    near = slice(max(k - 2, 0), k + 3)
    share = float((power[near] - around[near]).clip(0.0).sum() / max(power[1:].sum(), 1e-300))
    return Line(k * rate / len(x), share if ratio.max() > _LINE else 0.0)
