"""Readings of positions whose zero is not the URDF's: another convention, or an encoder with no reference."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading
from wearscope.closed_loop.intake.joint_fit import WORTH, Rows, is_clearly_less

#: Rows on which shifts are sought, and steps at which they are.
_FEW = 300
_STEP = np.pi / 4.0
#: Shifts of one joint that give all: torques hold sines and cosines of its position and of twice it.
_GIVE_ALL = np.arange(5) * 2.0 * np.pi / 5.0
#: A quarter turn, by which conventions differ, is taken where it leaves at most this many times as much.
_ALIKE = 1.05


def read_zeros(asked: Asked, any_size: bool = False) -> Iterator[Reading]:
    """Positions of some joints that turn, shifted by a constant; torques as they are or of any size."""
    few, shift = asked.rows.thin(_FEW), np.zeros(asked.rows.n)
    miss = _Misses(few, any_size)
    turning = [j for j in few.products.heard if not asked.slides[j]]
    least = few.products.miss(any_size)
    for _ in turning:
        # A joint that was shifted for its parent's sake is turned back with it.
        ways = [np.eye(few.n)[j] for j in turning if not shift[j]]
        ways += [way - np.eye(few.n)[j] for way in ways for j in np.flatnonzero(shift)]
        tried = [(way, k * _STEP) for way in ways for k in (1, -1, 2, -2, 3, -3, 4, 0.5, -0.5)]
        totals = [miss(shift + by * way) for way, by in tried]
        if not totals or not is_clearly_less(min(totals), least, WORTH):
            break
        way, by = tried[int(np.argmin(totals))]
        shift = _refine(miss, shift + by * way)
        least = miss(shift)
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


class _Misses:
    """What rows leave with their positions shifted (n,); torques as they are or of any size."""

    def __init__(self, rows: Rows, any_size: bool) -> None:
        self._rows, self._any_size, self._made = rows, any_size, dict[int, np.ndarray]()

    def __call__(self, shift: np.ndarray) -> float:
        moved, rows = np.flatnonzero(shift).tolist(), replace(self._rows, q=self._rows.q + shift)
        if len(moved) == 1:
            away = shift[moved[0]] - _GIVE_ALL
            weights = (1.0 + 2.0 * np.cos(away) + 2.0 * np.cos(2.0 * away)) / len(_GIVE_ALL)
            rows = rows.with_slack(np.tensordot(weights, self._give_all(moved[0]), 1))
        return rows.products.miss(self._any_size)

    def _give_all(self, joint: int) -> np.ndarray:
        if joint not in self._made:
            one, q = np.eye(self._rows.n)[joint], self._rows.q
            given = [self._rows.slack, *(replace(self._rows, q=q + by * one).slack for by in _GIVE_ALL[1:])]
            self._made[joint] = np.stack(given)
        return self._made[joint]


def _refine(miss: Callable[[np.ndarray], float], start: np.ndarray) -> np.ndarray:
    """Shifts near a first guess that leave least, as quarter turns where these leave about as little."""
    moved = np.flatnonzero(start)

    def shift(sizes: np.ndarray) -> np.ndarray:
        full = np.zeros(len(start))
        full[moved] = sizes
        return full

    simplex = start[moved] + 0.2 * np.vstack([np.zeros(len(moved)), np.eye(len(moved))])
    options = {"initial_simplex": simplex, "maxfev": 40 * len(moved), "xatol": 2e-3, "fatol": 1e-5}
    found = optimize.minimize(lambda x: miss(shift(x)), start[moved], method="Nelder-Mead", options=options).x
    best = shift(found)
    for j in moved:
        quarter = best.copy()
        quarter[j] = np.pi / 2.0 * np.round(best[j] / (np.pi / 2.0))
        if quarter[j] and miss(quarter) <= _ALIKE * miss(best):
            best = quarter
    return best
