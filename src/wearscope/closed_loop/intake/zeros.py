"""Readings of positions whose zero is not the URDF's: another convention, or an encoder with no reference."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading
from wearscope.closed_loop.intake.joint_fit import WORTH, Rows, is_clearly_less

#: Rows on which shifts are sought, and steps at which they are.
_FEW = 300
_STEP = np.pi / 4.0
#: A quarter turn, by which conventions differ, is taken where it leaves at most this many times as much.
_ALIKE = 1.05


def read_zeros(asked: Asked, any_size: bool = False) -> Iterator[Reading]:
    """Positions of some joints that turn, shifted by a constant; torques as they are or of any size."""
    few, shift = asked.rows.thin(_FEW), np.zeros(asked.rows.n)
    turning = [j for j in few.products.heard if not asked.slides[j]]
    least = few.products.miss(any_size)
    for _ in turning:
        # A joint that was shifted for its parent's sake is turned back with it.
        ways = [np.eye(few.n)[j] for j in turning if not shift[j]]
        ways += [way - np.eye(few.n)[j] for way in ways for j in np.flatnonzero(shift)]
        tried = [(way, k * _STEP) for way in ways for k in (1, -1, 2, -2, 3, -3, 4, 0.5, -0.5)]
        totals = [_left(few, shift + by * way, any_size) for way, by in tried]
        if not totals or not is_clearly_less(min(totals), least, WORTH):
            break
        way, by = tried[int(np.argmin(totals))]
        shift = _refine(few, shift + by * way, any_size)
        least = _left(few, shift, any_size)
    moved = np.flatnonzero(shift)
    if not len(moved) or not few.is_worth(least, any_size):
        return
    names, sizes = asked.names(moved, "q"), [f"{shift[j]:.4g}" for j in moved]
    pairs = ", ".join(f"{name}: {size}" for name, size in zip(names, sizes, strict=True))
    many = len(moved) > 1
    told = (
        f"{' and '.join(names)} {'count' if many else 'counts'} from another zero than the URDF's "
        f'{"joints" if many else "joint"}; write "shifted: {{{pairs}}}" in dataset.yaml.'
    )
    whole = replace(asked.rows, q=asked.rows.q + shift)
    codes = tuple(f"zero {name}" for name in names)
    yield Reading(told, codes, tuple(moved.tolist()), whole.products)


def _left(rows: Rows, shift: np.ndarray, any_size: bool) -> float:
    return replace(rows, q=rows.q + shift).products.miss(any_size)


def _refine(rows: Rows, start: np.ndarray, any_size: bool) -> np.ndarray:
    """Shifts near a first guess that leave least, as quarter turns where these leave about as little."""
    moved = np.flatnonzero(start)

    def shift(sizes: np.ndarray) -> np.ndarray:
        full = np.zeros(len(start))
        full[moved] = sizes
        return full

    simplex = start[moved] + 0.2 * np.vstack([np.zeros(len(moved)), np.eye(len(moved))])
    options = {"initial_simplex": simplex, "maxfev": 40 * len(moved), "xatol": 2e-3, "fatol": 1e-5}
    found = optimize.minimize(
        lambda x: _left(rows, shift(x), any_size), start[moved], method="Nelder-Mead", options=options
    ).x
    best = shift(found)
    for j in moved:
        quarter = best.copy()
        quarter[j] = np.pi / 2.0 * np.round(best[j] / (np.pi / 2.0))
        if quarter[j] and _left(rows, quarter, any_size) <= _ALIKE * _left(rows, best, any_size):
            best = quarter
    return best
