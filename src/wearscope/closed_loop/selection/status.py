"""What the test runs say of each term after everything is chosen and fitted; they change nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.joint_flexibility import find_jump_shares
from wearscope.closed_loop.model.prediction import find_signals, predict_reduced
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm

Status = Literal["confirmed", "not_confirmed", "refuted"]
#: Draws of the bootstrap over blocks of the test runs, and its seed.
_DRAWS, _SEED = 1000, 23
#: Growth of an error (RMS), of itself, that is none: figures of three digits agree.
SAME = 1e-3


@dataclass(frozen=True)
class Marked:
    """A term's worth on the test runs.

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
    rows = max(4, int(4 * prepared.band.torque))
    theta = after.solve()
    shares = find_jump_shares(after, theta)
    runs = [_take_test_run(after, theta, shares, run) for run in prepared.runs_for("test")]
    whole = np.concatenate([_sum_squares(run.left, run.keep, rows) for run in runs])
    scale = np.maximum(np.mean(whole, axis=0), 1e-300)
    pick = np.random.default_rng(np.random.SeedSequence([_SEED, len(whole)])).integers(
        0, len(whole), (_DRAWS, len(whole))
    )
    marked = []
    for term in terms:
        index = next(k for k, entry in enumerate(after.entries) if entry is term)
        change = after.solve_without(index) - theta
        without = np.concatenate(
            [_sum_squares(run.left - run.columns @ change, run.keep, rows) for run in runs]
        )
        joints = slice(None) if term.effect.spread else slice(term.joint, term.joint + 1)
        own = (without[:, joints] / scale[joints]).sum(axis=1)
        best = (whole[:, joints] / scale[joints]).sum(axis=1)
        if not best.any():
            marked.append(Marked("not_confirmed", np.nan, (np.nan, np.nan)))
            continue
        drawn = 1.0 - best[pick].sum(axis=1) / np.maximum(own[pick].sum(axis=1), 1e-300)
        low, high = np.quantile(drawn, [0.025, 0.975])
        status: Status = "confirmed" if low > 0.0 else "refuted" if high < -2.0 * SAME else "not_confirmed"
        marked.append(Marked(status, 1.0 - float(best.sum() / max(own.sum(), 1e-300)), (low, high)))
    return marked


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
    levelled = model.prepared.take_out_levels
    return _TestRun(levelled(run, residual), levelled(run, columns), run.keep)


def _sum_squares(residual: np.ndarray, keep: np.ndarray, rows: int) -> np.ndarray:
    """Squared residual summed over blocks of rows, (blocks, n)."""
    squares = residual**2 * keep
    return np.add.reduceat(squares, np.arange(0, len(squares), rows), axis=0)
