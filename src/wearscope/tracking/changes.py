"""What may change between sessions: candidates, each a group of an effect's columns at a joint."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import Effect, PayloadEffect, Signals, load_effect

if TYPE_CHECKING:
    from wearscope.tracking.structure import Structure

#: Friction that every joint has, as effects; and as a change, where it may be all of it.
_PLAIN = {"coulomb", "viscous"}
_EVERYWHERE = {*_PLAIN, "friction"}
#: Changes of friction, most elementary first; what follows is asked of joints too.
FRICTION = ("coulomb", "viscous", "friction", "load_dependent_friction", "wear")
OTHERS = (
    "torque_constant_error",
    "torque_offset",
    "joint_spring",
    "gravity_counterbalance",
    "rotor_inertia_error",
)
MOUNTED = ("joint_spring", "gravity_counterbalance")
#: Share of a joint's top speed over which the bump of worn friction dies away.
_BUMP = 0.05
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
    """

    name: str
    joint: int
    terms: tuple[ModelTerm, ...]
    friction: bool
    present: bool
    rank: int

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
        mounted = not self.present and self.name in MOUNTED
        return (not self.friction, not self.present, mounted, not self.spread, self.complexity, self.rank)

    @property
    def parameters(self) -> list[tuple[Effect, str]]:
        """Effect and parameter of each column."""
        return [(term.effect, term.effect.coefficients[k].name) for term in self.terms for k in term.subset]

    def columns(self, signals: Signals) -> np.ndarray:
        """Full-rate regressors (N, n, m)."""
        return np.concatenate([_term_columns(term, signals) for term in self.terms], axis=2)


def _term_columns(term: ModelTerm, signals: Signals) -> np.ndarray:
    if term.effect.name == "wear":
        # At f = 1: what is estimated is the wear's torque, not how worn it is.
        signals = replace(signals, wear=np.ones_like(signals.v))
    return term.columns(signals)


def plain_term(effect: Effect, joint: int, shape: Sequence[float] | None = None) -> ModelTerm:
    """An effect at a joint with its default shape and all its coefficients of the simplest variant."""
    numbers = tuple(float(x) for x in effect.pack({})[1]) if shape is None else tuple(shape)
    return ModelTerm(effect, joint, numbers, tuple(int(k) for k in effect.subsets()[0]))


def list_changes(structure: "Structure") -> list[Change]:
    """What may change at each joint that moves in the reference, and the load at the last one."""
    found: list[Change] = []
    last = structure.n - 1
    for joint in map(int, np.flatnonzero(structure.frame.moving)):
        own = [entry for entry in structure.entries if entry.joint == joint]
        found += _friction_changes(structure, joint, own)
        found += _other_changes(joint, own)
    payload = load_effect("payload_error")
    every = tuple(range(len(payload.coefficients)))
    there = any(isinstance(entry.effect, PayloadEffect) for entry in structure.entries)
    found.append(
        Change("payload_error", last, (ModelTerm(payload, last, (), every),), False, there, len(FRICTION))
    )
    return found


def _friction_changes(structure: "Structure", joint: int, own: list[ModelTerm]) -> list[Change]:
    present = {name for entry in own for name in (entry.effect.name, *entry.effect.contains)}
    coulomb, viscous = (plain_term(load_effect(name), joint) for name in ("coulomb", "viscous"))
    bump = _BUMP * float(structure.frame.top_speed[joint])
    wear = load_effect("wear")
    worn = plain_term(wear, joint, (bump, *wear.pack({})[1][1:].tolist()))
    load = plain_term(load_effect("load_dependent_friction"), joint)
    terms = {
        "coulomb": (coulomb,),
        "viscous": (viscous,),
        "friction": (coulomb, viscous),
        "load_dependent_friction": (load,),
        "wear": (worn,),
    }
    found = []
    for rank, name in enumerate(FRICTION):
        # Friction as a whole counts as there: every joint has some.
        there = name in _EVERYWHERE or name in present
        found.append(Change(name, joint, terms[name], True, there, rank))
    for entry in own:
        effect = entry.effect
        plain = effect.name in FRICTION or _covers_plain(effect)
        if is_friction(effect) and not (effect.empirical or plain or is_thermal(effect)):
            found.append(Change(effect.name, joint, (entry,), True, True, len(FRICTION)))
    return found


def is_thermal(effect: Effect) -> bool:
    """Whether an effect's torque depends on temperature or time, so that it is no property of a session."""
    return bool({"temp_{joint}", "t"} & set(effect.depends_on))


def _covers_plain(effect: Effect) -> bool:
    """Whether an effect holds Coulomb and viscous friction, which are asked by themselves."""
    return _PLAIN <= {effect.name, *effect.contains}


def is_friction(effect: Effect) -> bool:
    """Whether an effect's torque depends on the joint's own speed or its sign."""
    own = {"qd_{joint}", "sign_qd_{joint}"}
    return bool(own & set(effect.depends_on)) and not effect.spread


def _other_changes(joint: int, own: list[ModelTerm]) -> list[Change]:
    found, rank = [], len(FRICTION) + 1
    named = {entry.effect.name for entry in own}
    for k, name in enumerate(OTHERS):
        effect = load_effect(name)
        if name in named or effect.corrects in named:
            continue
        found.append(Change(name, joint, (plain_term(effect, joint),), False, False, rank + k))
    for k, entry in enumerate(own):
        effect = entry.effect
        if effect.empirical or effect.spread or is_friction(effect) or entry.is_deflection:
            continue
        found.append(Change(effect.name, joint, (entry,), False, True, rank + len(OTHERS) + k))
    return found
