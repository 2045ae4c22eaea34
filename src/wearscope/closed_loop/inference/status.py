"""Verdict of the test runs on each term, after everything is chosen and fitted; they change nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.delays import undo_shifts
from wearscope.closed_loop.model.joint_flexibility import find_jump_shares
from wearscope.closed_loop.model.prediction import find_signals, predict_reduced
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm

Status = Literal["confirmed", "not_confirmed", "refuted"]
#: Draws of the bootstrap over blocks of the test runs, and its seed.
_DRAWS, _SEED = 1000, 23
#: Relative growth of an error (RMS) that does not count: figures agree to three digits.
SAME = 1e-3


@dataclass(frozen=True)
class Marked:
    """What a term is worth on the test runs.

    Attributes
    ----------
    status : str
        ``confirmed`` where the whole interval of `reduction` is above zero, ``refuted`` where it is
        below what a growth of the error by `SAME` takes,
        ``not_confirmed`` else.
    reduction : float
        Share of the test runs' residual variance that the term removes at its joint (at all joints where it
        is felt, by their variance, for one that is felt at several); NaN where no row of theirs counts.
    interval : tuple of (float, float)
        Its 95 % interval, by resampling blocks of rows.
    """

    status: Status
    reduction: float
    interval: tuple[float, float]


def mark_terms(prepared: Prepared, after: Regression, terms: Sequence[ModelTerm]) -> list[Marked]:
    """Predict the test runs with and without each term, all others refitted on the training runs.

    Where gears bend or the record errs, all is linear about what the whole model says of both.
    """
    theta = after.solve()
    shares = find_jump_shares(after, theta)
    runs = [_take_test_run(after, theta, shares, run) for run in prepared.runs_for("test")]
    compare = _Comparison(prepared, [(run.left, run.keep) for run in runs])
    marked = []
    for term in terms:
        index = next(k for k, entry in enumerate(after.entries) if entry is term)
        change = after.solve_without(index) - theta
        marked.append(compare.mark(term, [run.left - run.columns @ change for run in runs]))
    return marked


def mark_delays(after: Regression, delays: Sequence[ModelTerm]) -> list[Marked]:
    """Mark the delays by which channels were shifted; a shift is far from linear."""
    runs = after.prepared.runs_for("test")

    def leave(model: Regression) -> list[np.ndarray]:
        theta = model.solve()
        return [run.measured - predict_reduced(model, theta, run) for run in runs]

    compare = _Comparison(
        after.prepared, [(left, run.keep) for left, run in zip(leave(after), runs, strict=True)]
    )
    return [compare.mark(term, leave(undo_shifts(after, [term]))) for term in delays]


class _Comparison:
    """Other residuals of the test runs against those (M, n) of a model, with the rows that count."""

    def __init__(self, prepared: Prepared, left: Sequence[tuple[np.ndarray, np.ndarray]]) -> None:
        self.rows = max(4, int(4 * prepared.band.torque))
        self.keep = [keep for _, keep in left]
        self.whole = self._sum_squares([x for x, _ in left])
        self.scale = np.maximum(np.mean(self.whole, axis=0), 1e-300)
        count = len(self.whole)
        seed = np.random.SeedSequence([_SEED, count])
        self.pick = np.random.default_rng(seed).integers(0, count, (_DRAWS, count))

    def mark(self, term: ModelTerm, without: Sequence[np.ndarray]) -> Marked:
        """Mark a term by the residuals that the model leaves without it."""
        joints = slice(None) if term.effect.spread else slice(term.joint, term.joint + 1)
        own, best = (
            (squares[:, joints] / self.scale[joints]).sum(axis=1)
            for squares in (self._sum_squares(without), self.whole)
        )
        if not best.any():
            return Marked("not_confirmed", np.nan, (np.nan, np.nan))
        drawn = 1.0 - best[self.pick].sum(axis=1) / np.maximum(own[self.pick].sum(axis=1), 1e-300)
        low, high = np.quantile(drawn, [0.025, 0.975])
        status: Status = "confirmed" if low > 0.0 else "refuted" if high < -2.0 * SAME else "not_confirmed"
        return Marked(status, 1.0 - float(best.sum() / max(own.sum(), 1e-300)), (low, high))

    def _sum_squares(self, left: Sequence[np.ndarray]) -> np.ndarray:
        """Squared residuals summed over blocks of rows of each run, (blocks, n)."""
        sums = []
        for x, keep in zip(left, self.keep, strict=True):
            squares = x**2 * keep
            sums.append(np.add.reduceat(squares, np.arange(0, len(squares), self.rows), axis=0))
        return np.concatenate(sums)


@dataclass(frozen=True)
class _TestRun:
    """What a model leaves of a test run (M, n), its columns (M, n, P), and the rows that count."""

    left: np.ndarray
    columns: np.ndarray
    keep: np.ndarray


def _take_test_run(
    model: Regression, theta: np.ndarray, shares: dict[int, float], run: PreparedRun
) -> _TestRun:
    residual = run.measured - predict_reduced(model, theta, run)
    columns = model.take_columns(run, find_signals(model, theta, run))
    for k, share in shares.items():
        columns[..., model.spans[k]] *= share
    return _TestRun(residual, columns, run.keep)
