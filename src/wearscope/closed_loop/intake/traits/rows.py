"""Rows of the runs, as stated, on which readings of the columns are compared."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import interpolate

from wearscope.closed_loop.intake.design_effect import JoinedBlocks
from wearscope.closed_loop.intake.filtering import differentiate, low_pass
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.traits.reading import Reading
from wearscope.effects.presliding_hysteresis import EFFECT as PRESLIDING

#: Largest number of rows of all runs; a joint with fewer rows than the second number does not count.
MOST_ROWS, LEAST_ROWS = 3000, 30
#: Margin at both ends of a recording [s] that is left out, since a torque may be late by as much.
LONGEST = 0.3
#: A drive is idle where its torque varies less than the first share of its usual variation, unless the motion
#: explains the second share of it. A joint rests in a run where it moves less than the third share of its
#: reach.
_QUIET, _MOST, _RESTS = 0.2, 0.5, 1e-2
#: Distances over which friction builds up after a reversal (presliding), as shares of the joint's reach, and
#: their least value [rad or m].
_YIELDS, _LEAST_WAY = (0.0003, 0.003), 1e-12
#: Step [s] of the delays that are undone before rests are bridged; the rest of a delay is undone afterwards.
_STEP = 0.02
#: Number of neighbouring rows in a block of residuals.
_BLOCK = 8
_MOTION = ("q", "v", "a", "sign", "sharp", "late", "slow", "jerk", "snap")


@dataclass(frozen=True)
class Rows:
    """Rows of some runs; arrays are (N, n).

    Attributes
    ----------
    prepared : Prepared
    q, v, a, jerk, snap : ndarray
        Position and its derivatives at the common bandwidth.
    sign, sharp, late, slow : ndarray
        Direction of motion with reversals of the fitted width; an abrupt direction less that one; directions
        that lag over a short and a longer distance (presliding) less the abrupt one.
    tau : ndarray
    counts : ndarray of bool
        Rows that count for a torque column.
    run, t : ndarray (N,)
        Number of the row's run, and its time in it [s].
    loaded, doubted : ndarray (N,) of bool
        Rows of runs that may carry a payload that is not stated; rows of runs to which a reading applies. The
        columns of all other runs are taken as stated.
    """

    prepared: Prepared
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    jerk: np.ndarray
    snap: np.ndarray
    sign: np.ndarray
    sharp: np.ndarray
    late: np.ndarray
    slow: np.ndarray
    tau: np.ndarray
    counts: np.ndarray
    run: np.ndarray
    t: np.ndarray
    loaded: np.ndarray
    doubted: np.ndarray

    @classmethod
    def of(cls, prepared: Prepared) -> "Rows":
        """Rows of all runs of a data set; those of idle drives do not count."""
        reach = np.max([np.ptp(run.signals.q, axis=0) for run in prepared.runs], axis=0)
        usual = np.median([_spread(run) for run in prepared.runs], axis=0)
        parts: list[dict[str, Any]] = []
        for k, run in enumerate(prepared.runs):
            own = _take(run, len(prepared.runs))
            travels = prepared.moving & (np.ptp(run.signals.q, axis=0) > _RESTS * reach)
            own["counts"] = own["counts"] & travels
            for j in np.flatnonzero(prepared.moving & (_spread(run) <= _QUIET * usual)).tolist():
                if np.ptp(run.signals.q[:, j]) > 0.0 and not _is_driven(run, own, j):
                    prepared.notes.append(
                        f"{run.label}: tau_{prepared.dataset.joints[j]} hardly varies, as of a joint that is "
                        "not driven; no reading of the columns is weighed on it."
                    )
                    own["counts"][:, j] = False
            every = np.ones(len(own["t"]), dtype=bool)
            parts.append({**own, "run": np.full(len(every), k), "loaded": every, "doubted": every})
        whole = cls(prepared, **{name: np.concatenate([one[name] for one in parts]) for name in parts[0]})
        starts, ends = (np.array([run.t[k] for run in prepared.runs])[whole.run] for k in (0, -1))
        inside = np.minimum(whole.t - starts, ends - whole.t) > LONGEST
        least = np.minimum(4 * LEAST_ROWS, whole.counts.sum(axis=0))
        return whole.pick(inside) if np.all(whole.counts[inside].sum(axis=0) >= least) else whole

    def pick(self, at: np.ndarray) -> "Rows":
        """Some of the rows."""
        names = (*_MOTION, "tau", "counts", "run", "t", "loaded", "doubted")
        return replace(self, **{name: getattr(self, name)[at] for name in names})

    def thin(self, most: int) -> "Rows":
        """Fewer rows for a first look: about `most` of the doubted runs, and as many of all others.

        A joint that is tested and for which too few of them count keeps rows of its own.
        """
        parts = [np.flatnonzero(self.doubted), np.flatnonzero(~self.doubted)]
        some = np.concatenate([one[:: max(1, len(one) // most)] for one in parts])
        for j in self.tested:
            if self.counts[some, j].sum() < LEAST_ROWS:
                own = np.flatnonzero(self.counts[:, j])
                some = np.append(some, own[:: max(1, len(own) // LEAST_ROWS)])
        return self.pick(np.unique(some))

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    @cached_property
    def slides(self) -> np.ndarray:
        """Mask (n,) of prismatic joints."""
        return np.array([unit == "m" for unit in self.prepared.dataset.position_unit])

    @property
    def joints(self) -> list[str]:
        """Names of the joints."""
        return self.prepared.dataset.joints

    @cached_property
    def scale(self) -> np.ndarray:
        """Spread (n,) of the torques in the rows that count; 0 where there are few or it is constant."""
        some = [self.tau[at, j] for j, at in enumerate(self.counts.T)]
        return np.array([y.std() if len(y) >= LEAST_ROWS and np.ptp(y) > 0.0 else 0.0 for y in some])

    @cached_property
    def tested(self) -> list[int]:
        """Indices of the torque columns that can be tested: those whose `scale` is not 0."""
        return [int(j) for j in np.flatnonzero(self.scale)]

    @cached_property
    def fold(self) -> np.ndarray:
        """Cross-validation fold (N,) of each row: whole runs, or fifths of each if fewer than three count."""
        number, length = np.unique(self.run, return_inverse=True, return_counts=True)[1:]
        counted = [len(np.unique(number[self.counts[:, j]])) for j in self.tested]
        # A payload of some runs must be fitted on a part of each of them.
        if min(counted, default=0) > 2 and self.loaded.all():
            return np.asarray(number % 5)
        start = np.concatenate([[0], np.cumsum(length)[:-1]])
        return np.asarray((np.arange(len(number)) - start[number]) * 5 // length[number])

    @cached_property
    def blocks(self) -> JoinedBlocks:
        """Blocks of neighbouring rows."""
        cut = (np.diff(self.run) != 0) | (np.arange(1, len(self.run)) % _BLOCK == 0)
        starts = np.append(0, 1 + np.flatnonzero(cut))
        return JoinedBlocks(starts, self.run[starts])

    @cached_property
    def _splines(self) -> dict[tuple[int, float], interpolate.CubicSpline]:
        return {}

    def _move_torque(self, k: int, delay: float) -> interpolate.CubicSpline:
        """Measured torque of run `k` over the time less a delay, which is undone before rests are bridged.

        A late torque is at rest later than the positions are.
        """
        if (k, delay) not in self._splines:
            run = self.prepared.runs[k]
            t = run.signals.t
            late = interpolate.CubicSpline(t, run.tau)(np.clip(t + delay, t[0], t[-1])) if delay else run.tau
            self._splines[k, delay] = interpolate.CubicSpline(run.t, run.reduce_torque(late))
        return self._splines[k, delay]

    def joint_of(self, reading: Reading) -> np.ndarray:
        """Joint (n,) to which each column that `torque` returns belongs."""
        return reading.joint_of if self.doubted.all() else np.arange(self.n)

    def delay_of(self, reading: Reading) -> np.ndarray:
        """Delay (N,) of the torque columns by a reading [s]."""
        starts = np.array(reading.delay or (0.0,) * len(self.prepared.runs))
        return np.asarray(starts[self.run] + reading.drift * self.t)

    def torque(self, reading: Reading) -> np.ndarray:
        """Torque columns (N, n) by a reading, with its delay, first-order filter and signs undone.

        Where the reading applies to some runs only, their columns are reordered, so that each column belongs
        to one joint in all runs.
        """
        out, lag, delay = self.tau.copy(), reading.lag, self.delay_of(reading)
        for k in np.unique(self.run).tolist() if reading.delay or lag else ():
            at = self.run == k
            most = (
                _STEP * round(float(np.median(delay[at])) / _STEP) if self.prepared.runs[k].bridges else 0.0
            )
            spline = self._move_torque(k, most)
            t = np.clip((self.t + delay)[at] - most, spline.x[0], spline.x[-1])
            out[at] = spline(t) + (lag * spline(t, 1) if lag else 0.0)
        crossed = sorted(reading.crossed)
        out[:, crossed] = self.q[:, crossed]
        out *= np.array(reading.torque_sign)[reading.joint_of]
        if self.doubted.all():
            return out
        return np.where(self.doubted[:, None], out[:, list(reading.torque_of)], self.tau)

    def motion(self, reading: Reading) -> "Rows":
        """Rows with the motion that a reading has."""
        order, factor = list(reading.motion_of), np.array(reading.factor)
        own = {name: getattr(self, name)[:, order] for name in _MOTION}
        for j in reading.crossed:
            for name, x in zip(_MOTION, self._torque_as_motion(j), strict=True):
                own[name][:, j] = x
        powers = {"v": 1, "a": 2, "jerk": 3, "snap": 4}
        own |= {name: own[name] * factor / reading.clock**k for name, k in powers.items()}
        way = np.sign(factor) * np.sign(reading.clock)
        own |= {name: own[name] * way for name in ("sign", "sharp", "late", "slow")}
        own |= {"q": own["q"] * factor + reading.zero}
        at = self.doubted[:, None]
        return replace(self, **{name: np.where(at, own[name], getattr(self, name)) for name in _MOTION})

    def _torque_as_motion(self, j: int) -> list[np.ndarray]:
        """Position, its derivatives and direction (N,) of joint `j`, taken from its torque column."""
        found = np.zeros((len(_MOTION), len(self.q)))
        for k in np.unique(self.run).tolist():
            run, at = self.prepared.runs[k], self.run == k
            parts = [low_pass(run.tau[:, [j]], run.band.torque, run.band.rate)]
            for _ in range(2):
                parts.append(differentiate(parts[-1], run.band.rate))
            rows = np.column_stack([run.reduce(x)[:, 0] for x in (*parts, np.sign(parts[1]))])
            found[:4, at] = interpolate.interp1d(run.t, rows, axis=0)(self.t[at]).T
        return list(found)


def _take(run: PreparedRun, runs: int) -> dict[str, np.ndarray]:
    """Arrays of a run, as stated, at some of its rows."""
    signals, most = run.signals, max(MOST_ROWS // runs, 3 * LEAST_ROWS)
    at = slice(None, None, max(1, len(run.t) // most))
    motion = {"q": signals.q, "v": signals.v, "a": signals.a, "sign": signals.sign}
    sign = np.where(run.resting, 0.0, np.sign(signals.v))
    motion |= {"sharp": sign - signals.sign}
    motion |= {
        name: _find_late(run, sign, share) for name, share in zip(("late", "slow"), _YIELDS, strict=True)
    }
    own = {name: run.reduce(x)[at] for name, x in motion.items()}
    line = interpolate.CubicSpline(run.t, run.reduce(signals.a))
    own |= {"jerk": line(run.t[at], 1), "snap": line(run.t[at], 2)}
    return own | {"tau": run.measured[at], "counts": run.keep[at], "t": run.t[at]}


def _find_late(run: PreparedRun, sign: np.ndarray, share: float) -> np.ndarray:
    """Direction (N, n) that lags a reversal over a share of the reach, less the abrupt one; 0 at rest."""
    ways = share * np.ptp(run.signals.q, axis=0) + _LEAST_WAY
    signals = replace(run.signals, sign=sign, _slopes={})
    late = [PRESLIDING.columns(signals, j, ways[[j]]) for j in range(len(ways))]
    return np.where(run.resting, 0.0, np.concatenate(late, axis=1))


def _is_driven(run: PreparedRun, own: dict[str, np.ndarray], j: int) -> bool:
    """Whether the motion explains most of a torque that hardly varies, or rows are too few to say so."""
    body = run.signals.rigid_body.inverse_dynamics(own["q"], own["v"], own["a"])
    at = own["counts"][:, j]
    if at.sum() < LEAST_ROWS:
        return True
    columns = [body[at, j], own["a"][at, j], own["sign"][at, j], own["v"][at, j], np.ones(at.sum())]
    return bool(subtract_fit(own["tau"][at, j], columns).var() < _MOST * own["tau"][at, j].var())


def subtract_fit(y: np.ndarray, columns: list[np.ndarray]) -> np.ndarray:
    """Residual (N,) of the least-squares fit of columns (N,) to a signal (N,)."""
    x = np.column_stack(columns)
    return np.asarray(y - x @ np.linalg.lstsq(x, y, rcond=None)[0])


def _spread(run: PreparedRun) -> np.ndarray:
    """Spread (n,) of the torques in the rows of a run that count."""
    some = zip(run.measured.T, run.keep.T, strict=True)
    return np.array([y[at].std() if at.any() else 0.0 for y, at in some])
