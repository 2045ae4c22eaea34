"""From a problem to its names, each with its odds and equivalents, and what is left."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd

from wearscope.closed_loop.inference.detection_limits import find_limits
from wearscope.closed_loop.inference.extensions import (
    UNBELIEVABLE,
    Extension,
    list_candidates,
    list_extensions,
    make_extension,
)
from wearscope.closed_loop.inference.gram import ROUNDING
from wearscope.closed_loop.inference.motion_dependence import Dependence, find_dependence
from wearscope.closed_loop.inference.moves import (
    SURELY,
    Moves,
    list_alternatives,
    tell_odds,
)
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.score import Model, Score
from wearscope.closed_loop.inference.splines import PAST, Splines
from wearscope.closed_loop.inference.term import Term
from wearscope.closed_loop.model.terms import make_candidate
from wearscope.effects.base import MeasurementEffect
from wearscope.effects.vocabulary import say_effect

#: Largest number of rounds in which names and reversals are settled in turn.
_TURNS = 3


@dataclass(frozen=True, eq=False)
class Found:
    """A term that the declared model lacks.

    Attributes
    ----------
    term : Term
    share : float
        Of the held-out loss at its joint that it removes.
    probability : float
        Of its name, among all that were tried in its place and none.
    equivalent : list of str
        Names whose odds are as good or nearly.
    """

    term: Term
    share: float
    probability: float
    equivalent: list[str]


@dataclass(frozen=True)
class Left:
    """Residual at a joint that a term could explain which was not accepted.

    Attributes
    ----------
    share : float
        Of the held-out loss.
    depends_on : list of str
        Signals.
    reason : str
    """

    share: float
    depends_on: list[str]
    reason: str


@dataclass(frozen=True)
class Answer:
    """Result of a search.

    Attributes
    ----------
    model : Model
        The most probable one.
    score : Score
    sigma : ndarray (n,)
        Residual scale by joint, with all terms that the search found.
    refused : dict of int to Left
        By joint, what the search found and could not take.
    """

    model: Model
    score: Score
    sigma: np.ndarray = field(repr=False)
    refused: dict[int, Left]
    _moves: Moves = field(repr=False)
    _first: Model = field(repr=False)
    _past: list[Term] = field(repr=False)

    @cached_property
    def found(self) -> list[Found]:
        """The model's terms; no model can hold the past, but names are judged next to it."""
        whole = self.model.has([*self.model.terms, *self._past])
        return [_judge(self._moves, whole, t) for t in self.model.terms]

    def without(self, terms: Sequence[Term], why: str) -> "Answer":
        """The answer whose model lacks some terms; what they explain is then told as left."""
        if not terms:
            return self
        moves = replace(self._moves, refused=self._moves.refused | {t.key: why for t in terms})
        rest = self.model.has([t for t in self.model.terms if t not in terms]).rescale()
        return replace(self, model=rest, _moves=moves)

    @cached_property
    def _rest(self) -> tuple[dict[int, Left], dict[int, str]]:
        return _suspect_rest(self._moves, self.model, self._list_open(self.refused))

    def _list_open(self, left: dict[int, Left]) -> list[int]:
        """Joints that move and of whose residual nothing is known yet."""
        return [j for j in np.flatnonzero(self.problem.prepared.moving).tolist() if j not in left]

    @property
    def suspected(self) -> dict[int, str]:
        """By joint, a sentence on names that would explain much, and whose odds are too low."""
        return self._rest[1]

    @cached_property
    def left(self) -> dict[int, Left]:
        """By joint, what a term or the motion could explain of the residual."""
        left = self.refused | self._rest[0]
        found = find_dependence(self.problem, self.model.fit, self._list_open(left), self.score.policy)
        return left | {j: _tell_dependence(one) for j, one in found.items()}

    @cached_property
    def candidates(self) -> pd.DataFrame:
        """Every candidate conditional on the first and on the last model."""
        tables = [_tabulate(self._moves, one, step) for step, one in enumerate((self._first, self.model))]
        return pd.concat(tables, ignore_index=True)

    @property
    def problem(self) -> Problem:
        """The problem, along the reversals that were found."""
        return self.model.problem

    @cached_property
    def limits(self) -> list[dict[str, float]]:
        """By joint, the share of its torque below which each effect gets no name."""
        return find_limits(self.model, self.score)


