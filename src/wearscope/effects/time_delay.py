"""Torque channel that is delayed against the position channel."""

from wearscope.effects.base import QUICK, MeasurementEffect, Parameter

EFFECT = MeasurementEffect(
    name="time_delay",
    form="tau(t - delay) in place of tau(t)",
    coefficients=(Parameter("delay", "s"),),
    source="Swevers et al. 1997, IEEE T. Robotics and Automation 13(5)",
    depends_on=("dtau_{joint}",),
    kind="lag",
    excitation=QUICK,
)
