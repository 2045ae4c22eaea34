"""Speed over which a joint's friction changes its sign (the width of its reversal).

A reversal that is modelled sharper or smoother than the machine's looks like friction at low speed after the
filters. The width is fitted on the training runs together with the rough model, friction by the load and
quadratic drag. The narrowest width that fits as well as the best one, within the noise, is taken. The search
for missing effects fits it again, with the terms that it finds.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from wearscope.closed_loop.intake.direction import average_direction, soften_direction
from wearscope.closed_loop.intake.filtering import Band, low_pass, rows
from wearscope.closed_loop.intake.rough_model import RoughRun, fit_bounded
from wearscope.closed_loop.intake.saturation import spread_out

#: Widths that are tried, over the joint's largest speed in the training runs.
WIDTHS = (0.0, *np.geomspace(5e-4, 0.25, 19).tolist())
#: Length of a block of residuals in periods of the common filter; most samples that are looked at.
_BLOCK_PERIODS, _MOST_SAMPLES = 4.0, 150_000


@dataclass(frozen=True)
class _JointRows:
    """One joint of one run: filtered columns, and full-rate signals of columns that the width changes."""

    tau: np.ndarray
    fixed: np.ndarray
    v: np.ndarray
    load: np.ndarray
    sign: np.ndarray
    keep: np.ndarray
    band: Band
    averaged: bool

    def design(self, width: float) -> np.ndarray:
        """Regressors (M, 7), those that the width changes first: direction, friction by load."""
        take = average_direction if self.averaged else soften_direction
        sign = take(self.v, width, self.sign)
        moving = np.column_stack([sign, sign * np.abs(self.load)])
        reduced = low_pass(moving, self.band.torque, self.band.rate)[rows(self.band, len(sign))]
        return np.column_stack([reduced[self.keep], self.fixed])


def _take_joint(run: RoughRun, j: int, band: Band, averaged: bool) -> _JointRows:
    v, known = run.v[:, j], run.known[:, j]
    columns = np.column_stack([run.tau[:, j], known, run.a[:, j], v, np.abs(v) * v, np.ones(len(v))])
    at = rows(band, len(v))
    keep = ~spread_out(run.faulty[:, [j]], int(band.rate / band.torque))[at, 0]
    reduced = low_pass(columns, band.torque, band.rate)[at][keep]
    return _JointRows(reduced[:, 0], reduced[:, 1:], v, known, run.sign[:, j], keep, band, averaged)


def _choose_width(parts: list[_JointRows], length: int, widths: np.ndarray) -> float:
    """The narrowest of `widths` whose error is within a standard error (over blocks) of the best one's."""
    tau = np.concatenate([part.tau for part in parts])
    edges = np.cumsum([0, *(len(part.tau) for part in parts)]).tolist()
    starts = np.concatenate([np.arange(a, b, length) for a, b in pairwise(edges)])
    losses = []
    for width in widths.tolist():
        x = np.vstack([part.design(width) for part in parts])
        # Friction dissipates power, so its coefficient is not negative.
        lower = np.where(np.arange(x.shape[1]) == 0, 0.0, -np.inf)
        theta = fit_bounded(x, tau, lower, np.full(x.shape[1], np.inf))[1]
        losses.append(np.add.reduceat((tau - x @ theta) ** 2, starts))
    best = min(losses, key=np.sum)
    worse = [loss - best for loss in losses]
    good = [w.sum() <= np.sqrt(len(w)) * w.std() for w in worse]
    return float(widths[good.index(True)])


def choose_reversal_widths(
    runs: list[RoughRun], moving: np.ndarray, band: Band, averaged: bool = False
) -> np.ndarray:
    """Speed (n,) over which each joint's friction changes its sign; 0 is an abrupt change.

    Parameters
    ----------
    runs : list of RoughRun
        Training runs, at `band.rate`.
    moving : ndarray (n,) of bool
        Joints that move in them; the others get 0.
    band : Band
    averaged : bool
        Whether the runs are thinned; the direction of motion is later taken at the recording's rate.
    """
    every = max(1, -(-sum(len(run.t) for run in runs) // _MOST_SAMPLES))
    runs = runs[::every]
    length = max(2, int(_BLOCK_PERIODS * band.rate / band.torque / band.stride))
    widths = np.zeros(len(moving))
    for j in np.flatnonzero(moving):
        top = max(float(np.abs(run.v[:, j]).max()) for run in runs)
        parts = [_take_joint(run, int(j), band, averaged) for run in runs]
        parts = [part for part in parts if len(part.tau) > length]
        if parts and top > 0.0:
            widths[j] = _choose_width(parts, length, top * np.array(WIDTHS))
    return widths
