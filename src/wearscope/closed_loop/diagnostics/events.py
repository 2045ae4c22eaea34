"""Short events in what the corrected model leaves: pushes and collisions, and a threshold for them."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.prediction import Predicted

#: Size of an event's peak and of its ends, in robust standard deviations of what is left.
_PEAK, _END = 6.0, 3.0
#: Longest event and longest gap within one [s]; share of the rows from which it is no event but structure.
_LONGEST, _GAP, _MOST = 1.5, 0.1, 0.15
#: Share of a joint's largest speed below which what is left may be a reversal's form.
_SLOW = 0.05
#: Events within a time without any are fewer than this, with 95 % confidence (Hanley and Lippman-Hand 1983).
_RULE_OF_THREE = 3.0


def find_events(prepared: Prepared, predicted: Sequence[Predicted]) -> list[dict[str, Any]]:
    """Events of all runs as ``verdict.json`` has them, in the order of joints and runs.

    Returns
    -------
    list of dict
        `run`, `joint`, `t` where it starts [s], `seconds` that it lasts, and `size`: its largest torque that
        the model does not have, with its sign.
    """
    events = []
    for j, joint in enumerate(prepared.dataset.joints):
        left = [(p.run.measured - p.after)[:, j] for p in predicted]
        kept = [p.run.keep[:, j] for p in predicted]
        every = np.concatenate([x[k] for x, k in zip(left, kept, strict=True)])
        if not prepared.moving[j] or not len(every):
            continue
        scale = 1.4826 * float(np.median(np.abs(every)))
        own: list[dict[str, Any]] = []
        count = 0
        for p, x, k in zip(predicted, left, kept, strict=True):
            speed = np.abs(p.run.signals.v[rows(p.run.band, len(p.run.signals.t))][:, j])
            fast = speed > _SLOW * prepared.top_speed[j]
            for start, stop in _find_stretches(np.where(k, np.abs(x), 0.0) / max(scale, 1e-300), p.run.t):
                peak = start + int(np.argmax(np.abs(x[start:stop]) * k[start:stop]))
                if not fast[peak]:
                    continue
                t, end = float(p.run.t[start]), float(p.run.t[stop - 1])
                found = {"run": p.run.file, "joint": joint, "t": t, "seconds": end - t}
                own.append(found | {"size": float(x[peak])})
                count += stop - start
        if count <= _MOST * len(every):
            events += own
    return events


def _find_stretches(size: np.ndarray, t: np.ndarray) -> list[tuple[int, int]]:
    """Stretches of rows above `_END` that reach `_PEAK`, short gaps bridged, no longer than an event."""
    at = np.flatnonzero(size > _END)
    if not len(at):
        return []
    parts = np.split(at, np.flatnonzero(np.diff(t[at]) > _GAP) + 1)
    return [
        (int(part[0]), int(part[-1]) + 1)
        for part in parts
        if size[part].max() > _PEAK and t[part[-1]] - t[part[0]] <= _LONGEST
    ]


def suggest_thresholds(
    prepared: Prepared, predicted: Sequence[Predicted], events: Sequence[dict[str, Any]]
) -> dict[str, dict[str, float]]:
    """By joint, the threshold of a collision detector on this model, and its rate of false alarms.

    The threshold is the largest torque that the model misses on the test runs outside of events, at the
    common bandwidth. No row exceeds it: its false alarms are fewer than three in the time that was tested.
    """
    found = {}
    for j, joint in enumerate(prepared.dataset.joints):
        most, seconds = 0.0, 0.0
        for p in (p for p in predicted if p.run.use == "test"):
            counts = p.run.keep[:, j].copy()
            for e in (e for e in events if e["joint"] == joint and e["run"] == p.run.file):
                counts &= (p.run.t < e["t"]) | (p.run.t > e["t"] + e["seconds"])
            most = max(most, float(np.max(np.abs(p.run.measured - p.after)[counts, j], initial=0.0)))
            seconds += float(counts.sum()) * p.run.band.stride / p.run.band.rate
        if seconds > 0.0:
            found[joint] = {
                "threshold": most,
                "false_alarms_per_hour_at_most": _RULE_OF_THREE * 3600.0 / seconds,
            }
    return found
