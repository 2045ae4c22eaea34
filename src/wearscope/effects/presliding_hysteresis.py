"""Presliding: friction that builds up over the displacement since the last reversal (Dahl's model)."""

import numpy as np

from wearscope.effects.base import REVERSALS, Effect, Parameter, Signals, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    moved = np.exp(-abs(v[j]) * dt / shape[0])
    next_state[0] = sign[j] + (state[0] - sign[j]) * moved if sign[j] != 0.0 else state[0]
    out[0] = next_state[0] - sign[j]


def _search(signals: Signals, joint: int) -> np.ndarray:
    return np.ptp(signals.q[:, joint]) * np.geomspace(1e-3, 0.3, 7)[:, None]


EFFECT = Effect(
    name="presliding_hysteresis",
    form="level (z - sign(v)), dz/dt = (v - abs(v) z)/displacement",
    coefficients=(Parameter("level", "{torque}"),),
    source="Dahl 1968; Canudas de Wit et al. 1995, IEEE T. Automatic Control 40(3)",
    depends_on=(
        "qd_{joint}",
        "sign_qd_{joint}",
        "reversal_{joint}",
    ),
    row=_row,
    shape=(
        # Elastic displacement before sliding: arc minutes for gear teeth and bearings, degrees for belts,
        # seals.
        Parameter(
            "displacement",
            "{position}",
            lower=1e-12,
            default=1e-3,
            believable=(0.0, 0.15),
            believable_prismatic=(0.0, 0.02),
        ),
    ),
    n_states=1,
    search=_search,
    parents=("coulomb",),
    excitation=REVERSALS,
    passive=lambda values, temperature: {"presliding": (values["level"], values["displacement"])},
)
