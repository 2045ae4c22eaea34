"""Change of each joint's test error by the correction, and whether its residual can be judged."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from wearscope.closed_loop.diagnostics.structure import JointState
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.prediction import Predicted, bootstrap_change, pooled_rms

Error = Literal["smaller", "same", "larger"]
#: Share of the torque (RMS) from which a residual is large, even if it looks like noise.
_HALF = 0.5
_SEED = 29
#: Change of an error that rounding alone explains [%].
_ROUNDING = 1e-6


@dataclass(frozen=True)
class ErrorChange:
    """A joint's error on the test runs.

    Attributes
    ----------
    error : str or None
        ``smaller`` or ``larger`` where the whole interval of `change` lies on one side of zero by more than
        rounding, ``same`` otherwise; None where no row counts.
    change : float
        Change of the RMS error [%], from the declared model refitted to the corrected one.
    interval : tuple of (float, float)
        95 % interval of `change`, by resampling the same blocks of rows for both models.
    torque : float
        RMS of the measured torque, gravity's part included [N m or N].
    share : float
        Error of the corrected model over `torque`.
    """

    error: Error | None
    change: float
    interval: tuple[float, float]
    torque: float
    share: float


def measure_error_change(prepared: Prepared, predicted: Sequence[Predicted]) -> list[ErrorChange]:
    """Change of each joint's error on the counted rows of the test runs."""
    test = [p for p in predicted if p.run.use == "test"]
    before, after = (
        [(p.run.measured - getattr(p, s), p.run.keep) for p in test] for s in ("before", "after")
    )
    torque = pooled_rms([(p.run.measured, p.run.keep) for p in test])
    left = pooled_rms(after)
    rows = max(4, int(4 * prepared.band.torque))
    change, (low, high) = bootstrap_change(before, after, rows, _SEED)
    found = []
    for j in range(prepared.n):
        error: Error | None = None
        if np.isfinite(change[j]):
            error = "smaller" if high[j] < -_ROUNDING else "larger" if low[j] > _ROUNDING else "same"
        share = float(left[j] / torque[j]) if torque[j] > 0.0 else np.nan
        found.append(
            ErrorChange(error, float(change[j]), (float(low[j]), float(high[j])), float(torque[j]), share)
        )
    return found


def withhold_judgement(
    prepared: Prepared, states: Sequence[JointState], error_changes: Sequence[ErrorChange]
) -> list[JointState]:
    """States of the joints, ``not_judged`` where the test runs allow no judgement.

    The training runs show whether a residual is noise. That does not make a model good where no row of the
    test runs counts, or where the model misses more than half of the torque: the residual is then larger than
    any structure that a test could find in it. A joint with visible structure stays ``unexplained``.
    """
    judged = []
    for state, one in zip(states, error_changes, strict=True):
        reason = _tell_missing(prepared, state.joint) if one.error is None else ""
        if not reason and one.share > _HALF and state.state != "unexplained":
            reason = (
                f"the corrected model misses {100 * one.share:.0f} % of the torque (RMS) on the test runs; "
                "record motion whose torque is well above what is left, faster, over more of the range or "
                "with a known payload, and see that the torque column is that of this joint"
            )
        judged.append(replace(state, state="not_judged", reason=reason) if reason else state)
    return judged


def _tell_missing(prepared: Prepared, joint: int) -> str:
    """Why no row of the test runs counts at a joint, and what to record."""
    name = prepared.dataset.joints[joint]
    if not prepared.moving[joint]:
        return f"{name} moves in no training run; record runs in which it moves, for training and as a test"
    runs = prepared.runs_for("test")
    moves = sum(float(np.sum(run.signals.sign[:, joint] != 0.0)) / run.band.rate for run in runs)
    whole = sum(float(run.signals.t[-1] - run.signals.t[0]) for run in runs)
    return (
        f"no row of the test runs counts at {name}: it moves in {moves:.1f} s of {whole:.1f} s, and in no "
        "stretch long and fast enough; record a test run in which it moves without halts"
    )
