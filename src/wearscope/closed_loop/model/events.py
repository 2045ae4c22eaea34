"""Short events in the residual torques, such as pushes and collisions, and a threshold to detect them.

A residual holds noise with a tail, and structure. An event stands out from that tail. An exponential through
the upper quartile and the upper tenth of the sizes gives the size that no row is expected to reach by chance.
The same is done with the largest size of each period, and the larger limit counts. Models fit worse near
reversals than elsewhere, so these rows have their own spread and tail.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import interpolate, ndimage, signal

from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import PreparedRun

Event = dict[str, Any]

#: Rows in a period of the common cut-off, which share noise and structure.
_PERIOD = 4
#: Shares of the rows that define the tail; expected number of chance events of a joint in all runs.
_UPPER, _TOP, _CHANCE = 0.25, 0.1, 0.01
#: Size at an event's ends [robust standard deviations]; longest event and longest gap within one [s]; share
#: of a joint's rows beyond which events are structure.
_END, _LONGEST, _GAP, _MOST = 3.0, 1.5, 0.1, 0.15
#: Where healthy runs define the noise: share of a joint's rows beyond which events are structure; multiple of
#: the healthy spread beyond which the runs' own spread is used.
_MOST_OF_SESSION, _WIDER = 0.4, 2.0
#: A row is loud above this share of its stretch's largest size. An event lasts while its torque is above this
#: share of its largest torque; the filter's ringing is smaller.
_LOUD, _LASTS = 0.1, 0.25
#: Share of a joint's largest speed below which a residual may be the reversal's form; reach of the filters
#: from there, in periods of the common cut-off.
_SLOW, _REACH = 0.05, 1.0
#: Numbers of rows over which residuals are averaged; single rows are used too.
_WIDTHS = (2, 4)
#: An event belongs to the machine where it occurs in more than half of the passes of a place, and in at least
#: this many.
_COMES_BACK = 3
#: Smallest event as a share of the largest torque that the model gives within the filters' reach.
_SMALL = 0.03
#: Fewest runs of the same motion whose median a push in a single run does not change.
_ALIKE = 3
#: Iterations of a robust fit.
FITS = 5
#: Speeds over which friction falls, over the largest speed; number of positions between which a torque is
#: linear.
_FALLS, _PLACES = (0.05, 0.3), 8
#: Where a time shows no event, fewer than this many are expected in such a time, with 95 % confidence (Hanley
#: and Lippman-Hand 1983).
_RULE_OF_THREE = 3.0


def find_events(
    runs: Sequence[PreparedRun],
    left: Sequence[np.ndarray],
    joints: Sequence[str],
    moving: np.ndarray,
    top_speed: np.ndarray,
    change: Sequence[np.ndarray] | None = None,
    healthy: np.ndarray | None = None,
) -> list[Event]:
    """Events of all runs as ``verdict.json`` has them, in the order of joints and runs.

    A residual smaller than a nearby step of a named effect is no event: it may be that step at another time,
    as where a lost motion is crossed a little later.

    Parameters
    ----------
    runs : sequence of PreparedRun
    left : sequence of ndarray (M, n)
        Residual torque of each run.
    joints : sequence of str
    moving : ndarray (n,) of bool
    top_speed : ndarray (n,)
    change : sequence of ndarray (M, n), optional
        Torque that the named effects add to the declared model.
    healthy : ndarray (n, k), optional
        Result of `measure_tails` for runs without events. Without it, many pushes hide each other, since they
        make the tail of the runs themselves.

    Returns
    -------
    list of dict
        `run`, `joint`, `t`: start on the recording's own clock [s], `seconds`: duration, `size`: largest
        residual torque with its sign, and `seen`: start and end of its rows above the noise [s].
    """
    events: list[Event] = []
    for j in np.flatnonzero(moving).tolist():
        kept = [run.keep[:, j] for run in runs]
        near = [_is_near_reversal(run, j, top_speed[j]) for run in runs]
        classes = [[k & ~n, k & n] for k, n in zip(kept, near, strict=True)]
        own = [x[:, j] for x in left]
        usual = None if healthy is None else healthy[j]
        sizes = _measure_sizes(own, kept, classes, usual)[0]
        parts = [_find_stretches(run, size, j, top_speed[j]) for run, size in zip(runs, sizes, strict=True)]
        if change is not None:
            parts = [
                [p for p in some if np.abs(x[p]).max() > _find_step(run.t, added[:, j], p)]
                for run, x, added, some in zip(runs, own, change, parts, strict=True)
            ]
        parts = [
            [p for p in some if not _may_be_form(run, x, p, j)]
            for run, x, some in zip(runs, own, parts, strict=True)
        ]
        found, outside = _stand_out(sizes, parts, classes, np.full(2, np.inf) if usual is None else usual[:2])
        rows_in_all = sum(int(k.sum()) for k in kept)
        if outside < (1.0 - (_MOST if usual is None else _MOST_OF_SESSION)) * rows_in_all:
            continue
        for run, x, some in zip(runs, own, _leave_places(runs, sizes, found, j), strict=True):
            for p in some:
                where = {"run": run.file, "joint": joints[j]}
                events.append(where | _describe(run.start + run.t[p], x[p] * run.keep[p, j]))
    return events


def _may_be_form(run: PreparedRun, left: np.ndarray, part: slice, joint: int) -> bool:
    """Whether a stretch of a residual (M,) may be the model's form, or the filters' at an end of the run."""
    reach, first, last = _REACH / run.band.torque, run.t[part.start], run.t[part.stop - 1]
    near = (run.t >= first - reach) & (run.t <= last + reach)
    largest = float(np.abs(run.measured[near, joint] - left[near]).max())
    peak = run.t[part][np.argmax(np.abs(left[part]))]
    at_end = min(peak - run.t[0], run.t[-1] - peak) < reach
    return bool(at_end or np.abs(left[part]).max() < _SMALL * largest)


def _describe(t: np.ndarray, missed: np.ndarray) -> Event:
    """Start, duration and size of an event, from its times [s] and its residual torque (M,)."""
    peak = int(np.argmax(np.abs(missed)))
    small = missed / missed[peak] < _LASTS
    first = float(t[np.max(np.flatnonzero(small[:peak]), initial=0)])
    last = float(t[peak + np.argmax(np.append(small[peak:-1], True))])
    seen = [float(t[0]), float(t[-1])]
    return {"t": first, "seconds": last - first, "size": float(missed[peak]), "seen": seen}


def _is_near_reversal(run: PreparedRun, joint: int, top: float) -> np.ndarray:
    """Mask (M,) of rows so near to a reversal or a rest that friction's form may affect them."""
    slow = np.abs(run.signals.v[:, joint]) < _SLOW * top
    reach = int(_REACH / run.band.torque * run.band.rate)
    felt = ndimage.maximum_filter1d(slow, 2 * reach + 1)
    return np.asarray(felt[rows(run.band, len(slow))])


