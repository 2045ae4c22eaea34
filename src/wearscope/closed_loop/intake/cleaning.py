"""Recording faults that no machine makes: spikes, steps of the encoder, frozen torque.

Faults that need no guess are corrected; their samples are left out of all fits, and a note reports them. A
position channel that steps in the middle of a run is refused, since either part may be the wrong one.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from wearscope.closed_loop.intake.acceptance import Acceptance
from wearscope.closed_loop.intake.recording import LEAST_CHANGES, Run, estimate_quantum
from wearscope.errors import InputError

#: A change from sample to sample is a fault where it exceeds this multiple of this percentile of the run's
#: changes ...
_ODD, _USUAL = 10.0, 98.0
#: ... and also this share of the largest speed (for a position) or of the torque's span (for a torque).
_OF_SPEED, _OF_SPAN = 0.25, 0.5
#: Widest spike [samples].
LONGEST_SPIKE = 4
#: Longest part at either end of a run that may be cut off [s]; shortest frozen stretch, in seconds and in
#: rows.
_START, _FROZEN_TIME, _FROZEN_ROWS = 1.5, 0.2, 20
#: Share of a position's span beyond which a step can be a fault; smaller ones are lost motion of the gear.
_STEP = 0.03
#: A faulty step begins or ends with a difference of at least this share of its largest one. In a quick
#: minimum-jerk move it is two thirds.
_ABRUPT = 0.75
#: Number of samples in which a joint that broke away keeps moving.
_SLIDES = 6
#: Largest share of a channel's rows in which spikes are still bridged.
_MOST = 0.01
#: Where a torque has more than the second number of constant stretches, a frozen one lasts at least the first
#: number times their 95th percentile.
_LONG, _MANY = 4.0, 20
#: A torque that is frozen or faulty in more than this share of a run is a dead channel; none of it counts.
MOST_FROZEN = 0.8
#: Position differences up to this many encoder steps are reading errors. A joint rests where its usual range
#: is at most this share of its reach, or at most this many encoder steps.
QUANTA, _RESTING, _RESTING_QUANTA = 5.0, 2e-3, 10.0


@dataclass
class Cleaned:
    """A run without its faults.

    Attributes
    ----------
    run : Run
        Uniformly sampled, without the rows beyond a step of a position.
    faulty : ndarray (N, n) of bool
        Samples, by joint, that were corrected or are no measurements; they must not count.
    notes : list of str
    """

    run: Run
    faulty: np.ndarray
    notes: list[str]


def find_stretches(marked: np.ndarray, apart: int = 1) -> list[tuple[int, int]]:
    """First and last index of each stretch of marked samples (N,).

    Marked samples belong to one stretch where they are at most `apart` samples apart.
    """
    at = np.flatnonzero(marked)
    if not len(at):
        return []
    breaks = np.flatnonzero(np.diff(at) > apart)
    first, last = at[np.r_[0, breaks + 1]], at[np.r_[breaks, len(at) - 1]]
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _least_odd(q: np.ndarray, quantum: float, reach: float) -> float:
    """Largest difference of a position (N,) that is no fault.

    This is a few encoder steps. Where the joint rests, its usual range counts too: a toggling count stays
    within that range, even where the recorder interpolated.
    """
    usual = float(np.ptp(np.percentile(q, [0.5, 99.5])))
    rests = usual <= max(_RESTING * reach, _RESTING_QUANTA * quantum)
    return max(QUANTA * quantum, 2.0 * usual if rests else 0.0, 1e-9)


def _depart(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Deviation (N-1,) of each position difference from the running median, and that median (N-1,)."""
    step = np.diff(q)
    around = ndimage.median_filter(step, 11, mode="nearest")
    return step - around, around


def _odd_steps(q: np.ndarray, floor: float) -> np.ndarray:
    """Deviation (N-1,) of faulty differences of a position (N,) from the running median; 0 elsewhere."""
    step = np.diff(q)
    sizes = np.abs(step[step != 0.0])
    resolution = float(sizes.min()) if len(sizes) >= LEAST_CHANGES else 0.0
    odd, around = _depart(q)
    least = max(
        _ODD * float(np.percentile(np.abs(odd), _USUAL)),
        _OF_SPEED * float(np.percentile(np.abs(around), 99.5)),
        _ODD * resolution,
        floor,
    )
    return np.where(np.abs(odd) > least, odd, 0.0)


def _is_abrupt(q: np.ndarray, odd: np.ndarray, low: int, high: int) -> bool:
    """Whether faulty differences begin or end abruptly, unlike a quick move in a slow recording."""
    step = np.diff(q)
    before, after = step[max(low - 1, 0)], step[min(high + 1, len(step) - 1)]
    edge = max(abs(step[low] - before), abs(step[high] - after))
    return bool(edge >= _ABRUPT * np.abs(odd[low : high + 1]).max())


def _comes_back(q: np.ndarray, net: float, low: int, high: int) -> bool:
    """Whether a position returns right before or after faulty differences: a push does, a lost count not."""
    rest, _ = _depart(q)
    around = rest[max(low - LONGEST_SPIKE, 0) : low], rest[high + 1 : high + 1 + LONGEST_SPIKE]
    return any(abs(net + float(part.sum())) < 0.5 * abs(net) for part in around)


