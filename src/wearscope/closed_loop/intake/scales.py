"""Readings of positions that go too far or not far enough: turns, angles before a gear, wrong degrees."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, reduce

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading, say_columns
from wearscope.closed_loop.intake.joint_fit import WORTH, Rows, is_clearly_less
from wearscope.closed_loop.intake.products import DOUBTFUL
from wearscope.closed_loop.intake.sizes import say_sizes

#: Octaves within which a size of all torques is sought.
_SIZES = 8.0
#: Rows on which factors are sought; octaves at which they are, of all joints and of one, and between them.
_FEW, _OF_ALL = 200, np.append(np.arange(-8.0, -3.0), np.arange(-3.0, 3.01, 0.5))
_OF_ONE, _BETWEEN = np.array([-1.0, -0.5, 0.5, 1.0]), 0.5
#: Octaves of a turn, half and quarter ones, a degree, and of twice and four times the counts.
_KNOWN = np.array([*np.log2([2.0 * np.pi, np.pi, 0.5 * np.pi, np.pi / 180.0]), -2.0, -1.0, 1.0, 2.0])
#: Octaves by which a factor of one differs from none, or from a known one; share of what the stated positions
#: leave, at most; share of what is left that another joint's factor leaves at most; shares of a torque's
#: variance by which more factors must be better.
_ONE, _CLEAR, _BETTER, _PLAIN = 0.05, 0.3, 0.7, 0.005


def read_scales(asked: Asked, any_size: bool = False) -> Iterator[Reading]:
    """Positions of joints that turn by a factor, all at once or some; torques as in `read_zeros`."""
    few, turns = asked.rows.thin(_FEW), ~np.array(asked.slides)
    way = turns.astype(float)
    heard = [j for j in few.products.heard if turns[j]]
    if not heard or not few.is_worth(0.0, any_size):
        return

    @cache
    def look(*octaves: float) -> float:
        return _scale(few, np.array(octaves)).miss(any_size)

    def miss_plain(octaves: np.ndarray) -> float:
        return look(*octaves.tolist())

    def miss_sized(octaves: np.ndarray) -> float:
        return _size(_scale(few, octaves), way)[0]

    def is_told(miss: Callable[[np.ndarray], float], octaves: np.ndarray, least: float) -> bool:
        """Whether half and twice do worse, as they do not where the motion says nothing of its size."""
        others = [miss(octaves + by * (octaves != 0.0)) for by in (-1.0, 1.0)]
        return all(is_clearly_less(least, one, DOUBTFUL) for one in others)

    stated, none = few.miss(any_size), np.zeros(few.n)
    found = [_refine(miss_plain, none, way, _OF_ALL)]
    # Next to torques of any size one factor of all joints is asked for: motors', or turns.
    if len(heard) > 1 and not any_size:
        found += [_add_single(miss_plain, start, left, heard) for left, start in ((stated, none), *found)]
    least, octaves = reduce(lambda one, other: other if other[0] < one[0] - _PLAIN else one, found)
    tried = [(least, octaves, miss_plain)]
    # What one joint lacks may look like its gravity at another scale and size.
    if len(heard) > 1 and not any_size:
        both, other = _refine(miss_sized, none, way, _OF_ALL)
        if is_clearly_less(both, least, DOUBTFUL):
            tried.insert(0, (both, other, miss_sized))
    for least, octaves, miss in tried:
        octaves = np.where(np.abs(octaves) < _ONE, 0.0, octaves)
        moved = np.flatnonzero(octaves)
        clear = len(moved) and least <= _CLEAR * stated
        clear = clear and few.is_worth(least, any_size or miss is miss_sized)
        if clear and is_told(miss, octaves, least):
            break
    else:
        return
    sized = miss is miss_sized
    octaves = _snap(miss, octaves, least)
    names, sizes = asked.names(moved, "q"), [f"{2.0 ** octaves[j]:.5g}" for j in moved]
    pairs = ", ".join(f"{name}: {size}" for name, size in zip(names, sizes, strict=True))
    alone = any_size or sized or is_told(miss_sized, octaves, least)
    also = "" if alone else ", as torques of another constant would ask for another"
    told = (
        f"{say_columns(names)} {'fit' if len(moved) > 1 else 'fits'} the URDF where multiplied by "
        f"{', '.join(dict.fromkeys(sizes))}, as turns or angles before a gear do; where the exact factor is "
        f'known, give that{also}; write "scaled: {{{pairs}}}" in dataset.yaml.'
    )
    codes = tuple(f"scale {name}" for name in names)
    products = _scale(asked.rows, octaves).products
    if sized:
        size = _size(_scale(few, octaves), way)[1]
        more, added = say_sizes(asked, np.array(heard), size)
        told, codes = f"{told.rstrip('.')}; in addition, {more}", (*codes, *added)
        products = products.resize(size)
    yield Reading(told, codes, tuple(moved.tolist()), products)


def find_scale(rows: Rows, way: np.ndarray) -> float:
    """Factor of all positions along a way that torques of any size next to springs ask for; 1 for none."""
    few, none = replace(rows.thin(_FEW), springs=True), np.zeros(rows.n)

    def miss(octaves: np.ndarray) -> float:
        return _size(_scale(few, octaves), way)[0]

    stated = miss(none)
    if stated < DOUBTFUL or np.sum(way[few.products.heard]) < 2:
        return 1.0
    least, octaves = _refine(miss, none, way, _OF_ALL)
    if np.abs(octaves).max() < _ONE or least > _BETTER * min(map(miss, (none, octaves - way, octaves + way))):
        return 1.0
    return float(2.0 ** _snap(miss, octaves, least)[way > 0.0][0])


def _size(rows: Rows, way: np.ndarray) -> tuple[float, np.ndarray]:
    """What one size of all joints' torques along a way leaves at best, and the sizes (n,)."""
    products = rows.products
    fine = optimize.minimize_scalar(
        lambda x: products.resize(2.0 ** (x * way)).total,
        bounds=(-_SIZES, _SIZES), method="bounded", options={"xatol": 0.02},
    )  # fmt: skip
    return float(fine.fun), 2.0 ** (float(fine.x) * way)


