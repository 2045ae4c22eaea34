"""Torque at a joint from the motion of another joint, as in the coupled gears of a wrist."""

import numpy as np

from wearscope.effects.base import ALONE, Effect, Parameter, Signals, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    other = int(shape[0])
    out[0] = v[other]
    out[1] = sign[other]
    out[2] = a[other]


def _search(signals: Signals, joint: int) -> np.ndarray:
    others = [i for i in range(signals.q.shape[1]) if i != joint]
    return np.array(others, dtype=float)[:, None].reshape(len(others), 1)


EFFECT = Effect(
    name="cross_coupling",
    form="viscous v_other + coulomb sign(v_other) + inertia a_other",
    coefficients=(
        Parameter("viscous", "{torque} s/rad"),
        Parameter("coulomb", "{torque}"),
        Parameter("inertia", "{torque} s^2/rad"),
    ),
    source="Staubli TX family wrist coupling: Gautier et al. 2013, IEEE ICRA",
    depends_on=("qd_{other}", "sign_qd_{other}", "qdd_{other}"),
    row=_row,
    shape=(Parameter("other", "index of the driving joint", lower=0.0, estimated=False),),
    variants=(("viscous",), ("coulomb",), ("inertia",), ("viscous", "coulomb")),
    search=_search,
    excitation=ALONE,
)
