"""From recorded channels to signals of one bandwidth: resampling, zero-phase filtering, differentiation.

Two zero-phase low-pass filters are used. The first, at `Band.motion`, stands before differentiation; its
cut-off is where the position's spectrum meets its own noise plateau. The second, at `Band.torque`, is applied
to the torque and to every regressor alike, since filtering only one of them makes a sharp Coulomb step look
like a Stribeck effect; its cut-off is where the torque stops being coherent with what the declared model
predicts.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import signal, sparse

from wearscope.closed_loop.intake.recording import Run
from wearscope.effects.signals import differentiate

#: A joint counts as at rest below this multiple of its speed noise, or this share of its largest speed.
_REST_NOISE, REST_SHARE = 5.0, 0.01
#: It also counts as at rest below this share of its largest speed in any train run.
_REST_OF_ALL = 0.002
_ORDER = 4
#: Half length of the common filter's impulse response, in periods of its cut-off.
_REACH = 4.0
#: Part of a run that is cut off at either end after a filter, in periods of its cut-off.
EDGE_PERIODS = 1.0
#: A fast recording is thinned to at least this many samples per period of the common cut-off, and to at least
#: this rate [Hz].
ROWS_PER_PERIOD, _LEAST_RATE = 20.0, 250.0
#: Half length of the anti-alias filter [new samples].
_TAPS = 10


@dataclass(frozen=True)
class Band:
    """Bandwidths in use.

    Attributes
    ----------
    rate : float
        Sampling rate of the runs [Hz].
    motion, torque : float
        Cut-off [Hz] of the filter before differentiation, and of the common filter.
    """

    rate: float
    motion: float
    torque: float

    @property
    def gear(self) -> float:
        """Cut-off [Hz] for the torque that bends the gears, well above the common cut-off."""
        return min(2.0 * self.torque, self.motion)

    @property
    def stride(self) -> int:
        """Number of samples from one row to the next; rows come at four times the common cut-off or more."""
        return max(1, int(self.rate / (4.0 * self.torque)))


def rows(band: Band, length: int) -> slice:
    """Rows that are kept of a run of `length` samples: one in `Band.stride`, without the edges."""
    edge = int(EDGE_PERIODS * band.rate / band.torque)
    return slice(edge, max(length - edge, edge), band.stride)


@dataclass
class Motion:
    """Uniformly sampled motion of one run.

    Attributes
    ----------
    t : ndarray (N,)
    q, v, a : ndarray (N, n)
        After the motion filter.
    temperature : ndarray (N, n)
        NaN where not measured.
    rest_speed : ndarray (n,)
        Speed below which a joint counts as at rest.
    sure_speed : ndarray (n,)
        Speed above which the direction of motion is known.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    temperature: np.ndarray
    rest_speed: np.ndarray
    sure_speed: np.ndarray


@lru_cache(maxsize=32)
def _sections(cutoff: float, rate: float) -> np.ndarray:
    return signal.butter(_ORDER, cutoff, fs=rate, output="sos")


@lru_cache(maxsize=32)
def _settled(cutoff: float, rate: float) -> np.ndarray:
    """Steady state (S, 1, 2) of the filter's sections for a constant signal of 1."""
    return np.asarray(signal.sosfilt_zi(_sections(cutoff, rate))[:, None, :])


def low_pass(x: np.ndarray, cutoff: float, rate: float) -> np.ndarray:
    """Zero-phase Butterworth low-pass along the first axis; unchanged where the cut-off reaches Nyquist."""
    if cutoff >= 0.45 * rate:
        return x
    sections, settled = _sections(cutoff, rate), _settled(cutoff, rate)
    length = min(len(x) - 1, int(3 * rate / cutoff))
    columns = np.atleast_2d(np.ascontiguousarray(x.T, dtype=float))
    # As `scipy.signal.sosfiltfilt`, which would compute the steady state at each call.
    before = 2.0 * columns[:, :1] - columns[:, length:0:-1]
    after = 2.0 * columns[:, -1:] - columns[:, -2 : -length - 2 : -1]
    y = np.concatenate([before, columns, after], axis=1)
    for _ in range(2):
        y = signal.sosfilt(sections, y, axis=-1, zi=settled * y[:, :1])[0][:, ::-1]
    y = y[:, length : y.shape[1] - length]
    return np.ascontiguousarray(y.T).reshape(x.shape)


