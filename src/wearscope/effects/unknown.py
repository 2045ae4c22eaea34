"""Empirical torque for structure that no effect of the vocabulary explains, with the signal it depends on.

The torque is a linear spline (a sum of hat functions) of one signal, or a product of two such splines for two
signals. It is multiplied by 1, the direction of motion or the speed. The knots span the range of values in
the recording. Outside that range the spline falls to zero within `TAPER` knots, as the recording tells
nothing there. The knots of each level in `LEVELS` are among those of the next level, so that the columns of a
coarse spline are sums of those of a fine one.
"""

from collections.abc import Sequence

import numpy as np
from numba import njit

from wearscope.effects.base import Effect, Parameter, Signals, compile_row

#: Numbers of hat functions that are tried.
LEVELS = (5, 9, 17, 33)
#: Finest level for most signals; for the joint's own position and speed, and for time, all levels are tried.
COARSE = 9
#: Number of hat functions of each signal where there are two, and number of their products.
SIDE, PRODUCT = 5, 25
#: Distance outside the recorded range, in knots, over which the spline falls to zero.
TAPER = 2.0
#: Signals by code.
SIGNALS = ("q", "qd", "qdd", "load", "temp", "t")
#: Codes of temperature and time: any drift of a run looks like a dependence on them.
SLOW = (SIGNALS.index("temp"), SIGNALS.index("t"))
#: Pairs of signals, by code: both of the joint itself; one of the joint and one of another joint.
_OWN_PAIRS = ((0, 1), (0, 3), (1, 3), (0, 4), (1, 4), (3, 4), (0, 5), (1, 5), (3, 5))
_OTHER_PAIRS = ((0, 0), (1, 1), (1, 0), (3, 0))
#: Factor on the spline, by code: 1, the direction of motion, the speed.
MODULATORS = ("", "sign_qd", "qd")


@njit(cache=True)
def _take(signal, source, t, q, v, a, load, temperature):
    """Return the value of a signal, given by its code and its joint."""
    return t if signal == 5 else (q, v, a, load, temperature)[signal][source]


@njit(cache=True)
def _locate(x, low, high, knots):
    """Return the knot below x, the fraction of the way to the next knot, and the taper outside the range."""
    place = (x - low) / (high - low) * (knots - 1)
    beyond = max(-place, place - (knots - 1.0), 0.0)
    place = min(max(place, 0.0), knots - 1.0)
    below = min(int(place), knots - 2)
    return below, place - below, max(0.0, 1.0 - beyond / TAPER)


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    modulator, second, knots = int(shape[2]), int(shape[5]), int(shape[9])
    factor = 1.0
    if modulator == 1:
        factor = sign[j]
    elif modulator == 2:
        factor = v[j]
    out[:] = 0.0
    x = _take(int(shape[0]), int(shape[1]), t, q, v, a, load, temperature)
    if second < 0:
        below, part, left = _locate(x, shape[3], shape[4], knots)
        out[below] = factor * left * (1.0 - part)
        out[below + 1] = factor * left * part
    else:
        below, part, left = _locate(x, shape[3], shape[4], SIDE)
        y = _take(second, int(shape[6]), t, q, v, a, load, temperature)
        other, share, rest = _locate(y, shape[7], shape[8], SIDE)
        for i in range(2):
            for k in range(2):
                weight = (part if i else 1.0 - part) * (share if k else 1.0 - share)
                out[(below + i) * SIDE + other + k] = factor * left * rest * weight


def _search(signals: Signals, joint: int) -> np.ndarray:
    n = signals.q.shape[1]
    kinds = [signals.q, signals.v, signals.a, signals.load, signals.temperature]
    seen: dict[tuple[int, int], tuple[float, float]] = {}
    for source in range(n):
        for code, x in enumerate(kinds):
            if (code < 4 or source == joint) and np.isfinite(x[:, source]).all():
                seen[code, source] = _reach(x[:, source])
    seen[5, joint] = _reach(signals.t)
    seen = {key: (low, high) for key, (low, high) in seen.items() if high - low > 1e-9 * (1.0 + abs(high))}
    found = []
    for (code, source), reach in seen.items():
        own = source == joint
        for modulator in range(3) if own and code < 5 else range(2):
            fine = (own and code < 2 and modulator < 2) or code == 5
            found.append((code, source, modulator, *reach, -1, 0, 0.0, 1.0, LEVELS[-1] if fine else COARSE))
    pairs = [((a, joint), (b, joint)) for a, b in _OWN_PAIRS]
    for other in (i for i in range(n) if i != joint):
        pairs += [((a, joint), (b, other)) for a, b in _OTHER_PAIRS]
    for one, two in pairs:
        if one in seen and two in seen:
            for modulator in range(2):
                found.append((*one, modulator, *seen[one], *two, *seen[two], PRODUCT))
    return np.array(found, dtype=float).reshape(-1, 10)


def _reach(x: np.ndarray) -> tuple[float, float]:
    """Return the range of a signal (N,) without its outermost values."""
    low, high = np.quantile(x, [0.002, 0.998])
    return float(low), float(high)


def coarsen(knots: int, fewer: int) -> np.ndarray:
    """Return the matrix (knots, fewer) that expresses coarse hat functions by fine ones."""
    place = np.linspace(0.0, fewer - 1.0, knots)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(fewer)))


def list_signals(shape: Sequence[float]) -> list[tuple[int, int]]:
    """Return code and joint of the one or two signals that the spline depends on."""
    first, second = (int(shape[0]), int(shape[1])), (int(shape[5]), int(shape[6]))
    return [first] if second[0] < 0 else [first, second]


class _Unknown(Effect):
    """A spline, whose shape parameters select its signals; without such signals, a spline of anything."""

    empirical = True

    def name_signals(self, shape: Sequence[float], joints: Sequence[str], joint: int) -> list[str]:
        """Return the signals that a term of the given shape at a joint depends on."""
        if not self.selects_signals:
            return super().name_signals(shape, joints, joint)
        modulator = MODULATORS[int(shape[2])]
        names = [
            "t" if SIGNALS[code] == "t" else f"{SIGNALS[code]}_{joints[source]}"
            for code, source in list_signals(shape)
        ]
        if modulator:
            names.append(f"{modulator}_{joints[joint]}")
        return list(dict.fromkeys(names))


EFFECT = _Unknown(
    name="unknown",
    form="modulator times a linear spline of one signal, or the product of two",
    coefficients=tuple(Parameter(f"height{k}", "{torque}") for k in range(LEVELS[-1])),
    source="de Boor 1978, A Practical Guide to Splines (linear B-splines)",
    depends_on=("{signal}",),
    shape=(
        Parameter("signal", "code: q, qd, qdd, load, temp, t", lower=0, upper=5, estimated=False),
        Parameter("source", "index of the joint whose signal it is", lower=0, estimated=False),
        Parameter("modulator", "code: 1, sign_qd, qd", lower=0, upper=2, estimated=False),
        Parameter("low", "unit of the signal", estimated=False),
        Parameter("high", "unit of the signal", default=1.0, estimated=False),
        Parameter("signal2", "code, -1 for none", lower=-1, upper=5, default=-1.0, estimated=False),
        Parameter("source2", "index of the joint whose signal it is", lower=0, estimated=False),
        Parameter("low2", "unit of the signal", estimated=False),
        Parameter("high2", "unit of the signal", default=1.0, estimated=False),
        Parameter("knots", "number of heights", 2, LEVELS[-1], default=COARSE, estimated=False),
    ),
    row=_row,
    search=_search,
    candidate=False,
)
