"""Readings of positions whose zero is not the URDF's: another convention, or an encoder with no reference."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading
from wearscope.closed_loop.intake.joint_fit import WORTH, Mixture, Rows, is_clearly_less

#: Rows on which shifts are sought, and steps at which they are.
_FEW = 200
_STEP = np.pi / 4.0
#: Shifts of one joint that give all: torques hold sines and cosines of its position and of twice it.
_GIVE_ALL = np.arange(5) * 2.0 * np.pi / 5.0
#: A quarter turn, by which conventions differ, is taken where it leaves at most this many times as much.
_ALIKE = 1.05
#: Share of its reach that a position may go from one row to the next.
_STEP_OF_REACH = 0.1


def read_zeros(asked: Asked, any_size: bool = False) -> Iterator[Reading]:
    """Positions of some joints that turn, shifted by a constant; torques as they are or of any size."""
    few, shift = asked.rows.thin(_FEW), np.zeros(asked.rows.n)
    if not few.is_worth(0.0, any_size):
        return
    miss = _Misses(few, any_size)
    turning = [j for j in few.products.heard if not asked.slides[j]]
    least = few.miss(any_size)
    for _ in turning:
        ones = [np.eye(few.n)[j] for j in turning if not shift[j]]
        # A joint that was shifted for its parent's sake is turned back with it.
        back = [one - np.eye(few.n)[j] for one in ones for j in np.flatnonzero(shift)]
        for ways in (ones, back):
            tried = [(way, k * _STEP) for way in ways for k in (1, -1, 2, -2, 3, -3, 4, 0.5, -0.5)]
            totals = [miss(shift + by * way, int(way.argmax()) if way.sum() else None) for way, by in tried]
            if totals and is_clearly_less(min(totals), least, WORTH):
                break
        else:
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


def starts_at_zero(q: np.ndarray) -> bool:
    """Whether all positions (N, n) are 0 at first, and leave that without a step, as written zeros do not."""
    moved = q[np.any(q != 0.0, axis=1)][:1]
    return bool(np.all(q[0] == 0.0) and np.all(np.abs(moved) <= _STEP_OF_REACH * np.ptp(q, axis=0)))


class _Misses:
    """What rows leave with their positions shifted (n,); torques as they are or of any size."""

    def __init__(self, rows: Rows, any_size: bool) -> None:
        self._rows, self._any_size, self._made = rows, any_size, dict[tuple[float, ...], Mixture]()

    def __call__(self, shift: np.ndarray, joint: int | None = None) -> float:
        """With many shifts of one joint asked for next to the same ones of others, where it is given."""
        moved = np.flatnonzero(shift).tolist()
        if joint is None and len(moved) != 1:
            return self._move(shift).miss(self._any_size)
        joint = moved[0] if joint is None else joint
        one = np.eye(len(shift))[joint]
        rest = shift - shift[joint] * one
        key = (joint, *rest.tolist())
        if key not in self._made:
            self._made[key] = Mixture([self._move(rest + by * one) for by in _GIVE_ALL])
        away = shift[joint] - _GIVE_ALL
        weights = (1.0 + 2.0 * np.cos(away) + 2.0 * np.cos(2.0 * away)) / len(_GIVE_ALL)
        return self._made[key].miss(weights, self._any_size)

    def _move(self, shift: np.ndarray) -> Rows:
        return replace(self._rows, q=self._rows.q + shift) if shift.any() else self._rows


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