def find_terms(
    problem: Problem,
    policy: Policy,
    progress: Callable[[str], None] = lambda _: None,
    start: Model | None = None,
) -> Answer:
    """Terms that a declared model lacks, with names, from the training runs.

    Parameters
    ----------
    problem : Problem
    policy : Policy
    progress : callable
        Called with a line of text at each move.
    start : Model, optional
        Of the same machine along other data, from whose terms the search goes on.

    Returns
    -------
    Answer
    """
    n = problem.prepared.n
    scale = np.maximum(np.sqrt(np.mean(problem.target**2, axis=0)), 1e-9)
    bare = Model(problem, (), scale)
    standard = [
        Term(c, tuple(int(k) for k in c.effect.subsets()[0]))
        for c in list_candidates(bare, range(n), lambda effect, _: effect.standard)
    ]
    splines = Splines(problem.prepared, problem.joined)
    score = Score(policy, problem.gram.layout)
    model = Moves(score, splines, progress).settle(bare.has(standard).rescale().rescale(), forms=False)
    score = Score(policy, problem.gram.layout, model)
    moves = Moves(score, splines, progress)
    first = model
    if start is not None:
        model = moves.settle(take_over(model.problem, start).rescale().rescale())
    for _ in range(_TURNS):
        before = {t.key for t in model.terms}
        model = moves.settle(moves.suit_laws(moves.split(moves.climb(model))))
        if {t.key for t in model.terms} == before:
            rest = moves.drop_unbelievable(model)
            if rest is None:
                break
            model = rest
    model = moves.settle(moves.explain_rest(model))
    past = [t for t in model.terms if t.effect.name == PAST.name]
    left = {t.joint: _tell_past(problem, model, t) for t in past}
    model = moves.prune(model.has([t for t in model.terms if t.effect.name != PAST.name]))
    model, unbelievable = _compare_unbelievable(moves, model)
    left |= unbelievable
    model = model.has(_join_parts(model.terms))
    return Answer(model, score, model.fit.settle_scale(), left, moves, first, past)


def take_over(problem: Problem, start: Model) -> Model:
    """The terms of another model of the same machine, made along a problem's data.

    An error of the recording acts on the torque that the other terms predict, so it comes last.
    """
    terms: list[Term] = []
    errors = [t for t in start.terms if t.model_term.is_measurement_error]
    for term in (t for t in start.terms if not t.model_term.is_measurement_error):
        shape = np.array(term.model_term.shape)
        made = make_candidate(term.effect, term.joint, problem.prepared, shape[None])
        made = replace(made, penalty=term.candidate.penalty)
        if term.effect.empirical:
            made = replace(made, rows=(made.rows[0][:, : len(term.subset)],))
        if made.joints:
            terms.append(replace(term, candidate=made, shape=0))
    model = Model(problem, tuple(terms), start.sigma)
    for term in errors:
        late = any(one.effect is term.effect and one.joint == term.joint for one in problem.late)
        if not late:
            assert isinstance(term.effect, MeasurementEffect)
            made = problem.measurement_candidate(term.effect, term.joint, model.fit)
            best = int(np.argmax(model.fit.add(made, term.subset).gain))
            model = model.extend(replace(term, candidate=made, shape=best))
    return model


def _share(given: Model, made: Model, joints: Sequence[int]) -> float:
    """Largest share of another model's held-out loss that one model removes at a joint."""
    lost, left = given.fit.held_out, made.fit.held_out
    return max(float(1.0 - left[j] / max(lost[j], 1e-300)) for j in joints)


def _join_parts(terms: Sequence[Term]) -> list[Term]:
    """Terms; those with the same effect, shape and joint are joined, as a search may find parts in turn."""
    parts: dict[tuple, list[Term]] = {}
    for term in terms:
        parts.setdefault((term.model_term.label, term.model_term.shape), []).append(term)
    every = {key: tuple(sorted({k for t in some for k in t.subset})) for key, some in parts.items()}
    return [replace(some[0], subset=every[key]) for key, some in parts.items()]


