"""Pushes on a robot at rest: moments at which its torques leave their level."""

from collections.abc import Sequence

import numpy as np

from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.recording import Run

#: Smallest push, in (robust) standard deviations of the torque; least time between two [s]; most that are
#: listed.
_FAR, _APART, _MOST = 10.0, 1.0, 6


def say_pushes(dataset: Dataset, runs: Sequence[Run]) -> str:
    """Pushes by recording, time, joint and size, as the end of a sentence; empty where there are none."""
    found = [(run.file, *one) for run in runs for one in find_pushes(run.t, run.tau)]
    told = []
    for file, t, sizes in found[:_MOST]:
        named = zip(dataset.joints, sizes.tolist(), dataset.torque_unit, strict=True)
        joints = ", ".join(f"{abs(size):.2g} {unit} at {joint}" for joint, size, unit in named if size)
        told.append(f"{file} at {t:.1f} s ({joints})")
    more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
    return f"; pushed in {', '.join(told)}{more}" if told else ""


def find_pushes(t: np.ndarray, tau: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Times [s] at which torques (N, n) leave their level most, and each joint's departure (n,).

    A joint that stays within its noise has 0.
    """
    level = np.median(tau, axis=0)
    spread = 1.4826 * np.median(np.abs(tau - level), axis=0) + 1e-12
    far = (np.abs(tau - level) > _FAR * spread).any(axis=1)
    rows = np.flatnonzero(far)
    if not len(rows):
        return []
    parts = np.split(rows, np.flatnonzero(np.diff(t[rows]) > _APART) + 1)
    found = []
    for part in parts:
        off = tau[part] - level
        peak = off[np.abs(off).argmax(axis=0), np.arange(tau.shape[1])]
        middle = part[int(np.argmax(np.sum((off / spread) ** 2, axis=1)))]
        found.append((float(t[middle]), np.where(np.abs(peak) > _FAR * spread, peak, 0.0)))
    return found
