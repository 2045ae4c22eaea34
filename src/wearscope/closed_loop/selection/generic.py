"""The generic term, `unknown`: what no name explains, as a spline of one or two signals at a joint."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import groupby

import numpy as np

from wearscope.closed_loop.intake.preprocessing import Prepared, PreparedRun
from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.model.regression import regularise
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, Refusal, adjust_p_values, weigh
from wearscope.closed_loop.selection.search import Found, Search
from wearscope.effects.base import Effect, Signals
from wearscope.effects.unknown import COARSE, LEVELS, PRODUCT, coarsen
from wearscope.effects.vocabulary import empirical_effect

#: Most generic terms of a joint.
_MOST = 2
#: A name that removes less of its joint's loss than the first is doubted: a generic term in its place must gain
#: so many times as much as the second.
_DOUBTED, _CLEARLY = 0.7, 1.5
#: Columns that are made at once.
_AT_ONCE = 8


def spline_rows(
    effect: Effect, joint: int, shapes: np.ndarray, runs: list[PreparedRun]
) -> Iterator[np.ndarray]:
    """Reduced regressors (M, knots) of each shape, all with the same number of knots."""
    knots = int(shapes[0, -1])
    for start in range(0, len(shapes), _AT_ONCE):
        part = shapes[start : start + _AT_ONCE]
        parts = []
        for run in runs:
            x = effect.stack(run.signals, joint, part).reshape(len(run.signals.t), len(part), -1)
            parts.append(run.reduce(np.ascontiguousarray(x[..., :knots])))
        stacked = np.concatenate(parts)
        yield from (np.ascontiguousarray(stacked[:, k]) for k in range(len(part)))


class GenericTerms:
    """Candidates of the generic term, made once a joint.

    Parameters
    ----------
    prepared : Prepared
    joined : Signals
        Of all training runs.
    """

    def __init__(self, prepared: Prepared, joined: Signals) -> None:
        self.prepared, self.joined = prepared, joined
        self.effect = empirical_effect()
        self._made: dict[int, list[Candidate]] = {}

    def at(self, joint: int) -> list[Candidate]:
        """Candidates at a joint: every signal and product, at every level of detail."""
        if joint not in self._made:
            self._made[joint] = list(self._make(joint))
        return self._made[joint]

    def _make(self, joint: int) -> Iterator[Candidate]:
        runs = self.prepared.runs_for("train")
        shapes = self.effect.shapes(self.joined, joint)
        order = sorted(range(len(shapes)), key=lambda k: shapes[k, -1])
        for knots, same in groupby(order, key=lambda k: int(shapes[k, -1])):
            own = shapes[list(same)]
            for shape, x in zip(own, spline_rows(self.effect, joint, own, runs), strict=True):
                for level in (PRODUCT,) if shape[5] >= 0 else (k for k in LEVELS if k <= knots):
                    named = shape.copy()
                    named[-1] = level
                    columns = x if level == knots else x @ coarsen(knots, level)
                    weight = float(np.mean((columns**2).sum(axis=0)))
                    yield Candidate(
                        self.effect, joint, (tuple(float(v) for v in named),), (joint,), (columns,),
                        weight * regularise(level),
                    )  # fmt: skip


def weigh_generic(
    search: Search, terms: GenericTerms, assembly: Assembly, joints: list[int]
) -> list[Evidence]:
    """Evidence on the generic term beside a model, p-values over all signals, levels and joints, judged.

    A single run, of which neighbouring parts are held out, cannot show that fine detail carries over to others.
    Those that remove too little even of the rows that they are fitted on are counted and not weighed.
    """
    policy, by_run = search.policy, assembly.layout.folds.by_run
    weighed: list[Evidence] = []
    count = 0
    for joint in joints:
        sigma = assembly.sigma[joint]
        for candidate in terms.at(joint):
            count += 1
            if not by_run and candidate.count > COARSE:
                continue
            assert candidate.penalty is not None
            scaled = replace(candidate, penalty=candidate.penalty / sigma**2)
            sums = assembly.sum_products(scaled)
            if assembly.add(sums).gain[0] < policy.unknown_share * assembly.sample_losses[joint]:
                continue
            subset = tuple(range(candidate.count))
            weighed.append(weigh(assembly, scaled, subset, search.flips))
    tried = max(1.0, count / max(len(weighed), 1))
    weighed = search.compare_whole(adjust_p_values([replace(e, tried=tried) for e in weighed]))
    wide = [(-np.inf, np.inf)] * LEVELS[-1]
    return [
        replace(e, refusal=rule.judge(e, policy, wide[: len(e.beta)], 0.0, by_run, generic=True))
        for e in weighed
    ]


def choose_plainest(able: list[Evidence]) -> Evidence:
    """The generic term that gains most, with as few hat functions as do as well."""
    best = max(able, key=lambda e: e.gain)
    like = [e for e in able if e.term.shape[:3] == best.term.shape[:3] and e.joint == best.joint]
    return min((e for e in like if not rule.separates(best, e)), key=lambda e: len(e.beta))


def explain_rest(
    search: Search, terms: GenericTerms, found: list[Found]
) -> tuple[list[Found], dict[int, Evidence]]:
    """Add generic terms where no name explains what is left; drop names that they make superfluous.

    Returns
    -------
    found : list of Found
    left : dict of int to Evidence
        By joint, the best generic structure that was found and could not be added.
    """
    found = doubt(search, terms, found)
    joints = [int(j) for j in np.flatnonzero(search.problem.prepared.moving)]
    left: dict[int, Evidence] = {}
    while joints:
        search.sigma = search.scale(found)
        assembly = search.assemble(found)
        weighed = weigh_generic(search, terms, assembly, joints)
        able = [e for e in weighed if e.refusal is Refusal.NONE and not search.drifts(assembly, e)]
        taken = []
        for joint in list(joints):
            here = [e for e in able if e.joint == joint]
            if here and sum(f.joint == joint and f.effect.empirical for f in found) < _MOST:
                taken.append(choose_plainest(here))
            else:
                joints.remove(joint)
                rest = [e for e in weighed if e.joint == joint and is_structure(search, e)]
                if rest:
                    left[joint] = max(rest, key=lambda e: e.gain)
        search.record(weighed, taken)
        for e in taken:
            search.progress(
                f"unknown structure at joint {e.joint}: {100 * e.share:.0f} % of its held-out loss"
            )
            found = [*found, Found(e.chosen, e)]
        if taken:
            new = {id(e.chosen) for e in taken}
            found = search.drop_superfluous(found, {e.joint for e in taken}, new)
    return found, left


def doubt(search: Search, terms: GenericTerms, found: list[Found]) -> list[Found]:
    """Replace names that leave much of their joint's loss where a generic term leaves clearly less."""
    for f in list(found):
        if f.effect.standard or f.evidence.share >= _DOUBTED:
            continue
        beside = search.assemble([k for k in found if k is not f])
        able = [
            e for e in weigh_generic(search, terms, beside, [f.evidence.joint]) if e.refusal is Refusal.NONE
        ]
        if not able:
            continue
        e = choose_plainest(able)
        if e.gain > _CLEARLY * f.evidence.gain and rule.separates(e, f.evidence):
            search.progress(f"{f.evidence.term.label} is replaced by unknown structure")
            found = [Found(e.chosen, e) if k is f else k for k in found]
    return found


def is_structure(search: Search, e: Evidence) -> bool:
    """Whether a generic term shows structure, though it cannot be added."""
    return (
        e.share >= search.policy.unknown_share
        and e.p_value <= search.policy.unknown_level
        and e.refusal is not Refusal.NONE
    )
