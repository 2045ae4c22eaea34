"""Constant offset of the torque sensor or the drive."""

from wearscope.effects.base import REVERSALS, Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = 1.0


EFFECT = Effect(
    name="torque_offset",
    form="offset",
    coefficients=(Parameter("offset", "{torque}"),),
    source="Janot et al. 2019, EMPS benchmark",
    depends_on=("constant",),
    row=_row,
    excitation=REVERSALS,
)
