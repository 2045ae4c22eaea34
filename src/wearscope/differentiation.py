"""Derivatives of uniformly sampled signals."""

import numpy as np

_CENTRAL = np.array([1.0, -9.0, 45.0, 0.0, -45.0, 9.0, -1.0]) / 60.0


def differentiate(x: np.ndarray, rate: float) -> np.ndarray:
    """Central difference of sixth order along the first axis, of second order at the ends.

    The plain central difference loses (w h)^2/6 of a signal at w; after two of them the acceleration of a
    stiff robot looks like that of one with elastic joints.
    """
    if len(x) < 3:
        return np.zeros_like(x)
    slope = np.gradient(x, 1.0 / rate, axis=0)
    if len(x) >= 7:
        inner = sum(c * x[6 - k : len(x) - k] for k, c in enumerate(_CENTRAL))
        slope[3:-3] = inner * rate
    return slope
