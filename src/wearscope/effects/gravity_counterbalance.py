"""Spring or hydraulic balancer, whose torque is a smooth function of the joint position alone."""

import numpy as np

from wearscope.effects.base import RANGE, Parameter, WaveEffect, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = np.sin(q[j])
    out[1] = np.cos(q[j])
    out[2] = 1.0
    out[3] = np.sin(2.0 * q[j])
    out[4] = np.cos(2.0 * q[j])


EFFECT = WaveEffect(
    name="gravity_counterbalance",
    form="bias + sine1 sin(q) + cosine1 cos(q) + sine2 sin(2 q) + cosine2 cos(2 q)",
    coefficients=(
        Parameter("sine1", "{torque}"),
        Parameter("cosine1", "{torque}"),
        Parameter("bias", "{torque}"),
        Parameter("sine2", "{torque}"),
        Parameter("cosine2", "{torque}"),
    ),
    source="First harmonics of the balancer torque of Weigand et al. 2020 (KUKA KR300)",
    depends_on=("q_{joint}",),
    row=_row,
    variants=(
        ("sine1", "cosine1"),
        ("sine1", "cosine1", "bias"),
        ("sine1", "cosine1", "bias", "sine2", "cosine2"),
    ),
    contains=("torque_offset",),
    excitation=RANGE,
)