def _breaks_away(q: np.ndarray, net: float, low: int, high: int) -> bool:
    """Whether a joint at rest moves on after faulty differences: it broke away, and no count was lost."""
    before = q[low] - q[max(low - _SLIDES, 0)]
    after = q[min(high + 1 + _SLIDES, len(q) - 1)] - q[high + 1]
    return bool(abs(before) < 0.1 * abs(net) and after * np.sign(net) > 0.2 * abs(net))


def _is_recorded(run: Run, odd: np.ndarray, j: int, low: int, high: int) -> bool:
    """Whether the recorded speed confirms that joint `j` moved as far as the faulty differences say."""
    if run.qd is None:
        return False
    at = slice(low, high + 2)
    speed, dt = run.qd[at, j], np.diff(run.t[at])
    moved = 0.5 * (speed[1:] + speed[:-1]) * dt
    return bool((np.abs(np.diff(run.q[at, j]) - moved) <= 0.25 * np.abs(odd[low : high + 1]).max()).all())


def _returns(net: float, nets: np.ndarray) -> bool:
    """Whether one of the run's steps `nets` undoes at least half of `net`, as with a gear's lost motion."""
    return bool((-np.sign(net) * nets >= 0.5 * abs(net)).any())


def _bridge(x: np.ndarray, first: int, last: int) -> None:
    """Replace samples `first` to `last` by the cubic through four good neighbours on either side."""
    rows = np.arange(max(first - 4, 0), min(last + 5, len(x)))
    good = rows[(rows < first) | (rows > last)]
    degree = min(3, len(good) - 1)
    centre = 0.5 * (first + last)
    inside = np.arange(first, last + 1)
    x[inside] = np.polyval(np.polyfit(good - centre, x[good], degree), inside - centre)


@dataclass
class _Position:
    """Faults of one position channel: its good rows, `first` to before `after`, and how many are bridged."""

    first: int
    after: int
    spikes: int = 0

    def list_notes(self, label: str, joint: str, t: np.ndarray) -> list[str]:
        notes = []
        if self.spikes:
            notes.append(f"{label}: spikes of q_{joint} in {self.spikes} rows were bridged and do not count.")
        if self.first:
            notes.append(
                f"{label}: q_{joint} steps at t = {t[self.first]:.6g} s; the rows before it are cut off."
            )
        if self.after < len(t):
            notes.append(
                f"{label}: q_{joint} steps at t = {t[self.after]:.6g} s; the rows from there on are cut off."
            )
        return notes


def _clean_position(
    run: Run, j: int, joint: str, floor: float, where: str, accepted: Acceptance
) -> tuple[_Position, np.ndarray, list[str]]:
    """Correct a position in place; return its faults, a mask (N,) of rows that do not count, and notes."""
    q, t = run.q[:, j], run.t
    as_recorded = q.copy()
    found, faulty, notes = _Position(0, len(q)), np.zeros(len(q), dtype=bool), []
    odd = _odd_steps(q, floor)
    stretches = find_stretches(odd != 0.0, apart=LONGEST_SPIKE)
    nets = np.array([odd[low : high + 1].sum() for low, high in stretches])
    for low, high in stretches:
        path = np.cumsum(odd[low : high + 1])
        net, largest = float(path[-1]), float(np.abs(path).max())
        if abs(net) < 0.2 * largest:
            found.spikes += high - low
            _bridge(q, low + 1, high)
            faulty[low + 1 : high + 1] = True
        elif abs(net) <= _STEP * float(np.ptp(q)) or (high > low and _returns(net, nets)):
            continue
        elif not _is_abrupt(q, odd, low, high) or _is_recorded(run, odd, j, low, high):
            continue
        elif _comes_back(q, net, low, high) or _breaks_away(q, net, low, high):
            continue
        elif accepted.accepts(f"step q_{joint}"):
            told = f"column 'q_{joint}' steps by {net:.3g} at t = {t[high + 1]:.6g} s."
            notes.append(accepted.refuse(run.label, told, f"step q_{joint}"))
        elif t[high + 1] - t[0] <= _START:
            found.first = max(found.first, high + 1)
        elif t[-1] - t[low] <= _START:
            found.after = min(found.after, low + 1)
        else:
            told = (
                f"column 'q_{joint}' steps by {net:.3g} at t = {t[high + 1]:.6g} s, as no joint moves; split "
                "the run there or correct the channel."
            )
            accepted.refuse(where, told, f"step q_{joint}")
    if found.spikes > _MOST * len(q):
        told = f"column 'q_{joint}' has spikes in {found.spikes} rows; correct the channel or record again."
        notes.append(accepted.refuse(where, told, f"spikes q_{joint}"))
        q[:] = as_recorded
        return _Position(0, len(q)), np.zeros(len(q), dtype=bool), notes
    return found, faulty, notes + found.list_notes(run.label, joint, t)


