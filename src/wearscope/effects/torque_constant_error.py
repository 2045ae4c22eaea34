"""Gain error of the measured torque."""

from wearscope.effects.base import MeasurementEffect, Parameter

EFFECT = MeasurementEffect(
    name="torque_constant_error",
    form="gain tau",
    coefficients=(Parameter("gain", "-", lower=-0.9),),
    source="Gautier and Briot 2014, IEEE T. Robotics 30(1): global identification of drive gains",
    depends_on=("tau_{joint}",),
    kind="gain",
)
