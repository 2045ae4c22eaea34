"""The state of a search: its problem, the scale of what is left, and what can be asked of a model."""

from collections.abc import Callable, Iterable, Sequence
from copy import copy
from dataclasses import replace

import numpy as np

from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen, find_reach
from wearscope.closed_loop.selection.delays import is_lag, lags_away_from_reversals, lags_slow_torque
from wearscope.closed_loop.selection.evidence import (
    Evidence,
    Found,
    Refusal,
    adjust_p_values,
    on_same_folds,
    weigh,
)
from wearscope.closed_loop.selection.forms import Forms
from wearscope.closed_loop.selection.offers import identify, list_candidates, list_subsets, tell_candidates
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.reversal import REVERSAL, is_exact, refine_reversals
from wearscope.closed_loop.selection.shape_fit import refine
from wearscope.closed_loop.selection.significance import make_flips
from wearscope.closed_loop.selection.whitening import does_drift_explain
from wearscope.effects.base import Effect, MeasurementEffect

#: Share of the best term's gain from which another one's shape is refined before they are compared.
NEAR = 0.5
#: Change of a reversal's width, of itself, from which models are made anew.
_SETTLED = 0.01


class Search:
    """A search for the terms that a problem's declared model lacks.

    Parameters
    ----------
    problem : Problem
    policy : Policy
    progress : callable
        Called with a line of text at each step.
    """

    def __init__(
        self, problem: Problem, policy: Policy, progress: Callable[[str], None] = lambda _: None
    ) -> None:
        self.policy, self.progress = policy, progress
        self.start_over(problem)

    def start_over(self, problem: Problem) -> None:
        """Forget all that was asked, and go on with a problem from the start."""
        self.problem = problem
        self.flips = make_flips(self.policy.flips, len(problem.layout.blocks), self.policy.seed)
        self.sigma = self.scale(())
        self.rows: list[dict] = []
        self.full: set[int] = set()
        self.no_delay: set[int] = set()
        self.left_out: frozenset[str] = frozenset()
        self.refused: dict[tuple, Refusal] = {}
        self._step = 0
        self.standard_losses = np.zeros((2, problem.prepared.n))
        self._forget_evidence()

    def _forget_evidence(self) -> None:
        self._weighed: dict[tuple, Evidence] = {}
        self._apart: dict[tuple, bool] = {}
        self._given_bodies: dict[tuple, np.ndarray] = {}
        self.forms = Forms(self.problem, self.policy)

    def go_on(self, problem: Problem) -> None:
        """Go on with another problem about the same terms."""
        self.problem = problem
        self._forget_evidence()

    def forget(self) -> None:
        """Let go of evidence and columns that are kept to save time."""
        self.problem.forget()
        self._forget_evidence()

    def scale(self, found: Sequence[Found]) -> np.ndarray:
        """Residual scale (n,) of the model with the terms found."""
        sigma = np.maximum(np.sqrt(np.mean(self.problem.target**2, axis=0)), 1e-9)
        return Assembly(self.problem.layout, self.problem.target, self._chosen(found), sigma).settle_scale()

    def _chosen(self, found: Iterable[Found]) -> tuple[Chosen, ...]:
        return (*self.problem.base, *(f.chosen for f in found))

    def assemble(self, found: Iterable[Found], standard: bool = False, held: bool = False) -> Assembly:
        """Normal equations of the declared model with the terms found, to ask about standard terms or not.

        Where reversals are `held`, without the errors of their width and form.
        """
        layout = self.problem.layout.for_standard if standard else self.problem.layout
        chosen = self._chosen(found)
        if held:
            chosen = tuple(c for c in chosen if c.candidate.effect is not REVERSAL)
        return Assembly(layout, self.problem.target, chosen, self.sigma)

    def candidates(
        self,
        assembly: Assembly,
        found: Sequence[Found],
        joints: Iterable[int],
        asks: Callable[[Effect, int], bool] = lambda effect, joint: True,
        every: bool = False,
    ) -> list[Candidate]:
        """What may be asked given a model; a joint with the most terms is left out, and remembered.

        Nothing that was left out for names with fewer parameters, unless `every` name is asked.
        """
        own = [f.joint for f in found if not f.effect.standard]
        asked = set(joints)
        full = {j for j in asked if own.count(j) >= self.policy.most_terms}
        self.full |= full
        out: Iterable[str] = () if every else self.left_out

        def is_asked(effect: Effect, joint: int) -> bool:
            return effect.name not in out and asks(effect, joint)

        return list_candidates(self.problem, assembly, sorted(asked - full), is_asked)

    def list_rivals(
        self, given: Assembly, others: Sequence[Found], joints: Sequence[int], every: bool = False
    ) -> list[Candidate]:
        """What may be asked in the place of a term that is felt at joints, of the whole robot too."""
        last = self.problem.prepared.n - 1
        made = self.candidates(
            given, others, {*joints, last}, lambda effect, joint: joint in joints or effect.per_robot, every
        )
        return [c for c in made if set(c.joints) & set(joints)]

    def weigh_all(
        self,
        assembly: Assembly,
        candidates: Iterable[Candidate],
        least: Callable[[Candidate], float] = lambda _: 0.0,
    ) -> list[Evidence]:
        """Evidence on all variants of the candidates given a model, p-values over all, judged by the rule.

        What is asked again given a model that is the same where the candidate is felt is not weighed again.

        Parameters
        ----------
        assembly : Assembly
        candidates : iterable of Candidate
        least : callable
            Reduction of the loss, on the rows that it is fitted on, below which a candidate is counted among
            those tried and not weighed.
        """
        by_run = self.problem.layout.folds.by_run
        weighed = []
        count = 0
        for candidate in candidates:
            sums = None
            for subset in list_subsets(candidate.effect, by_run):
                count += 1
                key = self._key(assembly, candidate, subset)
                e = self._weighed.get(key)
                if e is None:
                    sums = sums or assembly.sum_products(candidate)
                    if float(assembly.add(sums.select(subset)).gain.max()) < least(candidate):
                        continue
                    e = weigh(assembly, candidate, subset, self.policy, sums)
                    # Columns that are made from a residual are never asked again: kept, they fill the memory.
                    if not (candidate.effect.periodic or isinstance(candidate.effect, MeasurementEffect)):
                        self._weighed[key] = e
                weighed.append(e)
        more = count / max(len(weighed), 1)
        weighed = [replace(e, tried=e.tried * more) for e in weighed]
        compared = self.compare_whole(assembly, adjust_p_values(weighed))
        return [replace(e, refusal=self.judge(e)) for e in compared]

    def compare_whole(
        self, given: Assembly, weighed: Iterable[Evidence], found: bool = False
    ) -> list[Evidence]:
        """The same evidence with what it removes of the loss that the standard model leaves.

        Or, where a term is refused for that alone, of what is left given any form of the named terms, if it
        passes there: it is no part of theirs then.
        """
        own, standard = self.find_losses_given_bodies(given), self.standard_losses
        compared = []
        for e in weighed:
            losses = standard if e.term.effect.standard else own
            scale = self.sigma**2 / np.maximum(losses, 1e-300)
            e = replace(e, whole=max(g * scale[int(e.by_fifths), j] for j, g in e.gains.items()))
            if not e.term.effect.empirical and self.judge(e) is Refusal.IMMATERIAL:
                any_size = replace(e, whole=np.inf)
                if self.judge(any_size) is Refusal.NONE and self.passes_given_forms(given, any_size, found):
                    e = any_size
            compared.append(e)
        return compared

    def find_losses_given_bodies(self, given: Assembly) -> np.ndarray:
        """Losses (2, n) of the standard model, held out by runs and by fifths, with bodies that are named.

        Forms of friction and gears are followed by no machine exactly; a rigid body's is, so that what is
        small against a wrong mass is no part of it.
        """
        base = {id(c) for c in self.problem.base}
        terms = [c for c in given.chosen if id(c) in base or is_exact(c.candidate.effect)]
        if not self.standard_losses.any() or not any(c.candidate.effect.per_robot for c in terms):
            return self.standard_losses
        key = (frozenset((c.candidate, c.subset) for c in terms), tuple(given.sigma))
        if key not in self._given_bodies:
            standard = Assembly(given.layout, given.target, tuple(terms), given.sigma)
            self._given_bodies[key] = np.minimum(standard.joint_sums, self.standard_losses)
        return self._given_bodies[key]

    def passes_given_forms(self, given: Assembly, e: Evidence, found: bool = False) -> bool:
        """Whether a term passes the rule given any form of its joint's large terms, and is most of the rest.

        A machine's own rest at a large term is of many kinds: what removes a part of it is no effect yet.
        Of what was found that is not asked again.
        """
        key = (*self._key(given, e.chosen.candidate, e.chosen.subset), found)
        if key not in self._apart:
            own, by_run = self.forms.weigh(given, e), self.problem.layout.folds.by_run
            self._apart[key] = (
                own is not None
                and self.judge(own) is Refusal.NONE
                and (found or rule.is_beyond_chance(own, self.policy, by_run))
            )
        return self._apart[key]

    def _key(self, assembly: Assembly, candidate: Candidate, subset: tuple[int, ...]) -> tuple:
        """What evidence depends on: the candidate, and the model's terms that reach its joints."""
        terms = assembly.chosen
        reach = find_reach(terms, candidate)
        own = frozenset((t.candidate, t.subset) for t in terms if reach & set(t.candidate.joints))
        scale = tuple(float(assembly.sigma[j]) for j in sorted(reach))
        return (candidate, own, scale, subset)

    def judge(self, e: Evidence) -> Refusal:
        """Whether a term may be taken, by the rule."""
        term = e.term
        return rule.judge(
            e, self.policy, self.problem.bounds(term), self.problem.least(term),
            self.problem.layout.folds.by_run, any_form=self.problem.resembles_any(term),
        )  # fmt: skip

    def settle_reversals(self, found: list[Found], forms: bool = True) -> list[Found]:
        """Fit how the frictions reverse with the terms found, and make all anew along them."""
        old = self.problem.prepared.reversals
        fitted = refine_reversals(self.problem.prepared, self.assemble(found), forms)
        moved = fitted.differ(old, _SETTLED)
        return self.reverse_over(fitted.where(moved, old), found) if moved.any() else found

    def reverse_over(self, reversals: Reversals, found: list[Found]) -> list[Found]:
        """Make all anew along frictions that reverse in another way, and the terms found."""
        self.go_on(self.problem.reverse_over(reversals))
        return [Found(self.problem.remake(f.chosen), f.evidence) for f in found]

    def branch(self) -> "Search":
        """Another search from here on, which leaves this one as it is."""
        other = copy(self)
        other.rows, other.refused = list(self.rows), dict(self.refused)
        other.full, other.no_delay = set(self.full), set(self.no_delay)
        return other

    def adopt(self, other: "Search") -> None:
        """Go on with another search's problem, and with what it has asked."""
        self.__dict__.update(other.__dict__)
        self._forget_evidence()

    def choose(self, assembly: Assembly, able: list[Evidence], tried: int = 1) -> Evidence | None:
        """The term to add: shapes refined where they are near, drifts asked for, then the rule's choice.

        Parameters
        ----------
        assembly : Assembly
        able : list of Evidence
            What may be accepted.
        tried : int
            Models, given which the same was asked.
        """
        assembly, able = on_same_folds(assembly, able, self.policy)
        able = sorted((e for e in able if self.is_delay(assembly, e)), key=lambda e: -e.gain)
        while able and self.drifts(assembly, able[0], tried):
            able = able[1:]
        if not able:
            return None
        best = able[0]
        near = [e for e in able if e is best or (rule.touches(e, best) and e.gain > NEAR * best.gain)]
        near = [self.refine(assembly, e) for e in near]
        chosen = rule.choose(near, self.policy)
        if (
            chosen is not None
            and chosen.term.effect is not best.term.effect
            and self.drifts(assembly, chosen, tried)
        ):
            return near[0]
        return chosen

    def drifts(self, assembly: Assembly, e: Evidence, tried: int = 1) -> bool:
        """Whether a drift of what a term leaves explains it as well; `tried`: models that were asked."""
        drifts = does_drift_explain(self.problem, self.policy, self.flips, assembly, e, tried)
        if drifts:
            self.refused[identify(e)] = Refusal.DRIFTS
        return drifts

    def is_delay(self, assembly: Assembly, e: Evidence, settled: bool = False) -> bool:
        """Whether a term that delays its joint's torque is one; True of other terms.

        Parameters
        ----------
        assembly : Assembly
            The model, given which it was weighed.
        e : Evidence
        settled : bool
            Whether that is all else that was found. What is no delay then is not offered again.
        """
        if not is_lag(e.term.effect):
            return True
        speed = self.problem.at_rows("v")[:, e.joint]
        lags = e.joint not in self.no_delay and lags_away_from_reversals(assembly, e, speed, self.policy)
        if lags and settled and not lags_slow_torque(assembly, e, self.policy):
            self.no_delay.add(e.joint)
            lags = False
        if not lags:
            self.refused[identify(e)] = Refusal.NO_DELAY
        return lags

    def refine(self, assembly: Assembly, e: Evidence) -> Evidence:
        """The same term at its best continuous shape that is believable, its significance kept."""
        refined = refine(self.problem, assembly, e, self.policy)
        return e if self.judge(refined) is Refusal.BOUNDS else refined

    def weigh_again(self, given: Assembly, f: Found) -> Evidence:
        """Evidence on a term found given all others, in today's residual variances; its p-value kept.

        Gains of different scales must not be compared. What was found by fifths is asked by fifths.
        """
        made, by_fifths = f.chosen, f.evidence.by_fifths
        own = weigh(given, made.candidate, made.subset, self.policy, by_fifths=by_fifths)
        return self.compare_whole(given, [replace(own, p_value=f.evidence.p_value)], found=True)[0]

    def record(self, weighed: Sequence[Evidence], taken: Sequence[Evidence]) -> None:
        """Keep a row of each candidate for the candidates table."""
        joints = self.problem.prepared.dataset.joints
        self.rows += tell_candidates(self._step, joints, weighed, taken, self.refused)
        self._step += 1
