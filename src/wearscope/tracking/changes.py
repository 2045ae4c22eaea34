"""Hypotheses of what may change between sessions; each is a group of columns whose weights may change."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import Effect, Parameter, PayloadEffect, Signals
from wearscope.effects.vocabulary import plain_friction, session_effects

if TYPE_CHECKING:
    from wearscope.tracking.structure import Structure

#: Name and kind of a change of a joint's whole friction; also its name in the tables.
FRICTION = "friction"
#: Further kinds of change: torque that depends on the position, and a body on the link. A joint has at most
#: one change of each kind.
PLACE, BODY = "place", "body"
#: Odds [nats] against each effect relative to the one before, in the vocabulary's order of changes; odds
#: against a part that must be mounted.
_RARER, _MOUNTED = 0.3, 2.0
#: Speed over which friction that wear adds at low speed decays, as a share of the joint's top speed; it is
#: used as long as data do not show the value.
_BUMP = 0.05
#: Number of a body's parameters without its inertia.
_STATIC = 4


@dataclass(frozen=True)
class Change:
    """A group of columns that may have another weight than in the reference.

    Attributes
    ----------
    name : str
        Name that no other change of the joint has.
    joint : int
        Its joint; for a body, the joint that moves its link.
    terms : tuple of ModelTerm
        Effects whose coefficients change.
    kind : str
        A joint has at most one change of a kind.
    odds : float
        Odds against it relative to a change of friction [nats].
    weights : tuple of float
        Where all coefficients change in proportion, with one column: their values in the reference.
    """

    name: str
    joint: int
    terms: tuple[ModelTerm, ...]
    kind: str
    odds: float = 0.0
    weights: tuple[float, ...] = ()

    @property
    def key(self) -> str:
        """Name and joint index, which no other change has."""
        return f"{self.name}@{self.joint}"

    @property
    def count(self) -> int:
        """Number of columns."""
        return 1 if self.weights else sum(len(term.subset) for term in self.terms)

    @property
    def effects(self) -> list[str]:
        """Names of its effects."""
        return list(dict.fromkeys(term.effect.name for term in self.terms))

    @property
    def parameters(self) -> list[tuple[Effect, Parameter]]:
        """Effect and parameter of each coefficient."""
        return [(term.effect, term.effect.coefficients[k]) for term in self.terms for k in term.subset]

    def spread_over(self, value: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Change and standard error of each coefficient, from those of the columns."""
        if not self.weights:
            return value, error
        weights = np.array(self.weights)
        return value * weights, error * np.abs(weights)

    def columns(self, signals: Signals, bodies: np.ndarray) -> np.ndarray:
        """Full-rate regressors (N, n, count); `bodies` (N, n, 10 n) are the links' inertial regressors."""
        x = np.concatenate([_term_columns(term, signals, bodies) for term in self.terms], axis=2)
        return x @ np.array(self.weights)[:, None] if self.weights else x


def _term_columns(term: ModelTerm, signals: Signals, bodies: np.ndarray) -> np.ndarray:
    """Regressors (N, n, m) of a term that changes; a payload is a body on the link of the term's joint."""
    if isinstance(term.effect, PayloadEffect):
        return bodies[:, :, 10 * term.joint + np.array(term.subset)]
    if term.effect.needs_wear:
        # Wear is set to 1, since the worn friction's torque is estimated and not the level of wear.
        signals = replace(signals, wear=np.ones_like(signals.v))
    return term.columns(signals)


def plain_term(effect: Effect, joint: int, shape: Sequence[float] | None = None) -> ModelTerm:
    """Term of an effect at a joint, with its default or a given shape, in its simplest variant."""
    numbers = tuple(float(x) for x in effect.pack({})[1]) if shape is None else tuple(shape)
    return ModelTerm(effect, joint, numbers, tuple(int(k) for k in effect.subsets()[0]))


def list_changes(structure: "Structure", mean: np.ndarray) -> list[Change]:
    """All possible changes: those of each joint that moves in the reference, and a body on every link.

    Parameters
    ----------
    structure : Structure
    mean : ndarray (P,)
        Weights of the structure's columns in the reference.
    """
    found: dict[str, Change] = {}
    for joint in map(int, structure.moving):
        own = [
            (entry, mean[span])
            for entry, span in zip(structure.entries, structure.spans, strict=True)
            if entry.joint == joint and not entry.effect.empirical and not entry.is_deflection
        ]
        friction = [(entry, value) for entry, value in own if entry.effect.is_friction]
        if friction:
            weights = tuple(float(x) for _, value in friction for x in value)
            terms = tuple(entry for entry, _ in friction)
            whole = Change(f"all {FRICTION}", joint, terms, FRICTION, weights=weights)
            found[whole.key] = whole
        # Every joint has some plain friction, which may change as a whole.
        terms = tuple(plain_term(effect, joint) for effect in plain_friction())
        plain = Change(FRICTION, joint, terms, FRICTION)
        found[plain.key] = plain
        present = {entry.effect.name for entry, _ in own}
        for place, effect in enumerate(session_effects()):
            if effect.per_robot or effect.corrects in present:
                continue
            slow = _BUMP * float(structure.frame.top_speed[joint])
            shape = [slow if p.estimated and p.unit == "{position}/s" else p.default for p in effect.shape]
            rare = _RARER * place + _MOUNTED * (effect.is_by_position and effect.name not in present)
            change = Change(effect.name, joint, (plain_term(effect, joint, shape),), _find_kind(effect), rare)
            found[change.key] = change
        for entry, _ in own:
            if not entry.effect.spread and not entry.effect.is_thermal:
                change = Change(entry.effect.name, joint, (entry,), _find_kind(entry.effect))
                found.setdefault(change.key, change)
    return [*found.values(), *list_bodies(structure.n)]


def list_bodies(n: int) -> list[Change]:
    """A body on each of `n` links, without its inertia and with it."""
    effect = next(effect for effect in session_effects() if effect.per_robot)
    sizes = ((effect.name, _STATIC), (f"{effect.name} with inertia", len(effect.coefficients)))
    rare = _RARER * session_effects().index(effect)
    return [
        Change(name, link, (ModelTerm(effect, link, (), tuple(range(count))),), BODY, rare)
        for link in range(n)
        for name, count in sizes
    ]


def _find_kind(effect: Effect) -> str:
    """Kind of an effect's change: friction of any form, torque by position, or else the effect itself."""
    signals = set(effect.depends_on)
    if effect.is_friction and "load_{joint}" not in signals:
        return FRICTION
    return PLACE if signals <= {"constant", "q_{joint}"} else effect.name
