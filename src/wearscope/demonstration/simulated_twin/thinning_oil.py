"""Viscous friction of the twin, which decreases exponentially with temperature."""

import numpy as np

from wearscope.effects.base import Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = (shape[0] + (1.0 - shape[0]) * np.exp(-(temperature[j] - shape[1]) / shape[2])) * v[j]


EFFECT = Effect(
    name="thinning_oil",
    form="slope (floor + (1 - floor) exp(-(T - reference)/scale)) v",
    coefficients=(Parameter("slope", "{torque} s/{position}"),),
    source="wearscope.demonstration.twin",
    depends_on=("qd_{joint}", "temp_{joint}"),
    row=_row,
    shape=(
        Parameter("floor", "-", default=0.7),
        Parameter("reference", "deg C", default=40.0),
        Parameter("scale", "K", lower=1e-3, default=30.0),
    ),
    candidate=False,
)
