"""The generic term, `unknown`: what no name explains, as a spline of one or two signals at a joint."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.signals import join_signals, thin_signals
from wearscope.closed_loop.intake.threads import map_runs
from wearscope.closed_loop.model.candidates import Candidate, reduce_columns
from wearscope.closed_loop.model.regression import penalise, regularise
from wearscope.closed_loop.model.room import MadeRows, Room
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import (
    Evidence,
    Found,
    Refusal,
    adjust_p_values,
    on_same_folds,
    weigh,
)
from wearscope.closed_loop.selection.motion_dependence import Dependence
from wearscope.closed_loop.selection.past_doubt import doubt_for_past
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.revision import drop_superfluous, restore_standard
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.sums import Sums
from wearscope.effects.base import Effect, Signals
from wearscope.effects.unknown import COARSE, LEVELS, PRODUCT, coarsen
from wearscope.effects.vocabulary import empirical_effect

#: Share of the gain asked for that signals at the rows alone, without the filter, must show.
_ROUGHLY = 0.6
#: Bytes of its columns that are kept.
_ROOM = 2**29


class GenericTerms:
    """Candidates of the generic term.

    Parameters
    ----------
    prepared : Prepared
    joined : Signals
        Of all training runs.
    room : int
        Bytes of columns that are kept; the others are made again when they are asked for.
    """

    def __init__(self, prepared: Prepared, joined: Signals, room: int = _ROOM) -> None:
        self.prepared, self.joined = prepared, joined
        self.effect = empirical_effect()
        self.runs = prepared.runs_for("train")
        # The generic term has no memory, so that all runs can be one.
        self.thinned = join_signals(
            replace(thin_signals(run), sign=run.reduce(run.signals.sign)) for run in self.runs
        )
        self._room = Room(room)
        self._rough: dict[tuple[int, int], MadeRows] = {}
        self._exact: dict[tuple[int, tuple[float, ...]], Candidate] = {}
        self._shapes: dict[int, np.ndarray] = {}

    def roughly(self, joint: int) -> Iterator[Candidate]:
        """Candidates at a joint from the signals at the rows: each signal and product, at its finest."""
        if joint not in self._shapes:
            self._shapes[joint] = self.effect.shapes(self.joined, joint)
        for number, shape in enumerate(self._shapes[joint]):
            if (joint, number) not in self._rough:
                make = partial(_evaluate, self.effect, self.thinned, joint, shape)
                self._rough[joint, number] = MadeRows(self._room, make)
            yield self._wrap(joint, shape, self._rough[joint, number])

    def exactly(self, joint: int, shape: tuple[float, ...]) -> Candidate:
        """A candidate from the full-rate signals, through the common filter."""
        key = (joint, shape)
        if key not in self._exact:
            make = partial(_reduce, self.effect, self.runs, joint, np.array([shape]))
            self._exact[key] = self._wrap(joint, np.array(shape), MadeRows(self._room, make))
        return self._exact[key]

    def _wrap(self, joint: int, shape: np.ndarray, rows: Sequence[np.ndarray]) -> Candidate:
        named = (tuple(float(v) for v in shape),)
        return Candidate(self.effect, joint, named, (joint,), rows, penalise(rows[0]))


def list_levels(shape: tuple[float, ...]) -> list[int]:
    """Numbers of hat functions at which a spline is asked whose finest level is a shape's."""
    return [PRODUCT] if shape[5] >= 0 else [k for k in LEVELS if k <= shape[-1]]


def _coarsen(sums: Sums, finest: Candidate, level: int, sigma: float) -> Sums:
    """Products of a spline with fewer hat functions, from those of its finest level, with its penalty."""
    onto = coarsen(finest.count, level) if level < finest.count else np.eye(level)
    x = finest.rows[0]
    size = float(np.einsum("pk,pq,qk->", onto, x.T @ x, onto))
    return Sums(
        sums.columns,
        np.einsum("pk,bspq->bskq", onto, sums.cross),
        onto.T @ sums.gram @ onto,
        sums.score @ onto,
        size / level * regularise(level) / sigma**2,
        {},
    )


