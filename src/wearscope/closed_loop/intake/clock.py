"""The clock of a recording: its rate, lost samples, gaps that split it, and a uniform grid."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from wearscope.closed_loop.intake.recording import Run
from wearscope.closed_loop.intake.table_files import LEAST_ROWS, LEAST_TIME
from wearscope.errors import InputError

#: Relative difference of the time step from the stated one: up to the first value it is ignored; up to the
#: second the recording is resampled to the stated rate, with a note; a larger one is refused.
_OFF, _FAR_OFF = 0.02, 0.15
#: Samples are lost where a time step exceeds this multiple of the usual one, which is the longer of median
#: and stated step. Where more samples than the second number are lost at once, the gap splits the run.
_LOSS, _MOST_LOST = 1.6, 5
#: A gap up to this [s] is bridged however many samples it lacks, since the motion filter is slower.
_BRIDGED = 0.02
#: A clock that stands still in more than this share of its steps is a coarse one.
_MOST_REPEATED = 0.1
#: A longer gap [s] is no pause: the clock was set, as when a robot without its own clock finds the network's
#: time.
_LONGEST_PAUSE = 7 * 86400.0
#: Other time units that recorders write, and how many of each are a second.
_UNITS = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


def check_clock(where: str, t: np.ndarray, rate: float) -> list[str]:
    """Refuse a time column that is no clock or contradicts `sample_rate`; return notes on a small deviation.

    Parameters
    ----------
    where : str
        File.
    t : ndarray (N,)
        Time as recorded, from any origin.
    rate : float
        Stated rate [Hz].

    Raises
    ------
    InputError
        Where there are too few rows, time does not increase, or both the mean and the median time step
        (without steps that lose samples) differ from the stated one.
    """
    if len(t) < LEAST_ROWS:
        raise InputError(
            f"{where}: holds {len(t)} rows; a run needs at least {LEAST_ROWS} rows and one second."
        )
    steps = np.diff(t)
    back = np.flatnonzero(steps <= 0)
    if len(back) > _MOST_REPEATED * len(steps) and steps.min() == 0.0:
        moved = steps[steps > 0.0]
        finest = f" and else moves by {moved.min():.3g} s or more" if len(moved) else ""
        raise InputError(
            f"{where}: column 't' stands still in {len(back)} of {len(steps)} steps{finest}, so it has too "
            "few digits or rows stand twice; write all its digits and drop repeated rows, or let "
            "'wearscope new dataset' spread it."
        )
    if len(back):
        raise InputError(
            f"{where}: column 't' does not increase at row {back[0] + 1} "
            f"({t[back[0]]:.10g} s, then {t[back[0] + 1]:.10g} s); sort the rows and drop repeated ones."
        )
    median = float(np.median(steps))
    mean = float(np.mean(steps[steps < _LOSS * median]))
    off = min(abs(median * rate - 1.0), abs(mean * rate - 1.0))
    if off > _FAR_OFF:
        for unit, factor in _UNITS.items():
            if abs(median * rate / factor - 1.0) < _OFF:
                raise InputError(
                    f"{where}: column 't' steps by {median:.6g}, as in {unit}; divide it by {factor:.0f} to "
                    "have seconds."
                )
        other = "" if abs(mean / median - 1.0) < 1e-3 else f" ({1 / mean:.6g} Hz on average)"
        raise InputError(
            f"{where}: column 't' steps by {median:.6g} s, which is {1 / median:.6g} Hz{other}, "
            f"where sample_rate says {rate:g} Hz; correct one of them."
        )
    if t[-1] - t[0] < LEAST_TIME:
        raise InputError(f"{where}: lasts {t[-1] - t[0]:.3g} s; a run needs at least one second.")
    return [f"recorded at {1 / mean:.4g} Hz and brought to {rate:g} Hz."] if off > _OFF else []


def _find_losses(t: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Last row before each loss of samples, and how many samples are lost there (not rounded)."""
    steps = np.diff(t)
    usual = max(float(np.median(steps)), 1.0 / rate)
    before = np.flatnonzero(steps > _LOSS * usual)
    return before, steps[before] / usual - 1.0