def measure_tails(
    runs: Sequence[PreparedRun], left: Sequence[np.ndarray], moving: np.ndarray, top_speed: np.ndarray
) -> np.ndarray:
    """Noise and tail of each joint (n, k) in runs without events, for `find_events`.

    Columns: largest expected size over the spread, in rows away from reversals and near them; then the
    spreads as `_measure_sizes` returns them. Values are infinite where the joint rests.
    """
    found = np.full((len(moving), 4 + len(_WIDTHS)), np.inf)
    for j in np.flatnonzero(moving).tolist():
        kept = [run.keep[:, j] for run in runs]
        near = [_is_near_reversal(run, j, top_speed[j]) for run in runs]
        classes = [[k & ~n, k & n] for k, n in zip(kept, near, strict=True)]
        sizes, found[j, 2:] = _measure_sizes([x[:, j] for x in left], kept, classes)
        for c in range(2):
            found[j, c] = _find_limit(sizes, [own[c] for own in classes])
    return found


def _measure_sizes(
    left: Sequence[np.ndarray],
    kept: Sequence[np.ndarray],
    classes: Sequence[Sequence[np.ndarray]],
    healthy: np.ndarray | None = None,
) -> tuple[list[np.ndarray], np.ndarray]:
    """Size (M,) of each run's residual over its robust spread, and the spreads.

    A row's spread is that of rows of its class (near a reversal or not). A torque that lasts for several rows
    stands out more in their mean than in single rows, so the largest size over all widths of averaging is
    taken. The spreads are ordered by class, then by width. They are those of healthy runs, unless the runs'
    own spreads are far wider.
    """
    spreads: list[float] = []

    def spread_of(parts: Sequence[np.ndarray]) -> float:
        own = _find_spread(np.concatenate(parts))
        if healthy is not None and own < _WIDER * (usual := float(healthy[2 + len(spreads)])):
            own = min(own, usual)
        spreads.append(own)
        return own

    relative = [np.zeros(len(x)) for x in left]
    for c in range(2):
        spread = spread_of([x[own[c]] for x, own in zip(left, classes, strict=True)])
        for z, x, own in zip(relative, left, classes, strict=True):
            z[own[c]] = x[own[c]] / spread
    best = [np.abs(z) for z in relative]
    for width in _WIDTHS:
        box = np.ones(width)
        means = [
            np.where(k, np.convolve(z, box, "same")[: len(z)], 0.0)
            for z, k in zip(relative, kept, strict=True)
        ]
        spread = spread_of([x[k] for x, k in zip(means, kept, strict=True)])
        best = [np.maximum(size, np.abs(x) / spread) for size, x in zip(best, means, strict=True)]
    return best, np.array(spreads)


