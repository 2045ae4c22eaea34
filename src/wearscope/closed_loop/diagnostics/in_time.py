"""What a residual does in time: it jumps, its level shifts, or it has a line."""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.diagnostics.jumps import find_jumps
from wearscope.closed_loop.diagnostics.level_shift import fit_shift
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.selection.lines import find_common_line
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.whitening import bridge_uncounted

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


def see_level(
    train: list[PreparedRun], own: list[np.ndarray], keep: list[np.ndarray], policy: Policy
) -> list[Seen]:
    """What is left of a single recording is a level, which it does not tell from a drift's."""
    counted = np.concatenate([x[k] for x, k in zip(own, keep, strict=True)])
    if len({run.file for run in train}) > 1 or not np.any(counted):
        return []
    level = float(np.mean(counted))
    share = level**2 / float(np.mean(counted**2))
    told = f"a level of {level:.3g}, an offset or a drift, which a single run does not tell apart"
    return [Seen(share, [], told)] if share >= policy.beyond_doubt else []


def _share_out(own: list[np.ndarray], keep: list[np.ndarray]) -> list[float]:
    """Share of the residual's square that each run has."""
    squares = [float((x[k] ** 2).sum()) for x, k in zip(own, keep, strict=True)]
    return [square / max(sum(squares), 1e-300) for square in squares]


def see_lines(
    train: list[PreparedRun], own: list[np.ndarray], keep: list[np.ndarray], joints: int, policy: Policy
) -> list[Seen]:
    """A torque that is periodic in time, of one frequency in all runs and within the common band.

    Parameters
    ----------
    train : list of PreparedRun
    own : list of ndarray (M,)
        Residual of each run after the common filter; no torque that is compared has a hum above its cut-off.
    keep : list of ndarray (M,) of bool
        Rows that count.
    joints : int
        At how many it is asked.
    policy : Policy
    """
    # Rows that do not count, at reversals and rests, may hide a line.
    bridged = [bridge_uncounted(x[:, None], k)[:, 0] for x, k in zip(own, keep, strict=True)]
    line = find_common_line(bridged, 1.0 / float(np.median(np.diff(train[0].t))))
    if line is None or line.p_value * joints > policy.unknown_level or line.share < policy.structure_share:
        return []
    return [Seen(line.share, ["t"], f"a line at {line.frequency:.3g} Hz in time, common to the runs")]