def _evaluate(effect: Effect, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
    """Columns (M, m) of one shape along signals."""
    return np.ascontiguousarray(effect.columns(signals, joint, shape)[:, : int(shape[-1])])


def _reduce(effect: Effect, runs: list[PreparedRun], joint: int, shapes: np.ndarray) -> np.ndarray:
    """Columns (M, m) of one shape (1, k) along runs, through the common filter."""
    parts = map_runs(partial(reduce_columns, effect, joint, shapes), runs)
    return np.concatenate([x[:, : int(shapes[0, -1])] for x in parts])


def try_generic(
    terms: GenericTerms, assembly: Assembly, joints: list[int], policy: Policy
) -> tuple[list[Evidence], float]:
    """Evidence on what removes a share of its joint's loss, and how many were tried for each of them.

    A single run, of which neighbouring parts are held out, cannot show that fine detail carries over to
    others. Those that remove too little even of the rows that they are fitted on are counted and not
    weighed.
    """
    by_run = assembly.layout.folds.by_run
    weighed: list[Evidence] = []
    count = 0
    for joint in joints:
        sigma = assembly.sigma[joint]
        least = policy.structure_share * assembly.sample_losses[joint]
        for finest in terms.roughly(joint):
            sums = assembly.sum_products(replace(finest, penalty=None))
            levels = list_levels(finest.shapes[0])
            count += len(levels)
            # No level, nor any penalty, gains more than the finest one without.
            if float(assembly.add(sums).gain[0]) < _ROUGHLY * least:
                continue
            for level in levels:
                if not by_run and level > COARSE:
                    continue
                if float(assembly.add(_coarsen(sums, finest, level, sigma)).gain[0]) < _ROUGHLY * least:
                    continue
                named = (*finest.shapes[0][:-1], float(level))
                candidate = _scale(terms.exactly(joint, named), sigma)
                if _gain(assembly, candidate) >= least:
                    weighed.append(weigh(assembly, candidate, tuple(range(candidate.count)), policy))
    return weighed, max(1.0, count / max(len(weighed), 1))


def weigh_generic(
    search: Search, terms: GenericTerms, assembly: Assembly, joints: list[int]
) -> list[Evidence]:
    """Evidence on the generic term given a model, p-values over all signals, levels and joints, judged."""
    policy, by_run = search.policy, assembly.layout.folds.by_run
    weighed, tried = try_generic(terms, assembly, joints, policy)
    weighed = search.compare_whole(assembly, adjust_p_values([replace(e, tried=tried) for e in weighed]))
    return [
        replace(
            e,
            refusal=rule.judge(
                e, policy, [(-np.inf, np.inf)] * (len(e.beta) + len(e.term.shape)), 0.0, by_run, generic=True
            ),
        )
        for e in weighed
    ]


def _scale(candidate: Candidate, sigma: float) -> Candidate:
    """The candidate with its penalty in residual variances, as the rows are."""
    assert candidate.penalty is not None
    return replace(candidate, penalty=candidate.penalty / sigma**2)


def _gain(assembly: Assembly, candidate: Candidate) -> float:
    """Loss that it removes on the rows that it is fitted on."""
    return float(assembly.add(assembly.sum_products(candidate)).gain[0])


def choose_plainest(able: list[Evidence], policy: Policy) -> Evidence:
    """The generic term that gains most, with as few hat functions as do as well."""
    best = max(able, key=lambda e: e.gain)
    like = [e for e in able if e.term.shape[:3] == best.term.shape[:3] and e.joint == best.joint]
    return min((e for e in like if not rule.separates(best, e, policy)), key=lambda e: len(e.beta))


def explain_rest(
    search: Search, terms: GenericTerms, found: list[Found]
) -> tuple[list[Found], dict[int, Evidence], dict[int, Dependence]]:
    """Add generic terms where no name explains what is left; drop names that they make superfluous.

    Returns
    -------
    found : list of Found
    left : dict of int to Evidence
        By joint, the best generic structure that was found and could not be added.
    depends : dict of int to Dependence
        By joint, what was named and depends on what the motion has been.
    """
    found, depends = doubt_for_past(search, doubt(search, terms, found))
    joints = [int(j) for j in np.flatnonzero(search.problem.prepared.moving)]
    left: dict[int, Evidence] = {}
    while joints:
        search.sigma = search.scale(found)
        search.refused.clear()
        assembly = search.assemble(found)
        weighed = weigh_generic(search, terms, assembly, joints)
        able = [e for e in weighed if e.refusal is Refusal.NONE and not search.drifts(assembly, e)]
        taken = []
        for joint in list(joints):
            here = [e for e in able if e.joint == joint]
            if (
                here
                and sum(f.joint == joint and f.effect.empirical for f in found) < search.policy.most_terms
            ):
                taken.append(choose_plainest(on_same_folds(assembly, here, search.policy)[1], search.policy))
            else:
                joints.remove(joint)
                rest = [e for e in weighed if e.joint == joint and is_structure(search, e)]
                rest.sort(key=lambda e: -e.gain)
                best = next((e for e in rest if not search.drifts(assembly, e)), None)
                if best is not None:
                    left[joint] = best
        search.record(weighed, taken)
        for e in taken:
            search.progress(
                f"unknown structure at joint {e.joint}: {100 * e.share:.0f} % of its held-out loss"
            )
            found = [*found, Found(e.chosen, e)]
        if taken:
            new, there = {id(e.chosen) for e in taken}, {e.joint for e in taken}
            found = drop_superfluous(search, found, there, new)
            found = restore_standard(search, found, there)
    return found, left, depends


def doubt(search: Search, terms: GenericTerms, found: list[Found]) -> list[Found]:
    """Add a generic term where it leaves clearly less than a name that leaves much of its joint's loss.

    The name is tested again given that structure, as all others at the joint are. It is dropped where it had
    represented the structure, and stays where the structure had hidden it. Of a single run, which cannot give
    a generic term, such a name is dropped.

    A wave is asked whatever it leaves, since one of few periods may follow any curve, and so is what the
    whole robot has, whose many columns may: such a name is doubted where the fitted errors are not alike
    either.
    """
    for f in list(found):
        sure = f.evidence.share >= search.policy.beyond_doubt
        flexible = f.effect.periodic or f.effect.per_robot
        if f.effect.standard or (sure and not flexible) or not any(k is f for k in found):
            continue
        given = search.assemble([k for k in found if k is not f])
        weighed = weigh_generic(search, terms, given, [f.evidence.joint])
        able = [e for e in weighed if e.refusal in (Refusal.NONE, Refusal.ALONE)]
        if not able:
            continue
        given, (own, *able) = on_same_folds(given, [search.weigh_again(given, f), *able], search.policy)
        e = choose_plainest(able, search.policy)
        is_like = own in rule.fit_alike([e, own], search.policy)
        # No machine follows a name's form exactly.
        holds = own.gain >= (1.0 - search.policy.large_share) * e.gain
        if rule.separates(e, own, search.policy) and not (holds or (sure and is_like)):
            label = f.evidence.term.label
            if e.refusal is Refusal.ALONE:
                search.progress(f"{label} is dropped: structure without a name")
                found = [k for k in found if k is not f]
            else:
                search.progress(f"{label} is doubted: unknown structure does better")
                found = [*found, Found(e.chosen, e)]
                found = drop_superfluous(search, found, {e.joint, f.joint}, {id(e.chosen)})
    return found


def is_structure(search: Search, e: Evidence) -> bool:
    """Whether a generic term shows structure, though it cannot be added."""
    policy = search.policy
    gain, error = rule.summed(-e.change)
    held_out = e.share >= policy.structure_share and gain > policy.unexpected * error
    return (
        # Runs of different kinds may disagree on the form of what most of the loss is.
        (held_out or (e.fitted >= policy.beyond_chance and not rule.is_slow(e)))
        and e.p_value <= policy.unknown_level
        and e.refusal is not Refusal.NONE
    )
