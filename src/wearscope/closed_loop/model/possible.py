"""Models whose coefficients are physically possible: none beyond a bound that its effect sets.

An effect that a declared model lacks can push one of its own coefficients beyond zero: friction that drives
the motion, or a negative inertia. Such a coefficient is taken out and the others are fitted again, beginning
with the one furthest beyond its bound in standard errors (an active set, Lawson and Hanson 1974, ch. 23).
"""

from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression

#: Likely causes of such an estimate, by the signal that the effect depends on.
_CAUSES = {
    "qdd_{joint}": "the URDF's inertias are too large, the torque lacks the body's own part, or the torque "
    "and position channels are shifted in time",
    "": "the torque is measured behind the friction, its friction was taken out, or the torque and position "
    "channels are shifted in time",
}


@dataclass(frozen=True)
class Impossible:
    """An estimate that no machine has, and its 95 % interval."""

    joint: int
    effect: str
    parameter: str
    unit: str
    value: float
    interval: tuple[float, float]
    causes: str

    @property
    def is_significant(self) -> bool:
        """Whether the whole interval lies beyond zero."""
        low, high = self.interval
        return not low <= 0.0 <= high

    def describe(self, joints: list[str]) -> str:
        """One sentence: what the runs give, what is taken instead, and likely causes."""
        low, high = self.interval
        return (
            f"{joints[self.joint]}: the runs give {self.effect} {self.parameter} {self.value:.3g} "
            f"{self.unit} ({low:.3g} to {high:.3g}), which no machine has; the model takes 0. Likely causes: "
            f"{self.causes}"
        )


def keep_possible(model: Regression, count: int) -> tuple[Regression, list[Impossible]]:
    """The model without coefficients that the runs place beyond a bound of zero.

    Parameters
    ----------
    model : Regression
    count : int
        Number of the model's first entries that may lose coefficients; one that loses all is taken out.

    Returns
    -------
    Regression
        The model with the other parameters fitted again.
    list of Impossible
        Coefficients that were taken out.
    """
    out: list[Impossible] = []
    while True:
        beyond = [one for one in list_beyond(model) if one[0] < count]
        if not beyond:
            return model, out
        i, k, impossible = max(beyond, key=lambda one: one[3])[:3]
        entries = list(model.entries)
        subset = tuple(s for s in entries[i].subset if s != k)
        if subset:
            entries[i] = replace(entries[i], subset=subset)
        else:
            del entries[i]
            count -= 1
        model = refit(model, entries)
        out.append(impossible)


def list_beyond(model: Regression) -> list[tuple[int, int, Impossible, float]]:
    """Coefficients beyond a bound of zero: indices of entry and coefficient, report, relative distance.

    The distance beyond zero is relative to the width of the coefficient's interval.
    """
    theta, prepared = model.solve(), model.prepared
    places = []
    for i, (entry, span) in enumerate(zip(model.entries, model.spans, strict=True)):
        for k, value in zip(entry.subset, theta[span], strict=True):
            p = entry.effect.coefficients[k]
            if (p.lower == 0.0 and value < 0.0) or (p.upper == 0.0 and value > 0.0):
                places.append((i, k, float(value)))
    if not places:
        return []
    estimates = estimate(model, conditional=True)
    found = []
    for i, k, value in places:
        effect, joint = model.entries[i].effect, model.entries[i].joint
        p = effect.coefficients[k]
        low, high = estimates[i].intervals.get(p.name, (-np.inf, np.inf))
        unit = p.unit_at(prepared.dataset.position_unit[joint], prepared.dataset.torque_unit[joint])
        causes = _CAUSES["qdd_{joint}" if "qdd_{joint}" in effect.depends_on else ""]
        one = Impossible(joint, effect.name, p.name, unit, value, (low, high), causes)
        found.append((i, k, one, abs(value) / max(high - low, 1e-300)))
    return found
