"""A term of a model: one shape of a candidate, and some of its coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from wearscope.closed_loop.model.terms import Candidate, ModelTerm
from wearscope.effects.base import Effect
from wearscope.effects.unknown import SLOW, list_signals


@dataclass(frozen=True, eq=False)
class Term:
    """One shape of a candidate with a subset of its coefficients, in a model.

    Attributes
    ----------
    candidate : Candidate
    subset : tuple of int
    shape : int
        Which of the candidate's shapes.
    alternatives : float
        Names, shapes and subsets that were tried at its joint.
    """

    candidate: Candidate
    subset: tuple[int, ...]
    shape: int = 0
    alternatives: float = field(default=1.0)

    @property
    def effect(self) -> Effect:
        """Its effect."""
        return self.candidate.effect

    @property
    def joint(self) -> int:
        """Its joint."""
        return self.candidate.joint

    @cached_property
    def columns(self) -> np.ndarray:
        """Which of the candidate's columns it has, (m,)."""
        return self.shape * self.candidate.count + np.array(self.subset, dtype=int)

    @cached_property
    def _picks(self) -> slice | np.ndarray:
        """The same, as a slice where they follow each other: that copies nothing."""
        first, m = self.columns[0], len(self.columns)
        return slice(first, first + m) if np.all(np.diff(self.columns) == 1) else self.columns

    @cached_property
    def penalty(self) -> np.ndarray:
        """Prior precision (m, m) of its coefficients."""
        if self.candidate.penalty is None:
            return np.zeros((len(self.subset),) * 2)
        return np.asarray(self.candidate.penalty[np.ix_(self.subset, self.subset)])

    @cached_property
    def model_term(self) -> ModelTerm:
        """Effect, joint, shape and coefficients in use."""
        return self.candidate.term(self.shape, self.subset)

    @property
    def follows_direction(self) -> bool:
        """Whether its columns change with how the direction of motion reverses."""
        past = self.effect.empirical and not self.model_term.shape
        fixed = past or self.model_term.is_measurement_error or self.model_term.is_deflection
        return self.effect.follows_direction and not fixed

    @property
    def follows_time(self) -> bool:
        """Whether it is a spline of time or temperature, as any drift of a recording seems to follow."""
        shape = self.model_term.shape
        return bool(shape) and any(code in SLOW for code, _ in list_signals(shape))

    @property
    def key(self) -> tuple:
        """Key of the term without its shape; only splines are told apart by their shape."""
        shape = self.model_term.shape if self.effect.empirical else ()
        return (self.effect.name, self.joint, self.subset, shape)

    @property
    def is_exact(self) -> bool:
        """Whether no machine departs from its form: a body, or a constant."""
        return self.effect.spread or self.effect.is_offset

    def list_signals(self, joints: Sequence[str]) -> set[str]:
        """Signals that its torque is a function of; a load follows positions."""
        if self.effect.spread:
            return {f"q_{joint}" for joint in joints}
        if self.effect.is_offset:
            return set()
        shape = self.model_term.shape
        names = {name.removeprefix("sign_") for name in self.effect.name_signals(shape, joints, self.joint)}
        return names | {"q" + name.removeprefix("load") for name in names if name.startswith("load_")}

    def at_joint(self, joint: int) -> np.ndarray:
        """Its columns (M, m) at a joint where it is felt."""
        return np.asarray(self.candidate.rows[self.candidate.joints.index(joint)][:, self._picks])


def find_reach(terms: Sequence[Term], joints: Sequence[int]) -> set[int]:
    """Joints that a model couples to some joints, these included."""
    reach = set(joints)
    grown = True
    while grown:
        more = {j for t in terms if reach & set(t.candidate.joints) for j in t.candidate.joints}
        grown = not more <= reach
        reach |= more
    return reach
