"""Training runs that no one model explains: in some a torque acts from outside, or the machine differs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.model.regression import Regression

#: Runs contradict the others where their error (RMS), left out of the fit, is this many times that of the
#: fitted runs, and where leaving them out lowers the error of the fitted runs to this share.
_APART, _QUIETER = 3.0, 0.7


@dataclass(frozen=True)
class Contradiction:
    """Runs that contradict the other runs at a joint.

    Attributes
    ----------
    files : list of str
    share : float
        Of the joint's residual variance in the training runs that goes with them.
    """

    files: list[str]
    share: float


def find_contradictions(model: Regression) -> dict[int, Contradiction]:
    """By joint, training runs that a model fitted to the others misses by far.

    Without them the others are fitted better. Half of the recordings at most can contradict the others, and
    two must be left. Noise that is larger in one run is no contradiction: it changes as much more from row
    to row.

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
    """The loudest recordings at a joint, where they contradict the others; None where none do."""
    runs = model.prepared.runs_for("train")

    def leave(files: Sequence[str]) -> dict[str, np.ndarray]:
        """Residual by recording of the model that is fitted to some of them."""
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
