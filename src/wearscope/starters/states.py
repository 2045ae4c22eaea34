"""Spreads joint states over columns: from lists in cells, or from rows of one joint each.

Columns that are numbered, next to columns that hold the joints' names, are renamed.
"""

import re
from typing import Any

import numpy as np
import pandas as pd

from wearscope import limits
from wearscope.errors import InputError
from wearscope.starters.columns import find_time, split_name

#: A cell that is a list in text, perhaps as Python prints arrays; a column's name with a number at its end.
_LIST = re.compile(r"(?:[a-z.]+\()?[\[('].*[,\s].*[\])]", re.DOTALL)
#: What Python writes around numbers, such as ``np.float64(0.1)`` or ``array([0.1, 0.2], dtype=float32)``.
_WRAPPED = re.compile(r"(?:np\.|numpy\.)?(?:float\d*|array|tensor)\((?:'[df]', *)?|(?:, *dtype=[\w.]+)?\)")
_NUMBERED = re.compile(r"(.*?)(name|position|velocity|effort)s?[_.\[]?(\d+)\]?", re.IGNORECASE)

#: Words of a column that names the joint of each row.
_JOINT = set("joint joints axis axes achse jnt motor actuator gelenk signal channel variable".split())
#: Joints take turns where more than this share of the rows are of another joint than the row before, and
#: where no joint has fewer rows than this share of the largest count.
_TURNS = 0.8


def spread_states(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the table with one column for each joint and signal.

    Lists in cells are spread over numbered columns. Numbers are replaced by joints' names where the table has
    these. Rows of one joint each become rows of all joints.

    Parameters
    ----------
    frame : DataFrame
        Lists may be texts, such as ``[0.1, 0.2]``; each row has as many values as the first.

    Raises
    ------
    InputError
        Where a list has more values than a table may have columns.
    """
    parts: list[pd.DataFrame] = []
    for name in frame.columns:
        column = frame[name]
        first: Any = column.iloc[0] if len(frame) else None
        listed = isinstance(first, (list, tuple, np.ndarray))
        size = first.count(",") if isinstance(first, str) else len(first) if listed else 1
        if size > limits.COLUMNS:
            raise InputError(
                f"column '{name}': has lists of more than {limits.COLUMNS} values; leave it out."
            )
        if isinstance(first, str) and _LIST.fullmatch(first.strip()):
            plain = column.astype(str).str.replace(_WRAPPED, "", regex=True)
            cells = plain.str.strip("[]() \n").str.split(r"\s*,\s*|\s+", regex=True, expand=True)
        elif listed and size:
            cells = pd.DataFrame(column.tolist(), index=frame.index)
        else:
            parts.append(column.to_frame())
            continue
        cells = cells.iloc[:, : int(cells.iloc[0].notna().sum())]
        cells.columns = pd.Index([f"{name}_{k}" for k in range(cells.shape[1])])
        parts.append(cells)
    return _pivot(_take_names(pd.concat(parts, axis=1))) if parts else frame


def _pivot(frame: pd.DataFrame) -> pd.DataFrame:
    """Place the joints side by side where a column names each row's joint; else return the table as it is."""
    time = find_time([str(column) for column in frame.columns])
    for key in [str(column) for column in frame.columns if str(column) not in time]:
        counts = frame[key].value_counts()
        words = set(split_name(key)) if frame[key].notna().all() else set()
        # A column that names or numbers recordings does not take turns, and its values are not equally
        # frequent as a rule.
        turns = words & (_JOINT | {"name", "id"}) and _take_turns(frame[key])
        turns = turns or (words & _JOINT and _follow(frame, key, time))
        if not turns or not 1 < len(counts) <= limits.JOINTS or counts.min() < _TURNS * counts.max():
            continue
        values = [column for column in frame.columns if column != key and str(column) not in time]
        whole = frame.assign(**{column: pd.to_numeric(frame[column], errors="coerce") for column in values})
        values = [column for column in values if whole[column].notna().any()]
        # Rows with the same stamp are one sample. Where each row has a stamp of its own, the k-th rows of all
        # joints are one sample.
        own = len(time) == 1 and frame[time[0]].nunique() < 1.5 * counts.max()
        own = own and not frame.duplicated([time[0], key]).any()
        sample = frame[time[0]] if own else frame.groupby(key).cumcount()
        parts = [whole.groupby(sample, sort=False)[list(time)].first()]
        for one, rows in whole.groupby(key, sort=False):
            named_so = {column: str(one) if len(values) == 1 else f"{column}_{one}" for column in values}
            parts.append(rows.set_index(sample[rows.index])[values].rename(columns=named_so))
        return pd.concat(parts, axis=1).reset_index(drop=True)
    return frame


def _take_turns(key: pd.Series) -> bool:
    """Return whether nearly every row is of another joint than the row before."""
    return bool(np.mean(key.to_numpy()[1:] != key.to_numpy()[:-1]) > _TURNS)


def _follow(frame: pd.DataFrame, key: str, time: tuple[str, ...]) -> bool:
    """Return whether the joints follow each other in blocks, each of which covers the time from its start."""
    if len(time) != 1:
        return False
    ends = np.flatnonzero(frame[key].to_numpy()[1:] != frame[key].to_numpy()[:-1])
    stamps = frame[time[0]].to_numpy()
    return len(ends) == frame[key].nunique() - 1 and all(stamps[k + 1] < stamps[k] for k in ends)


def _take_names(frame: pd.DataFrame) -> pd.DataFrame:
    """Rename numbered columns by the joints' names, where other columns hold these and never change."""
    found = {str(column): _NUMBERED.fullmatch(str(column)) for column in frame.columns}
    joints = {}
    for column, match in found.items():
        if match and match[2].lower() == "name" and frame[column].nunique() == 1:
            joints[match[1], match[3]] = str(frame[column].iloc[0]).strip("'\" ")
    named = {
        column: f"{joints[match[1], match[3]]}.{match[2].lower()}"
        for column, match in found.items()
        if match and match[2].lower() != "name" and (match[1], match[3]) in joints
    }
    return frame.rename(columns=named)
