"""Rotor inertia reflected to the joint."""

from wearscope.effects.base import QUICK, ArmatureEffect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = a[j]


EFFECT = ArmatureEffect(
    name="rotor_inertia",
    form="J a",
    coefficients=(Parameter("inertia", "{torque} s^2/{position}", lower=0.0),),
    source="Sciavicco and Siciliano 2000, sec. 4.2",
    depends_on=("qdd_{joint}",),
    row=_row,
    excitation=QUICK,
)
