"""Moves that raise the score of a model: add, drop and swap terms and refine their shapes."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize

from wearscope.closed_loop.inference.delays import is_lag, lags_away_from_reversals, lags_slow_torque
from wearscope.closed_loop.inference.extensions import (
    Extension,
    is_believable,
    is_beyond,
    list_extensions,
    may_gain,
    rank_pairs,
)
from wearscope.closed_loop.inference.laws import fit_law, is_law, refine_reversals
from wearscope.closed_loop.inference.reversal import is_wide
from wearscope.closed_loop.inference.score import SURELY, Model, Score
from wearscope.closed_loop.inference.splines import Splines
from wearscope.closed_loop.inference.term import Term, find_reach
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.model.terms import make_candidate
from wearscope.effects.vocabulary import say_effect

#: Number of extensions scored at each step: those that gain most on the rows they are fitted on.
TOP = 8
#: Pairs of a joint's extensions that are scored: those that hide each other most.
_PAIRS = 6
#: Largest number of moves; far more than any model of a robot has terms.
_MOST = 200
#: Rounds in which the numbers of a shape are refined in turn.
_ROUNDS = 2
#: Relative change of a reversal's width from which columns are computed again.
_SETTLED = 0.01
_NO_DELAY = "no delay: it differs away from reversals or at low frequencies"


@dataclass
class Moves:
    """Moves that turn a model into a more probable one.

    Attributes
    ----------
    score : Score
    splines : Splines
        Structure without a name.
    progress : callable
        Called with a line of text at each move.
    refused : dict of tuple to str
        Terms that are not tried again, and why.
    left : set of frozenset
        Terms of models that were left.
    whole : set of frozenset
        Terms of models of which none is to be split.
    without : frozenset of str
        Names of effects that are not tried.
    """

    score: Score
    splines: Splines
    progress: Callable[[str], None]
    refused: dict[tuple, str] = field(default_factory=dict)
    left: set[frozenset] = field(default_factory=set)
    whole: set[frozenset] = field(default_factory=set)
    without: frozenset[str] = frozenset()

    def climb(self, model: Model) -> Model:
        """The model that no single move makes more probable.

        Models are compared two at a time, and such comparisons can lead in a circle. So no move returns to a
        model that was left.
        """
        for _ in range(_MOST):
            moved = (
                self.drop(model, lambda term: not term.effect.is_plain_friction)
                or self.add(model)
                or self.drop(model)
                or self.swap(model)
                or self.add_pair(model)
                or self.refuse_delays(model)
            )
            if moved is None:
                return model
            self.left.add(model.keys)
            model = moved
        return model

    def is_new(self, model: Model) -> bool:
        """Whether no model with the same terms was left before."""
        return model.keys not in self.left

    def drop_unbelievable(self, model: Model) -> Model | None:
        """A model without a term that the others move outside its believable bounds."""
        for term in [t for t in model.terms if is_beyond(model, t, self.score.policy.most_rows)]:
            rest = model.without(term)
            if is_complete(rest) and self.is_new(rest):
                self.progress(f"dropped {self.name(term)}: a parameter is not believed next to the others")
                return rest.rescale()
        return None

    def refuse_delays(self, model: Model) -> Model | None:
        """A model without delays that vanish at low frequencies; these are not tried again."""
        for term in (t for t in model.terms if is_lag(t.effect)):
            rest = model.without(term)
            if not lags_slow_torque(rest.fit, term):
                self.refused[term.key] = _NO_DELAY
                self.progress(f"dropped {self.name(term)}: {_NO_DELAY}")
                return rest.rescale()
        return None

    def settle(self, model: Model, forms: bool = True) -> Model:
        """The model with fitted widths and forms of reversals, and its columns along them."""
        old = model.problem.prepared.reversals
        fitted = refine_reversals(model.problem.prepared, model.fit, forms)
        moved = fitted.differ(old, _SETTLED)
        return reverse_over(model, fitted.where(moved, old)).rescale() if moved.any() else model

    def tell(self, told: str, gain: float) -> None:
        """A line on a move and its odds."""
        self.progress(f"{told}, odds {tell_odds(gain)}")

    def name(self, term: Term) -> str:
        """A term in words, with its joint."""
        what = say_effect(term.effect.name)
        joint = self.splines.prepared.dataset.joints[term.joint]
        return f"{what} of the whole robot" if term.effect.per_robot else f"{what} at {joint}"

    def drop(self, model: Model, may_go: Callable[[Term], bool] = lambda term: True) -> Model | None:
        """A model without one of the terms, where that is more probable.

        Missing terms can hide plain friction, which others refine: it is dropped only once nothing else is
        added.
        """
        for term in sorted(filter(may_go, model.terms), key=lambda t: t.effect.standard):
            rest = model.without(term)
            if not is_complete(rest) or _carries_spline(rest, term):
                continue
            gain = self.score.compare(model, rest)
            if gain > -_demand(term):
                self.tell(f"dropped {self.name(term)}", gain)
                return rest.rescale()
        return None

    def prune(self, model: Model) -> Model:
        """A model without all terms whose removal makes it more probable."""
        while (rest := self.drop(model)) is not None:
            model = rest
        return model

    def add(self, model: Model) -> Model | None:
        """A model with the best further term at each group of coupled joints, where that is more probable."""
        n = model.problem.prepared.n
        extensions = self.list_extensions(model, range(n))
        taken, reached = model, set[int]()
        for group in _list_groups(model):
            own = [o for o in extensions if group & set(o.term.candidate.joints)]
            tried = [(None, *self.choose(model, own[: 2 * TOP], model)), *self.enrich(model, group)]
            poorer, best, gain = max(tried, key=lambda one: one[2])
            joints = find_reach(model.fit.terms, best.candidate.joints) if best else set()
            if best is None or joints & reached:
                continue
            reached |= joints
            told = "added {}" if poorer is None else "{} takes further parameters"
            self.tell(told.format(self.name(best)), gain)
            rest = taken if poorer is None else taken.without(poorer)
            taken = self.refine(rest.extend(best), best)
        return taken.rescale() if taken is not model else None

    def enrich(self, model: Model, group: set[int]) -> list[tuple[Term, Term | None, float]]:
        """Each term at some joints with the best of its richer forms, and how much that raises the score."""
        found = []
        for term in [t for t in model.terms if group & set(t.candidate.joints)]:
            rest = model.without(term)
            found.append((term, *self.choose(rest, _list_richer(rest, term), model)))
        return found

    def add_pair(self, model: Model) -> Model | None:
        """A model with two more terms at a joint that hide each other, where that is more probable."""
        best, most = None, 2.0 * SURELY
        for joint in range(model.problem.prepared.n):
            extensions = [o for o in self.list_every_extension(model, [joint]) if not o.refusal]
            for one, two in rank_pairs(model, extensions)[:_PAIRS]:
                made = model.extend(one).extend(two)
                if not self.is_new(made):
                    continue
                gain = self.score.compare(model, made)
                sound = gain > most and self.is_sound(model, made, one) and self.is_sound(model, made, two)
                if sound:
                    best, most = made, gain
        if best is None:
            return None
        one, two = best.terms[-2:]
        self.tell(f"added {self.name(one)} and {self.name(two)}", most)
        return self.refine(self.refine(best, one), two).rescale()

    def swap(self, model: Model) -> Model | None:
        """A model with another term in the place of one, where that is more probable."""
        last = model.problem.prepared.n - 1
        for term in [t for t in model.terms if not t.effect.is_in_every_drive]:
            rest = model.without(term)
            if not is_complete(rest):
                continue
            reach = find_reach(rest.fit.terms, term.candidate.joints)
            extensions = [
                o
                for o in self.list_extensions(rest, sorted(reach | {last}))
                if o.term.key != term.key and set(o.term.candidate.joints) & reach
            ]
            best, gain = self.choose(rest, extensions[:TOP], model)
            if best is not None and gain > SURELY:
                self.tell(f"{self.name(term)} is replaced by {self.name(best)}", gain)
                return self.refine(rest.extend(best), best).rescale()
        return None

    def split(self, model: Model) -> Model:
        """The model, or one with several terms in the place of one of the whole robot, if more probable.

        Such a term has many parameters, and can imitate effects of several joints that each explain a part.
        """
        if model.keys in self.whole:
            return model
        self.whole.add(model.keys)
        for term in [t for t in model.terms if t.effect.per_robot and t.effect.name not in self.without]:
            rest = model.without(term)
            apart = replace(self, without=self.without | {term.effect.name}, left=set(self.left))
            tried = apart.climb(rest)
            gain = self.score.compare(model, tried)
            if gain > SURELY and self.is_new(tried):
                self.tell(f"{self.name(term)} is replaced by several effects", gain)
                self.left.add(model.keys)
                return self.climb(tried)
        return model

    def list_every_extension(self, model: Model, joints: Iterable[int]) -> list[Extension]:
        """Offers of effects that are not left out."""
        wanted = (lambda effect, _: effect.name not in self.without) if self.without else None
        return list_extensions(model, joints, wanted)

    def list_extensions(self, model: Model, joints: Iterable[int]) -> list[Extension]:
        """Those that may gain."""
        return [o for o in self.list_every_extension(model, joints) if may_gain(self.score, model, o)]

    def choose(
        self, base: Model, extensions: Iterable[Extension], reference: Model
    ) -> tuple[Term | None, float]:
        """The extension that makes a model most probable, and by how many nats more than a reference."""
        best, most = None, 0.0
        for extension in extensions:
            if extension.refusal:
                continue
            made = base.extend(extension.term)
            if not self.is_new(made):
                continue
            gain = self.score.compare(reference, made)
            if gain > max(most, _demand(extension.term)) and self.is_sound(base, made, extension.term):
                best, most = extension.term, gain
        return best, most

    def is_sound(self, given: Model, made: Model, term: Term) -> bool:
        """Whether a term's parameters are believed in the whole model; a delay's away from reversals too."""
        if term.key in self.refused or not is_believable(made, term):
            return False
        if not is_lag(term.effect):
            return True
        speed = given.problem.at_rows("v")[:, term.joint]
        if lags_away_from_reversals(given.fit, term, speed):
            return True
        self.refused[term.key] = _NO_DELAY
        return False

    def refine(self, model: Model, term: Term) -> Model:
        """The model with a term's continuous shape where it fits best."""
        rest = model.without(term)
        fine = refine_shape(rest, term)
        made = rest.extend(fine)
        return made if fine is term or is_believable(made, fine) else model

    def suit_laws(self, model: Model) -> Model:
        """The model with the most probable laws of friction, each with the reversal that suits it."""
        prepared = model.problem.prepared
        for joint in np.flatnonzero(prepared.moving).tolist():
            own = [t for t in model.terms if t.joint == joint]
            # An offset acts like friction that differs by direction, except where the joint reverses.
            offsets = [t for t in own if t.effect.is_offset]
            wide = prepared.reversals.width[joint] > 0.0
            laws = [t for t in own if is_law(t.effect)] if wide else []
            none: list[Term | None] = [None] if wide and self.needs_law(model, joint) else []
            for term in [*offsets, *(laws or none)]:
                # Where another reversal was taken over, the model's terms were made again along it.
                now = next((t for t in model.terms if term is not None and t.key == term.key), None)
                if term is None or now is not None:
                    model = self.suit_law(model, joint, now)
        return model

    def needs_law(self, model: Model, joint: int) -> bool:
        """Whether a joint's reversal is wider than drives have, or a law gains more than the form error."""
        extensions = list_extensions(model, [joint], lambda effect, _: is_law(effect))
        share = self.score.policy.form_error * model.fit.fitted[joint] * model.fit.weight[joint]
        wide = is_wide(model.problem.prepared, joint)
        return wide or any(o.gain > share for o in extensions)

    def suit_law(self, model: Model, joint: int, term: Term | None) -> Model:
        """The model with the most probable law in the place of a joint's, and its reversal."""
        problem, best, most = model.problem, model, SURELY
        rest = model if term is None else model.without(term)
        extensions = {
            o.term.effect.name: o.term for o in list_extensions(rest, [joint], lambda e, _: is_law(e))
        }
        for law_term in extensions.values():
            effect = law_term.effect
            shapes = effect.shapes(problem.joined, joint)
            fitted = fit_law(problem.prepared, model.fit, joint, term, effect, shapes)
            if fitted is None:
                continue
            shape, reversals = fitted
            along = reverse_over(rest, reversals)
            candidate = make_candidate(effect, joint, along.problem.prepared, shape[None])
            law = Term(candidate, tuple(range(candidate.count)), 0, law_term.alternatives)
            made = along.extend(law).rescale()
            gain = self.score.compare(model, made)
            if gain > most and self.is_sound(along, made, law):
                best, most = made, gain
        if best is not model:
            self.tell(f"added {self.name(best.terms[-1])}, with a reversal of its own", most)
        return best

    def explain_rest(self, model: Model) -> Model:
        """The model with splines where no name explains what is left, or one does better than a name."""
        for joint in np.flatnonzero(model.problem.prepared.moving).tolist():
            for _ in range(_MOST):
                moved = self.add_spline(model, joint)
                if moved is None:
                    break
                model = self.climb(moved)
        return model

    def add_spline(self, model: Model, joint: int) -> Model | None:
        """A model with a spline at a joint, added or in the place of a name, where that is more probable."""
        names = [
            t
            for t in model.terms
            if t.joint == joint and not (t.effect.is_in_every_drive or t.effect.empirical)
        ]
        for base, name in [(model, None), *((model.without(t), t) for t in names)]:
            if not is_complete(base):
                continue
            best, most = None, 0.0
            for spline in self.splines.list_terms(base, joint, self.score, past=name is not None):
                made = base.extend(spline)
                if not self.is_new(made):
                    continue
                gain = self.score.compare(model, made)
                share = 1.0 - made.fit.held_out[joint] / max(base.fit.held_out[joint], 1e-300)
                if gain > max(most, SURELY) and share >= self.score.policy.structure_share:
                    best, most = made, gain
            if best is not None:
                instead = "" if name is None else f" in the place of {self.name(name)}"
                self.tell(f"added {self.name(best.terms[-1])}{instead}", most)
                self.left.add(model.keys)
                return best.rescale()
        return None


