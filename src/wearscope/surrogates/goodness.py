"""Fit (6) of predictions to runs, and what replicated runs say of noise."""

import numpy as np
from numpy.typing import ArrayLike


def model_fit(y: ArrayLike, predicted: ArrayLike) -> float:
    """Model fit (6) [%]: 100 (1 - |y - yhat| / |y - mean y|); NaN where y does not vary."""
    y, predicted = np.asarray(y, dtype=float), np.asarray(predicted, dtype=float)
    if y.size == 0 or np.ptp(y) <= 1e-12 * np.abs(y).max():
        return float("nan")
    return float(100.0 * (1.0 - np.linalg.norm(y - predicted) / np.linalg.norm(y - y.mean())))


def pure_error(z: ArrayLike, y: ArrayLike) -> tuple[float, int]:
    """Sum of squares and degrees of freedom of replicated points."""
    z, y = np.round(np.asarray(z, dtype=float), 9), np.asarray(y, dtype=float)
    _, group = np.unique(z, axis=0, return_inverse=True)
    group = group.ravel()
    count = np.bincount(group)
    means = np.bincount(group, weights=y) / count
    return float(np.sum((y - means[group]) ** 2)), int(np.sum(count - 1))
