"""Direction of motion (sign of the speed), smoothed around rest in three usual forms of friction's reversal.

With x = v / width the forms are tanh(x), x / sqrt(1 + x^2) and 2/pi arctan(pi x / 2). All have the slope 1 at
rest and tend to 1; each later form tends to it more slowly.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


def _algebraic(x: np.ndarray) -> np.ndarray:
    return x / np.sqrt(1.0 + x**2)


def _arctangent(x: np.ndarray) -> np.ndarray:
    return 2.0 / np.pi * np.arctan(0.5 * np.pi * x)


FORMS: tuple[Callable[[np.ndarray], np.ndarray], ...] = (np.tanh, _algebraic, _arctangent)
"""Forms of the reversal; their index is their number."""
_SLOPES: tuple[Callable[[np.ndarray], np.ndarray], ...] = (
    lambda x: 1.0 / np.cosh(np.clip(x, -300.0, 300.0)) ** 2,
    lambda x: (1.0 + x**2) ** -1.5,
    lambda x: 1.0 / (1.0 + (0.5 * np.pi * x) ** 2),
)
#: Values of v / width at which friction has reached half of its level.
_HALF = np.array([np.arctanh(0.5), 1.0 / np.sqrt(3.0), 2.0 / np.pi])
#: Largest v / width; larger values are cut to it.
_FAST = 1e4


def soften_direction(v: np.ndarray, width: float, sign: np.ndarray, form: int = 0) -> np.ndarray:
    """Direction of motion (N,), smoothed over the speed `width` in one of `FORMS`; 0 where `sign` is 0."""
    return np.where(sign == 0.0, 0.0, FORMS[form](v / width)) if width > 0 else sign


def vary_direction(v: np.ndarray, width: float, sign: np.ndarray, form: int = 0) -> np.ndarray:
    """Derivatives (N, 3) of `soften_direction` with respect to the width and the form of the reversal.

    Column 0 is the derivative with respect to the logarithm of the width. Columns 1 and 2 are the differences
    of the other two forms to this one. All are zero at rest.
    """
    if not width > 0:
        return np.zeros((len(v), len(FORMS)))
    x = np.clip(v / width, -_FAST, _FAST)
    now = FORMS[form](x)
    others = [other(x) - now for other in FORMS if other is not FORMS[form]]
    return np.where(sign[:, None] == 0.0, 0.0, np.column_stack([-x * _SLOPES[form](x), *others]))


def average_direction(v: np.ndarray, width: float, sign: np.ndarray) -> np.ndarray:
    """`soften_direction` (N,) averaged over each sample's interval, with the speed linear between samples.

    It is used for speeds that were thinned: a reversal between two kept samples keeps its time.
    """
    middle = 0.5 * (v[1:] + v[:-1])
    low, high = np.append(v[:1], middle), np.append(middle, v[-1:])
    change = high - low
    flat = np.abs(change) < 1e-9 * max(float(np.abs(v).max()), 1e-300)
    if width > 0:
        # ln(2 cosh) without overflow; the constant ln 2 cancels in the difference.
        risen = width * (np.logaddexp(high / width, -high / width) - np.logaddexp(low / width, -low / width))
    else:
        risen = np.abs(high) - np.abs(low)
    average = risen / np.where(flat, 1.0, change)
    return np.where(sign == 0.0, 0.0, np.where(flat, soften_direction(v, width, sign), average))


@dataclass(frozen=True, eq=False)
class Reversals:
    """How each joint's direction of motion changes.

    Attributes
    ----------
    width : ndarray (n,)
        Speed over which it changes [rad/s or m/s]; 0 is an abrupt change.
    form : ndarray (n,) of int
        Number of its form in `FORMS`.
    """

    width: np.ndarray
    form: np.ndarray

    @classmethod
    def over(cls, width: np.ndarray) -> "Reversals":
        """Reversals of given widths, all of the first form."""
        return cls(np.array(width, dtype=float), np.zeros(len(width), dtype=int))

    def differ(self, other: "Reversals", share: float = 0.0) -> np.ndarray:
        """Whether each joint (n,) has another form, or a width that differs by more than a share."""
        return (self.form != other.form) | (np.abs(self.width - other.width) > share * other.width)

    def change_form(self, step: int) -> "Reversals":
        """Reversals of the form `step` places later; friction reaches half its level at the same speed."""
        form = (self.form + step) % len(FORMS)
        return Reversals(self.width * _HALF[self.form] / _HALF[form], form)

    def where(self, chosen: np.ndarray, other: "Reversals") -> "Reversals":
        """These reversals at the joints that the mask (n,) chooses, `other` at all others."""
        return Reversals(np.where(chosen, self.width, other.width), np.where(chosen, self.form, other.form))

    def soften(self, v: np.ndarray, sign: np.ndarray) -> np.ndarray:
        """Direction of motion (N, n); see `soften_direction`."""
        return np.column_stack([soften_direction(*one) for one in self._by_joint(v, sign)])

    def vary(self, v: np.ndarray, sign: np.ndarray) -> np.ndarray:
        """Derivatives (N, n, 3) of the direction with respect to the reversals; see `vary_direction`."""
        return np.stack([vary_direction(*one) for one in self._by_joint(v, sign)], axis=1)

    def _by_joint(self, v: np.ndarray, sign: np.ndarray) -> list[tuple[np.ndarray, float, np.ndarray, int]]:
        return list(zip(v.T, self.width.tolist(), sign.T, self.form.tolist(), strict=True))
