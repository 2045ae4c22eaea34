"""Lost motion between motor and link at torque reversal.

Robot gears have 1 arc minute of lost motion, planetary gears of the lowest class up to 20 (6 mrad), a worn
screw or rack 1 mm. These figures set the believable range.
"""

import numpy as np

from wearscope.effects.base import GRAVITY_SIGN, Parameter, Signals, TransmissionEffect


def _search(signals: Signals, joint: int) -> np.ndarray:
    scale = max(np.std(signals.load[:, joint]), 1e-9)
    return scale * np.array([[0.03], [0.1], [0.3]])


EFFECT = TransmissionEffect(
    name="backlash",
    form="inverse dynamics along q - (lost_motion/2) tanh(tau_rb/mesh_torque), to first order",
    coefficients=(
        Parameter(
            "lost_motion",
            "{position}",
            lower=0.0,
            upper=0.1,
            believable=(0.0, 6e-3),
            believable_prismatic=(0.0, 1e-3),
        ),
    ),
    source="Nordin and Gutman 2002, Automatica 38(10)",
    depends_on=("load_{joint}", "reversal_load_{joint}"),
    shape=(Parameter("mesh_torque", "{torque}", lower=1e-9, default=1.0),),
    bend=lambda torque, shape: 0.5 * np.tanh(torque / shape[0]),
    abrupt=True,
    installs=("lost_motion", "mesh_torque"),
    search=_search,
    excitation=GRAVITY_SIGN,
)
