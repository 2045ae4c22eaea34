"""Friction that changes with the recorded temperature, as the lubricant's viscosity does.

Viscosity falls exponentially, by 2 to 6 % per kelvin in usual oils. Over a few kelvins, or with a rate of 0,
the change is linear. A slope is that at the reference temperature.
"""

from collections.abc import Mapping

import numpy as np

from wearscope.effects.base import TEMPERATURE, Effect, Parameter, Signals, compile_row, saturate

#: Least span of the recorded temperature [K] that can show a dependence; a sensor shows smaller spans even at
#: constant temperature.
LEAST_SPAN = 0.5
#: Shares by which friction falls per kelvin that are tried [1/K].
_RATES = (0.002, 0.01, 0.03, 0.08)


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    warmer = saturate(temperature[j] - shape[0], shape[1])
    out[0] = warmer * sign[j]
    out[1] = warmer * v[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    mean = np.mean(signals.temperature[:, joint])
    return np.array([(mean, rate) for rate in _RATES])


def varies(signals: Signals, joint: int) -> bool:
    """Return whether a joint's temperature is recorded, and spans more than a sensor shows anyway."""
    temperature = signals.temperature[:, joint]
    return bool(np.isfinite(temperature).all() and np.ptp(temperature) > LEAST_SPAN)


def _be_passive(values: Mapping[str, float], temperature: float) -> dict[str, float]:
    warmer = saturate(temperature - values["reference"], values["rate"])
    return {"friction": values["coulomb_slope"] * warmer, "damping": values["viscous_slope"] * warmer}


EFFECT = Effect(
    name="temperature_dependent_friction",
    form="(coulomb_slope sign(v) + viscous_slope v) (1 - exp(-rate (T - reference))) / rate",
    coefficients=(
        Parameter("coulomb_slope", "{torque}/K"),
        Parameter("viscous_slope", "{torque} s/({position} K)"),
    ),
    source="Bittencourt and Gunnarsson 2012, ASME JDSMC 134(5); exponential viscosity: Reynolds 1886",
    depends_on=("temp_{joint}", "qd_{joint}", "sign_qd_{joint}"),
    row=_row,
    shape=(
        Parameter("reference", "deg C", default=40.0, estimated=False),
        Parameter("rate", "1/K", lower=0.0, upper=0.2),
    ),
    variants=(("coulomb_slope",), ("viscous_slope",), ("coulomb_slope", "viscous_slope")),
    search=_search,
    parents=("coulomb", "viscous"),
    applies=varies,
    excitation=TEMPERATURE,
    passive=_be_passive,
)
