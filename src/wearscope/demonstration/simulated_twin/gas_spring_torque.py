"""Gas spring of the twin, between two pins and with polytropic gas; see `wearscope.demonstration.twin`."""

import numpy as np

from wearscope.effects.base import Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    span, arm = shape[0], shape[1]
    angle = q[j] + shape[2]
    length = np.sqrt(span**2 + arm**2 + 2.0 * span * arm * np.cos(angle))
    stroke = (span + arm - length) / (2.0 * arm)
    out[0] = -((1.0 / (1.0 - shape[3] * stroke)) ** shape[4]) * span * arm * np.sin(angle) / length


EFFECT = Effect(
    name="gas_spring_torque",
    form="-force (1 - filling stroke(q))^-exponent span arm sin(q + mount) / length(q)",
    coefficients=(Parameter("force", "N"),),
    source="wearscope.demonstration.twin",
    depends_on=("q_{joint}",),
    row=_row,
    shape=(
        Parameter("span", "m", default=0.62),
        Parameter("arm", "m", default=0.17),
        Parameter("mount", "rad", default=1.2),
        Parameter("filling", "-", default=0.8),
        Parameter("exponent", "-", default=1.2),
    ),
    candidate=False,
)