def split_at_gaps(run: Run, rate: float, where: str) -> tuple[list[Run], list[str]]:
    """Pieces of a run between its gaps, with notes.

    A few lost samples do not split the run; `Run.losses` keeps their times, and `resample` interpolates them.
    A piece that is too short is dropped. A jump longer than any pause means that the clock was set; it is
    taken out of the time.

    Raises
    ------
    InputError
        Where no piece is long enough.
    """
    before, lost = _find_losses(run.t, rate)
    most = max(_MOST_LOST + 0.5, _BRIDGED * rate)
    few = before[lost <= most]
    notes = []
    losses = np.column_stack([run.t[few], run.t[few + 1]])
    if len(few):
        notes.append(
            f"{run.file}: {int(np.round(lost[lost <= most]).sum())} samples lost at {len(few)} "
            "places are interpolated and do not count."
        )
    gaps = before[lost > most]
    if not len(gaps):
        return [replace(run, losses=losses)], notes
    edges = [0, *(gaps + 1).tolist(), len(run.t)]
    jumps = np.diff(run.t)[gaps]
    skipped = np.concatenate([[0.0], np.cumsum(np.where(jumps > _LONGEST_PAUSE, jumps, 0.0))])
    pieces = []
    for (start, stop), ahead in zip(pairwise(edges), skipped.tolist(), strict=True):
        t = run.t[start:stop]
        if len(t) < LEAST_ROWS or t[-1] - t[0] < LEAST_TIME:
            notes.append(
                f"{run.file}: {len(t)} rows from t = {t[0] + run.start:.10g} s on, between two gaps, are too "
                "short to use and are left out."
            )
            continue
        inside = losses[(losses[:, 0] >= t[0]) & (losses[:, 1] <= t[-1])]
        piece = run.cut(start, stop)
        pieces.append(replace(piece, t=t - ahead, losses=inside - ahead, start=run.start + ahead))
    if not pieces:
        raise InputError(
            f"{where}: column 't' jumps so often that no second of it is whole; record the run again."
        )
    told = "; a gap of more than a week is taken as a clock that was set" if skipped[-1] else ""
    notes.append(
        f"{run.file}: column 't' jumps at {len(gaps)} place(s), first by {jumps[0]:.6g} s at row "
        f"{gaps[0] + 1}; the run is used in {len(pieces)} piece(s) of "
        f"{sum(piece.t[-1] - piece.t[0] for piece in pieces):.0f} s{told}."
    )
    if len(pieces) > 1:
        pieces = [replace(piece, piece=k + 1) for k, piece in enumerate(pieces)]
    return pieces, notes


def space_evenly(run: Run, rate: float) -> tuple[Run, list[str]]:
    """Run whose rows are evenly spaced in time where that makes its positions smoother, with a note.

    Often a device samples at an even rate, and only the stamps jitter. Where the samples themselves jitter,
    their stamps make the positions smoother.
    """
    row = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(run.t) * rate), 1.0))])
    even = np.polyval(np.polyfit(row, run.t, 1), row)
    even += run.t[0] - even[0]
    off = np.abs(even - run.t - np.mean(even - run.t))
    if off.max() < 1e-3 / rate or off.max() > 1.0 / rate:
        return run, []
    other = replace(run, t=even, losses=np.interp(run.losses, run.t, even))
    rough = [(np.diff(resample(one, rate).q, 3, axis=0) ** 2).sum(axis=0) for one in (run, other)]
    moves = (rough[0] > 0.0) & (rough[1] > 0.0)
    if np.log(rough[1][moves] / rough[0][moves]).sum() >= 0.0:
        return run, []
    return other, [
        f"{run.file}: rows are evenly spaced in time, as positions are smoother so than by column 't', which "
        f"jitters by up to {1e3 * off.max():.2g} ms."
    ]


def resample(run: Run, rate: float) -> Run:
    """Run on a uniform time grid; runs that already are uniform come back as they are."""
    uniform = run.t[0] + np.arange(round((run.t[-1] - run.t[0]) * rate) + 1) / rate
    uniform = uniform[uniform <= run.t[-1] + 1e-3 / rate]
    if len(uniform) == len(run.t) and np.abs(uniform - run.t).max() < 1e-3 / rate:
        return run

    def take(x: np.ndarray | None) -> np.ndarray | None:
        return None if x is None else np.column_stack([np.interp(uniform, run.t, c) for c in x.T])

    q, tau = take(run.q), take(run.tau)
    assert q is not None and tau is not None
    off = None
    if run.off is not None:
        off = np.column_stack([np.interp(uniform, run.t, c.astype(float)) > 0.0 for c in run.off.T])
    channels = {name: np.interp(uniform, run.t, x) for name, x in run.channels.items()}
    return replace(
        run,
        t=uniform,
        q=q,
        tau=tau,
        qd=take(run.qd),
        temperature=take(run.temperature),
        channels=channels,
        off=off,
    )


def mark_losses(run: Run) -> np.ndarray:
    """Mask (N,) of the samples of a uniform run that are interpolated over lost ones."""
    marked = np.zeros(len(run.t), dtype=bool)
    for start, stop in run.losses:
        marked |= (run.t > start + 1e-9) & (run.t < stop - 1e-9)
    return marked
