"""Viscous friction that grows with the square of the speed, as from churned oil; it only dissipates power."""

from wearscope.effects.base import SPEEDS, Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = v[j] * abs(v[j])


EFFECT = Effect(
    name="quadratic_viscous",
    form="curvature v abs(v)",
    coefficients=(Parameter("curvature", "{torque} s^2/{position}^2", lower=0.0),),
    source="Hamon et al. 2010, IEEE IROS: friction with speed-squared term",
    depends_on=("qd_{joint}",),
    row=_row,
    parents=("viscous", "coulomb"),
    excitation=SPEEDS,
    passive=lambda values, temperature: {"quadratic": values["curvature"]},
)
