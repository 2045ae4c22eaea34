"""Exact detection probabilities of a test quantity that is quadratic in one Gaussian nuisance.

With w = s x, x standard normal, y = a + b w + c w^2 is A + B x + C x^2, and P(y >= h) is a difference of
two normal distribution functions at the roots of A + B x + C x^2 = h.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtr

Array = NDArray[np.float64]
_REACH = 9.0
#: Brackets that shrink no more are left out when they are more than the rest of this share.
_CROWDED = 0.9


def standardise(coefficients: ArrayLike, sigma: ArrayLike) -> Array:
    """Coefficients in x of y = a + b w + c w^2, w = sigma x.

    Parameters
    ----------
    coefficients : array (..., 3)
        a, b, c.
    sigma : array (...,)

    Returns
    -------
    array (..., 3)
        A, B, C.
    """
    a, b, c = np.moveaxis(np.asarray(coefficients, dtype=float), -1, 0)
    s = np.asarray(sigma, dtype=float)
    a, b, c, s = np.broadcast_arrays(a, b, c, s)
    return np.stack([a, b * s, c * s * s], axis=-1)


def tail_probability(quadratic: ArrayLike, h: ArrayLike) -> Array:
    """P(A + B x + C x^2 >= h) for standard normal x.

    The roots are taken in the form that does not cancel, so C may be zero or tiny.

    Parameters
    ----------
    quadratic : array (..., 3)
    h : array (...,)

    Returns
    -------
    array (...,)
    """
    a, b, c = np.moveaxis(np.asarray(quadratic, dtype=float), -1, 0)
    a, b, c, h = np.broadcast_arrays(a, b, c, np.asarray(h, dtype=float))
    b = np.abs(b)
    lift = h - a
    discriminant = b * b + 4 * c * lift
    inside = discriminant >= 0
    root = np.sqrt(np.where(inside, discriminant, 0.0))
    half = -0.5 * (b + root)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        near = np.where(half != 0, -lift / half, 0.0)
        far = np.where(c != 0, half / c, -np.inf)
    low, high = np.minimum(near, far), np.maximum(near, far)
    up = c > 0
    below, beyond = ndtr(low), ndtr(np.where(up, -high, high))
    curved = np.where(inside, np.where(up, below + beyond, beyond - below), up.astype(float))
    flat = c == 0
    if not flat.any():
        return curved
    straight = np.where(b > 0, ndtr(-near), (lift <= 0).astype(float))
    return np.where(flat, straight, curved)


def spread(quadratic: ArrayLike) -> Array:
    """Standard deviation sqrt(B^2 + 2 C^2), shape (...,)."""
    quadratic = np.asarray(quadratic, dtype=float)
    return np.hypot(quadratic[..., 1], np.sqrt(2.0) * quadratic[..., 2])


def threshold(quadratic: ArrayLike, probability: ArrayLike) -> Array:
    """Smallest h with P(y >= h) <= `probability`, by bisection on the exact distribution.

    The bracket is the range of y over |x| <= 9; it is halved until it is one rounding unit wide, and its
    upper end is returned.

    Parameters
    ----------
    quadratic : array (..., 3)
    probability : float or array (...,)

    Returns
    -------
    array (...,)
    """
    quadratic, wanted = np.asarray(quadratic, dtype=float), np.asarray(probability, dtype=float)
    shifted = quadratic.copy()
    shifted[..., 0] = 0.0
    b, c = np.abs(quadratic[..., 1]), quadratic[..., 2]
    ends = np.stack([c * _REACH**2 - b * _REACH, c * _REACH**2 + b * _REACH])
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        turn = np.where(c != 0, -b / (2 * c), np.inf)
        vertex = np.where(np.abs(turn) < _REACH, -b * b / (4 * c), 0.0)
    low = np.minimum(np.minimum(ends[0], ends[1]), vertex)
    high = np.maximum(np.maximum(ends[0], ends[1]), vertex)
    shape = np.broadcast_shapes(high.shape, wanted.shape)
    asked = np.broadcast_to(shifted, (*shape, 3)).reshape(-1, 3)
    wanted, low, high = (np.broadcast_to(one, shape).ravel() for one in (wanted, low, high))
    found, where = high.copy(), np.arange(high.size)
    for _ in range(200):  # next to 0, numbers go on for longer
        middle = 0.5 * (low + high)
        shrinks = (middle > low) & (middle < high)
        left = np.count_nonzero(shrinks)
        if left == 0:
            break
        if left < _CROWDED * len(where):  # some need half as many steps as others
            found[where] = high
            where, asked, wanted = where[shrinks], asked[shrinks], wanted[shrinks]
            low, high, middle = low[shrinks], high[shrinks], middle[shrinks]
        above = tail_probability(asked, middle) > wanted
        low = np.where(above, middle, low)
        high = np.where(above, high, middle)
    found[where] = high
    high = found.reshape(shape)
    return quadratic[..., 0] + high


def detection_probability(null: ArrayLike, alternative: ArrayLike, false_alarm: float = 0.01) -> Array:
    """P_d (14) at the threshold that P_f' sets, exactly.

    Parameters
    ----------
    null, alternative : array (..., 3)
        A, B, C under H0 and H1, of shapes that broadcast.
    false_alarm : float
        P_f'.

    Returns
    -------
    array (...,)
        Where y does not vary under H0, the threshold lies just above that value, and P_d = P(y > it).
    """
    null, alternative = np.asarray(null, dtype=float), np.asarray(alternative, dtype=float)
    scale = 1e-12 * np.maximum(np.abs(null).max(axis=-1), np.finfo(float).tiny)
    fixed = spread(null) <= scale
    h = np.where(fixed, null[..., 0] + scale, threshold(null, false_alarm))
    return tail_probability(alternative, h)