def tell_odds(gain: float) -> str:
    """Odds of a gain in nats."""
    most = 1000.0
    return f"over {most:.0f} to 1" if gain > np.log(most) else f"{np.exp(gain):.2g} to 1"


def _demand(term: Term) -> float:
    """Nats by which a term must raise the score."""
    return 0.0 if term.effect.is_in_every_drive else SURELY


def is_complete(model: Model) -> bool:
    """Whether for each term that refines another the model has that other term."""
    given, base = model.problem.given, model.problem.base
    for term in model.terms:
        others = [t.effect for t in (*base, *model.terms) if t.joint == term.joint and t is not term]
        if not term.effect.empirical and not term.effect.has_parent([*given, *others]):
            return False
    return True


def _carries_spline(rest: Model, term: Term) -> bool:
    """Whether a term is plain friction of a joint with a spline, which would take its place."""
    return term.effect.is_in_every_drive and any(
        t.effect.empirical for t in rest.terms if t.joint == term.joint
    )


def _list_richer(rest: Model, term: Term) -> list[Extension]:
    """Forms of a term with further coefficients, conditional on a model without it."""
    if len(term.subset) >= len(term.effect.coefficients):
        return []
    forms = list_extensions(rest, [term.joint], lambda effect, _: effect.name == term.effect.name)
    return [o for o in forms if set(o.term.subset) > set(term.subset)]


