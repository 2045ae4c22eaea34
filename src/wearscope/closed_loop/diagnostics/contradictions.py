"""Training runs that one model cannot explain together: an outside torque acts, or the machine differs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.model.regression import Regression

#: Runs that are left out of a fit contradict the fitted runs under two conditions: their RMS error is more
#: than the first number times the fitted runs' error, and without them the fitted runs' error falls below the
#: second share of what it was.
_APART, _QUIETER = 3.0, 0.7


@dataclass(frozen=True)
class Contradiction:
    """Runs that contradict the other runs at a joint.

    Attributes
    ----------
    files : list of str
    share : float
        Share of the joint's residual variance in the training runs that vanishes without these runs.
    """

    files: list[str]
    share: float


def find_contradictions(model: Regression) -> dict[int, Contradiction]:
    """Training runs, by joint, that a model fitted to the other runs misses by far.

    Without them the others are fitted better. At most half of the recordings can contradict the others, and
    at least two others must be left. A run that is only noisier is no contradiction: its residual also
    changes more from row to row.

    Parameters
    ----------
    model : Regression
        The corrected model.

    Returns
    -------
    dict of int to Contradiction
    """
    compared = {j: _compare(model, j) for j in np.flatnonzero(model.prepared.moving).tolist()}
    return {j: one for j, one in compared.items() if one is not None}


def _compare(model: Regression, j: int) -> Contradiction | None:
    """The recordings with the largest residuals at a joint, if they contradict the others; else None."""
    runs = model.prepared.runs_for("train")

    def leave(files: Sequence[str]) -> dict[str, np.ndarray]:
        """Residuals by recording, of the model fitted to the recordings `files`."""
        theta = model.solve(np.array([runs[block.run].file in files for block in model.blocks]))
        left: dict[str, list[np.ndarray]] = {}
        for run, x, y in zip(runs, model.columns, model.target, strict=True):
            left.setdefault(run.file, []).append((y[:, j] - x[:, j] @ theta)[run.keep[:, j]])
        return {file: whole for file, some in left.items() if len(whole := np.concatenate(some))}

    left = leave([run.file for run in runs])
    order = sorted(left, key=lambda file: _rms([left[file]]))
    for count in range(1, len(order) // 2 + 1):
        quiet, loud = order[:-count], order[-count:]
        if len(quiet) < 2:
            return None
        own = leave(quiet)
        fitted, missed = (_rms([own[file] for file in some]) for some in (quiet, loud))
        noisier = max(1.0, _change([left[f] for f in loud]) / max(_change([left[f] for f in quiet]), 1e-300))
        before = _rms([left[file] for file in quiet])
        if fitted > 0.0 and missed > _APART * noisier * fitted and fitted < _QUIETER * before:
            every = _rms(list(left.values()))
            return Contradiction(sorted(loud), 1.0 - (fitted / max(every, 1e-300)) ** 2)
    return None


def _rms(parts: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _change(parts: Sequence[np.ndarray]) -> float:
    """Median change from row to row, to which missing terms hardly contribute."""
    return float(np.median(np.abs(np.concatenate([np.diff(x) for x in parts]))))
