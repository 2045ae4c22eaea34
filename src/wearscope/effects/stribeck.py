"""Stribeck effect: friction that falls with speed after break-away, as lubrication sets in."""

import numpy as np

from wearscope.effects.base import SLOW_MOTION, Effect, Parameter, Signals, compile_row, decay


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    out[0] = decay(abs(v[j]) / shape[0], shape[1]) * sign[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    fastest = np.abs(signals.v[:, joint]).max()
    return np.array(
        [(fastest * share, power) for power in (1.0, 2.0) for share in (0.02, 0.05, 0.1, 0.2, 0.4)]
    )


EFFECT = Effect(
    name="stribeck",
    form="level exp(-abs(v/speed)^exponent) sign(v)",
    coefficients=(Parameter("level", "{torque}", lower=0.0),),
    source="Armstrong-Helouvry et al. 1994, Automatica 30(7)",
    depends_on=(
        "qd_{joint}",
        "sign_qd_{joint}",
    ),
    row=_row,
    shape=(
        Parameter("speed", "{position}/s", lower=1e-9, default=0.1),
        Parameter("exponent", "-", lower=0.3, upper=4.0, default=1.0, estimated=False),
    ),
    search=_search,
    parents=("coulomb",),
    excitation=SLOW_MOTION,
    passive=lambda values, temperature: {"falling": (values["level"], values["speed"], values["exponent"])},
)