@lru_cache(maxsize=64)
def thinning(length: int, band: "Band") -> sparse.csr_matrix:
    """The common filter and the choice of rows, edges cut, as one sparse matrix (M, N).

    The filter's impulse response is cut where it has fallen below 1e-4 of its peak; beyond the ends the
    signal is extended by odd reflection, as `low_pass` does.
    """
    if band.torque >= 0.45 * band.rate:
        return sparse.eye(length, format="csr")[rows(band, length)]
    half = int(_REACH * band.rate / band.torque)
    impulse = np.zeros(4 * half + 1)
    impulse[2 * half] = 1.0
    taps = signal.sosfiltfilt(_sections(band.torque, band.rate), impulse)[half : 3 * half + 1]
    taps /= taps.sum()
    centres = np.arange(length)[rows(band, length)]
    at = centres[:, None] + np.arange(-half, half + 1)
    weight = np.broadcast_to(taps, at.shape).copy()
    row = np.broadcast_to(np.arange(len(centres))[:, None], at.shape)
    before, after = at < 0, at >= length
    mirrored = np.where(before, -at, np.where(after, 2 * (length - 1) - at, at)).clip(0, length - 1)
    sign = np.where(before | after, -1.0, 1.0)
    parts = [
        sparse.coo_matrix(((weight * sign).ravel(), (row.ravel(), mirrored.ravel())), (len(centres), length))
    ]
    for outside, end in ((before, 0), (after, length - 1)):
        if outside.any():
            total = 2.0 * (weight * outside).sum(axis=1)
            column = np.full(len(centres), end)
            parts.append(
                sparse.coo_matrix((total, (np.arange(len(centres)), column)), (len(centres), length))
            )
    return sum(parts[1:], parts[0]).tocsr()


def thin(x: np.ndarray, band: "Band") -> np.ndarray:
    """Common filter, then one row in `Band.stride`, edges cut: (N, K) to (M, K)."""
    return thinning(len(x), band) @ x


def choose_factor(rate: float, motion: float, torque: float) -> int:
    """Thinning factor of a recording: one sample of so many is kept.

    Recordings of less than twice 250 Hz stay as they are; faster ones keep at least 250 Hz, `ROWS_PER_PERIOD`
    samples a period of the common cut-off and three of the motion filter's.

    Parameters
    ----------
    rate, motion, torque : float
        Sampling rate and cut-offs [Hz].
    """
    return max(1, int(rate / max(_LEAST_RATE, ROWS_PER_PERIOD * torque, 3.0 * motion)))


