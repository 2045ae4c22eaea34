"""Structure outside the vocabulary: an empirical torque on the signal that it depends on.

A linear spline of hat functions between the least and the largest value seen, held constant outside of it,
times 1, the direction of motion or the speed. The knots of each number in `LEVELS` are among those of the
next one, so that the columns of a fine spline give those of the coarse ones.
"""

from collections.abc import Sequence

import numpy as np

from wearscope.effects.base import Effect, Parameter, Signals, compile_row
from wearscope.effects.motions import OTHERS

#: Numbers of hat functions worth trying.
LEVELS = (5, 9, 17, 33)
#: Finest level tried for most signals; that of the joint's own position and speed is the last one.
COARSE = 9
#: Signals by code.
SIGNALS = ("q", "qd", "qdd", "load", "temp", "t")
#: What the spline is multiplied with, by code: nothing, the direction of motion, the speed.
MODULATORS = ("", "sign_qd", "qd")


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    signal, source, modulator = int(shape[0]), int(shape[1]), int(shape[2])
    if signal == 0:
        x = q[source]
    elif signal == 1:
        x = v[source]
    elif signal == 2:
        x = a[source]
    elif signal == 3:
        x = load[source]
    elif signal == 4:
        x = temperature[source]
    else:
        x = t
    factor = 1.0
    if modulator == 1:
        factor = sign[j]
    elif modulator == 2:
        factor = v[j]
    knots = int(shape[5])
    place = (x - shape[3]) / (shape[4] - shape[3]) * (knots - 1)
    place = min(max(place, 0.0), knots - 1.0)
    out[:] = 0.0
    below = min(int(place), knots - 2)
    out[below] = factor * (below + 1 - place)
    out[below + 1] = factor * (place - below)


def _search(signals: Signals, joint: int) -> np.ndarray:
    n = signals.q.shape[1]
    found = []

    def add(code: int, source: int, modulator: int, x: np.ndarray) -> None:
        low, high = np.quantile(x, [0.002, 0.998])
        if high - low > 1e-9 * (1.0 + abs(high)):
            local = source == joint and code < 2 and modulator < 2
            found.append((code, source, modulator, low, high, LEVELS[-1] if local else COARSE))

    for source in [joint, *(i for i in range(n) if i != joint)]:
        own = source == joint
        kinds = [signals.q, signals.v, signals.a, signals.load]
        for code, x in enumerate(kinds):
            for modulator in range(3) if own else range(2):
                add(code, source, modulator, x[:, source])
        if own and np.isfinite(signals.temperature[:, source]).all():
            for modulator in range(3):
                add(4, source, modulator, signals.temperature[:, source])
    for modulator in range(2):
        add(5, joint, modulator, signals.t)
    return np.array(found, dtype=float).reshape(-1, 6)


def coarsen(knots: int, fewer: int) -> np.ndarray:
    """Hat functions of a coarser level as sums of those of a finer one, (knots, fewer)."""
    place = np.linspace(0.0, fewer - 1.0, knots)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(fewer)))


def name_signals(shape: Sequence[float], joints: Sequence[str], joint: int) -> list[str]:
    """Signals that a term of the given shape at a joint depends on."""
    signal, source, modulator = SIGNALS[int(shape[0])], int(shape[1]), MODULATORS[int(shape[2])]
    names = ["t" if signal == "t" else f"{signal}_{joints[source]}"]
    if modulator:
        names.append(f"{modulator}_{joints[joint]}")
    return list(dict.fromkeys(names))


EFFECT = Effect(
    name="unknown",
    form="modulator times a linear spline of one signal",
    coefficients=tuple(Parameter(f"height{k}", "{torque}") for k in range(LEVELS[-1])),
    source="de Boor 1978, A Practical Guide to Splines (linear B-splines)",
    depends_on=("{signal}",),
    shape=(
        Parameter("signal", "code: q, qd, qdd, load, temp, t", lower=0, upper=5, estimated=False),
        Parameter("source", "index of the joint whose signal it is", lower=0, estimated=False),
        Parameter("modulator", "code: 1, sign_qd, qd", lower=0, upper=2, estimated=False),
        Parameter("low", "unit of the signal", estimated=False),
        Parameter("high", "unit of the signal", default=1.0, estimated=False),
        Parameter("knots", "number of heights", 2, LEVELS[-1], default=COARSE, estimated=False),
    ),
    row=_row,
    search=_search,
    candidate=False,
    empirical=True,
    repeatable=True,
    excitation=OTHERS,
    name_driver=name_signals,
)
