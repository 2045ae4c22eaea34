"""Converts time stamps of any unit and origin to seconds, and finds their sample rate."""

import re
import warnings
from typing import Literal

import numpy as np
import pandas as pd

from wearscope.errors import InputError, describe
from wearscope.robots.spatial import Array
from wearscope.starters.columns import find_time, says_time, split_name

_DAY = 86400.0  # [s]
#: Length of each unit of time stamps [s].
UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "d": _DAY}
#: Other words for these units in a column's name.
_NAMES = {
    "s": {"sec", "secs", "seconds"},
    "ms": {"msec", "msecs", "millis", "milliseconds"},
    "us": {"usec", "usecs", "micros", "microseconds", "µs"},
    "ns": {"nsec", "nsecs", "nanosec", "nanos", "nanoseconds"},
    "d": {"days"},
}
#: Range of sample rates of robots [Hz]; it includes 5 Hz with rounded stamps. A unit of time that gives a
#: rate outside the range is not that of the clock.
_SLOWEST, _FASTEST = 4.99, 20_000.0
#: A clock is coarser than the samples where more than the first share of its stamps repeat. Rows out of order
#: are sorted where they are at most the second share.
_COARSE, _UNSORTED = 0.1, 0.02
#: A step longer than this many median steps is a gap, and does not count for the rate.
_LOSS = 1.6
#: A column with at most this many different dates tells the day of the recording, not the time.
_FEW_DATES = 2
#: A clock restarts where it goes back by more than this share of the time recorded so far; fewest rows of a
#: recording.
_BACK, _FEWEST = 0.5, 50
#: A column holds numbers where more than this share of its cells do; the other cells have no time.
_NUMBERS = 0.5
_ELSE = "name another column with --time, or leave this one out and give --rate."
_STANDS = f"does not increase; {_ELSE}"


def to_seconds(
    stamps: pd.Series, where: str, unit: str | None = None, name: str = "t"
) -> tuple[Array, list[str]]:
    """Convert time stamps to seconds (N,) from the first row, with notes on how they were read.

    Parameters
    ----------
    stamps : Series
        Numbers of any unit and origin, or dates.
    where : str
        File and column, for messages.
    unit : str, optional
        A key of `UNITS`; by default it is guessed from the column's name and its steps.
    name : str
        Name of the column.

    Raises
    ------
    InputError
        Where the stamps are neither numbers nor dates, or no unit gives a robot's sample rate.
    """
    notes = []
    if pd.api.types.is_bool_dtype(stamps):
        raise InputError(f"{where}: holds truth values, no times; name the time with --time.")
    numbers = pd.to_numeric(stamps, errors="coerce")
    if numbers.notna().sum() > _NUMBERS * len(stamps):
        stamps = numbers
    if not pd.api.types.is_numeric_dtype(stamps):
        try:
            since = _read_dates(stamps, "raise")
        except (ValueError, TypeError) as error:
            told = describe(error, 120)
            raise InputError(
                f"{where}: is no number and no date ({told}); name the time with --time."
            ) from None
        return since - since[0], [f"{where}: read as dates."]
    # The origin is subtracted before the conversion to float, so that large integers keep their last digits.
    first = stamps.dropna().iloc[0] if stamps.notna().any() else 0
    t = (stamps - first).to_numpy(dtype=float)
    if unit is None:
        unit, why = _guess_unit(t, where, name)
        if unit != "s":
            notes.append(f"{where}: taken as {unit}, by its {why}.")
    if abs(float(first)) * UNITS[unit] > 1e8:
        notes.append(f"{where}: counts since the epoch.")
    return t * UNITS[unit], notes


def _read_dates(stamps: pd.Series, errors: Literal["raise", "coerce"]) -> Array:
    """Convert dates, or times of the day that may pass midnight, to seconds (N,) from any origin."""
    text = stamps.astype(str).str.replace(r"(?<=:\d\d),(?=\d)", ".", regex=True)
    # Of the two orders, day or month first, the one that makes the recording shorter is taken.
    orders = (False, True) if re.match(r"\d{1,2}[./-]\d{1,2}[./-]\d", str(text.iloc[0])) else (False,)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # where a day cannot be a month
        tried = [
            pd.to_datetime(text, format="mixed", utc=True, errors=errors, dayfirst=one) for one in orders
        ]
    dates = min(tried, key=lambda one: one.max() - one.min())
    since = (dates - dates.min()).dt.total_seconds().to_numpy(dtype=float)
    if text.str.fullmatch(r"\d{1,2}:[\d:.]+").all():
        back = np.diff(since, prepend=since[:1])
        since = since + _DAY * np.cumsum((back < -0.5 * _DAY).astype(float) - (back > 0.5 * _DAY))
    return np.asarray(since)


