"""Friction that grows with the transmitted load.

The coefficient is friction over load. A gear of efficiency e that drives its load has 1/e - 1: 0.1 to 0.4 for
strain wave and cycloidal gears, about 0.6 for the spur gears of a small servo. From 1 on a gear cannot be
driven back by its load: worm gears and lead screws have 0.5 to 4 (efficiencies of 0.67 to 0.2).
"""

import numpy as np

from wearscope.effects.base import PAYLOAD, Effect, Parameter, Signals, compile_row, decay


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = abs(load[j]) * sign[j]
    out[1] = out[0] * decay(abs(v[j]) / shape[0], 1.0)


def _search(signals: Signals, joint: int) -> np.ndarray:
    fastest = max(float(np.abs(signals.v[:, joint]).max()), 1e-9)
    return fastest * np.geomspace(0.05, 0.8, 9)[:, None]


EFFECT = Effect(
    name="load_dependent_friction",
    form="(coefficient + fall exp(-abs(v)/speed)) abs(tau_rb) sign(v)",
    coefficients=(
        Parameter("coefficient", "-", lower=0.0, believable=(0.0, 4.0)),
        Parameter("fall", "-", lower=0.0, default=0.0, believable=(0.0, 4.0)),
    ),
    variants=(("coefficient",),),
    extensions=(("coefficient", "fall"),),
    source="Gogoussis and Donath 1988; Hamon et al. 2010, IEEE IROS",
    depends_on=(
        "load_{joint}",
        "sign_qd_{joint}",
    ),
    row=_row,
    shape=(Parameter("speed", "{position}/s", lower=1e-9, default=1.0, estimated=False),),
    search=_search,
    parents=("coulomb",),
    excitation=PAYLOAD,
    passive=lambda values, temperature: {"by_load": values["coefficient"]},
)
