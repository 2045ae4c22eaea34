"""Torque periodic in position: gear mesh, cogging, ball-screw pitch."""

import numpy as np

from wearscope.effects.base import Effect, Parameter, Signals, compile_row
from wearscope.effects.motions import SESSIONS


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = np.cos(shape[0] * q[j])
    out[1] = np.sin(shape[0] * q[j])


def _search(signals: Signals, joint: int) -> np.ndarray:
    # From three periods over the visited range, in steps that the range resolves, to where even slow motion
    # turns the ripple into frequencies that are not used.
    reach = max(np.ptp(signals.q[:, joint]), 1e-12)
    speed = np.abs(signals.v[:, joint])
    slow = max(np.quantile(speed[speed > 0.01 * speed.max()], 0.2), 1e-12)
    highest = 2 * np.pi * min(signals.bandwidth / slow, 0.4 / signals.dt / slow, 300 / reach)
    return np.arange(2 * np.pi * 3 / reach, max(highest, 2 * np.pi * 4 / reach), np.pi / reach)[:, None]


def _search_width(signals: Signals, joint: int, shape: np.ndarray) -> float:
    # A wave that gains half a period over the visited range is another one.
    travel = max(float(np.ptp(signals.q[:, joint])), 1e-12)
    return min(0.3, np.pi / travel / float(shape[0]))


EFFECT = Effect(
    name="torque_ripple",
    form="cosine cos(wavenumber q) + sine sin(wavenumber q)",
    coefficients=(
        Parameter("cosine", "{torque}"),
        Parameter("sine", "{torque}"),
    ),
    source="Holtz and Springob 1996, IEEE T. Industrial Electronics 43(2)",
    depends_on=("q_{joint}",),
    row=_row,
    shape=(Parameter("wavenumber", "1/{position}", lower=0.0, default=1.0),),
    search=_search,
    repeatable=True,
    search_width=_search_width,
    periodic=True,
    excitation=SESSIONS,
)
