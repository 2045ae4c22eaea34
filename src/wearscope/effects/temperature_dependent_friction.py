"""Friction that changes linearly with the recorded temperature."""

import numpy as np

from wearscope.effects.base import TEMPERATURE, Effect, Parameter, Signals, compile_row

#: Least span of the recorded temperature [K] that can show a dependence; a sensor shows smaller spans even at
#: constant temperature.
LEAST_SPAN = 0.5


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    warmer = temperature[j] - shape[0]
    out[0] = warmer * sign[j]
    out[1] = warmer * v[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    return np.array([[np.mean(signals.temperature[:, joint])]])


def varies(signals: Signals, joint: int) -> bool:
    """Return whether a joint's temperature is recorded, and spans more than a sensor shows anyway."""
    temperature = signals.temperature[:, joint]
    return bool(np.isfinite(temperature).all() and np.ptp(temperature) > LEAST_SPAN)


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
    shape=(Parameter("reference", "deg C", default=40.0, estimated=False),),
    variants=(("coulomb_slope",), ("viscous_slope",), ("coulomb_slope", "viscous_slope")),
    search=_search,
    parents=("coulomb", "viscous"),
    applies=varies,
    excitation=TEMPERATURE,
    passive=lambda values, temperature: {
        "friction": values["coulomb_slope"] * (temperature - values["reference"]),
        "damping": values["viscous_slope"] * (temperature - values["reference"]),
    },
)
