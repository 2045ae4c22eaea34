"""Change of friction with temperature: the temperature terms of the paper's eq. (17)."""

import numpy as np

from wearscope.effects.base import TEMPERATURE, FrictionLaw, Parameter, compile_row, decay


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    warmth, reference = temperature[j], shape[3]
    speed = abs(v[j])
    warm = decay(speed / (shape[0] + shape[1] * warmth), shape[2]) * sign[j]
    cold = decay(speed / (shape[0] + shape[1] * reference), shape[2]) * sign[j]
    out[0] = warm - cold
    out[1] = warmth * warm - reference * cold
    out[2] = (warmth - reference) * v[j]


EFFECT = FrictionLaw(
    name="friction_temperature",
    form="s(T) - s(reference), s(T) = (eta1 + eta2 T) exp(-abs(v/(eta3 + eta4 T))^alpha) sign(v) + eta6 T v",
    coefficients=(
        Parameter("eta1", "{torque}"),
        Parameter("eta2", "{torque}/K"),
        Parameter("eta6", "{torque} s/({position} K)"),
    ),
    source="Samuelsson et al. 2014, eq. (17); Bittencourt et al. 2011",
    depends_on=("qd_{joint}", "sign_qd_{joint}", "temp_{joint}"),
    row=_row,
    shape=(
        Parameter("eta3", "{position}/s", default=np.nan, estimated=False),
        Parameter("eta4", "{position}/(s K)", estimated=False),
        Parameter("alpha", "-", lower=0.1, upper=4.0, default=1.0, estimated=False),
        Parameter("reference", "deg C", default=50.0, estimated=False),
    ),
    candidate=False,
    excitation=TEMPERATURE,
)