def _judge(moves: Moves, model: Model, term: Term) -> Found:
    """A term with its odds against all alternatives that were tried in its place."""
    rest = model.without(term)
    share = _share(rest, model, term.candidate.joints)
    against = [moves.score.compare(model, rest)]
    equivalent = []
    if not (term.effect.is_in_every_drive or term.effect.empirical):
        values = _count_values(model, term)
        for gain, other, made in list_alternatives(moves, model, term):
            against.append(gain)
            simpler = _count_values(made, other) <= values
            # A richer effect often fits as well as the one that it contains.
            alike = simpler and not _is_told_apart(model, made, other)
            if gain > -moves.score.policy.name_odds or alike:
                equivalent.append(other.effect.name)
    odds = float(np.sum(np.exp(np.clip(against, -700.0, 700.0))))
    return Found(term, share, 1.0 / (1.0 + odds), list(dict.fromkeys(equivalent)))


def _count_values(model: Model, term: Term) -> int:
    """Fitted values of a term, at most as many as the motion determines."""
    measured = model.fit.measure(term)
    size = np.sqrt(np.maximum(np.diag(measured), 1e-300))
    rank = int(np.linalg.matrix_rank(measured / np.outer(size, size), tol=ROUNDING, hermitian=True))
    return min(term.effect.complexity(term.subset), rank + term.effect.complexity(()))


def _is_told_apart(better: Model, worse: Model, term: Term) -> bool:
    """Whether two models' held-out losses differ by more than twice the standard error, by blocks."""
    layout = better.problem.gram.layout
    change = np.zeros(len(layout.blocks))
    for j in term.candidate.joints:
        squares = [(m.fit.leave_held_out(j) ** 2) * layout.keep[:, j] for m in (better, worse)]
        change += layout.sum_blocks(squares[1] - squares[0]) * better.fit.weight[j]
    error = float(np.sqrt(len(change) * max(float(change.var(ddof=1)), 1e-300)))
    return bool(change.sum() >= 2.0 * error)


def _tell_past(problem: Problem, model: Model, term: Term) -> Left:
    joints = problem.prepared.dataset.joints
    depends = [name.format(joint=joints[term.joint]) for name in term.effect.depends_on]
    share = _share(model.without(term), model, [term.joint])
    told = f"it depends on the past of {', '.join(depends)}, which no model holds"
    return Left(share, depends, told)


def _tell_dependence(one: Dependence) -> Left:
    on = f"{'the past of ' if one.past else ''}{', '.join(one.depends_on)}"
    return Left(one.share, one.depends_on, f"it depends on {on}, as no noise of its kind does")


def _compare_unbelievable(moves: Moves, model: Model) -> tuple[Model, dict[int, Left]]:
    """The model without the names at a joint that one effect of unbelievable size explains better.

    Such names only divide that one effect among them: the joint stays open, and the effect is reported.
    """
    left, quiet = {}, replace(moves, progress=lambda _: None)
    joints = model.problem.prepared.dataset.joints
    for joint in sorted({t.joint for t in model.terms if not (t.effect.standard or t.effect.empirical)}):
        own = [t for t in model.terms if t.joint == joint and not (t.effect.standard or t.effect.empirical)]
        rest = model.has([t for t in model.terms if t not in own])
        # Other names at the joint may be right: those stay that are still needed next to the one effect.
        tried = [(base, o) for base in (rest, model) for o in list_extensions(base, [joint])]
        for base, extension in ((base, o) for base, o in tried if o.refusal == UNBELIEVABLE):
            term, made = extension.term, base.extend(extension.term)
            if moves.score.compare(model, made) <= SURELY:
                continue
            made = quiet.prune(made)
            divided = [t for t in own if t not in made.terms]
            if divided and term in made.terms:
                depends = term.effect.name_signals(term.model_term.shape, joints, joint)
                told = f"{say_effect(term.effect.name)} would explain it: {extension.refusal}"
                share = _share(made.without(term), made, [joint])
                left[joint] = Left(share, list(dict.fromkeys(depends)), told)
                model = moves.prune(model.has([t for t in model.terms if t not in divided]).rescale())
                break
    return model, left