def _clean_torque(
    run: Run, j: int, joint: str, where: str, accepted: Acceptance
) -> tuple[np.ndarray, list[str]]:
    """Bridge spikes of a torque in place; return a mask (N,) of rows that do not count, and notes."""
    spiky = _bridge_spikes(run.tau[:, j])
    off = np.zeros(len(run.t), dtype=bool) if run.off is None else run.off[:, j]
    notes: list[str] = []
    if spiky.any():
        notes.append(
            f"{run.label}: spikes of tau_{joint} in {int(spiky.sum())} rows were bridged and do not count."
        )
    frozen = _find_frozen(run, j) & ~off
    if frozen.mean() > MOST_FROZEN:
        told = (
            f"column 'tau_{joint}' does not change over most of the run; the channel is dead or saturated, "
            "record it again or leave the joint out."
        )
        notes.append(accepted.refuse(where, told, f"frozen tau_{joint}"))
        return spiky, notes
    if frozen.any():
        notes.append(
            f"{run.label}: tau_{joint} does not change in {int(frozen.sum())} rows in which the joint moves; "
            "they do not count."
        )
    if np.ptp(run.tau[:, j]) == 0.0:
        frozen[:] = True
        notes.append(f"{run.label}: tau_{joint} is constant while the joint rests; its rows do not count.")
    return spiky | frozen | off, notes


def _bridge_spikes(tau: np.ndarray) -> np.ndarray:
    """Bridge the spikes of a torque (N,) in place; return a mask (N,) of them."""
    odd = np.abs(tau - ndimage.median_filter(tau, 2 * LONGEST_SPIKE + 1, mode="nearest"))
    span = float(np.ptp(np.percentile(tau, [1, 99])))
    spiky = odd > max(_ODD * float(np.percentile(odd, _USUAL)), _OF_SPAN * span, 1e-12)
    for low, high in find_stretches(spiky):
        change = abs(tau[min(high + 1, len(tau) - 1)] - tau[max(low - 1, 0)])
        if high - low >= LONGEST_SPIKE or change > 0.3 * odd[low : high + 1].max():
            spiky[low : high + 1] = False
            continue
        _bridge(tau, low, high)
    return spiky


def _find_frozen(run: Run, j: int) -> np.ndarray:
    """Samples (N,) in which a torque does not change although its joint moves."""
    tau = run.tau[:, j]
    shortest = max(_FROZEN_ROWS, int(_FROZEN_TIME / float(np.median(np.diff(run.t)))))
    frozen = np.zeros(len(tau), dtype=bool)
    stretches = find_stretches(np.diff(tau) == 0.0)
    if len(stretches) > _MANY:
        # A coarsely quantised torque keeps one value for several samples without being frozen.
        usual = float(np.percentile([high + 1 - low for low, high in stretches], 95))
        shortest = max(shortest, int(_LONG * usual))
    least = 1e-3 * float(np.ptp(run.q[:, j]))
    for low, high in stretches:
        if high + 1 - low >= shortest and np.ptp(run.q[low : high + 2, j]) > least:
            frozen[low : high + 2] = True
    return frozen


def clean_run(
    run: Run,
    joints: list[str],
    where: str,
    reach: np.ndarray | None = None,
    accepted: Acceptance | None = None,
) -> Cleaned:
    """Bridge spikes of a run, cut off steps near its ends, and mark the samples that must not count.

    Parameters
    ----------
    run : Run
        Uniformly sampled; it is not changed.
    joints : list of str
    where : str
        What to call the run in messages.
    reach : ndarray (n,), optional
        Largest span of each position in the runs of the data set; this run's own where None.
    accepted : Acceptance, optional

    Raises
    ------
    InputError
        Where a position steps in the middle of the run, has too many spikes, or too little is left.
    """
    accepted = accepted or Acceptance()
    cleaned = replace(run, q=run.q.copy(), tau=run.tau.copy())
    quantum = estimate_quantum(run.q) if run.quantum is None else run.quantum
    reach = np.ptp(run.q, axis=0) if reach is None else reach
    notes: list[str] = []
    first, after = 0, len(run.t)
    odd_position = np.zeros(len(run.t), dtype=bool)
    for j, joint in enumerate(joints):
        floor = _least_odd(run.q[:, j], float(quantum[j]), float(reach[j]))
        found, odd, told = _clean_position(cleaned, j, joint, floor, where, accepted)
        first, after = max(first, found.first), min(after, found.after)
        odd_position |= odd
        notes += told
    # A wrong position of one joint makes the rigid-body torque of all of them wrong.
    faulty = np.repeat(odd_position[:, None], len(joints), axis=1)
    for j, joint in enumerate(joints):
        if run.off is not None and run.off[:, j].all():
            faulty[:, j] = True
            continue
        odd, told = _clean_torque(cleaned, j, joint, where, accepted)
        faulty[:, j] |= odd
        notes += told
    if after - first < 50 or cleaned.t[after - 1] - cleaned.t[first] < 0.5 * (run.t[-1] - run.t[0]):
        raise InputError(f"{where}: little is left once steps of the positions are cut off; record it again.")
    return Cleaned(cleaned.cut(first, after), faulty[first:after], notes)