def _list_groups(model: Model) -> list[set[int]]:
    """Joints that a model couples, as sets."""
    groups: list[set[int]] = []
    for joint in range(model.problem.prepared.n):
        if not any(joint in group for group in groups):
            groups.append(find_reach(model.fit.terms, [joint]))
    return groups


def reverse_over(model: Model, reversals: Reversals) -> Model:
    """The same terms along frictions that reverse in another way."""
    problem = model.problem.reverse_over(reversals)
    return Model(problem, tuple(problem.remake(t) for t in model.terms), model.sigma)


def refine_shape(given: Model, term: Term) -> Term:
    """A term at the continuous shape that fits best with a model, from the best value of its grid on.

    Parameters
    ----------
    given : Model
        Without the term.
    term : Term
    """
    effect, joint, problem = term.effect, term.joint, given.problem
    fixed = effect.selects_signals or effect.empirical or not effect.shape_of(term.subset)
    if effect.search is None or fixed:
        return term
    grid = effect.shapes(problem.joined, joint)
    estimated = effect.estimated_shapes(term.subset)
    shape = np.array(term.model_term.shape)

    def make(tried: np.ndarray) -> Term:
        candidate = make_candidate(effect, joint, problem.prepared, tried[None])
        return replace(term, candidate=candidate, shape=0)

    def lose(tried: np.ndarray) -> float:
        made = make(tried)
        return -float(given.fit.add(made.candidate, made.subset).gain[0])

    start = lose(shape)
    least = start
    # The search is in the logarithm, so parameters that may be zero or negative stay as they are.
    varied = (np.ptp(grid, axis=0) > 0.0) & (grid.min(axis=0) > 0.0) & (shape > 0.0)
    free = [k for k in sorted(range(len(shape)), key=lambda k: k not in estimated) if varied[k]]
    for k in free * (_ROUNDS if len(free) > 1 else 1):
        low, high = np.log(grid[:, k].min() / shape[k]), np.log(grid[:, k].max() / shape[k])
        if k in estimated[:1]:
            width = effect.width(problem.joined, joint, shape.tolist())
            low, high = np.clip((low, high), -width, width)
        unit = np.arange(len(shape)) == k
        found = optimize.minimize_scalar(
            lambda x, at=shape, unit=unit: lose(at * np.exp(x * unit)),
            bounds=(low, high), method="bounded", options={"maxiter": 10, "xatol": 1e-3 * (high - low)},
        )  # fmt: skip
        if found.fun < least:
            shape, least = shape * np.exp(found.x * unit), float(found.fun)
    return make(shape) if least < start else term


def list_alternatives(moves: Moves, model: Model, term: Term) -> list[tuple[float, Term, Model]]:
    """Other terms in the place of one, by how many nats more probable they make the model."""
    rest = model.without(term)
    if not is_complete(rest):
        return []
    last = model.problem.prepared.n - 1
    joints: Sequence[int] = range(last + 1) if term.effect.spread else sorted({term.joint, last})
    felt = set(term.candidate.joints)
    extensions = [
        o
        for o in list_extensions(rest, joints)
        if o.term.effect.name != term.effect.name and felt & set(o.term.candidate.joints) and not o.refusal
    ]
    made = [(o.term, rest.extend(o.term)) for o in extensions[: 2 * TOP]]
    return [(moves.score.compare(model, m), t, m) for t, m in made if moves.is_sound(rest, m, t)]
