"""What a residual does in time: it jumps, its level shifts, or it has a line."""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.diagnostics.jumps import find_jumps
from wearscope.closed_loop.diagnostics.level_shift import fit_shift
from wearscope.closed_loop.diagnostics.lines import find_common_line, find_line
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.selection.policy import Policy

#: Least deviance of shifts of level: in 600 series of a kind, those of noise and drifts reach 25.
_SHIFTED = 30.0


@dataclass(frozen=True)
class Seen:
    """Structure that was seen in a joint's residual.

    Attributes
    ----------
    share : float
        Of its variance.
    depends_on : list of str
        Signals that it depends on, as far as that is known.
    reason : str
        How it was seen.
    """

    share: float
    depends_on: list[str]
    reason: str


def see_jumps(
    train: list[PreparedRun], own: list[np.ndarray], keep: list[np.ndarray], policy: Policy
) -> list[Seen]:
    """Jumps in time of single runs; the run that holds most of the residual's square is told."""
    seen = []
    for run, x, k, part in zip(train, own, keep, _share_out(own, keep), strict=True):
        jumps = find_jumps(run.t[k], x[k])
        if jumps is not None:
            share = jumps.share * part
            where = f"{abs(jumps.size):.3g} at {jumps.time:.3g} s of {run.file}"
            seen.append((share, f"it jumps in time, most by {where}"))
    share = sum(part for part, _ in seen)
    return [Seen(share, ["t"], max(seen)[1])] if share >= policy.structure_share else []


def see_shifts(
    train: list[PreparedRun], own: list[np.ndarray], keep: list[np.ndarray], policy: Policy
) -> list[Seen]:
    """A shift of level at a moment of each run, by all runs together; the surest is told."""
    found = []
    for run, x, k, part in zip(train, own, keep, _share_out(own, keep), strict=True):
        shift = fit_shift(run.t[k], x[k])
        if shift is not None:
            found.append((shift, shift.share * part, run.file))
    if sum(shift.deviance for shift, _, _ in found) < _SHIFTED:
        return []
    share = sum(part for shift, part, _ in found if shift.deviance > 0.0)
    if share < policy.structure_share:
        return []
    most, _, file = max(found, key=lambda one: one[0].deviance)
    told = f"its level shifts at a moment, surest by {abs(most.size):.3g} at {most.time:.3g} s of {file}"
    return [Seen(share, ["t"], told)]


def _share_out(own: list[np.ndarray], keep: list[np.ndarray]) -> list[float]:
    """Share of the residual's square that each run has."""
    squares = [float((x[k] ** 2).sum()) for x, k in zip(own, keep, strict=True)]
    return [square / max(sum(squares), 1e-300) for square in squares]


def see_lines(full: list[np.ndarray], rate: float, rms: float, joints: int, policy: Policy) -> list[Seen]:
    """A torque that is periodic in time, as most runs have it.

    Parameters
    ----------
    full : list of ndarray (N,)
        Residual of each run before the common filter.
    rate : float
    rms : float
        Of the residual after it, whose share is told.
    joints : int
        At how many it is asked.
    policy : Policy
    """
    found = [(line, x) for x in full if (line := find_line(x, rate)) is not None]
    if not found or np.median([line.share for line, _ in found]) < policy.structure_share:
        return _from_common_line(full, rate, joints, policy)
    size = float(np.median([line.share * np.var(x) for line, x in found])) / max(rms**2, 1e-300)
    middle = float(np.median([line.frequency for line, _ in found]))
    return [Seen(size, ["t"], f"a line at {middle:.3g} Hz in time")]


def _from_common_line(full: list[np.ndarray], rate: float, joints: int, policy: Policy) -> list[Seen]:
    """A slow or weak line that the runs have in common."""
    line = find_common_line(full, rate)
    if line is None or line.share < policy.structure_share or line.p_value * joints > policy.unknown_level:
        return []
    return [Seen(line.share, ["t"], f"a line at {line.frequency:.3g} Hz in time, common to the runs")]
