"""Torque driven by the motion of another joint (wrist couplings)."""

from wearscope.effects.base import Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    other = int(shape[0])
    out[0] = v[other]
    out[1] = sign[other]
    out[2] = a[other]


EFFECT = Effect(
    name="cross_coupling",
    form="viscous v_other + coulomb sign(v_other) + inertia a_other",
    coefficients=(
        Parameter("viscous", "{torque} s/rad"),
        Parameter("coulomb", "{torque}"),
        Parameter("inertia", "{torque} s^2/rad"),
    ),
    source="Staubli TX family wrist coupling: Gautier et al. 2013, IEEE ICRA",
    depends_on=("qd_{other}", "sign_qd_{other}", "qdd_{other}"),
    row=_row,
    shape=(Parameter("other", "index of the driving joint", lower=0.0),),
)
