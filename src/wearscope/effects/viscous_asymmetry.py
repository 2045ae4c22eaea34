"""Viscous friction that differs between the two directions of motion."""

from wearscope.effects.base import SPEEDS, Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = abs(v[j])


EFFECT = Effect(
    name="viscous_asymmetry",
    form="half_difference abs(v)",
    coefficients=(Parameter("half_difference", "{torque} s/{position}"),),
    source="Swevers et al. 1997, IEEE T. Robotics and Automation 13(5)",
    depends_on=(
        "qd_{joint}",
        "sign_qd_{joint}",
    ),
    row=_row,
    parents=("viscous", "coulomb"),
    excitation=SPEEDS,
)
