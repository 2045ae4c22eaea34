"""Effects of a user's own, as the files that tests write: one compiled, one of a measured channel."""

HOSE = """
import numpy as np
from wearscope.effects.base import Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = np.sin(shape[0] * q[j]) * sign[j]


EFFECT = Effect(
    name="hose_drag",
    form="level sin(k q) sign(v)",
    coefficients=(Parameter("level", "{torque}"),),
    source="a test",
    depends_on=("q_{joint}", "sign_qd_{joint}"),
    row=_row,
    shape=(Parameter("k", "1/{position}", default=2.0),),
)
"""
PRESSURE = """
from wearscope.effects.base import Effect, Parameter

EFFECT = Effect(
    name="balancer_pressure",
    form="area p q",
    coefficients=(Parameter("area", "{torque}/(bar {position})"),),
    source="a test",
    depends_on=("pressure", "q_{joint}"),
    regressors=lambda s, j, shape: s.channels["pressure"][:, None] * s.q[:, [j]],
    applies=lambda s, j: "pressure" in s.channels,
)
"""
