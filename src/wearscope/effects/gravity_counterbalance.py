"""Spring or hydraulic balancer between a pin on the base and a pin on the turning link.

The link's pin is `ratio` times as far from the axis as the base's, and they are L apart, with
L^2 = 1 + ratio^2 - 2 ratio cos(q - angle). A force in proportion to L gives a sine of the position. A
constant force, such as a preload, gives a sine over L. The column of `pretension` is what that has in
addition to a sine, so that the two are told apart. `bias` is for gas pressure, over a limited range.
"""

import numpy as np

from wearscope.effects.base import RANGE, BalancerEffect, Parameter, Signals, compile_row

#: Angles [rad] and ratios that are tried.
_ANGLES, _RATIOS = np.pi / 18.0 * np.arange(1, 38), (0.12, 0.25, 0.5)


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    angle, ratio = q[j] - shape[0], shape[1]
    length = np.sqrt(1.0 + ratio * ratio - 2.0 * ratio * np.cos(angle))
    out[0] = np.sin(q[j])
    out[1] = np.cos(q[j])
    out[2] = 1.0
    out[3] = np.sin(angle) * (1.0 / length - 1.0) / ratio


def _search(signals: Signals, joint: int) -> np.ndarray:
    return np.array([(angle, ratio) for angle in _ANGLES for ratio in _RATIOS])


EFFECT = BalancerEffect(
    name="gravity_counterbalance",
    form="bias + sine1 sin(q) + cosine1 cos(q) + pretension sin(q - angle) (1/L - 1) / ratio, "
    "L^2 = 1 + ratio^2 - 2 ratio cos(q - angle)",
    coefficients=(
        Parameter("sine1", "{torque}", shaped=False),
        Parameter("cosine1", "{torque}", shaped=False),
        Parameter("bias", "{torque}", shaped=False),
        Parameter("pretension", "{torque}"),
    ),
    source="Spring between two pins: Weigand et al. 2020 (KUKA KR300)",
    depends_on=("q_{joint}",),
    row=_row,
    shape=(
        Parameter("angle", "{position}", default=np.pi),
        Parameter("ratio", "-", lower=0.01, upper=0.95, default=0.25),
    ),
    search=_search,
    variants=(
        ("sine1", "cosine1"),
        ("sine1", "cosine1", "bias"),
        ("sine1", "cosine1", "pretension"),
    ),
    contains=("torque_offset",),
    excitation=RANGE,
    step=float(_ANGLES[0]),
)
