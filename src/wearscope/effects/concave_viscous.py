"""Viscous friction that levels off at high speed."""

import numpy as np

from wearscope.effects.base import Effect, Parameter, Signals, compile_row
from wearscope.effects.motions import SLOW_MOTION


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = abs(v[j]) ** shape[0] * sign[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    return np.array([[0.35], [0.5], [0.7]])


EFFECT = Effect(
    name="concave_viscous",
    form="level abs(v)^exponent sign(v)",
    coefficients=(Parameter("level", "{torque} s^b/{position}^b"),),
    source="Grotjahn and Heimann 2001: power-law viscous friction",
    depends_on=("qd_{joint}",),
    row=_row,
    shape=(Parameter("exponent", "-", lower=0.05, upper=0.95, default=0.5, estimated=False),),
    search=_search,
    searched=1,
    parents=("viscous", "coulomb"),
    excitation=SLOW_MOTION,
)
