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
#: Standard errors by which the test runs' loss must change.
_ERRORS = 2.0


@dataclass(frozen=True)
class Marked:
    """A term's worth on the test runs.

    Attributes
    ----------
    status : str
        ``confirmed`` where the test error falls by the term outside its noise, ``refuted`` where it rises so,
        ``not_confirmed`` else.
    reduction : float
        Share of the test runs' residual variance that the term removes at its joint (at all joints where it
        is felt, by their variance, for one that is felt at several).
    """

    status: Status
    reduction: float


def mark_terms(prepared: Prepared, after: Regression, terms: Sequence[ModelTerm]) -> list[Marked]:
    """Predict the test runs with and without each term, all others refitted on the training runs."""
    rows = max(4, int(4 * prepared.band.torque))
    whole = _losses(prepared, after, rows)
    scale = np.maximum(np.nanmean(whole, axis=0), 1e-300)
    marked = []
    for term in terms:
        without = refit(after, [t for t in after.entries if t is not term])
        own = _losses(prepared, without, rows)
        joints = slice(None) if term.effect.spread else slice(term.joint, term.joint + 1)
        gain = ((own - whole)[:, joints] / scale[joints]).sum(axis=1)
        total = float((own[:, joints] / scale[joints]).sum())
        error = float(np.sqrt(len(gain) * max(gain.var(ddof=1), 1e-300))) if len(gain) > 1 else np.inf
        sure = abs(gain.sum()) > _ERRORS * error
        status: Status = "not_confirmed" if not sure else "confirmed" if gain.sum() > 0 else "refuted"
        marked.append(Marked(status, float(gain.sum()) / max(total, 1e-300)))
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
