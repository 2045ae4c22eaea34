"""What no name explains: the empirical term, and names that it shows to be wrong or superfluous."""

from typing import TYPE_CHECKING

import numpy as np

from wearscope.closed_loop.selection.empirical import SplineFamily, make_spline_families, score_splines
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.selection.evidence import DRIFTS, MATERIAL, Found, Scored, Scorer, adjust_p_values, separates

if TYPE_CHECKING:
    from wearscope.closed_loop.selection.search import Tracer

#: Share of its joint's loss that a name must remove not to be doubted; how much more the empirical term must
#: remove in its place.
_DOUBTED, _CLEARLY = 0.7, 1.3
#: Most empirical terms of a data set.
_MOST = 3


class Rest:
    """Describes the structure that the names leave.

    Parameters
    ----------
    tracer : Tracer
    """

    def __init__(self, tracer: "Tracer") -> None:
        self.tracer = tracer
        self._families: dict[int, list[SplineFamily]] = {}

    def families(self, joint: int) -> list[SplineFamily]:
        """Families of the empirical term at a joint."""
        if joint not in self._families:
            t = self.tracer
            self._families[joint] = make_spline_families(joint, t.prepared, t.joined)
        return self._families[joint]

    def score(self, model: Regression, joints: list[int]) -> list[Scored]:
        """Score the empirical term beside a model, p-values adjusted over signals, levels and joints."""
        t = self.tracer
        scorer = Scorer(model, t.folds, t.flips)
        scored = [s for j in joints for family in self.families(j) for s in score_splines(scorer, family)]
        adjust_p_values(scored)
        return scored

    def choose(self, model: Regression, scored: list[Scored]) -> Scored | None:
        """Empirical term that is significant and worth having."""
        o, choice = self.tracer.options, self.tracer.choice
        able = [s for s in scored if choice.passes(s, o.least_unknown, o.alpha_unknown)]
        able = [s for s in able if s.cv_share * choice.left(s) >= o.minimum_unknown]
        while able:
            taken = plainest(able)
            if choice.stands_out(model, taken):
                return taken
            taken.reason = DRIFTS
            able.remove(taken)
        return None

    def explain(self, found: list[Found], step: int) -> tuple[list[Found], Regression]:
        """Describe what no name explains; take back names that the description makes wrong or superfluous."""
        t = self.tracer
        found = self.doubt(found)
        model = t.fit([f.entry for f in found])
        joints = [int(j) for j in np.flatnonzero(t.prepared.moving)]
        for _ in range(_MOST):
            scored = self.score(model, joints)
            taken = self.choose(model, scored)
            t.record(step, scored, taken)
            step += 1
            if taken is None:
                break
            t.progress(f"step {step}: unknown structure at joint {taken.entry.joint}")
            found = self._take_back(found, taken)
            found.append(Found(taken.entry, [], taken))
            model = t.fit([f.entry for f in found])
        return found, model

    def doubt(self, found: list[Found]) -> list[Found]:
        """Replace names that leave much of their joint's loss where an empirical term leaves clearly less."""
        t = self.tracer
        for f in list(found):
            others = [k for k in found if k is not f]
            beside = t.fit([k.entry for k in others])
            joint = f.entry.joint
            felt = slice(None) if f.entry.effect.spread else slice(joint, joint + 1)
            before = beside.cross_validate_joints(t.folds)[felt].sum()
            named = t.fit([k.entry for k in found])
            after = named.cross_validate_joints(t.folds)[felt].sum()
            if before - after >= _DOUBTED * before:
                continue
            taken = self.choose(beside, self.score(beside, [joint]))
            if taken is None or taken.cv_gain < _CLEARLY * (before - after):
                continue
            if separates(taken.cv_loss, named.cross_validate(t.folds), MATERIAL * taken.cv_gain):
                t.progress(f"{f.entry.label} gives way to unknown structure")
                found = [*others, Found(taken.entry, [], taken)]
        return found

    def _take_back(self, found: list[Found], unknown: Scored) -> list[Found]:
        """Drop names at the joint without which the empirical term does as well."""
        t = self.tracer
        joint = unknown.entry.joint
        kept = list(found)
        for f in sorted((f for f in found if f.entry.joint == joint), key=lambda f: f.scored.cv_gain):
            with_it = t.fit([k.entry for k in kept] + [unknown.entry])
            others = [k for k in kept if k is not f]
            without = t.fit([k.entry for k in others] + [unknown.entry])
            a, b = with_it.cross_validate(t.folds), without.cross_validate(t.folds)
            if not separates(a, b, 0.0) or np.nansum(b - a) < 0.1 * f.scored.cv_gain:
                kept = others
        return kept


def plainest(able: list[Scored]) -> Scored:
    """Empirical term with the largest gain, with as few hat functions as do as well."""
    best = max(able, key=lambda s: s.cv_gain)
    signal = best.entry.joint, best.entry.shape[:3]
    like = [
        s
        for s in able
        if (s.entry.joint, s.entry.shape[:3]) == signal
        and not separates(best.cv_loss, s.cv_loss, MATERIAL * best.cv_gain)
    ]
    return min(like, key=lambda s: s.size)
