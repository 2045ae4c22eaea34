"""Coulomb friction that differs between the two directions of motion."""

from wearscope.effects.base import REVERSALS, Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = abs(sign[j])


EFFECT = Effect(
    name="coulomb_asymmetry",
    form="half_difference abs(sign(v))",
    coefficients=(Parameter("half_difference", "{torque}"),),
    source="Swevers et al. 1997, IEEE T. Robotics and Automation 13(5)",
    depends_on=("sign_qd_{joint}",),
    row=_row,
    parents=("coulomb",),
    excitation=REVERSALS,
)
