"""Viscous friction."""

from wearscope.effects.base import SPEEDS, Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = v[j]


EFFECT = Effect(
    name="viscous",
    form="slope v",
    coefficients=(Parameter("slope", "{torque} s/{position}", lower=0.0),),
    source="Armstrong-Helouvry et al. 1994, Automatica 30(7)",
    depends_on=("qd_{joint}",),
    row=_row,
    passive=lambda values, temperature: {"damping": values["slope"]},
    excitation=SPEEDS,
)
