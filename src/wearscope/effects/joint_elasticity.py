"""Compliance of the gear between motor and link.

The smallest strain wave gears have some 200 N m/rad, a slide's toothed belt as thin as they come 1e4 N/m
(5e4 N per unit of strain, 5 m long); every other drive is stiffer. A joint of smaller loads than those gears
are made for has a softer one, that yields to them as far as a gear may be slack (`backlash.py`).
"""

from wearscope.effects.base import QUICK, Parameter, TransmissionEffect

EFFECT = TransmissionEffect(
    name="joint_elasticity",
    form="inverse dynamics along q - compliance tau_rb, to first order in the compliance",
    coefficients=(
        Parameter(
            "compliance",
            "{position}/({torque})",
            lower=0.0,
            upper=1.0,
            believable=(0.0, 5e-3),
            believable_prismatic=(0.0, 1e-4),
            travel=6e-3,
            travel_prismatic=1e-3,
        ),
    ),
    source="Spong 1987, ASME JDSMC 109(4)",
    depends_on=("load_{joint}", "qdd_{joint}"),
    spread=True,
    installs=("compliance",),
    excitation=QUICK,
)
