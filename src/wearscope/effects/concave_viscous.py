"""Viscous friction that levels off at high speed."""

from collections.abc import Iterable

import numpy as np

from wearscope.effects.base import SLOW_MOTION, Effect, Parameter, Signals, compile_row


@compile_row
def _row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out):
    size = abs(v[j])
    softened = np.sqrt(size**2 + shape[1] ** 2)
    out[0] = size * softened ** (shape[0] - 1.0) * sign[j] if softened > 0.0 else 0.0


def _search(signals: Signals, joint: int) -> np.ndarray:
    fastest = np.abs(signals.v[:, joint]).max()
    return np.array(
        [
            (exponent, fastest * share)
            for exponent in (0.2, 0.35, 0.5, 0.7)
            for share in (1e-3, 0.05, 0.15, 0.45)
        ]
    )


class _ConcaveViscous(Effect):
    """A law of which the search fits one shape more than the estimation does."""

    def complexity(self, subset: Iterable[int]) -> int:
        """Return the number of fitted values: the coefficients of a subset, and one of the shapes."""
        return super().complexity(subset) + 1


EFFECT = _ConcaveViscous(
    name="concave_viscous",
    form="level abs(v) (v^2 + speed^2)^((exponent - 1)/2) sign(v)",
    coefficients=(Parameter("level", "{torque} s^b/{position}^b", lower=0.0),),
    source="Carreau 1972, Trans. Soc. Rheol. 16(1); Grotjahn and Heimann 2001: power law, with speed 0",
    depends_on=("qd_{joint}", "sign_qd_{joint}"),
    row=_row,
    shape=(
        Parameter("exponent", "-", lower=0.05, upper=0.95, default=0.5, estimated=False),
        Parameter("speed", "{position}/s", lower=0.0, default=0.0, estimated=False),
    ),
    search=_search,
    parents=("viscous", "coulomb"),
    excitation=SLOW_MOTION,
)
