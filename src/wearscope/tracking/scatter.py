"""How much healthy sessions differ: what a change must exceed beyond its own noise.

The reference's sessions, each held out in turn, are estimated as any later one is. What their estimates have
beyond their own covariance is scatter between sessions. As a share of the joint's torque it is pooled over
the joints by its median (moments after Paule and Mandel 1982), weighed with a prior where there are few
sessions; what single changes have beyond that inflates their variance (shrunk as in Smyth 2004).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from wearscope.tracking.inference import Estimate

#: Prior scatter, as a share of the joint's friction and of its whole torque, and the sessions it is worth.
PRIOR_FRICTION, PRIOR_TORQUE, PRIOR_SESSIONS = 0.01, 0.003, 3.0
#: Degrees of freedom that the pooled scatter lends to that of a single change.
POOLED_DOF = 20.0


@dataclass(frozen=True)
class Scatter:
    """Scatter of healthy sessions.

    Attributes
    ----------
    friction, torque : float
        Standard deviation of a change of friction, as a share of the joint's friction, and of any other
        change, as a share of its torque.
    inflation : mapping of str to float
        Variance beyond that, by the change's key; 1 where nothing is known.
    dof : float
        Degrees of freedom of the variances.
    sessions : int
        Held-out sessions, or runs where there is one session.
    """

    friction: float
    torque: float
    inflation: Mapping[str, float]
    dof: float
    sessions: int

    def covariance(self, estimate: Estimate) -> np.ndarray:
        """Whole covariance (m, m) of an estimate."""
        size = self.friction if estimate.change.friction else self.torque
        whole = estimate.noise + add_scatter(estimate, size**2)
        return np.asarray(self.inflation.get(estimate.change.key, 1.0) * whole)

    def p_value(self, estimate: Estimate) -> float:
        """p-value of no change, for this change alone (Wald's F)."""
        m = len(estimate.value)
        statistic = _distance(estimate.value, self.covariance(estimate)) / m
        return float(stats.f.sf(statistic, m, self.dof))

    def width(self, estimate: Estimate) -> np.ndarray:
        """Half width (m,) of the 95 % interval of each parameter."""
        error = np.sqrt(np.maximum(np.diag(self.covariance(estimate)), 0.0))
        return np.asarray(stats.t.ppf(0.975, self.dof) * error)


def add_scatter(estimate: Estimate, size: float) -> np.ndarray:
    """Covariance (m, m) of a change that scatters by a mean square torque of `size`, as a share of the scale.

    A body's parameters that the motion hardly shows scatter no more than is believed of them beforehand.
    """
    shares, m = estimate.shares, len(estimate.value)
    if size <= 0.0:
        return np.zeros((m, m))
    ridge = 1e-9 * np.trace(shares) / m * np.eye(m)
    return np.asarray(np.linalg.inv((shares + ridge) / size + estimate.prior))


def _distance(value: np.ndarray, covariance: np.ndarray) -> float:
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    return float((value / scale) @ np.linalg.solve(covariance / np.outer(scale, scale), value / scale))


def relative_change(estimate: Estimate, scatter: Scatter) -> tuple[float, float]:
    """Change of a joint's friction as a share of it, and the half width of its 95 % interval.

    The sign is that of the power it takes: positive where friction rose.
    """
    # Each column is felt with the sign of the motion, so that the sum of its torques tells the sign.
    value, covariance = estimate.value, scatter.covariance(estimate)
    unit = estimate.shares
    size = np.sqrt(max(float(value @ unit @ value), 1e-300))
    slope = unit @ value / size
    error = np.sqrt(max(float(slope @ covariance @ slope), 0.0))
    sign = np.sign(np.sqrt(np.maximum(np.diag(unit), 0.0)) @ value) or 1.0
    return float(sign * size), float(1.96 * error)


def measure_friction(estimate: Estimate, scatter: Scatter) -> tuple[float, float]:
    """RMS torque by which a joint's friction changed, as a share of it, and half its 95 % interval.

    Noise makes any RMS larger; its expected part is taken out. The sign is as of `relative_change`.
    """
    share, half = relative_change(estimate, scatter)
    made = share**2 - float(np.sum(estimate.shares * estimate.noise))
    wide = float(stats.t.ppf(0.975, scatter.dof)) / 1.96
    return float(np.sign(share) * np.sqrt(max(made, 0.0))), wide * half


def measure_scatter(
    held_out: Sequence[Mapping[str, Estimate]], joints: int, of_sessions: bool = True
) -> Scatter:
    """Scatter from the estimates of held-out healthy sessions.

    Parameters
    ----------
    held_out : sequence of mapping of str to Estimate
        By session, the estimate of each change alone.
    joints : int
        Number of joints that move.
    of_sessions : bool
        Whether whole sessions are held out; runs of one session show nothing of how sessions differ.
    """
    sizes = {}
    for friction, prior in ((True, PRIOR_FRICTION), (False, PRIOR_TORQUE)):
        by_joint: dict[int, list[Estimate]] = {}
        for estimates in held_out:
            for estimate in estimates.values():
                if estimate.change.asked and estimate.change.friction == friction:
                    by_joint.setdefault(estimate.change.joint, []).append(estimate)
        found = [_excess(own) for own in by_joint.values()]
        count = max(len(held_out) - 1, 0) * joints if found else 0
        # The median of a variance from few sessions lies below their mean.
        middle = stats.chi2.median(len(held_out)) / len(held_out) if found else 1.0
        pooled = float(np.median(found)) / middle if found else 0.0
        weighed = (PRIOR_SESSIONS * prior**2 + count * pooled) / (PRIOR_SESSIONS + count)
        sizes[friction] = weighed if of_sessions and len(held_out) > 1 else max(weighed, prior**2)
    scatter = Scatter(float(np.sqrt(sizes[True])), float(np.sqrt(sizes[False])), {}, 1.0, len(held_out))
    inflation = {}
    for key in {key for estimates in held_out for key in estimates}:
        own = [estimates[key] for estimates in held_out if key in estimates]
        total = sum(_distance(e.value, scatter.covariance(e)) for e in own)
        expected = sum(len(e.value) for e in own)
        inflation[key] = max(1.0, (POOLED_DOF + total) / (POOLED_DOF + expected))
    dof = POOLED_DOF + max(len(held_out) - 1, 0)
    return Scatter(scatter.friction, scatter.torque, inflation, dof, len(held_out))


def _excess(estimates: Sequence[Estimate]) -> float:
    """Variance between sessions, as a share of scale, at which the statistics are of the size expected."""

    def surplus(size: float) -> float:
        return float(
            np.mean([_distance(e.value, e.noise + add_scatter(e, size)) / len(e.value) for e in estimates])
            - 1.0
        )

    if surplus(0.0) <= 0.0:
        return 0.0
    high = 1e-6
    while surplus(high) > 0.0 and high < 1e4:
        high *= 10.0
    return float(optimize.brentq(surplus, 0.0, high, xtol=1e-12)) if high < 1e4 else high
