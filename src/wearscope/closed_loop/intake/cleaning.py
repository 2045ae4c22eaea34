"""Recording faults that no machine makes: wrapped angles, spikes, steps of the encoder, frozen torque.

What can be mended without guessing is mended, kept out of all fits and said in a note; a position channel
that steps in the middle of a run is refused, since either half may be the wrong one.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from wearscope.closed_loop.intake.dataset import Run
from wearscope.errors import InputError

#: A change is a fault beyond this multiple of what the run's own 98th percentile is ...
_ODD, _USUAL = 10.0, 98.0
#: ... and beyond this share of the largest speed, or of the torque's span.
_OF_SPEED, _OF_SPAN = 0.25, 0.5
#: Widest spike [samples].
LONGEST_SPIKE = 4
#: Seconds at either end of a run that may be cut off; shortest frozen stretch.
_START, _FROZEN_TIME, _FROZEN_ROWS = 1.5, 0.2, 20
#: Share of a position's span beyond which a step can be a fault; smaller ones are lost motion of the gear.
_STEP = 0.03
#: Most spikes of one channel that are still mended, as a share of its rows.
_MOST = 0.01


@dataclass
class Cleaned:
    """A run without its faults.

    Attributes
    ----------
    run : Run
        Uniformly sampled, cut to the part that holds.
    faulty : ndarray (N, n) of bool
        Samples of joints that were mended or are not measurements, and must not count.
    notes : list of str
    """

    run: Run
    faulty: np.ndarray
    notes: list[str]


def _stretches(marked: np.ndarray, apart: int = 1) -> list[tuple[int, int]]:
    """First and last index of stretches of marked samples (N,), joined where at most `apart` apart."""
    at = np.flatnonzero(marked)
    if not len(at):
        return []
    breaks = np.flatnonzero(np.diff(at) > apart)
    first, last = at[np.r_[0, breaks + 1]], at[np.r_[breaks, len(at) - 1]]
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _odd_steps(q: np.ndarray) -> np.ndarray:
    """How far each difference of a position (N,) is from those around it; 0 (N-1,) where that is no fault."""
    step = np.diff(q)
    sizes = np.abs(step[step != 0.0])
    resolution = float(sizes.min()) if len(sizes) else 0.0
    around = ndimage.median_filter(step, 11, mode="nearest")
    odd = step - around
    least = max(
        _ODD * float(np.percentile(np.abs(odd), _USUAL)),
        _OF_SPEED * float(np.percentile(np.abs(around), 99.5)),
        _ODD * resolution,
        1e-9,
    )
    return np.where(np.abs(odd) > least, odd, 0.0)


def _returns(net: float, nets: np.ndarray) -> bool:
    """Whether steps `nets` of a run go back and forth as far as one of them: a gear's lost motion."""
    return bool((-np.sign(net) * nets >= 0.5 * abs(net)).any())


def _bridge(x: np.ndarray, first: int, last: int) -> None:
    """Replace samples `first` to `last` by the cubic through four good neighbours on either side."""
    rows = np.arange(max(first - 4, 0), min(last + 5, len(x)))
    good = rows[(rows < first) | (rows > last)]
    degree = min(3, len(good) - 1)
    centre = 0.5 * (first + last)
    inside = np.arange(first, last + 1)
    x[inside] = np.polyval(np.polyfit(good - centre, x[good], degree), inside - centre)


def _clean_position(
    run: Run, j: int, joint: str, slides: bool, where: str, faulty: np.ndarray
) -> tuple[int, int, list[str]]:
    """Mend a position in place; rows that hold as (first, after last), and notes."""
    q, t = run.q[:, j], run.t
    notes: list[str] = []
    first, after, wraps, spikes = 0, len(q), 0, 0
    odd = _odd_steps(q)
    stretches = _stretches(odd != 0.0, apart=LONGEST_SPIKE)
    nets = np.array([odd[low : high + 1].sum() for low, high in stretches])
    for low, high in stretches:
        path = np.cumsum(odd[low : high + 1])
        net, largest = float(path[-1]), float(np.abs(path).max())
        if abs(net) < 0.2 * largest:
            spikes += high - low
            _bridge(q, low + 1, high)
            faulty[low + 1 : high + 1] = True
        elif not slides and abs(abs(net) - 2 * np.pi) < 0.3 and high == low:
            q[high + 1 :] -= np.sign(net) * 2 * np.pi
            wraps += 1
        elif abs(net) <= _STEP * float(np.ptp(q)) or (high > low and _returns(net, nets)):
            continue
        elif t[high + 1] - t[0] <= _START:
            first = max(first, high + 1)
        elif t[-1] - t[low] <= _START:
            after = min(after, low + 1)
        else:
            raise InputError(
                f"{where}: column 'q_{joint}' steps by {net:.3g} at t = {t[high + 1]:.6g} s, as no joint "
                "moves; split the run there or mend the channel."
            )
    if spikes > _MOST * len(q):
        raise InputError(
            f"{where}: column 'q_{joint}' has spikes in {spikes} rows; mend the channel or record again."
        )
    if wraps:
        notes.append(f"{run.file}: q_{joint} was unwrapped at {wraps} rows.")
    if spikes:
        notes.append(f"{run.file}: spikes of q_{joint} in {spikes} rows were bridged and do not count.")
    if first:
        notes.append(f"{run.file}: q_{joint} steps at t = {t[first]:.6g} s; the rows before it are cut off.")
    if after < len(q):
        notes.append(
            f"{run.file}: q_{joint} steps at t = {t[after]:.6g} s; the rows from there on are cut off."
        )
    return first, after, notes


