"""The score: by how many nats one whole model is more probable than another.

    ln BF = sum_j nu_j / 2 * ln((L_j(a) + f_j) / (L_j(b) + f_j)) + (E(a) - E(b)) / 2 - (cost(b) - cost(a))

- L_j: loss of joint j on rows that are held out: runs in turn, or fifths where there are fewer than three.
- f_j: form error, a share of what the standard model leaves there (`Score.find_form`).
- nu_j: independent rows in the direction in which the two models differ there: rows over the design effect of
  that direction, and no more than `most_rows`.
- E: squared size of named payloads and link errors, in standard deviations of what is expected of them.
- cost: ln(nu) / 2 a coefficient (Schwarz 1978), the logarithm of the alternatives tried at the joint (Chen
  and Chen 2008, Biometrika 95), and the odds against what not every drive has.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from wearscope.closed_loop.inference.gram import Fit
from wearscope.closed_loop.inference.layout import Layout
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.term import Term
from wearscope.effects.base import BalancerEffect, WaveEffect

#: Nats by which a name must raise the score, on top of its prior odds; prior odds for what every drive has.
SURELY = 1.0
#: A model this many nats behind is improbable enough to end the comparison early.
_HOPELESS = -8.0
#: Number of coefficients that a height of a penalised spline counts as.
_SPLINE = 0.5
#: Number of coefficients that a searched shape counts as: half of its values are no better than the others.
_SHAPE = 0.5


@dataclass(frozen=True, eq=False)
class Model:
    """The declared model with terms, fitted.

    Attributes
    ----------
    problem : Problem
    terms : tuple of Term
        In addition to the declared ones.
    sigma : ndarray (n,)
        Residual scale by which it is fitted.
    base : Model, optional
        The same without the last term.
    """

    problem: Problem
    terms: tuple[Term, ...]
    sigma: np.ndarray = field(repr=False)
    base: "Model | None" = field(default=None, repr=False)

    @cached_property
    def fit(self) -> Fit:
        """Its fit."""
        base = None if self.base is None else self.base.fit
        return Fit(self.problem.gram, (*self.problem.base, *self.terms), self.sigma, base)

    @cached_property
    def keys(self) -> frozenset[tuple]:
        """Keys of its terms, without their shapes."""
        return frozenset(term.key for term in self.terms)

    @cached_property
    def extensions(self) -> dict[int, list]:
        """Possible further terms by joint, once they were listed."""
        return {}

    @cached_property
    def drift(self) -> float:
        """Number of terms that a drift resembles, each by the share of its torque."""
        return sum(_resembles_drift(self.fit, term) for term in self.terms)

    def has(self, terms: Sequence[Term], sigma: np.ndarray | None = None) -> "Model":
        """The model with other terms, or another residual scale; products of common terms are taken over."""
        made = Model(self.problem, tuple(terms), self.sigma if sigma is None else sigma)
        every = (*self.problem.base, *made.terms)
        made.__dict__["fit"] = Fit(self.problem.gram, every, made.sigma, like=self.fit)
        return made

    def extend(self, term: Term) -> "Model":
        """The model with one more term."""
        return Model(self.problem, (*self.terms, term), self.sigma, self)

    def without(self, term: Term) -> "Model":
        """The model without a term."""
        return self.has([t for t in self.terms if t is not term])

    def rescale(self) -> "Model":
        """The model weighed by its own residuals."""
        return self.has(self.terms, self.fit.settle_scale())


@dataclass(frozen=True)
class Score:
    """What compares models of one data set.

    Attributes
    ----------
    policy : Policy
    layout : Layout
    standard : Model or None
        The declared model with what every joint may have; None before there is one.
    """

    policy: Policy
    layout: Layout
    standard: Model | None = None

    @cached_property
    def recordings(self) -> int:
        """Recordings that the training runs are pieces of."""
        return len(np.unique(self.layout.folds.recording))

    @cached_property
    def _forms(self) -> dict[frozenset, np.ndarray]:
        return {}

    def find_form(self, a: Model, b: Model) -> np.ndarray:
        """Form error (n,) by joint of the terms that only one of two models has [squares of the torque].

        It is a share of the standard model's residual, conditional on bodies of either model and on the
        common terms that depend on other signals. The forms of the latter are wrong by that share too, and
        the same share of their error may follow the signals in question.
        """
        if self.standard is None:
            return np.zeros(len(self.layout.prepared.moving))
        joints = self.layout.prepared.dataset.joints
        common = [t for t in b.terms if t in a.terms]
        differ = [t for t in (*a.terms, *b.terms) if t not in common]
        signals = {name for t in differ for name in t.list_signals(joints)}
        there = {t.key for t in self.standard.terms}
        record = any(t.model_term.is_measurement_error for t in differ)
        # Of a body in two models, the one with more parameters.
        bodies = {t.key[:2]: t for t in sorted(differ, key=lambda t: len(t.subset)) if t.effect.spread}
        apart = [
            t
            for t in (*common, *bodies.values())
            if t.key not in there and not t.model_term.is_measurement_error
            # An error of the recording may follow any torque.
            if t.is_exact or not (record or t.list_signals(joints) & signals)
        ]
        key = frozenset((t.key, t.candidate) for t in apart)
        if key not in self._forms:
            share, left = self.policy.form_error, self._leave(apart)
            exact = self._leave([t for t in apart if t.is_exact])
            self._forms[key] = share * (left + share * np.maximum(exact - left, 0.0))
        return self._forms[key]

    def _leave(self, terms: Sequence[Term]) -> np.ndarray:
        """Held-out loss (n,) of the standard model with terms, at most its own."""
        assert self.standard is not None
        given = self.standard.has([*self.standard.terms, *terms]) if terms else self.standard
        return np.minimum(given.fit.held_out, self.standard.fit.held_out)

    def compare(self, a: Model, b: Model) -> float:
        """Nats by which model `b` is more probable than `a`; an upper bound where that is low already."""
        lost, left = a.fit.held_out, b.fit.held_out
        form = self.find_form(a, b)
        ratio = np.log(np.maximum(lost + form, 1e-300) / np.maximum(left + form, 1e-300))
        differ = np.flatnonzero(np.abs(lost - left) > 1e-9 * lost).tolist()
        energy = 0.5 * (a.fit.energy - b.fit.energy)
        most = 0.5 * self.policy.most_rows * float(np.maximum(ratio, 0.0).sum()) + energy
        few = [self._cost(b, rows) - self._cost(a, rows) for rows in (2.0, self.policy.most_rows)]
        if most - min(few) < _HOPELESS:
            return most - min(few)
        total, rows = energy, 2.0
        for j in differ:
            own = self._count_rows(a.fit, b.fit, j)
            total += 0.5 * own * float(ratio[j])
            rows = max(rows, own)
        return float(total - (self._cost(b, rows) - self._cost(a, rows)))

    def _cost(self, model: Model, rows: float) -> float:
        unlikely = sum(_poses_as_balancer(model, term) for term in model.terms)
        cost = sum(0.5 * self.count(term) * np.log(rows) + self.odds(term) for term in model.terms)
        return float(cost + 0.5 * self.policy.name_odds * unlikely + self._drift_odds * model.drift)

    def count(self, term: Term) -> float:
        """Coefficients of a term, and what its shape counts as."""
        if term.effect.empirical:
            return max(2.0, _SPLINE * len(term.subset))
        return len(term.subset) + _SHAPE * len(term.effect.shape_of(term.subset))

    def odds(self, term: Term) -> float:
        """Prior odds against a term whatever its torque, in nats; negative for what every drive has."""
        effect, policy = term.effect, self.policy
        if effect.is_in_every_drive:
            return -SURELY
        odds = policy.name_odds
        if effect.standard:
            return odds
        odds += float(np.log(max(term.alternatives, 1.0)))
        if effect.empirical:
            return odds + policy.unknown_odds
        return odds + (2.0 * policy.unknown_odds if effect.selects_signals and self.recordings < 2 else 0.0)

    def find_odds(self, model: Model, term: Term) -> float:
        """Prior odds against a model's term, those of a drift in its place included, in nats."""
        return self.odds(term) + self._drift_odds * _resembles_drift(model.fit, term)

    @property
    def _drift_odds(self) -> float:
        return 2.0 * self.policy.unknown_odds / self.recordings

    def _count_rows(self, a: Fit, b: Fit, joint: int) -> float:
        """Independent rows that inform on how two models differ at a joint."""
        direction = (b.predict(joint) - a.predict(joint)) * self.layout.keep[:, joint]
        better = a if a.fitted[joint] < b.fitted[joint] else b
        return self.count_rows(direction * better.leave(joint), int(self.layout.keep[:, joint].sum()))

    def count_rows(self, product: np.ndarray, count: int) -> float:
        """Independent rows that inform on a direction, by its product (M,) with what a model leaves."""
        return self.layout.joined.count_rows(product, count, self.policy.most_rows)


def _resembles_drift(fit: Fit, term: Term) -> float:
    """Share of a term's torque that a drift of few recordings has: it follows time, and has a level."""
    if term.effect.is_in_every_drive or term.effect.spread:
        return 0.0
    slow = term.effect.is_thermal or (term.effect.empirical and term.follows_time)
    return 1.0 if slow else fit.find_level(term)


def _poses_as_balancer(model: Model, term: Term) -> bool:
    """Whether a spring takes gravity's load off its joint, for which balancers are built."""
    effect = term.effect
    if isinstance(effect, BalancerEffect | WaveEffect) or not effect.is_by_position:
        return False
    gravity = model.problem.gravity(term.joint)
    torque = term.at_joint(term.joint) @ model.fit.coefficients(term)
    size = float(np.linalg.norm(torque) * np.linalg.norm(model.problem.target))
    # Where gravity gives nothing but round-off there is nothing to balance.
    return float(torque @ gravity) < -1e-6 * size
