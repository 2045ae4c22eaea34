"""Torque that is periodic in position, from gear mesh, cogging or the pitch of a ball screw."""

import numpy as np

from wearscope.effects.base import SESSIONS, Parameter, Signals, WaveEffect, compile_row

#: Fewest periods over the visited range. If the time is spread evenly over the range, a wave of this many
#: periods has a correlation of 0.1 with the straight line of a spring; a wave of one period has 0.8.
FEWEST_PERIODS = 1.5
#: Fewest periods in a turn. The rigid-body torque is a polynomial of second degree in sine and cosine of each
#: joint's angle, so that errors of its parameters look like waves with fewer periods.
LOWEST_ORDER = 3.0


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = np.cos(shape[0] * q[j])
    out[1] = np.sin(shape[0] * q[j])


def _search(signals: Signals, joint: int) -> np.ndarray:
    # The steps are those that the visited range resolves. The highest wavenumber is that at which even slow
    # motion gives the ripple a frequency that is filtered out.
    reach = max(np.ptp(signals.q[:, joint]), 1e-12)
    speed = np.abs(signals.v[:, joint])
    slow = max(np.quantile(speed[speed > 0.01 * speed.max()], 0.2), 1e-12)
    highest = 2 * np.pi * min(signals.bandwidth / slow, 0.4 / signals.dt / slow, 300 / reach)
    lowest = max(2 * np.pi * FEWEST_PERIODS / reach, LOWEST_ORDER)
    return np.arange(lowest, max(highest, lowest + 2 * np.pi / reach), np.pi / reach)[:, None]


EFFECT = WaveEffect(
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
    excitation=SESSIONS,
    passive=lambda values, temperature: {"wave": (values["cosine"], values["sine"], values["wavenumber"])},
)