def _clean_torque(run: Run, j: int, joint: str, where: str, faulty: np.ndarray) -> list[str]:
    """Bridge spikes of a torque in place and mark frozen stretches."""
    tau = run.tau[:, j]
    notes: list[str] = []
    odd = np.abs(tau - ndimage.median_filter(tau, 2 * LONGEST_SPIKE + 1, mode="nearest"))
    span = float(np.ptp(np.percentile(tau, [1, 99])))
    spiky = odd > max(_ODD * float(np.percentile(odd, _USUAL)), _OF_SPAN * span, 1e-12)
    for low, high in _stretches(spiky):
        beside = abs(tau[min(high + 1, len(tau) - 1)] - tau[max(low - 1, 0)])
        if high - low >= LONGEST_SPIKE or beside > 0.3 * odd[low : high + 1].max():
            spiky[low : high + 1] = False
            continue
        _bridge(tau, low, high)
    if spiky.any():
        faulty |= spiky
        notes.append(
            f"{run.file}: spikes of tau_{joint} in {int(spiky.sum())} rows were bridged and do not count."
        )
    shortest = max(_FROZEN_ROWS, int(_FROZEN_TIME / float(np.median(np.diff(run.t)))))
    frozen = np.zeros(len(tau), dtype=bool)
    for low, high in _stretches(np.diff(tau) == 0.0):
        if high + 1 - low >= shortest and _travels(run.q[low : high + 2, j], run.q[:, j]):
            frozen[low : high + 2] = True
    if frozen.any():
        faulty |= frozen
        notes.append(
            f"{run.file}: tau_{joint} does not change in {int(frozen.sum())} rows in which the joint moves; "
            "they do not count."
        )
    return notes


def _travels(part: np.ndarray, whole: np.ndarray) -> bool:
    return bool(np.ptp(part) > 1e-3 * np.ptp(whole))


def clean_run(run: Run, joints: list[str], slides: list[bool], where: str) -> Cleaned:
    """Mend what can be mended of a run.

    Parameters
    ----------
    run : Run
        Uniformly sampled; it is not changed.
    joints : list of str
    slides : list of bool
        Whether each joint is prismatic; the others may wrap at a full turn.
    where : str
        What to call the run in messages.

    Raises
    ------
    InputError
        Where a position steps in the middle of the run, has too many spikes, or too little is left.
    """
    mended = replace(run, q=run.q.copy(), tau=run.tau.copy())
    faulty = np.zeros(run.q.shape, dtype=bool)
    notes: list[str] = []
    first, after = 0, len(run.t)
    odd_position = np.zeros(len(run.t), dtype=bool)
    for j, joint in enumerate(joints):
        start, stop, told = _clean_position(mended, j, joint, slides[j], where, odd_position)
        first, after = max(first, start), min(after, stop)
        notes += told
    # A wrong position of one joint makes the rigid-body torque of all of them wrong.
    faulty |= odd_position[:, None]
    for j, joint in enumerate(joints):
        notes += _clean_torque(mended, j, joint, where, faulty[:, j])
    for j, joint in enumerate(joints):
        if np.mean(faulty[:, j]) > 0.8:
            raise InputError(
                f"{where}: column 'tau_{joint}' does not change over most of the run; the channel is dead or "
                "saturated, record it again or leave the joint out."
            )
    if after - first < 50 or mended.t[after - 1] - mended.t[first] < 0.5 * (run.t[-1] - run.t[0]):
        raise InputError(f"{where}: little is left once steps of the positions are cut off; record it again.")
    part = slice(first, after)
    kept = replace(
        mended,
        t=mended.t[part],
        q=mended.q[part],
        tau=mended.tau[part],
        qd=None if run.qd is None else run.qd[part],
        temperature=None if run.temperature is None else run.temperature[part],
    )
    return Cleaned(kept, faulty[part], notes)