def _snap(miss: Callable[[np.ndarray], float], octaves: np.ndarray, least: float) -> np.ndarray:
    """Factors in octaves (n,), known ones where these leave about as little."""
    nearest = _KNOWN[np.argmin(np.abs(octaves[:, None] - _KNOWN), axis=1)]
    known = np.where(np.abs(octaves - nearest) < _ONE, nearest, octaves)
    return octaves if is_clearly_less(least, miss(known), WORTH) else known


def _scale(rows: Rows, octaves: np.ndarray) -> Rows:
    return rows.times(2.0**octaves, "q", "v", "a", "top")


def _refine(
    miss: Callable[[np.ndarray], float], start: np.ndarray, way: np.ndarray, tried: np.ndarray
) -> tuple[float, np.ndarray]:
    """What the best factor along a way leaves, and the octaves (n,) of all joints with it."""
    by = float(min(tried, key=lambda x: miss(start + x * way)))
    fine = optimize.minimize_scalar(
        lambda x: miss(start + x * way),
        bounds=(by - _BETWEEN, by + _BETWEEN), method="bounded", options={"xatol": 5e-3},
    )  # fmt: skip
    return float(fine.fun), start + float(fine.x) * way


def _add_single(
    miss: Callable[[np.ndarray], float], octaves: np.ndarray, least: float, joints: list[int]
) -> tuple[float, np.ndarray]:
    """Factors of single joints added while one makes what is left clearly smaller."""
    ways = np.eye(len(octaves))
    for _ in joints:
        best = min(joints, key=lambda j: min(miss(octaves + x * ways[j]) for x in _OF_ONE / 2.0))
        left, other = _refine(miss, octaves, ways[best], _OF_ONE)
        if left > _BETTER * least:
            break
        least, octaves = left, other
    return least, octaves