def decimate(x: np.ndarray, factor: int) -> np.ndarray:
    """Every `factor`-th sample of (N, ...) along the first axis after a zero-phase FIR anti-alias filter.

    The filter is flat up to half the new Nyquist frequency and attenuates by 80 dB above that frequency. The
    ends are extended by odd reflection, as `low_pass` does.
    """
    if factor == 1:
        return x
    half = _TAPS * factor
    taps = _anti_alias(factor)
    reach = min(half, len(x) - 1)
    head, tail = 2 * x[:1] - x[reach:0:-1], 2 * x[-1:] - x[-2 : -reach - 2 : -1]
    extended = np.concatenate([head, x, tail])
    filtered = signal.upfirdn(taps, extended, 1, factor, axis=0)
    # The filter delays by `half`; sample 0 stands at `reach` of the extended signal.
    start = half + reach
    if start % factor:
        extended = np.concatenate([np.repeat(extended[:1], factor - start % factor, axis=0), extended])
        filtered = signal.upfirdn(taps, extended, 1, factor, axis=0)
        start += factor - start % factor
    count = -(-len(x) // factor)
    return np.ascontiguousarray(filtered[start // factor : start // factor + count])


@lru_cache(maxsize=32)
def _anti_alias(factor: int) -> np.ndarray:
    return signal.firwin(2 * _TAPS * factor + 1, 0.75 / factor, window=("kaiser", 8.0))


def position_noise(q: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Noise of measured positions and the frequency up to which motion stands out of it.

    Parameters
    ----------
    q : ndarray (N, n)
    rate : float

    Returns
    -------
    density : ndarray (n,)
        One-sided power density of the noise plateau, per Hz.
    edge : ndarray (n,)
        Frequency [Hz] up to which the density is more than ten times the plateau; NaN for joints that
        stand still.

    Notes
    -----
    Densities are taken of the second difference, which leaves no leakage of the slow motion, and divided by
    its gain.
    """
    length = int(min(len(q) // 2, 4 * rate))
    frequency, density = signal.welch(np.diff(q, 2, axis=0), rate, nperseg=length, axis=0)
    gain = np.maximum(2.0 * np.sin(np.pi * frequency / rate), 1e-3) ** 4
    density = density / gain[:, None]
    plateau = np.median(density[frequency > 0.25 * rate], axis=0)
    smooth = signal.medfilt2d(density, (5, 1))
    edge = np.full(q.shape[1], np.nan)
    for j in range(q.shape[1]):
        if np.ptp(q[:, j]) > 0:
            below = np.flatnonzero((smooth[:, j] < 10 * plateau[j]) & (frequency > 1.0))
            edge[j] = frequency[below[0]] if len(below) else frequency[-1]
    return plateau, edge


def choose_motion_cutoff(runs: list[Run], rate: float) -> float:
    """Cut-off [Hz] of the filter before differentiation, from the positions of the training runs."""
    edges = np.array([position_noise(run.q, rate)[1] for run in runs])
    with np.errstate(all="ignore"):
        finite = edges[np.isfinite(edges)]
    edge = float(np.median(finite)) if len(finite) else rate / 10
    return float(np.clip(edge, 5.0, rate / 10))


def choose_torque_cutoff(pairs: list[tuple[np.ndarray, np.ndarray]], rate: float, highest: float) -> float:
    """Cut-off [Hz] of the common filter.

    Parameters
    ----------
    pairs : list of (ndarray (N, n), ndarray (N, n))
        Measured torque and the torque the declared model predicts, run by run.
    rate, highest : float

    Returns
    -------
    float
        Highest frequency to which most joints' torques have a coherence of at least one half with the
        prediction, in [4, `highest`] Hz.
    """
    longest = max(len(m) for m, _ in pairs)
    pairs = [(m, p) for m, p in pairs if len(m) >= 0.25 * longest]
    length = int(min(min(len(m) for m, _ in pairs) // 4, 2 * rate))
    edges = []
    for j in range(pairs[0][0].shape[1]):
        cross: np.ndarray = 0.0  # type: ignore[assignment]
        auto: list[np.ndarray] = [0.0, 0.0]  # type: ignore[list-item]
        for measured, predicted in pairs:
            frequency, c = signal.csd(measured[:, j], predicted[:, j], rate, nperseg=length)
            cross = cross + c
            auto[0] = auto[0] + signal.welch(measured[:, j], rate, nperseg=length)[1]
            auto[1] = auto[1] + signal.welch(predicted[:, j], rate, nperseg=length)[1]
        coherence = np.abs(cross) ** 2 / np.maximum(auto[0] * auto[1], 1e-300)
        smooth = np.convolve(coherence, np.ones(3) / 3, mode="same")
        below = np.flatnonzero((smooth < 0.5) & (frequency > 2.0))
        edges.append(frequency[below[0]] if len(below) else frequency[-1])
    return float(np.clip(np.median(edges), 4.0, highest))


def differentiate_run(run: Run, rate: float, cutoff: float, usual_speed: np.ndarray | None = None) -> Motion:
    """Speed and acceleration of a run by the motion filter and central differences.

    Parameters
    ----------
    run : Run
        Uniformly sampled.
    rate, cutoff : float
        [Hz]
    usual_speed : ndarray (n,), optional
        Largest speed of each joint in the train runs: far below it a joint rests.
    """
    q = low_pass(run.q, cutoff, rate)
    v = differentiate(q, rate)
    density = position_noise(run.q, rate)[0]
    if run.quantum is not None:
        # Rounding to a grid is white noise of a twelfth of its step squared where the joint moves.
        density = np.maximum(density, run.quantum**2 / (6.0 * rate))
    if run.qd is not None:
        # Either the recorded speed or the differentiated position may be far noisier; take the quieter one.
        quieter = position_noise(run.qd, rate)[0] < density * (2 * np.pi * cutoff) ** 2 / 3
        v[:, quieter] = low_pass(run.qd[:, quieter], cutoff, rate)
    a = differentiate(v, rate)
    speed_noise = np.sqrt(density * (2 * np.pi) ** 2 * cutoff**3 / 3)
    sure = _REST_NOISE * speed_noise
    top = np.abs(v).max(axis=0)
    rest = np.maximum(sure, REST_SHARE * top)
    if usual_speed is not None:
        rest = np.maximum(rest, _REST_OF_ALL * usual_speed)
    temperature = np.full(q.shape, np.nan) if run.temperature is None else run.temperature
    return Motion(run.t, q, v, a, temperature, rest, sure)
