"""Compliance of the gear between motor and link.

The smallest strain wave gears have a stiffness of about 200 N m/rad. The thinnest toothed belt of a slide has
1e4 N/m (5e4 N per unit of strain, 5 m long). Every other drive is stiffer, and this sets the believable
range. A joint with smaller loads may have a softer gear. Its compliance is believed as long as the deflection
under the joint's load stays within the largest believable lost motion (`backlash.py`).
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
    installs=("compliance",),
    excitation=QUICK,
)