def _find_spread(x: np.ndarray) -> float:
    """Robust standard deviation; infinite where it would be zero."""
    spread = 1.4826 * float(np.median(np.abs(x))) if len(x) else 0.0
    return spread if spread > 0.0 else np.inf


def _stand_out(
    sizes: Sequence[np.ndarray],
    parts: Sequence[Sequence[slice]],
    classes: Sequence[Sequence[np.ndarray]],
    limits: np.ndarray,
) -> tuple[list[list[slice]], int]:
    """Stretches that stand out of the tail of their class's rows, and the number of rows outside of them.

    `limits` (2,) are upper bounds of the size that each class may reach by chance.
    """
    limits = limits.copy()
    calm = [[c.copy() for c in own] for own in classes]
    found: list[list[slice]] = []
    for _ in range(FITS):
        # Events distort the tail that they are judged by, so the next pass leaves them out.
        for c in range(2):
            limits[c] = min(limits[c], _find_limit(sizes, [own[c] for own in calm]))
        over = [
            (own[0] & (size > limits[0])) | (own[1] & (size > limits[1]))
            for size, own in zip(sizes, classes, strict=True)
        ]
        found = [[p for p in some if o[p].any()] for some, o in zip(parts, over, strict=True)]
        calm = [[c.copy() for c in own] for own in classes]
        for own, some in zip(calm, found, strict=True):
            for p in some:
                own[0][p] = own[1][p] = False
    loud = [int(_is_loud(size[p]).sum()) for size, some in zip(sizes, found, strict=True) for p in some]
    return found, sum(int(c.sum()) for own in classes for c in own) - sum(loud)


def _find_step(t: np.ndarray, added: np.ndarray, part: slice) -> float:
    """Peak-to-peak size of a torque around a stretch, less a straight line; it is large at a step."""
    near = (t >= t[part.start] - _GAP) & (t <= t[part.stop - 1] + _GAP)
    return float(np.ptp(signal.detrend(added[near])))


