"""Search for the set of changes that a session shows: changes are added, dropped and swapped by one score."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from wearscope.tracking.changes import BODY, Change
from wearscope.tracking.evidence import SURE, Evidence, Fit

#: Largest number of steps of the search, and of changes that each step compares in full.
_STEPS, _TRIED = 30, 8
#: A joint is unexplained where its mean square residual exceeds this multiple of the healthy sessions'.
_FAR = 4.0
#: Least RMS torque of a change: of friction as a share of the joint's friction, of anything else as a share
#: of the joint's torque.
_LEAST_FRICTION, _LEAST_TORQUE = 0.02, 0.005
#: p-value above which a change may be zero; standard errors by which a body may lie beyond the arm's reach.
CHANCE, _SURE = 0.05, 2.0
#: Two changes cancel where the RMS torque of their sum is below this share of the smaller change's.
_CANCEL = 0.5


@dataclass(frozen=True, eq=False)
class Found:
    """Result of the search in a session.

    Attributes
    ----------
    fit : Fit
        Fit of the best set.
    named : tuple of Change
        Changes of the set that are reported.
    alike : dict of str to list of Change
        By the key of a change of the set, others that explain the session as well in its place.
    cancelling : list of (Change, Change)
        Pairs whose torques cancel; neither is reported.
    unexplained : dict of int to float
        By unexplained joint, its mean square residual over that of healthy sessions.
    """

    fit: Fit
    named: tuple[Change, ...]
    alike: dict[str, list[Change]]
    cancelling: list[tuple[Change, Change]]
    unexplained: dict[int, float]


def find_changes(evidence: Evidence, usual: np.ndarray, reach: float) -> Found:
    """The best set of changes of a session.

    Parameters
    ----------
    evidence : Evidence
    usual : ndarray (n,)
        Mean square residual of healthy sessions.
    reach : float
        Reach of the arm [m].
    """
    search = _Search(evidence, reach)
    best = search.climb()
    moving = evidence.structure.moving
    for _ in range(2):
        # Unexplained torque is treated as autocorrelated noise, so that it does not distort the healthy
        # machine's parameters.
        variance = evidence.structure.scales.noise**2
        for j in moving:
            if best.held[j] > _FAR * usual[j]:
                scores = np.einsum("rk,r->rk", evidence.z[:, j], best.left[:, j])
                shown = [score for score in scores.T if np.any(score)]
                variance[j] = best.held[j] * max(map(evidence.blocks.find_design_effect, shown), default=1.0)
        if np.allclose(variance, evidence.variance):
            break
        evidence.weigh(variance)
        best = search.climb()
    unexplained = {int(j): float(best.held[j] / usual[j]) for j in moving if best.held[j] > _FAR * usual[j]}
    cancelling = [pair for pair in combinations(best.changes, 2) if _cancel(evidence, best, *pair)]
    gone = {change.key for pair in cancelling for change in pair}
    gone |= {c.key for c in best.changes if _is_doubtful(evidence, best, c, usual, unexplained)}
    named = tuple(change for change in best.changes if change.key not in gone)
    return Found(
        best, named, {c.key: search.list_alike(best, c) for c in best.changes}, cancelling, unexplained
    )


def _cancel(evidence: Evidence, fit: Fit, a: Change, b: Change) -> bool:
    """Whether the torques of two changes cancel at a joint."""
    one, other = evidence.torque(fit, a), evidence.torque(fit, b)
    sizes = [np.sqrt((x**2).sum(axis=0)) for x in (one, other, one + other)]
    both = np.minimum(sizes[0], sizes[1])
    return bool(np.any((both > 0.1 * np.maximum(sizes[0], sizes[1])) & (sizes[2] < _CANCEL * both)))


def _is_doubtful(
    evidence: Evidence, fit: Fit, change: Change, usual: np.ndarray, unexplained: dict[int, float]
) -> bool:
    """Whether a change matters most at an unexplained joint, and explains less there than is left."""
    less = evidence.fit([other for other in fit.changes if other is not change])
    j = int(np.argmax((less.held - fit.held) / usual))
    return j in unexplained and less.held[j] < 2.0 * fit.held[j]


class _Search:
    """Moves between sets of changes of one session."""

    def __init__(self, evidence: Evidence, reach: float):
        self.evidence, self.reach = evidence, reach

    def is_allowed(self, fit: Fit) -> bool:
        """Whether every change is the only one of its kind at its joint, significant, large and possible."""
        return len({(c.kind, c.joint) for c in fit.changes}) == len(fit.changes) and all(
            self._is_possible(fit, change) for change in fit.changes
        )

    def _is_possible(self, fit: Fit, change: Change) -> bool:
        """Whether a fitted change is significant, large enough, and within what a machine can do."""
        value, error = fit.values[change.key], fit.error(change)
        if fit.p_value(change) > CHANCE:
            return False
        scales = self.evidence.structure.scales
        friction = any(term.effect.is_friction for term in change.terms)
        size = np.sqrt((self.evidence.torque(fit, change) ** 2).sum(axis=0) / self.evidence.count)
        least = _LEAST_FRICTION * scales.friction if friction else _LEAST_TORQUE * scales.torque
        if not np.any(size > least):
            return False
        if change.kind == BODY:
            far = np.linalg.norm(value[1:4]) - _SURE * np.linalg.norm(error[1:4])
            return bool(far <= self.reach * (abs(value[0]) + _SURE * error[0]))
        if change.weights:
            return bool(value[0] > -1.0)
        lower = [term.effect.coefficients[k].lower for term in change.terms for k in term.subset]
        return all(x > low for x, low in zip(value, lower, strict=True) if -np.inf < low < 0.0)

    def best(self, base: Sequence[Change], over: Fit) -> tuple[Fit | None, float]:
        """The best set of `base` and one more change, and its log odds over `over`; None if none gains."""
        able = [change for change in self.evidence.changes if change not in base]
        ranked = self.evidence.rank(base, able)[:_TRIED]
        tried = [self.evidence.fit([*base, change]) for change in ranked]
        gains = [(self.evidence.compare(over, fit), k) for k, fit in enumerate(tried)]
        hopeful = [
            tried[k] for gain, k in sorted(gains, reverse=True) if gain > 0.0 and self.is_allowed(tried[k])
        ]
        if not hopeful:
            return None, 0.0
        king = hopeful[0]
        for fit in hopeful[1:] * 2:  # pairwise, since the number of independent rows differs by pair
            king = fit if fit is not king and self.evidence.compare(king, fit) > 0.0 else king
        return king, self.evidence.compare(over, king)

    def climb(self) -> Fit:
        """The set of a greedy search that no further move improves."""
        evidence, fit = self.evidence, self.evidence.fit(())
        for _ in range(_STEPS):
            fewer = [evidence.fit([c for c in fit.changes if c is not gone]) for gone in fit.changes]
            gains = [evidence.compare(fit, other) if self.is_allowed(other) else 0.0 for other in fewer]
            if max(gains, default=0.0) > 0.0:
                fit = fewer[int(np.argmax(gains))]
                continue
            new, gain = self.best(fit.changes, fit)
            if new is None:
                for count in (1, 2):
                    for gone in combinations(fit.changes, count):
                        other, found = self.best([c for c in fit.changes if c not in gone], fit)
                        if other is not None and found > max(gain, 0.5):
                            new, gain = other, found
            if new is None:
                break
            fit = new
        return fit

    def list_alike(self, fit: Fit, change: Change) -> list[Change]:
        """Changes that explain as much as a change of a set and could replace it, the likeliest first."""
        rest = [other for other in fit.changes if other is not change]
        able = [c for c in self.evidence.changes if c not in fit.changes]
        found = []
        for other in self.evidence.rank(rest, able)[: 2 * _TRIED]:
            tried = self.evidence.fit([*rest, other])
            gain = self.evidence.compare(fit, tried) + other.odds - change.odds
            if (
                gain > -SURE
                and self.is_allowed(tried)
                and (other.kind, other.joint) != (change.kind, change.joint)
            ):
                found.append((gain, other))
        return [other for _, other in sorted(found, key=lambda pair: -pair[0])]
