"""Torque channel that is delayed against the position channel."""

from wearscope.effects.base import QUICK, MeasurementEffect, Parameter

#: Smallest believable delay, in samples of the recording; the clocks of two channels may differ by as much.
_LEAST_SAMPLES = 0.1


EFFECT = MeasurementEffect(
    name="time_delay",
    form="tau(t - delay) in place of tau(t)",
    coefficients=(Parameter("delay", "s"),),
    source="Swevers et al. 1997, IEEE T. Robotics and Automation 13(5)",
    depends_on=("dtau_{joint}",),
    kind="lag",
    least=lambda signals: _LEAST_SAMPLES * signals.dt / signals.factor,
    excitation=QUICK,
)
