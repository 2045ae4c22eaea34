"""Possible extensions of a model: candidates that apply, with the coefficients that make sense."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.score import Model, Score
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.model.terms import Candidate
from wearscope.effects.base import Effect, MeasurementEffect, WaveEffect

#: Largest ratio (RMS) to which columns of one term may cancel each other, or other terms' torque.
_CANCELS = 12.0
UNBELIEVABLE = "a parameter is outside its believable bounds"
_CANCELLED = "its columns cancel each other"


@dataclass(frozen=True, eq=False)
class Extension:
    """A term that a model may be extended by.

    Attributes
    ----------
    term : Term
    beta : ndarray (m,)
        Its coefficients with the model.
    gain : float
        Reduction of the sum of squares on all rows, in residual variances.
    sine : float
        Of the angle between its torque and the model.
    refusal : str
        Why it is not taken whatever its score; empty where nothing speaks against it.
    """

    term: Term
    beta: np.ndarray
    gain: float
    sine: float
    refusal: str


def list_candidates(
    model: Model,
    joints: Iterable[int],
    wanted: Callable[[Effect, int], bool] | None = None,
) -> list[Candidate]:
    """Candidates that apply and that the model neither has nor contains, but whose parents it has.

    In a single run temperature is a function of time: next to a term of either, a term of the other would
    only change its form.
    """
    problem, fit = model.problem, model.fit
    present: list[list[Effect]] = [list(problem.given) for _ in range(problem.prepared.n)]
    for term in fit.terms:
        present[term.joint].append(term.effect)
    alone = not problem.layout.folds.by_run
    thermal = {t.joint for t in model.terms if alone and t.effect.is_thermal}
    made = []
    for joint in joints:
        there = present[joint]
        for effect in problem.effects:
            if not problem.prepared.moving[joint] or not (wanted is None or wanted(effect, joint)):
                continue
            if not effect.repeatable and any(effect.name in (e.name, *e.contains) for e in there):
                continue
            if not effect.has_parent(there) or (joint in thermal and effect.is_thermal):
                continue
            # A generic term has an offset of its own.
            if effect.is_offset and any(e.empirical for e in there):
                continue
            if isinstance(effect, MeasurementEffect):
                candidate: Candidate | None = problem.measurement_candidate(effect, joint, fit)
            elif isinstance(effect, WaveEffect):
                candidate = problem.periodic_candidate(effect, joint, fit.leave(joint))
            else:
                candidate = problem.candidate(effect, joint)
            if candidate is not None:
                made.append(candidate)
    return made


def list_subsets(effect: Effect, by_run: bool) -> list[tuple[int, ...]]:
    """Subsets of an effect's coefficients to try; in a single run only the smallest, which contain no other.

    All subsets of a body are tried there too, as a prior bounds its coefficients.
    """
    if not by_run and not effect.per_robot:
        return [tuple(int(k) for k in s) for s in effect.plain_subsets()]
    names = [p.name for p in effect.coefficients]
    richer = [tuple(sorted(names.index(name) for name in extension)) for extension in effect.extensions]
    return list(dict.fromkeys([*(tuple(int(k) for k in s) for s in effect.subsets()), *richer]))


def list_extensions(
    model: Model,
    joints: Iterable[int],
    wanted: Callable[[Effect, int], bool] | None = None,
) -> list[Extension]:
    """The best shape of each candidate and subset conditional on a model; the largest gain comes first.

    Parameters
    ----------
    model : Model
    joints : iterable of int
    wanted : callable, optional
        Whether an effect at a joint is tried; all are by default, and kept with the model.
    """
    kept: dict[int, list[Extension]] = model.extensions if wanted is None else {}
    joints = list(joints)
    for joint in joints:
        if joint not in kept:
            kept[joint] = _list_at(model, joint, wanted)
    return sorted(
        (o for joint in joints for o in kept[joint]), key=lambda o: -o.gain / np.sqrt(len(o.term.subset))
    )


def _list_at(model: Model, joint: int, wanted: Callable[[Effect, int], bool] | None) -> list[Extension]:
    """Extensions at one joint, as `list_extensions` has them."""
    by_run = model.problem.layout.folds.by_run
    candidates = list_candidates(model, [joint], wanted)
    tried = sum(_count_alternatives(c, list_subsets(c.effect, by_run)) for c in candidates)
    return [
        make_extension(model, c, subset, tried)
        for c in candidates
        for subset in list_subsets(c.effect, by_run)
    ]


def _count_alternatives(candidate: Candidate, subsets: Sequence[tuple[int, ...]]) -> float:
    """Alternatives that a candidate is: one where every joint may have the effect, else shapes by subset."""
    effect = candidate.effect
    if effect.standard:
        return 1.0
    shapes = effect.count_alternatives(len(candidate.shapes)) * candidate.tried
    return sum(shapes if effect.shape_of(subset) or not effect.shape else 1.0 for subset in subsets)


def make_extension(
    model: Model, candidate: Candidate, subset: tuple[int, ...], tried: float, shape: int | None = None
) -> Extension:
    """A candidate with some coefficients conditional on a model, at its best shape or at a given one."""
    added = model.fit.add(candidate, subset)
    s = int(np.argmax(added.gain)) if shape is None else shape
    beta, own = added.beta[s], added.own[s]
    power = max(float(beta @ own @ beta), 1e-300)
    sine = float(np.sqrt(max(float(beta @ added.inner[s] @ beta), 0.0) / power))
    term = Term(candidate, subset, s, tried)
    refusal = _refuse(model.problem, term, beta, own)
    if not refusal and candidate.penalty is None and sine < 1e-3:
        refusal = _CANCELLED
    return Extension(term, beta, float(added.gain[s]), sine, refusal)


def _refuse(problem: Problem, term: Term, beta: np.ndarray, own: np.ndarray) -> str:
    """Why coefficients (m,), with their Gram matrix (m, m), are not believed; empty where they are."""
    made = term.model_term
    values = (*beta.tolist(), *made.shape)
    if not all(low <= x <= high for x, (low, high) in zip(values, problem.bounds(made), strict=True)):
        return UNBELIEVABLE
    if abs(float(beta[0])) < made.effect.least_size(problem.joined):
        return "smaller than can be believed"
    parts, power = np.maximum(np.diag(own), 0.0) * beta**2, max(float(beta @ own @ beta), 1e-300)
    free = term.candidate.penalty is None
    return _CANCELLED if free and np.sqrt(parts / power).max() > _CANCELS else ""


def rank_pairs(model: Model, extensions: Sequence[Extension]) -> list[tuple[Term, Term]]:
    """Pairs of extensions of different effects that hide each other; those that hide most come first.

    Two terms hide each other where they gain more together, on all rows, than the sum of their gains alone.
    """
    terms = [o.term for o in extensions]
    inner, reduced, spans = model.fit.project(terms)
    count, most = len(reduced), max((len(t.subset) for t in terms), default=0)
    # Terms with fewer coefficients are filled up with some that gain nothing.
    every = np.eye(count + 2 * most)
    every[:count, :count] = inner
    score = np.concatenate([reduced, np.zeros(2 * most)])
    fill = count + np.arange(2 * most).reshape(2, most)
    places = [np.array([np.r_[s, one[s.stop - s.start :]] for s in spans]) for one in fill]
    pairs = [(k, j) for k, j in combinations(range(len(terms)), 2) if terms[k].effect is not terms[j].effect]
    if not pairs:
        return []
    k, j = np.array(pairs).T
    own = np.concatenate([places[0][k], places[1][j]], axis=1)
    beta = np.linalg.solve(every[own[:, :, None], own[:, None]], score[own][..., None])[..., 0]
    alone, sizes = (
        np.array(x) for x in zip(*[(o.gain, len(o.term.subset)) for o in extensions], strict=True)
    )
    more = ((score[own] * beta).sum(axis=1) - alone[k] - alone[j]) / np.sqrt(sizes[k] + sizes[j])
    return [
        (terms[pairs[o][0]], terms[pairs[o][1]]) for o in np.argsort(-more, kind="stable") if more[o] > 0.0
    ]


def is_believable(model: Model, term: Term) -> bool:
    """Whether a term's parameters are believed in a whole model."""
    beta = model.fit.coefficients(term)
    return not _refuse(model.problem, term, beta, model.fit.measure(term))


def is_beyond(model: Model, term: Term, most_rows: float) -> bool:
    """Whether a coefficient lies outside its believable bounds by more than twice its standard error."""
    beta, error = model.fit.coefficients(term), 2.0 * model.fit.errors(term, most_rows)
    low, high = np.array(model.problem.bounds(term.model_term)[: len(beta)]).T
    return bool(np.any((beta + error < low) | (beta - error > high)))


def may_gain(score: Score, model: Model, extension: Extension) -> bool:
    """Whether what an extension gains on the rows it is fitted on could outweigh its cost at all."""
    fit, policy = model.fit, score.policy
    joints = list(extension.term.candidate.joints)
    loss = float((fit.fitted[joints] * fit.weight[joints]).min())
    most = 0.5 * policy.most_rows * len(joints) * -np.log(max(1.0 - extension.gain / max(loss, 1e-300), 1e-6))
    # With a body, the links' parameters may also come closer to their prior.
    relief = 0.5 * extension.gain if extension.term.effect.spread else 0.0
    return bool(
        max(most, relief) > score.odds(extension.term) + 0.5 * score.count(extension.term) * np.log(30.0)
    )
