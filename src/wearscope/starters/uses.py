"""Recordings that are fitted and those that are only scored, and the rate that they have in common."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from wearscope.errors import InputError

#: Rates of two recordings may differ by this share: the reader brings them to one.
_OFF = 0.15
#: Share of a lone recording's motion that is kept for training; a second then lies before the test.
_TRAINING, _GAP = 0.7, 1.0
#: Least length of a part [s]; steps in which its motion is added up [s].
_PART, _STEP = 2.0, 0.1


@dataclass
class Recorded:
    """A recording in the platform's columns: ``t``, then by joint ``q_``, ``tau_`` and what else there is."""

    name: str
    frame: pd.DataFrame
    use: str = "train"
    file: str = ""


def take_common_rate(
    runs: list[Recorded], rates: Sequence[float], files: Sequence[Path], stated: float | None
) -> tuple[float, list[str]]:
    """Rate of all recordings [Hz], to which faster ones are averaged, with notes.

    Raises
    ------
    InputError
        Naming a recording that is slower than the stated rate.
    """
    slow = [own for own in rates if own < (1.0 + _OFF) * min(rates)]
    rate, notes = stated or float(np.median(slow)), []
    for k, (file, own) in enumerate(zip(files, rates, strict=True)):
        if own < (1.0 - _OFF) * rate:
            raise InputError(
                f"{file}: has {own:g} Hz where --rate says {rate:g} Hz; give --rate {own:g}, or leave it out."
            )
        if own > (1.0 + _OFF) * rate:
            frame = runs[k].frame
            part = np.floor((frame["t"] - frame["t"].iloc[0] + 0.5 / own) * rate)
            runs[k] = replace(runs[k], frame=frame.groupby(part.to_numpy()).mean().reset_index(drop=True))
            notes.append(f"{file.name}: {own:g} Hz, averaged to {rate:g} Hz.")
    return rate, notes


def _find_cut(frame: pd.DataFrame, rate: float) -> int:
    """Row up to which a share of all joints' motion is done, so that joints move on both sides of it."""
    every = max(1, round(_STEP * rate))
    q = frame[[name for name in frame if str(name).startswith("q_")]].to_numpy(dtype=float)[::every]
    moved = np.abs(np.diff(q, axis=0)) / np.maximum(np.ptp(q, axis=0), 1e-12)
    done = np.cumsum(moved.mean(axis=1)) if len(q) > 1 else np.ones(1)
    return every * (int(np.searchsorted(done, _TRAINING * done[-1])) + 1)


def choose_uses(runs: list[Recorded], files: Sequence[Path], test: Sequence[str], rate: float) -> list[str]:
    """Mark the runs that are only scored; a lone run is cut in two."""
    if len(runs) == 1:
        if test:
            raise InputError("--test: there is one recording only; give another for training.")
        whole = runs[0]
        cut = _find_cut(whole.frame, rate)
        later = whole.frame.iloc[cut + int(_GAP * rate) :]
        if min(cut, len(later)) < _PART * rate:
            raise InputError(
                f"{files[0]}: {len(whole.frame) / rate:.3g} s are too short to be cut into a training and "
                f"a test part; record {2.0 * _PART / (1.0 - _TRAINING):.0f} s or more, or give a "
                "second recording."
            )
        runs[:] = [
            replace(whole, name=f"{whole.name}_first", frame=whole.frame.iloc[:cut]),
            replace(whole, name=f"{whole.name}_last", frame=later, use="test"),
        ]
        return [
            f"test: the one recording's last {len(later) / rate:.0f} s, {100 * (1 - _TRAINING):.0f} % of its "
            "motion; a second one would say more."
        ]
    chosen = {Path(one).name for one in test} or {files[-1].name}
    unknown = chosen - {file.name for file in files} - {run.file for run in runs}
    if unknown:
        raise InputError(f"--test {sorted(unknown)[0]}: is none of the recordings; name one of them.")
    for run, file in zip(runs, files, strict=True):
        run.use = "test" if chosen & {file.name, run.file} else "train"
    if all(run.use == "test" for run in runs):
        raise InputError("--test: names every recording; leave one for training.")
    return [f"test: {', '.join(sorted(chosen))}" + ("." if test else ", the last one, as none was named.")]