def _find_limit(sizes: Sequence[np.ndarray], counts: Sequence[np.ndarray]) -> float:
    """Size that no row is expected to reach by chance, from the tails of all rows and of periods.

    A residual at a reversal fills only a few rows. How it differs from one reversal to the next does not show
    in the tail of all rows, but in the tail of each period's largest size.
    """
    every, periods = [np.zeros(0)], [np.zeros(0)]
    for size, own in zip(sizes, counts, strict=True):
        at = np.flatnonzero(own)
        every.append(size[at])
        first = np.flatnonzero(np.diff(at // _PERIOD, prepend=-1))
        periods.append(np.maximum.reduceat(size[at], first) if len(at) else size[at])
    return max(_extrapolate(np.concatenate(every)), _extrapolate(np.concatenate(periods)))


def _extrapolate(size: np.ndarray) -> float:
    """Size that none of these sizes is expected to reach by chance: an exponential fits their upper tail."""
    if not len(size):
        return np.inf
    upper, top = np.quantile(size, [1.0 - _UPPER, 1.0 - _TOP])
    mean = (top - upper) / np.log(_UPPER / _TOP)
    return float(top + mean * np.log(max(_TOP * len(size), 1.0) / _CHANCE))


def _find_stretches(run: PreparedRun, size: np.ndarray, joint: int, top: float) -> list[slice]:
    """Stretches of rows above `_END` in motion, short gaps bridged, no longer than an event.

    A longer stretch may be several events that a filter's ringing joins. It is cut half way between the parts
    near its largest size, if none of these is longer than an event. A stretch shorter than half a period of
    the common filter is left out, since the filter makes even the shortest push that long.
    """
    fewest = int(0.5 * run.band.rate / run.band.torque / run.band.stride)
    speed = np.abs(run.signals.v[rows(run.band, len(run.signals.t)), joint])

    def split(at: np.ndarray) -> list[np.ndarray]:
        parts = np.split(at, np.flatnonzero(np.diff(run.t[at]) > _GAP) + 1)
        return [part for part in parts if len(part)]

    def is_short(part: np.ndarray) -> bool:
        return bool(run.t[part[-1]] - run.t[part[0]] <= _LONGEST)

    found = []
    for part in split(np.flatnonzero(size > _END)):
        loud = [part] if is_short(part) else split(part[_is_loud(size[part])])
        cuts = [(one[-1] + other[0] + 1) // 2 for one, other in pairwise(loud)]
        ends = pairwise([part[0], *cuts, part[-1] + 1])
        found += [slice(int(one), int(other)) for one, other in ends] if all(map(is_short, loud)) else []
    return [
        part
        for part in found
        if np.mean(speed[part] > _SLOW * top) > 0.5 and np.sum(size[part] > _END) >= fewest
    ]


def _is_loud(size: np.ndarray) -> np.ndarray:
    """Rows (M,) of a stretch that are near its largest size."""
    return size > _LOUD * size.max()


def _leave_places(
    runs: Sequence[PreparedRun], sizes: Sequence[np.ndarray], found: Sequence[Sequence[slice]], joint: int
) -> list[list[slice]]:
    """Stretches, except those at positions where most passes of the joint show one, as at a damaged tooth.

    The latter belong to the machine. They need at least `_COMES_BACK` passes with an event.
    """
    positions = [run.signals.q[rows(run.band, len(run.signals.t)), joint] for run in runs]
    inside = [np.zeros(len(run.t), dtype=bool) for run in runs]
    for marked, own in zip(inside, found, strict=True):
        for part in own:
            marked[part] = True

    def comes_back(place: float) -> bool:
        passes = [np.flatnonzero(np.diff(q >= place)) for q in positions]
        hit = sum(int((marked[at] | marked[at + 1]).sum()) for at, marked in zip(passes, inside, strict=True))
        return hit >= _COMES_BACK and 2 * hit > sum(map(len, passes))

    each = zip(positions, sizes, found, strict=True)
    return [
        [part for part in own if not comes_back(float(q[part][np.argmax(size[part])]))]
        for q, size, own in each
    ]


def mark_events(run: PreparedRun, t: np.ndarray, events: Sequence[Event], joint: str) -> np.ndarray:
    """Mask of times `t` (M,) of a run that lie in an event, or within the common filter's reach of one."""
    reach, t = _REACH / run.band.torque, t + run.start
    marked = np.zeros(len(t), dtype=bool)
    for e in events:
        if e["joint"] == joint and e["run"] == run.file:
            marked |= (t > e["seen"][0] - reach) & (t < e["seen"][1] + reach)
    return marked


def leave_out(
    runs: Sequence[PreparedRun], events: Sequence[Event], joints: Sequence[str]
) -> list[PreparedRun]:
    """Copies of the runs in which rows of events do not count."""
    made = []
    for run in runs:
        marked = np.column_stack([mark_events(run, run.t, events, joint) for joint in joints])
        made.append(replace(run, keep=run.keep & ~marked) if marked.any() else run)
    return made


def take_out_state(runs: Sequence[PreparedRun], left: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Residual (M, n) of each run, less the part that depends on each joint's own state alike in all runs.

    A change of the machine depends on its state (friction, a load, a gain, a spring); a push does not.
    """
    out = [x.copy() for x in left]
    for j in range(left[0].shape[1] if left else 0):
        columns = []
        q = np.concatenate([run.signals.q[:, j] for run in runs])
        ends = np.linspace(q.min(), q.max() + 1e-9, _PLACES)
        knots = np.concatenate([ends[:1], ends, ends[-1:]])
        for run in runs:
            s = run.signals
            v, sign, load = s.v[:, j], s.sign[:, j], s.load[:, j]
            top = max(float(np.abs(v).max()), 1e-300)
            falls = [sign * np.exp(-np.abs(v) / (share * top)) for share in _FALLS]
            place = interpolate.BSpline.design_matrix(s.q[:, j], knots, 1).toarray()
            x = np.column_stack([sign, v, *falls, s.a[:, j], load, sign * np.abs(load), place])
            columns.append(run.reduce_columns(x, j))
        counts = np.concatenate([run.keep[:, j] for run in runs])
        x, y = np.concatenate(columns), np.concatenate([one[:, j] for one in left])
        x = x / np.maximum(np.abs(x).max(axis=0), 1e-300)
        if counts.sum() <= 2 * x.shape[1]:
            continue
        weight = counts.astype(float)
        theta = np.zeros(x.shape[1])
        for _ in range(FITS):
            theta = np.linalg.lstsq(x * weight[:, None], y * weight, rcond=1e-8)[0]
            miss = np.abs(y - x @ theta)
            scale = max(1.4826 * float(np.median(miss[counts])), 1e-300)
            # A push has no more weight than a row of noise (Huber 1964).
            weight = counts * np.sqrt(np.minimum(1.0, 2.0 * scale / np.maximum(miss, 1e-300)))
        begins = np.cumsum([len(one) for one in left])[:-1]
        for one, rest in zip(out, np.split(y - x @ theta, begins), strict=True):
            one[:, j] = rest
    return out


def take_out_common(
    runs: Sequence[PreparedRun], left: Sequence[np.ndarray], repeats: Sequence[tuple[int, int]]
) -> list[np.ndarray]:
    """Residual (M, n) of each run, less its median over the runs of the same motion, if three or more.

    Parameters
    ----------
    runs : sequence of PreparedRun
    left : sequence of ndarray (M, n)
    repeats : sequence of (int, int)
        Pairs of runs of the same motion.
    """
    counted = [np.where(run.keep, x, np.nan) for run, x in zip(runs, left, strict=True)]
    out = [x.copy() for x in left]
    for i, own in enumerate(out):
        alike = [i, *(a + b - i for a, b in repeats if i in (a, b))]
        short = min(len(left[k]) for k in alike)
        each = np.array([counted[k][:short] for k in alike])
        common = np.ma.median(np.ma.masked_invalid(each), axis=0).filled(0.0)
        enough = np.isfinite(each).sum(axis=0) >= _ALIKE
        own[:short] -= np.where(enough, common, 0.0)
    return out


def suggest_thresholds(
    runs: Sequence[PreparedRun], left: Sequence[np.ndarray], events: Sequence[Event], joints: Sequence[str]
) -> dict[str, dict[str, float]]:
    """By joint, the threshold of a collision detector on this model, and its rate of false alarms.

    The threshold is the largest residual torque of the test runs outside of events. No row exceeds it: its
    false alarms are fewer than three in the time that was tested.
    """
    found = {}
    for j, joint in enumerate(joints):
        most, seconds = 0.0, 0.0
        for run, x in zip(runs, left, strict=True):
            if run.use == "test":
                counts = run.keep[:, j] & ~mark_events(run, run.t, events, joint)
                most = max(most, float(np.max(np.abs(x[counts, j]), initial=0.0)))
                seconds += float(counts.sum()) * run.band.stride / run.band.rate
        if seconds > 0.0:
            found[joint] = {
                "threshold": most,
                "false_alarms_per_hour_at_most": _RULE_OF_THREE * 3600.0 / seconds,
            }
    return found
