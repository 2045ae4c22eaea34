"""Gain error of the measured torque.

The torque constant of a drive is known within 10 %, and falls by a few per cent as the magnets warm up. This
sets the believable range. A larger error is believed only at a joint for which the intake has noted that its
torques have another magnitude than the stated bodies need.
"""

from wearscope.effects.base import PAYLOAD, MeasurementEffect, Parameter

EFFECT = MeasurementEffect(
    name="torque_constant_error",
    form="gain tau",
    coefficients=(Parameter("gain", "-", lower=-0.9, believable=(-0.15, 0.15)),),
    source="Gautier and Briot 2014, IEEE T. Robotics 30(1): global identification of drive gains",
    depends_on=("tau_{joint}",),
    kind="gain",
    excitation=PAYLOAD,
)
