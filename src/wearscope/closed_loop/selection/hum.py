"""Hum: a torque of one frequency in time, taken out of what the search compares.

It is no effect of the machine's motion, and a name that happens to have its frequency gains by it. What it is
worth stays in every error that is told, and its joint `unexplained` (`diagnostics/in_time.py`).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.lines import FEWEST_ROWS, find_common_line, find_line, make_waves
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Hum, Problem
from wearscope.closed_loop.selection.whitening import bridge_uncounted

#: Most lines of a joint, such as a hum's harmonics.
_MOST = 6
#: Share of the power of a signal of the motion from which on that has a line itself.
_OF_MOTION = 0.02
#: Share of a line that sines of one phase in all runs hold, from which on a term that goes with time has it.
_IN_STEP = 0.8
#: Frequencies that are compared within a resolved one to either side.
_STEPS = 20


@dataclass(frozen=True)
class _Rows:
    """A joint's rows that count in one run: times (M,) [s], what is left there (M,), the motion (M, 4 n)."""

    t: np.ndarray
    left: np.ndarray
    motion: np.ndarray


def find_hum(problem: Problem, model: Assembly, policy: Policy) -> Hum | None:
    """The hum that a model leaves, or None.

    Of each joint, line by line: one that stands out of the residual's spectrum, of one frequency in all runs,
    which holds `structure_share` of it. Lines that the motion has too are none of it, and neither are those
    with a phase that all runs share, which a term that goes with time predicts. Joints whose frequencies are
    not resolved have one.

    Parameters
    ----------
    problem : Problem
    model : Assembly
        With the terms found.
    policy : Policy
    """
    unpack, train = problem.layout.unpack, problem.train
    q, v, load = (problem.at_rows(name) for name in ("q", "v", "load"))
    motion = unpack(np.concatenate([q, v, np.abs(v), load], axis=1))
    moving = np.flatnonzero(problem.prepared.moving).tolist()
    kept = {joint: unpack(problem.layout.keep[:, joint]) for joint in moving}
    left = {joint: unpack(model.residual[:, joint]) for joint in moving}
    level = policy.unknown_level / max(len(moving), 1)

    def take(joint: int, x: Sequence[np.ndarray]) -> list[_Rows]:
        every = zip(train, x, motion, kept[joint], strict=True)
        return [_Rows(run.t[k], y[k], m[k]) for run, y, m, k in every if k.any()]

    lines: list[tuple[float, int]] = []
    for joint in moving:
        x = left[joint]
        for _ in range(_MOST):
            near = _find_frequency(problem, x, kept[joint], level, policy.structure_share)
            if near is None:
                break
            runs = take(joint, x)
            frequency = _refine([runs], near)
            if not _is_hum(runs, frequency, policy):
                break
            lines.append((near, joint))
            x = [y - _fit(run.t, y, k, frequency) for run, y, k in zip(train, x, kept[joint], strict=True)]
    if not lines:
        return None
    by_joint: dict[int, list[float]] = {}
    for group in _group(lines, 1.0 / max(float(np.ptp(run.t)) for run in train)):
        middle = float(np.median([frequency for frequency, _ in group]))
        frequency = _refine([take(joint, left[joint]) for _, joint in group], middle)
        for joint in {joint for _, joint in group}:
            by_joint.setdefault(joint, []).append(frequency)
    torque = np.zeros_like(model.target)
    for joint, own in by_joint.items():
        every = zip(train, left[joint], kept[joint], strict=True)
        torque[:, joint] = np.concatenate([_fit(run.t, y, k, np.array(own)) for run, y, k in every])
    return Hum(torque, by_joint)


def _group(lines: Sequence[tuple[float, int]], resolved: float) -> list[list[tuple[float, int]]]:
    """Lines (frequency [Hz], joint) whose neighbours are no further than is resolved [Hz]."""
    groups: list[list[tuple[float, int]]] = []
    for line in sorted(lines):
        if groups and line[0] - groups[-1][-1][0] < resolved:
            groups[-1].append(line)
        else:
            groups.append([line])
    return groups


def _find_frequency(
    problem: Problem, left: Sequence[np.ndarray], keep: Sequence[np.ndarray], level: float, share: float
) -> float | None:
    """Frequency [Hz] of the line that stands out in most runs, or that they have in common."""
    bridged = [bridge_uncounted(x[:, None], k)[:, 0] for x, k in zip(left, keep, strict=True) if k.any()]
    rate = 1.0 / float(np.median(np.diff(problem.train[0].t)))
    lines = [line for x in bridged if (line := find_line(x, rate, FEWEST_ROWS)) is not None]
    if lines and np.median([line.share for line in lines]) >= share:
        return float(np.median([line.frequency for line in lines]))
    common = find_common_line(bridged, rate)
    if common is None or common.p_value > level or common.share < share:
        return None
    return common.frequency


def _fit(t: np.ndarray, x: np.ndarray, keep: np.ndarray, frequencies: float | np.ndarray) -> np.ndarray:
    """Sines (M,) that fit the rows of a series that count best."""
    if not keep.any():
        return np.zeros(len(t))
    wave = make_waves(t, frequencies)
    return np.asarray(wave @ np.linalg.lstsq(wave[keep], x[keep], rcond=None)[0])


def _held(t: np.ndarray, x: np.ndarray, frequency: float) -> np.ndarray:
    """Sum of squares of series (M, K) that a sine holds, and of all about their means, (2, K)."""
    x = x - x.mean(axis=0)
    wave = make_waves(t, frequency)
    left = x - wave @ np.linalg.lstsq(wave, x, rcond=None)[0]
    return np.array([(x**2).sum(axis=0) - (left**2).sum(axis=0), (x**2).sum(axis=0)])


def _sum_held(runs: Sequence[_Rows], frequency: float) -> np.ndarray:
    """The same (2,) of what is left in runs, a sine in each."""
    return np.sum([_held(run.t, run.left[:, None], frequency)[:, 0] for run in runs], axis=0)


def _refine(joints: Sequence[Sequence[_Rows]], frequency: float) -> float:
    """The frequency near one at which sines hold the largest share of joints."""
    longest = max(float(np.ptp(run.t)) for runs in joints for run in runs)
    near = frequency + np.linspace(-1.5, 1.5, 3 * _STEPS + 1) / longest
    held = [sum(np.divide(*_sum_held(runs, f)) for runs in joints) for f in near]
    return float(near[int(np.argmax(held))])


def _is_hum(runs: Sequence[_Rows], frequency: float, policy: Policy) -> bool:
    """Whether a line is much, the motion has none there, and the runs share no phase of it.

    The phases of two runs agree by chance.
    """
    held, whole = _sum_held(runs, frequency)
    if not held >= policy.structure_share * whole:
        return False
    of_motion, motion = np.sum([_held(run.t, run.motion, frequency) for run in runs], axis=0)
    if (of_motion > _OF_MOTION * motion).any():
        return False
    if len(runs) < 3:
        return True
    t, left = (np.concatenate([getattr(run, name) for run in runs]) for name in ("t", "left"))
    return bool(_held(t, left[:, None], frequency)[0, 0] < _IN_STEP * held)
