"""Error of the declared rotor inertia: additional inertia on the motor side."""

from wearscope.effects.base import POSTURES, ArmatureEffect, Parameter
from wearscope.effects.rotor_inertia import EFFECT as ROTOR_INERTIA

EFFECT = ArmatureEffect(
    name="rotor_inertia_error",
    form="J a beyond the declared J",
    coefficients=(Parameter("inertia", "{torque} s^2/{position}"),),
    source="Sciavicco and Siciliano 2000, sec. 4.2",
    depends_on=("qdd_{joint}",),
    row=ROTOR_INERTIA.row,
    candidate="rotor_inertia",
    excitation=POSTURES,
)
