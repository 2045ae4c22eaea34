"""Columns that are updated less often than the rows: a value repeats over rows, or rows are blank."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from scipy import ndimage

from wearscope.robots.spatial import Array

#: Kinds whose slowest column sets the rate; columns of other kinds, such as temperatures, may be slower.
_MOTION = ("position", "velocity", "torque", "current", "goal", "duty")
#: Fewest changes of a column that show for how many rows its values are held.
_FEWEST = 50
#: Two conditions on a held column. At most the first share of its values are held for fewer rows than the
#: median. At least the second share are held for the median number of rows, plus or minus one.
_SHORTER, _ALIKE = 0.02, 0.7
#: A column counts as held only where its median step is at least this many times its smallest step. A slowly
#: moving encoder changes by one count at a time and is not held.
_STEPS = 3.0
#: Columns are written by turns, each row with some of them, where fewer than this share of the rows have a
#: number in every column.
_BY_TURNS = 0.5


def find_hold(x: Array) -> int:
    """Find for how many rows a channel (N,) holds each value; 1 where each row may have a new one."""
    with np.errstate(invalid="ignore"):  # no step between infinite values
        steps = np.diff(x)
    at = np.flatnonzero(steps)
    gaps = np.diff(at)
    if len(gaps) < _FEWEST:
        return 1
    held, sizes = int(np.median(gaps)), np.abs(steps[at])
    shorter, alike = np.mean(gaps < max(held - 1, 2)), np.mean(np.abs(gaps - held) <= 1)
    clear = np.median(sizes) >= _STEPS * sizes.min() and shorter <= _SHORTER and alike >= _ALIKE
    return held if held > 1 and clear else 1


def _is_quicker(x: Array, held: int) -> bool:
    """Return whether a channel (N,) has new values more often than every `held` rows."""
    gaps = np.diff(np.flatnonzero(np.diff(x)))
    return bool(np.count_nonzero(gaps < held - 1) > _SHORTER * len(gaps))


def _find_news(x: Array, held: int) -> np.ndarray:
    """Return the rows of a channel (N,) with a new reading, also where the reading did not change."""
    at = np.concatenate([[0], np.flatnonzero(np.diff(x)) + 1])
    if held == 1:
        return np.arange(len(x))
    ends = np.append(at[1:], len(x))
    again = [np.arange(a, max(b - held // 2, a + 1), held) for a, b in zip(at, ends, strict=True)]
    return np.concatenate(again)


def take_news(
    t: Array, numbers: pd.DataFrame, columns: Mapping[str, Sequence[str]], where: str
) -> tuple[Array, pd.DataFrame, list[str]]:
    """Reduce a table to the rate of its slowest motion column, and average faster columns over its rows.

    A table whose columns all have a new value in each row is returned as it is.

    Parameters
    ----------
    t : ndarray (N,)
        [s]
    numbers : DataFrame (N, K)
        NaN where a cell is blank.
    columns : mapping of str to sequence of str
        Columns by kind.
    where : str
        Name of the file, for notes.

    Returns
    -------
    t : ndarray (M,)
        [s]
    numbers : DataFrame (M, K)
    notes : list of str
        One note where rows were reduced.
    """
    motion = [name for kind in _MOTION for name in columns.get(kind, ())]
    others = [name for name in map(str, numbers) if name not in motion]
    numbers = numbers.assign(**numbers[others].ffill().bfill())
    there = numbers.notna().to_numpy()
    least = int(there.sum(axis=0).min())
    by_turns = least >= _FEWEST and there.all(axis=1).sum() < _BY_TURNS * least
    held, kinds = dict.fromkeys(map(str, numbers), 1), {}
    for kind in _MOTION:
        own = {name: numbers[name].dropna().to_numpy(dtype=float) for name in columns.get(kind, ())}
        holds = {name: find_hold(x) for name, x in own.items()}
        longest = max(holds.values(), default=1)
        if longest > 1:
            # A recorder reads all channels of one kind at the same times. So a channel that hardly moves, and
            # whose values do not show this, is assumed to be held for as many rows as the others.
            held |= {name: longest for name, x in own.items() if not _is_quicker(x, longest)}
            kinds[kind] = longest
    if not kinds and not by_turns:
        return t, numbers, []
    news = {}
    for k, name in enumerate(map(str, numbers)):
        rows = np.flatnonzero(there[:, k])
        news[name] = rows[_find_news(numbers[name].to_numpy(dtype=float)[rows], held[name])]
    slowest = min(motion, key=lambda name: len(news[name]))
    first, last = max(news[name][0] for name in motion), min(news[name][-1] for name in motion)
    at = news[slowest][(news[slowest] >= first) & (news[slowest] <= last)]
    taken = {}
    for name, rows in news.items():
        x = numbers[name].to_numpy(dtype=float)[rows]
        if name in motion:
            width = max(1, round(len(rows) / len(news[slowest])))
            smooth = ndimage.uniform_filter1d(x, width + 1 - width % 2)
            taken[name] = np.interp(t[at], t[rows], smooth)
        else:
            taken[name] = x[np.maximum(np.searchsorted(rows, at, side="right") - 1, 0)]
    what = [f"{kind} is held over {rows} rows" for kind, rows in kinds.items()]
    what += ["no row has all columns"] if by_turns else []
    told = f"{where}: {' and '.join(what)}; rows are those of '{slowest}', which is new least often."
    return t[at], pd.DataFrame(taken), [told]
