"""Friction that changes with the measured temperature."""

import numpy as np

from wearscope.effects.base import Effect, Parameter, Signals, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    warmer = temperature[j] - shape[0]
    out[0] = warmer * sign[j]
    out[1] = warmer * v[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    return np.array([[np.mean(signals.temperature[:, joint])]])


EFFECT = Effect(
    name="temperature_dependent_friction",
    form="(coulomb_slope sign(v) + viscous_slope v) (T - reference)",
    coefficients=(
        Parameter("coulomb_slope", "{torque}/K"),
        Parameter("viscous_slope", "{torque} s/({position} K)"),
    ),
    source="Bittencourt and Gunnarsson 2012, ASME JDSMC 134(5)",
    depends_on=("temp_{joint}", "qd_{joint}", "sign_qd_{joint}"),
    row=_row,
    shape=(Parameter("reference", "deg C", default=40.0),),
    variants=(("coulomb_slope",), ("viscous_slope",), ("coulomb_slope", "viscous_slope")),
    search=_search,
)
