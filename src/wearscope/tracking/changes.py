"""What may change between sessions: candidates, each a group of an effect's columns at a joint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import Effect, PayloadEffect, Signals
from wearscope.effects.vocabulary import plain_friction, session_effects, worn_effect

if TYPE_CHECKING:
    from wearscope.tracking.structure import Structure

#: A joint's plain friction as a whole, as a change and in the tables.
FRICTION = "friction"
#: A joint's friction over its speed, of whatever form, of which only the size is asked.
CURVE = "curve"
#: Widths of the curve's bumps at low speed, as shares of the joint's top speed.
_WIDTHS = (0.04, 0.16)
#: A payload's parameters count as so many values: a mass and three moments.
_BODY = 4


@dataclass(frozen=True)
class Change:
    """A group of columns that may have another weight than in the reference.

    Attributes
    ----------
    name : str
        What is called by it: an effect, or ``friction`` for Coulomb and viscous friction together.
    joint : int
    terms : tuple of ModelTerm
        Effects whose coefficients change.
    friction : bool
        Whether it is a change of the joint's friction.
    present : bool
        Whether the reference has all of it.
    rank : int
        Place among changes that explain the same.
    asked : bool
        Whether sessions are asked for it; False where only its size is.
    """

    name: str
    joint: int
    terms: tuple[ModelTerm, ...]
    friction: bool
    present: bool
    rank: int
    asked: bool = True

    @property
    def key(self) -> str:
        """Name and joint index, which no other change has."""
        return f"{self.name}@{self.joint}"

    @property
    def count(self) -> int:
        """Columns."""
        return sum(len(term.subset) for term in self.terms)

    @property
    def complexity(self) -> int:
        """Number of values that it chooses."""
        return sum(
            _BODY if isinstance(term.effect, PayloadEffect) else len(term.subset) for term in self.terms
        )

    @property
    def spread(self) -> bool:
        """Whether it is felt at several joints."""
        return any(term.effect.spread for term in self.terms)

    @property
    def order(self) -> tuple[bool, bool, bool, bool, int, int]:
        """What is believed first of changes that explain the same: friction, what is there, loads.

        Loads change from day to day. A spring or a balancer that was not there comes last: nobody mounts
        one unknowingly.
        """
        mounted = not self.present and any(term.effect.mounted for term in self.terms)
        return (not self.friction, not self.present, mounted, not self.spread, self.complexity, self.rank)

    @property
    def parameters(self) -> list[tuple[Effect, str]]:
        """Effect and parameter of each column."""
        return [(term.effect, term.effect.coefficients[k].name) for term in self.terms for k in term.subset]

    def columns(self, signals: Signals) -> np.ndarray:
        """Full-rate regressors (N, n, m)."""
        return np.concatenate([_term_columns(term, signals) for term in self.terms], axis=2)


def _term_columns(term: ModelTerm, signals: Signals) -> np.ndarray:
    if term.effect.needs_wear:
        # At f = 1: what is estimated is the wear's torque, not how worn it is.
        signals = replace(signals, wear=np.ones_like(signals.v))
    if isinstance(term.effect, PayloadEffect):
        # A load between sessions is no error of what is declared.
        signals = replace(signals, carries=True)
    return term.columns(signals)


def plain_term(effect: Effect, joint: int, shape: Sequence[float] | None = None) -> ModelTerm:
    """An effect at a joint with its default shape and all its coefficients of the simplest variant."""
    numbers = tuple(float(x) for x in effect.pack({})[1]) if shape is None else tuple(shape)
    return ModelTerm(effect, joint, numbers, tuple(int(k) for k in effect.subsets()[0]))


def list_changes(structure: "Structure") -> list[Change]:
    """What may change at each joint that moves in the reference, and the load at the last one."""
    asked = session_effects()
    whole, single = [e for e in asked if e.per_robot], [e for e in asked if not e.per_robot]
    found: list[Change] = []
    for joint in map(int, structure.moving):
        own = [entry for entry in structure.entries if entry.joint == joint]
        friction = [effect for effect in single if effect.is_friction]
        found += _friction_changes(structure, joint, friction, own)
        found += _other_changes(joint, [effect for effect in single if not effect.is_friction], own)
    last = structure.n - 1
    for effect in whole:
        every = tuple(range(len(effect.coefficients)))
        there = any(entry.effect.name == effect.name for entry in structure.entries)
        found.append(
            Change(effect.name, last, (ModelTerm(effect, last, (), every),), False, there, _rank(effect))
        )
    return found


def list_measured(structure: "Structure") -> list[Change]:
    """What may change, then each moving joint's friction curve."""
    return [*list_changes(structure), *(make_curve(structure, int(j)) for j in structure.moving)]


def make_curve(structure: "Structure", joint: int) -> Change:
    """Friction of a joint over its speed: Coulomb, viscous, and bumps at low speed of two widths."""
    top_speed = float(structure.frame.top_speed[joint])
    terms = [plain_term(effect, joint) for effect in plain_friction()]
    bump = worn_effect()
    terms += [
        ModelTerm(bump, joint, (share * top_speed, *bump.pack({})[1][1:].tolist()), (0,)) for share in _WIDTHS
    ]
    return Change(CURVE, joint, tuple(terms), True, True, _rank(bump), asked=False)


def _rank(effect: Effect) -> int:
    """Place of an effect among changes that explain the same; what no joint is asked for comes last."""
    return len(session_effects()) if effect.changes is None else effect.changes


def make_friction_change(joint: int) -> Change:
    """Plain friction of a joint as a whole; every joint has some."""
    terms = tuple(plain_term(effect, joint) for effect in plain_friction())
    return Change(FRICTION, joint, terms, True, True, max(_rank(term.effect) for term in terms))


def _friction_changes(
    structure: "Structure", joint: int, asked: Sequence[Effect], own: list[ModelTerm]
) -> list[Change]:
    present = {name for entry in own for name in (entry.effect.name, *entry.effect.contains)}
    plain = {effect.name for effect in plain_friction()}
    top_speed = float(structure.frame.top_speed[joint])
    found = []
    for effect in asked:
        shape = None if effect.change_shape is None else effect.change_shape(top_speed).tolist()
        there = effect.name in plain | present
        term = plain_term(effect, joint, shape)
        found.append(Change(effect.name, joint, (term,), True, there, _rank(effect)))
    found.append(make_friction_change(joint))
    known = {effect.name for effect in asked}
    for entry in own:
        effect = entry.effect
        covers = plain <= {effect.name, *effect.contains}
        if effect.is_friction and not (
            effect.empirical or effect.is_thermal or covers or effect.name in known
        ):
            found.append(Change(effect.name, joint, (entry,), True, True, _rank(effect)))
    return found


def _other_changes(joint: int, asked: Sequence[Effect], own: list[ModelTerm]) -> list[Change]:
    found = []
    named = {entry.effect.name for entry in own}
    for effect in asked:
        if effect.name in named or effect.corrects in named:
            continue
        found.append(Change(effect.name, joint, (plain_term(effect, joint),), False, False, _rank(effect)))
    for entry in own:
        effect = entry.effect
        if effect.empirical or effect.spread or effect.is_friction or entry.is_deflection:
            continue
        found.append(Change(effect.name, joint, (entry,), False, True, _rank(effect)))
    return found
