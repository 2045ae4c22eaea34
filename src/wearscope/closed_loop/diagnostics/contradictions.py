"""Training runs that no one model explains: in some a torque acts from outside, or the machine differs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.regression import Regression

#: Runs contradict the others from this ratio of errors (RMS) on, left out over fitted; without them at most
#: this share of the fitted runs' error may remain.
_APART, _QUIETER = 3.0, 0.7
#: Ridge of a fit to some of the runs, of the columns' squares.
_RIDGE = 1e-6


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


def find_contradictions(prepared: Prepared, model: Regression) -> dict[int, Contradiction]:
    """By joint, training runs that a model fitted to the others misses by far.

    Without them the others are fitted better. Half of the recordings at most can contradict the others, and
    two must be left. Noise that is larger in one run is no contradiction: it changes as much more from row
    to row.

    Parameters
    ----------
    prepared : Prepared
    model : Regression
        The corrected model.

    Returns
    -------
    dict of int to Contradiction
    """
    theta = model.solve()
    train = prepared.runs_for("train")
    files = [run.file for run in train]
    found = {}
    for j in np.flatnonzero(prepared.moving).tolist():
        parts: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        for file in dict.fromkeys(files):
            own = [k for k, run in enumerate(train) if run.file == file and run.keep[:, j].any()]
            if own:
                x = np.concatenate([model.columns[k][train[k].keep[:, j], j] for k in own])
                known = [train[k].measured[:, j] - train[k].reduce(train[k].known)[:, j] for k in own]
                y = np.concatenate([v[train[k].keep[:, j]] for k, v in zip(own, known, strict=True)])
                parts[file] = x, y
        one = _compare(parts, theta)
        if one is not None:
            found[j] = one
    return found


def _compare(parts: dict[str, tuple[np.ndarray, np.ndarray]], theta: np.ndarray) -> Contradiction | None:
    """The loudest recordings, where they contradict the others; None where none do."""
    left = {file: y - x @ theta for file, (x, y) in parts.items()}
    order = sorted(parts, key=lambda file: _rms([left[file]]))
    for count in range(1, len(order) // 2 + 1):
        quiet, loud = order[:-count], order[-count:]
        if len(quiet) < 2:
            return None
        own = _fit([parts[file] for file in quiet])
        fitted = _rms([parts[file][1] - parts[file][0] @ own for file in quiet])
        missed = _rms([parts[file][1] - parts[file][0] @ own for file in loud])
        noisier = max(1.0, _change([left[f] for f in loud]) / max(_change([left[f] for f in quiet]), 1e-300))
        before = _rms([left[file] for file in quiet])
        if fitted > 0.0 and missed > _APART * noisier * fitted and fitted < _QUIETER * before:
            every = _rms(list(left.values()))
            return Contradiction(sorted(loud), 1.0 - (fitted / max(every, 1e-300)) ** 2)
    return None


def _fit(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """Coefficients (P,) by least squares; those that the rows do not determine stay near zero."""
    x, y = (np.concatenate(one) for one in zip(*parts, strict=True))
    scale = np.sqrt(np.maximum((x**2).sum(axis=0), 1e-300))
    z = x / scale
    return np.asarray(np.linalg.solve(z.T @ z + _RIDGE * np.eye(z.shape[1]), z.T @ y) / scale)


def _rms(parts: Sequence[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def _change(parts: Sequence[np.ndarray]) -> float:
    """Median change from row to row, to which missing terms hardly contribute."""
    return float(np.median(np.abs(np.concatenate([np.diff(x) for x in parts]))))
