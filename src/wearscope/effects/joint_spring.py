"""Spring at the joint, such as a cable or hose package."""

from wearscope.effects.base import RANGE, Effect, Parameter, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = q[j]
    out[1] = 1.0


EFFECT = Effect(
    name="joint_spring",
    form="stiffness q + preload",
    coefficients=(
        Parameter("stiffness", "{torque}/{position}"),
        Parameter("preload", "{torque}"),
    ),
    source="Sciavicco and Siciliano 2000, sec. 4.2",
    depends_on=("q_{joint}",),
    row=_row,
    contains=("torque_offset",),
    excitation=RANGE,
    passive=lambda values, temperature: {"stiffness": values["stiffness"], "preload": values["preload"]},
)