def _suspect_rest(
    moves: Moves, model: Model, joints: Sequence[int]
) -> tuple[dict[int, Left], dict[int, str]]:
    """By joint, candidates that would explain the rest but are not believed; a sentence on low odds."""
    problem, policy = model.problem, moves.score.policy
    names = problem.prepared.dataset.joints
    left: dict[int, Left] = {}
    suspected: dict[int, str] = {}
    for joint in joints:
        able = []
        for extension in list_extensions(model, [joint]):
            loss = model.fit.fitted[joint] * model.fit.weight[joint]
            if extension.gain < policy.structure_share * loss or extension.term.effect.standard:
                continue
            made = model.extend(extension.term)
            share, gain = _share(model, made, [joint]), moves.score.compare(model, made)
            if share < policy.structure_share:
                continue
            effect = extension.term.effect
            if extension.refusal and gain > 0.0 and joint not in left:
                depends = effect.name_signals(extension.term.model_term.shape, names, joint)
                told = f"{say_effect(effect.name)} would explain it: {extension.refusal}"
                left[joint] = Left(share, list(dict.fromkeys(depends)), told)
            elif not extension.refusal and gain + moves.score.find_odds(made, extension.term) > 0.0:
                able.append((share, say_effect(effect.name), gain))
        if able and joint not in left:
            share, _, gain = max(able)
            likely = dict.fromkeys(name for _, name, _ in sorted(able, reverse=True))
            suspected[joint] = (
                f"{' or '.join(likely)} would remove {100 * share:.0f} % of the squared error that is left; "
                f"that is too uncertain for a name (odds against it: {tell_odds(max(-gain, 0.0))}), and "
                "longer or more training runs can decide it"
            )
        for spline in moves.splines.list_terms(model, joint, moves.score, every=True):
            made = model.extend(spline)
            share, gain = _share(model, made, [joint]), moves.score.compare(model, made)
            if gain > 0.0 and share >= policy.structure_share and joint not in left:
                signals = spline.effect.name_signals(spline.model_term.shape, names, joint)
                depends = list(dict.fromkeys(signals))
                told = f"structure in {', '.join(depends)}: too few runs to show that it carries over"
                left[joint] = Left(share, depends, told)
    return left, {j: told for j, told in suspected.items() if j not in left}


def _tabulate(moves: Moves, model: Model, step: int) -> pd.DataFrame:
    """Each candidate conditional on a model: gain on held-out runs, and why it was taken or not."""
    joints = model.problem.prepared.dataset.joints
    rows = []
    taken = {t.key for t in model.terms}
    every = [*_list_taken(model), *((model, o) for o in list_extensions(model, range(len(joints))))]
    for given, extension in every:
        term = extension.term
        made = given.extend(term)
        gain = moves.score.compare(given, made)
        joints_felt = list(term.candidate.joints)
        better = (made.fit.by_fold - given.fit.by_fold)[joints_felt].sum(axis=0) < 0.0
        refusal = extension.refusal or moves.refused.get(term.key, "")
        rows.append(
            {
                "step": step,
                "joint": joints[term.joint],
                "effect": term.effect.name,
                "coefficients": " ".join(term.effect.coefficients[k].name for k in term.subset),
                "shape": " ".join(f"{v:.6g}" for v in term.model_term.shape),
                "cv_gain": _share(given, made, term.candidate.joints),
                "p_value": float(1.0 / (1.0 + np.exp(np.clip(gain, -700.0, 700.0)))),
                "agreement": float(np.mean(better)),
                "isolability": extension.sine,
                "taken": term.key in taken,
                "reason": "taken"
                if term.key in taken
                else (refusal or f"its odds are too low: {tell_odds(gain)}"),
            }
        )
    columns = "step joint effect coefficients shape cv_gain p_value agreement isolability taken reason"
    return pd.DataFrame(rows, columns=columns.split())


def _list_taken(model: Model) -> list[tuple[Model, Extension]]:
    """Each of a model's terms as an extension to the model without it."""
    apart = [(model.without(t), t) for t in model.terms]
    return [(rest, make_extension(rest, t.candidate, t.subset, t.alternatives, t.shape)) for rest, t in apart]
