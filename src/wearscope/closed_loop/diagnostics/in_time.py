"""What a residual does in time: it jumps, its level shifts, or it has a line."""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.diagnostics.jumps import find_jumps, fit_shift
from wearscope.closed_loop.inference.lines import CommonLine, find_common_line, find_line
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.series import bridge_uncounted
from wearscope.closed_loop.intake.prepared import PreparedRun

#: Share of what is left of a single recording from which a level is told.
_LEVEL = 0.7
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
    return [Seen(share, [], told)] if share >= _LEVEL else []


def see_lines(
    full: list[np.ndarray], train: list[PreparedRun], own: list[np.ndarray], keep: list[np.ndarray],
    rate: float, cut_off: float, joints: int, policy: Policy,
) -> list[Seen]:  # fmt: skip
    """A torque that is periodic in time, as most runs have it, below the common cut-off.

    Parameters
    ----------
    full : list of ndarray (N,)
        Residual of each run before the common filter.
    train : list of PreparedRun
    own : list of ndarray (M,)
        Residual of each run after it.
    keep : list of ndarray (M,) of bool
        Rows that count.
    rate : float
        Of the residuals before the filter [Hz].
    cut_off : float
        Of the filter [Hz]: no torque that is compared has a hum above it.
    joints : int
        At how many it is asked.
    policy : Policy
    """
    found = [(line, x) for x in full if (line := find_line(x, rate)) is not None]
    shares = [line.share if line.frequency < cut_off else 0.0 for line, _ in found]
    if not found or np.median(shares) < policy.structure_share:
        # Before the filter rows that do not count, at reversals and rests, may hide a line.
        bridged = [bridge_uncounted(x[:, None], k)[:, 0] for x, k in zip(own, keep, strict=True)]
        slower = 1.0 / float(np.median(np.diff(train[0].t)))
        commons = [find_common_line(full, rate), find_common_line(bridged, slower)]
        slow = [line for line in commons if line is not None and line.frequency < cut_off]
        return _from_common_lines(slow, joints, policy)
    counted = np.concatenate([x[k] for x, k in zip(own, keep, strict=True)])
    power = float(np.mean(counted**2)) if len(counted) else 0.0
    size = float(np.median([share * np.var(x) for share, (_, x) in zip(shares, found, strict=True)])) / max(
        power, 1e-300
    )
    middle = float(np.median([line.frequency for line, _ in found if line.frequency < cut_off]))
    return [Seen(size, ["t"], f"a line at {middle:.3g} Hz in time")]


def _from_common_lines(lines: list[CommonLine], joints: int, policy: Policy) -> list[Seen]:
    """A slow or weak line that the runs have in common, the surest of those looked for."""
    sure = [x for x in lines if x.p_value * joints * len(lines) <= policy.unknown_level]
    large = [x for x in sure if x.share >= policy.structure_share]
    if not large:
        return []
    line = min(large, key=lambda x: x.p_value)
    return [Seen(line.share, ["t"], f"a line at {line.frequency:.3g} Hz in time, common to the runs")]
