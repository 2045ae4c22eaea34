"""What the test runs say of each term after everything is chosen and fitted; they change nothing."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.closed_loop.model.prediction import predict_reduced, refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm

Status = Literal["confirmed", "not_confirmed", "refuted"]
#: Draws of the bootstrap over blocks of the test runs, and its seed.
_DRAWS, _SEED = 1000, 23


@dataclass(frozen=True)
class Marked:
    """A term's worth on the test runs.

    Attributes
    ----------
    status : str
        ``confirmed`` where the whole interval of `reduction` is above zero, ``refuted`` where it is below,
        ``not_confirmed`` else.
    reduction : float
        Share of the test runs' residual variance that the term removes at its joint (at all joints where it
        is felt, by their variance, for one that is felt at several).
    interval : tuple of (float, float)
        Its 95 % interval, by resampling blocks of rows.
    """

    status: Status
    reduction: float
    interval: tuple[float, float]


def mark_terms(prepared: Prepared, after: Regression, terms: Sequence[ModelTerm]) -> list[Marked]:
    """Predict the test runs with and without each term, all others refitted on the training runs."""
    rows = max(4, int(4 * prepared.band.torque))
    whole = _losses(prepared, after, rows)
    scale = np.maximum(np.mean(whole, axis=0), 1e-300)
    pick = np.random.default_rng(np.random.SeedSequence([_SEED, len(whole)])).integers(
        0, len(whole), (_DRAWS, len(whole))
    )
    marked = []
    for term in terms:
        without = refit(after, [t for t in after.entries if t is not term])
        joints = slice(None) if term.effect.spread else slice(term.joint, term.joint + 1)
        own = (_losses(prepared, without, rows)[:, joints] / scale[joints]).sum(axis=1)
        best = (whole[:, joints] / scale[joints]).sum(axis=1)
        drawn = 1.0 - best[pick].sum(axis=1) / np.maximum(own[pick].sum(axis=1), 1e-300)
        low, high = np.quantile(drawn, [0.025, 0.975])
        status: Status = "confirmed" if low > 0.0 else "refuted" if high < 0.0 else "not_confirmed"
        marked.append(Marked(status, 1.0 - float(best.sum() / max(own.sum(), 1e-300)), (low, high)))
    return marked


def _losses(prepared: Prepared, model: Regression, rows: int) -> np.ndarray:
    """Squared residual summed over blocks of rows of the test runs, (blocks, n)."""
    theta = model.solve()
    losses = []
    for run in prepared.runs_for("test"):
        residual = (run.measured - predict_reduced(model, theta, run)) * run.keep
        for start in range(0, len(residual), rows):
            losses.append((residual[start : start + rows] ** 2).sum(axis=0))
    return np.array(losses)