def _guess_unit(t: Array, where: str, column: str) -> tuple[str, str]:
    """Guess the unit of times (N,); return it, and whether the column's name or its step tells it."""
    steps = np.diff(t[np.isfinite(t)])
    steps = steps[steps > 0.0]
    if not len(steps):
        raise InputError(f"{where}: {_STANDS}")
    step = float(np.median(steps))
    units = [name for name, size in UNITS.items() if _SLOWEST <= 1.0 / (step * size) <= _FASTEST]
    words = split_name(column)
    for unit in units:
        if set(words) & {unit, *_NAMES[unit]}:
            return unit, "name"
    if not says_time(column) and np.all(np.diff(t) == 1.0):
        raise InputError(
            f"{where}: counts the rows, so that it tells no time; give --rate without it, or --time-unit ms "
            "where it is milliseconds."
        )
    if units:
        return units[0], "step"
    raise InputError(f"{where}: steps by {step:.6g}, which gives no robot's rate in s, ms, us or ns; {_ELSE}")


def find_clock(frame: pd.DataFrame) -> tuple[str, ...]:
    """Find the column of the running time, or the two columns of seconds and nanoseconds.

    Columns that hold only the date, or times out of order, are passed over where there is another.
    """
    every = [str(column) for column in frame.columns]
    columns = list(every)
    while names := find_time(columns):
        stamps = frame[names[0]]
        steps = np.diff(pd.to_numeric(stamps, errors="coerce").to_numpy(dtype=float))
        back = np.mean(steps[np.isfinite(steps)] < 0.0) if np.isfinite(steps).any() else 0.0
        if len(names) == 2 or (stamps.nunique() > _FEW_DATES and back <= _UNSORTED):
            return names
        columns.remove(names[0])
    return find_time(every)


def find_restarts(stamps: pd.Series) -> list[int]:
    """Find the rows at which a clock restarts, as where one file holds several recordings.

    A row that is merely out of order goes back by only a small part of the time recorded so far.
    """
    numbers = pd.to_numeric(stamps, errors="coerce")
    if numbers.notna().sum() <= _NUMBERS * len(stamps):
        numbers = pd.Series(_read_dates(stamps, "coerce"))
    rows = np.flatnonzero(np.isfinite(numbers.to_numpy(dtype=float)))
    t, starts = numbers.to_numpy(dtype=float)[rows], [0]
    for k in (np.flatnonzero(np.diff(t) < 0.0) + 1).tolist():
        part = t[starts[-1] : k]
        if len(part) >= _FEWEST and part[-1] - t[k] > _BACK * np.ptp(part):
            starts.append(k)
    return rows[starts[1:]].tolist() if len(t) - starts[-1] >= _FEWEST else []


def order_rows(t: Array, where: str) -> tuple[np.ndarray, Array, list[str]]:
    """Return the rows to keep in order of time, their times, and notes.

    A few rows out of order are sorted, and rows with a repeated stamp are dropped. Where many stamps repeat,
    the clock is coarser than the samples; the samples are then spread evenly between its ticks.

    Raises
    ------
    InputError
        Where time runs backwards at many rows, or never increases.
    """
    rows = np.flatnonzero(np.isfinite(t))
    if not len(rows):
        raise InputError(f"{where}: has no time in any row; {_ELSE}")
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
        # The recording may start and end anywhere within a tick, so the first and last tick are not used.
        ticks = np.flatnonzero(~again)[1:]
        if not len(ticks):
            raise InputError(f"{where}: {_STANDS}")
        kept = np.interp(np.arange(len(kept)), ticks, kept[ticks])
        keep = np.concatenate([np.diff(kept) > 0.0, [False]])
        notes.append(f"{where}: the clock is coarser than the samples, which are spread between its ticks.")
        return rows[keep], kept[keep], notes
    if again.any():
        notes.append(f"{where}: {int(again.sum())} rows with a repeated time are left out.")
    return rows[~again], kept[~again], notes


def find_rate(t: Array) -> float:
    """Return the sample rate [Hz] of times (N,): from the median step, or the mean step where they jitter."""
    steps = np.diff(t)
    median = float(np.median(steps))
    mean = float(np.mean(steps[steps < _LOSS * median]))
    rate = 1.0 / (median if abs(mean / median - 1.0) < 0.01 else mean)
    whole = round(rate)
    return float(whole) if whole and abs(rate / whole - 1.0) < 5e-4 else float(f"{rate:.6g}")
