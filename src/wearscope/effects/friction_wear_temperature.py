"""Friction over speed, temperature and wear: the paper's eq. (17), odd in the speed."""

from collections.abc import Mapping

import numpy as np

from wearscope.effects.base import TEMPERATURE, FrictionLaw, Parameter, Signals, compile_row, decay


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    warmth, worn = temperature[j], wear[j]
    speed = abs(v[j])
    bump = decay(speed / (shape[0] + shape[1] * warmth), shape[3]) * sign[j]
    out[0] = sign[j]
    out[1] = bump
    out[2] = warmth * bump
    out[3] = v[j]
    out[4] = warmth * v[j]
    # Every wear term vanishes at f = 0, where eta8 f would divide by zero.
    out[5] = worn * decay(speed / (shape[2] * worn), shape[3]) * sign[j] if worn > 0.0 else 0.0
    out[6] = worn * v[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    fastest = max(float(np.abs(signals.v[:, joint]).max()), 1e-9)
    return np.array([(fastest * share, 0.0, 1e-3, 1.0) for share in (0.02, 0.05, 0.1, 0.2, 0.4)])


def _hold(values: Mapping[str, float], temperature: float) -> dict[str, float | tuple[float, ...]]:
    """Return the friction of a passive joint at a temperature, without wear and negative Stribeck terms."""
    held: dict[str, float | tuple[float, ...]] = {
        "friction": values["eta0"],
        "damping": values["eta5"] + values["eta6"] * temperature,
    }
    bump = values["eta1"] + values["eta2"] * temperature
    if bump > 0.0:
        held["falling"] = (bump, values["eta3"] + values["eta4"] * temperature, values["alpha"])
    return held


EFFECT = FrictionLaw(
    name="friction_wear_temperature",
    form="eta0 + (eta1 + eta2 T) exp(-abs(v/(eta3 + eta4 T))^alpha) + (eta5 + eta6 T) v"
    " + eta7 f exp(-abs(v/(eta8 f))^alpha) + eta9 f v",
    coefficients=(
        Parameter("eta0", "{torque}"),
        Parameter("eta1", "{torque}"),
        Parameter("eta2", "{torque}/K"),
        Parameter("eta5", "{torque} s/{position}"),
        Parameter("eta6", "{torque} s/({position} K)"),
        Parameter("eta7", "{torque}"),
        Parameter("eta9", "{torque} s/{position}"),
    ),
    source="Samuelsson et al. 2014, eq. (17); Bittencourt et al. 2011",
    depends_on=("qd_{joint}", "sign_qd_{joint}", "temp_{joint}", "wear_{joint}"),
    row=_row,
    passive=_hold,
    shape=(
        Parameter("eta3", "{position}/s", default=np.nan),
        Parameter("eta4", "{position}/(s K)", estimated=False),
        Parameter("eta8", "{position}/s", lower=1e-12, default=1e-3, estimated=False),
        Parameter("alpha", "-", lower=0.1, upper=4.0, default=1.0, estimated=False),
    ),
    search=_search,
    candidate=False,
    contains=("coulomb", "viscous", "stribeck", "temperature_dependent_friction", "wear"),
    parts=("wear", "friction_temperature"),
    excitation=TEMPERATURE,
)
