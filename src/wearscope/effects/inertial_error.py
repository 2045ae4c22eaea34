"""Error of the links' masses, first moments and inertias in the URDF.

The last link has the same regressors as a payload: only a payload that changes between runs tells the two
apart. One motion does not identify all coefficients, and some coefficients no motion identifies (Gautier and
Khalil 1990: base parameters).
"""

from wearscope.effects.base import QUICK, InertialEffect
from wearscope.effects.payload_error import EFFECT as PAYLOAD_ERROR

EFFECT = InertialEffect(
    name="inertial_error",
    form="inverse dynamics of additional mass, first moments and inertia of each link",
    coefficients=(),
    source="Gautier and Khalil 1990, IEEE T. Robotics and Automation 6(3)",
    depends_on=("load_{joint}",),
    link=PAYLOAD_ERROR.coefficients,
    candidate="rigid_body",
    contains=("payload_error",),
    excitation=QUICK,
)
