"""Friction that changes with the time since start, as a joint warms up whose temperature is not recorded."""

import numpy as np

from wearscope.effects.base import TIME, Effect, Parameter, Signals, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    cold = np.exp(-t / shape[0])
    out[0] = cold * sign[j]
    out[1] = cold * v[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    return signals.t.max() * np.array([[0.1], [0.3], [1.0], [3.0]])


EFFECT = Effect(
    name="warm_up_drift",
    form="(coulomb_drift sign(v) + viscous_drift v) exp(-t/time_constant)",
    coefficients=(
        Parameter("coulomb_drift", "{torque}"),
        Parameter("viscous_drift", "{torque} s/{position}"),
    ),
    source="Daemi and Heimann 1998: friction of a robot while it warms up",
    depends_on=("t", "qd_{joint}", "sign_qd_{joint}"),
    row=_row,
    shape=(Parameter("time_constant", "s", lower=1e-3, default=100.0),),
    variants=(("coulomb_drift",), ("viscous_drift",), ("coulomb_drift", "viscous_drift")),
    search=_search,
    parents=("coulomb", "viscous"),
    excitation=TIME,
)
