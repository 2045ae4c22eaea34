"""Time stamps of any unit and origin as seconds, and the rate that they have."""

import numpy as np
import pandas as pd

from wearscope.errors import InputError
from wearscope.robots.spatial import Array

#: Seconds in units that recorders write.
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Sampling rates of robots [Hz]: a unit that gives another is not the clock's.
_SLOWEST, _FASTEST = 5.0, 20_000.0
#: Share of repeated stamps from which the clock is coarse, and of rows out of order that are sorted.
_COARSE, _UNSORTED = 0.1, 0.02
_LOSS = 1.6


def to_seconds(stamps: pd.Series, where: str, unit: str | None = None) -> tuple[Array, list[str]]:
    """Time (N,) in seconds from the first row, with notes on what was taken for what.

    Parameters
    ----------
    stamps : Series
        Numbers of any unit and origin, or dates.
    where : str
        File and column, for messages.
    unit : str, optional
        Of `UNITS`; guessed from the step where left out.

    Raises
    ------
    InputError
        Where they are neither, or no unit gives a robot's rate.
    """
    notes = []
    if not pd.api.types.is_numeric_dtype(stamps):
        try:
            dates = pd.to_datetime(stamps, format="mixed", utc=True)
        except (ValueError, TypeError) as error:
            told = " ".join(str(error).split())[:120]
            raise InputError(
                f"{where}: is no number and no date ({told}); name the time with --time."
            ) from None
        since = (dates - dates.iloc[0]).dt.total_seconds()
        return since.to_numpy(dtype=float), [f"{where}: read as dates."]
    # Large integers keep their last digits when the origin goes first.
    first = stamps.dropna().iloc[0] if stamps.notna().any() else 0
    t = (stamps - first).to_numpy(dtype=float)
    if unit is None:
        unit = _guess_unit(t, where)
        if unit != "s":
            notes.append(f"{where}: taken as {unit}, by its step.")
    if abs(float(first)) * UNITS[unit] > 1e8:
        notes.append(f"{where}: counts since the epoch.")
    return t * UNITS[unit], notes


def _guess_unit(t: Array, where: str) -> str:
    steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0.0]
    if not len(steps):
        raise InputError(f"{where}: does not increase; name another column with --time, or give --rate.")
    step = float(np.median(steps))
    for name, size in UNITS.items():
        if _SLOWEST <= 1.0 / (step * size) <= _FASTEST:
            return name
    raise InputError(
        f"{where}: steps by {step:.6g}, which gives no robot's rate in s, ms, us or ns; name another column "
        "with --time, or give --rate."
    )


def order_rows(t: Array, where: str) -> tuple[np.ndarray, Array, list[str]]:
    """Rows to keep, in order of time, and their times, with notes.

    A few rows out of order are sorted and repeated ones dropped; where many stamps repeat, the clock is
    coarser than the samples, which are then spread evenly between its ticks.

    Raises
    ------
    InputError
        Where time runs backwards at many rows.
    """
    rows = np.flatnonzero(np.isfinite(t))
    notes = [f"{where}: {len(t) - len(rows)} rows without a time are left out."] if len(rows) < len(t) else []
    back = int(np.sum(np.diff(t[rows]) < 0.0))
    if back > max(_UNSORTED * len(rows), 1):
        row = int(rows[np.flatnonzero(np.diff(t[rows]) < 0.0)[0] + 1])
        raise InputError(
            f"{where}: runs backwards at {back} rows, first at row {row}; split the file there, or sort it."
        )
    if back:
        rows = rows[np.argsort(t[rows], kind="stable")]
        notes.append(f"{where}: {back} rows out of order were sorted.")
    kept = t[rows]
    again = np.concatenate([[False], np.diff(kept) <= 0.0])
    if np.mean(again) > _COARSE:
        ticks = np.flatnonzero(~again)
        kept = np.interp(np.arange(len(kept)), ticks, kept[ticks])
        keep = np.concatenate([[True], np.diff(kept) > 0.0])
        notes.append(f"{where}: the clock is coarser than the samples, which are spread between its ticks.")
        return rows[keep], kept[keep], notes
    if again.any():
        notes.append(f"{where}: {int(again.sum())} rows with a repeated time are left out.")
    return rows[~again], kept[~again], notes


def find_rate(t: Array) -> float:
    """Sampling rate [Hz] of times (N,): the median step's, or the mean one's where the clock jitters."""
    steps = np.diff(t)
    median = float(np.median(steps))
    mean = float(np.mean(steps[steps < _LOSS * median]))
    rate = 1.0 / (median if abs(mean / median - 1.0) < 0.01 else mean)
    whole = round(rate)
    return float(whole) if whole and abs(rate / whole - 1.0) < 0.005 else float(f"{rate:.6g}")
