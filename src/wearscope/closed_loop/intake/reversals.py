"""Over which speed a joint's friction changes its sign.

A reversal that is modelled sharper or smoother than the machine's leaks through the filters and looks like
friction at low speed. The width is sought on the training runs with the rough model, friction under load and
drag of second order with it; friction that grows towards rest, or lags the reversal by a distance, only
where the torque clearly asks for it. The narrowest width that does as well as the best within the noise is
taken.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.direction import average_direction, soften_direction
from wearscope.closed_loop.intake.filtering import Band, low_pass, rows
from wearscope.closed_loop.intake.rough_model import RoughRun, fit_bounded
from wearscope.closed_loop.intake.saturation import spread_out

#: Widths that are tried, over the joint's largest speed in the training runs.
WIDTHS = (0.0, *np.geomspace(5e-4, 0.25, 19).tolist())
#: Speeds over which friction that grows towards rest falls off, as shares of the largest speed.
_STRIBECK = (0.02, 0.1)
#: Distances over which friction builds up after a reversal (presliding), over the distance that the joint
#: travels at its largest speed in a second.
_PRESLIDING = (0.002, 0.01, 0.05)
#: Length of a block of residuals in periods of the common filter; most samples that are looked at.
_BLOCK_PERIODS, _MOST_SAMPLES = 4.0, 150_000
#: Friction that grows towards rest is fitted with the width only where it lowers the loss by this share.
_CLEAR = 0.1


def _lag_direction(sign: np.ndarray, travelled: np.ndarray, distance: float) -> np.ndarray:
    """Direction (N,) that follows a reversal over a distance: dz = (sign - z) d(travelled) / distance."""
    lagged, state = np.empty(len(sign)), 0.0
    edges = [0, *(np.flatnonzero(np.diff(sign)) + 1).tolist(), len(sign)]
    for start, stop in pairwise(edges):
        since = travelled[start:stop] - travelled[max(start - 1, 0)]
        lagged[start:stop] = sign[start] + (state - sign[start]) * np.exp(-since / distance)
        state = lagged[stop - 1]
    return lagged


@dataclass(frozen=True)
class _JointRows:
    """One joint of one run: reduced columns, and full-rate signals for columns that the width changes."""

    tau: np.ndarray
    fixed: np.ndarray
    v: np.ndarray
    load: np.ndarray
    sign: np.ndarray
    keep: np.ndarray
    top: float
    band: Band
    averaged: bool

    def design(self, width: float) -> np.ndarray:
        """Regressors (M, K) that the width changes: direction, friction towards rest, friction by load."""
        take = average_direction if self.averaged else soften_direction
        sign = take(self.v, width, self.sign)
        rest = [sign * np.exp(-np.abs(self.v) / (share * self.top)) for share in _STRIBECK]
        moving = np.column_stack([sign, *rest, sign * np.abs(self.load)])
        return low_pass(moving, self.band.torque, self.band.rate)[rows(self.band, len(sign))][self.keep]


def _take_joint(run: RoughRun, j: int, band: Band, top: float, averaged: bool) -> _JointRows:
    v, sign = run.v[:, j], run.sign[:, j]
    travelled = np.cumsum(np.abs(v)) / band.rate
    lagging = [_lag_direction(np.sign(v), travelled, share * top) - np.sign(v) for share in _PRESLIDING]
    columns = np.column_stack(
        [run.tau[:, j], *lagging, run.known[:, j], run.a[:, j], v, np.abs(v) * v, np.ones(len(v))]
    )
    at = rows(band, len(v))
    reduced = low_pass(columns, band.torque, band.rate)[at]
    bad = spread_out(run.faulty[:, [j]], int(band.rate / band.torque))[at, 0]
    return _JointRows(reduced[~bad, 0], reduced[:, 1:], v, run.known[:, j], sign, ~bad, top, band, averaged)


class _Losses:
    """Squared residuals by block, as a function of the width; all other columns are factorised once.

    Parameters
    ----------
    parts : list of _JointRows
    length : int
        Rows of a block.
    shaped : bool
        Whether friction towards rest and what lags are fitted too.
    designs : dict of float to ndarray
        By width, what the parts' designs are; shared by the losses of one joint.
    """

    def __init__(
        self, parts: list[_JointRows], length: int, shaped: bool, designs: dict[float, np.ndarray]
    ) -> None:
        self.parts, self.shaped, self.designs = parts, shaped, designs
        self.y = np.concatenate([part.tau for part in parts])
        first = 0 if shaped else len(_PRESLIDING)
        self.fixed = np.vstack([part.fixed[part.keep, first:] for part in parts])
        self.basis, self.factor = np.linalg.qr(self.fixed)
        edges = np.cumsum([0, *(len(part.tau) for part in parts)])
        self.starts = np.concatenate([np.arange(a, b, length) for a, b in pairwise(edges.tolist())])

    def at(self, width: float) -> np.ndarray:
        """Squared residual of each block (B,) where the direction changes over `width`."""
        if width not in self.designs:
            self.designs[width] = np.vstack([part.design(width) for part in self.parts])
        moving = self.designs[width] if self.shaped else self.designs[width][:, [0, -1]]
        onto = self.basis.T @ moving
        rest = moving - self.basis @ onto
        # Once more, so that nearly collinear columns are orthogonal to rounding.
        again = self.basis.T @ rest
        own, factor = np.linalg.qr(rest - self.basis @ again)
        k, fixed = moving.shape[1], self.fixed.shape[1]
        x = np.block([[onto + again, self.factor], [factor, np.zeros((k, fixed))]])
        y = np.concatenate([self.basis.T @ self.y, own.T @ self.y])
        lower = np.full(k + fixed, -np.inf)
        # Friction takes power; so does the part that grows towards rest, and the part that lags comes late.
        lower[: 1 + (len(_STRIBECK) + len(_PRESLIDING) if self.shaped else 0)] = 0.0
        theta = fit_bounded(x, y, lower, np.full(k + fixed, np.inf))[1]
        left = (self.y - moving @ theta[:k] - self.fixed @ theta[k:]) ** 2
        return np.add.reduceat(left, self.starts)


def _choose_width(parts: list[_JointRows], length: int) -> float:
    """Width of a joint's reversal, over the largest speed, without or with friction that grows towards rest.

    A wide reversal with such friction looks much like a narrower one without it. So it is fitted only where
    the torque clearly asks for it.
    """
    designs: dict[float, np.ndarray] = {}
    width, plain = _choose_width_with(parts, _Losses(parts, length, False, designs))
    other, rich = _choose_width_with(parts, _Losses(parts, length, True, designs))
    gain = plain - rich
    clear = gain.sum() > max(2.0 * np.sqrt(len(gain)) * gain.std(), _CLEAR * rich.sum())
    return other if clear else width


def _choose_width_with(parts: list[_JointRows], by_width: _Losses) -> tuple[float, np.ndarray]:
    """Narrowest width that does as well as the best within a standard error, and its losses by block."""
    top = parts[0].top
    losses = {width: by_width.at(width * top) for width in WIDTHS}
    best = min(losses, key=lambda width: losses[width].sum())
    k = WIDTHS.index(best)
    if k > 0:
        low, high = WIDTHS[k - 1] or 0.3 * WIDTHS[1], WIDTHS[min(k + 1, len(WIDTHS) - 1)]
        found = optimize.minimize_scalar(
            lambda log: float(by_width.at(np.exp(log) * top).sum()),
            bounds=(np.log(low), np.log(high)),
            method="bounded",
            options={"xatol": 0.02, "maxiter": 12},
        )
        refined = float(np.exp(found.x))
        losses[refined] = by_width.at(refined * top)
        best = min(losses, key=lambda width: losses[width].sum())
    for width in sorted(losses):
        worse = losses[width] - losses[best]
        if worse.sum() <= np.sqrt(len(worse)) * worse.std():
            return width, losses[width]
    return best, losses[best]


def choose_reversal_widths(
    runs: list[RoughRun], moving: np.ndarray, band: Band, averaged: bool = False
) -> np.ndarray:
    """Speed (n,) over which each joint's friction changes its sign; 0 is at once.

    Parameters
    ----------
    runs : list of RoughRun
        Training runs, at `band.rate`.
    moving : ndarray (n,) of bool
        Joints that move in them; the others get 0.
    band : Band
    averaged : bool
        The runs are thinned from a higher rate, at which the direction will be taken.
    """
    every = max(1, -(-sum(len(run.t) for run in runs) // _MOST_SAMPLES))
    runs = runs[::every]
    length = max(2, int(_BLOCK_PERIODS * band.rate / band.torque / band.stride))
    widths = np.zeros(len(moving))
    for j in np.flatnonzero(moving):
        top = max(float(np.abs(run.v[:, j]).max()) for run in runs)
        parts = [_take_joint(run, int(j), band, top, averaged) for run in runs]
        parts = [part for part in parts if len(part.tau) > length]
        if parts and top > 0.0:
            widths[j] = _choose_width(parts, length) * top
    return widths
