"""Gain error of the measured torque.

Drives' torque constants are stated to 10 %, and fall with the magnet's temperature by a few percent. Intake
notes joints whose torques are of another size than the stated bodies need; larger errors are believed there.
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
    changes=5,
)
