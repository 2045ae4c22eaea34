"""Compliance of the gear between motor and link."""

from wearscope.effects.base import Parameter, TransmissionEffect

EFFECT = TransmissionEffect(
    name="joint_elasticity",
    form="inverse dynamics along q - compliance tau_rb, to first order in the compliance",
    coefficients=(Parameter("compliance", "{position}/({torque})", lower=0.0, upper=0.01),),
    source="Spong 1987, ASME JDSMC 109(4)",
    depends_on=("load_{joint}", "qdd_{joint}"),
    spread=True,
    installs=("compliance",),
)
