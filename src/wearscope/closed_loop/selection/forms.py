"""Whether what a small term explains may be the form of larger ones that were named."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from wearscope.closed_loop.model.candidates import make_candidate
from wearscope.closed_loop.model.regression import regularise
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.evidence import Evidence, adjust_p_values, weigh
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem
from wearscope.effects.base import Effect
from wearscope.effects.unknown import COARSE, MODULATORS, SIGNALS
from wearscope.effects.vocabulary import empirical_effect

#: Signals that the direction of motion represents.
_DIRECTION = ("sign_qd", "reversal")


class Forms:
    """Curves of what the named terms of a model depend on, in which any form that they may have lies.

    Parameters
    ----------
    problem : Problem
    policy : Policy
    """

    def __init__(self, problem: Problem, policy: Policy) -> None:
        self.problem, self.policy = problem, policy
        self.effect = empirical_effect()
        self._shapes: dict[int, dict[tuple[int, ...], np.ndarray]] = {}
        self._made: dict[tuple[int, ...], Chosen] = {}

    def weigh(self, assembly: Assembly, e: Evidence) -> Evidence | None:
        """Evidence on a term given a model with any curve in each signal of each large term at its joint.

        No machine follows a named term's form exactly, and what it leaves of a large one may pass for
        another, small term; not where these curves have taken it in. Large against another is a term of whose
        power `material_whole` is more than that one gains.

        Parameters
        ----------
        assembly : Assembly
            The model, conditional on which the term was weighed.
        e : Evidence

        Returns
        -------
        Evidence or None
            Its p-value over all that may be asked at all joints. None where none named is large against it,
            or one that is depends on what has no curve.
        """
        curves = self._find_curves(assembly, e)
        if not curves:
            return None
        given = Assembly(assembly.layout, assembly.target, (*assembly.chosen, *curves), assembly.sigma)
        own = weigh(given, e.chosen.candidate, e.chosen.subset, self.policy)
        asked = len(self.problem.effects) * int(self.problem.prepared.moving.sum())
        return adjust_p_values([replace(own, tried=e.tried * asked, whole=np.inf)])[0]

    def _find_curves(self, assembly: Assembly, e: Evidence) -> list[Chosen]:
        """Curves of the terms named at a joint that are large against one; none where one has no curve."""
        joint = e.joint
        base = {id(c.candidate) for c in self.problem.base}
        curves: dict[tuple[int, ...], Chosen] = {}
        for chosen, span in zip(assembly.chosen, assembly.spans, strict=True):
            made = chosen.candidate
            if joint not in made.joints or id(made) in base or made.effect.standard:
                continue
            if self.policy.material_whole * _find_power(assembly, chosen, span, joint) <= e.gain:
                continue
            driver = int(made.shapes[0][0]) if made.effect.name_driver is not None else None
            for key in list_signals(made.effect, joint if made.effect.per_robot else made.joint, driver):
                shape = None if key is None else self._list_shapes(joint).get(key)
                if key is None or shape is None:
                    return []
                curves[key] = self._make(joint, key, shape, float(assembly.sigma[joint]))
        return list(curves.values())

    def _list_shapes(self, joint: int) -> dict[tuple[int, ...], np.ndarray]:
        """Shapes of the generic term of one signal at a joint by signal, source and modulator."""
        if joint not in self._shapes:
            every = self.effect.shapes(self.problem.joined, joint)
            self._shapes[joint] = {(int(s[0]), int(s[1]), int(s[2])): s for s in every if s[5] < 0}
        return self._shapes[joint]

    def _make(self, joint: int, key: tuple[int, ...], shape: np.ndarray, sigma: float) -> Chosen:
        """A curve as a term of a model, held as the generic term is."""
        knots = int(shape[-1]) if self.problem.layout.folds.by_run else min(COARSE, int(shape[-1]))
        if (joint, *key) not in self._made:
            named = np.array(shape)
            named[-1] = knots
            made = make_candidate(self.effect, joint, self.problem.prepared, named[None])
            self._made[joint, *key] = Chosen(made, tuple(range(knots)))
        chosen = self._made[joint, *key]
        weight = float(np.mean((chosen.rows[0] ** 2).sum(axis=0))) / sigma**2
        full = np.zeros((chosen.candidate.count,) * 2)
        full[:knots, :knots] = weight * regularise(knots)
        return Chosen(replace(chosen.candidate, penalty=full), chosen.subset)


def _find_power(assembly: Assembly, chosen: Chosen, span: slice, joint: int) -> float:
    """Sum of squares of a term's torque at a joint, in residual variances."""
    torque = chosen.rows[chosen.candidate.joints.index(joint)] @ assembly.theta[span]
    counted = torque * assembly.layout.keep[:, joint] / assembly.sigma[joint]
    return float(counted @ counted)


def list_signals(
    effect: Effect, source: int, driver: int | None = None
) -> Iterator[tuple[int, int, int] | None]:
    """Signal, source and modulator, by code, of curves that hold an effect's form; None where there is none.

    Parameters
    ----------
    effect : Effect
    source : int
        Joint whose signals it depends on.
    driver : int, optional
        Joint that drives it, whose signals it depends on instead.
    """
    own = "_{joint}" if driver is None else "_{other}"
    source = source if driver is None else driver
    names = [name.removesuffix(own) for name in effect.depends_on]
    modulators = [0]
    modulators += [MODULATORS.index("sign_qd")] if set(names) & set(_DIRECTION) else []
    for name in dict.fromkeys("qd" if name in _DIRECTION else name for name in names):
        if name not in SIGNALS:
            yield None
            continue
        code = SIGNALS.index(name)
        for modulator in modulators:
            yield code, source, modulator
