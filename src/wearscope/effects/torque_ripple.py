"""Torque periodic in position: gear mesh, cogging, ball-screw pitch."""

import numpy as np

from wearscope.effects.base import Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = np.cos(shape[0] * q[j])
    out[1] = np.sin(shape[0] * q[j])


EFFECT = Effect(
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
)
