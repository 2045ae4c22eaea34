"""What may be asked conditional on a model, and what an answer depends on."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, Refusal
from wearscope.closed_loop.selection.problem import Problem
from wearscope.effects.base import Effect, MeasurementEffect


def list_candidates(
    problem: Problem,
    assembly: Assembly,
    joints: Iterable[int],
    asks: Callable[[Effect, int], bool] = lambda effect, joint: True,
) -> list[Candidate]:
    """What may be asked conditional on a model: not there, not contained, with its parents, where it applies.

    In a single run temperature is a function of time, so that next to one term that goes with either another
    would be its form. Nothing is made of an effect at a joint that `asks` leaves out.
    """
    n, declared = problem.prepared.n, {id(c.candidate) for c in problem.base}
    present: list[list[Effect]] = [list(problem.given) for _ in range(n)]
    thermal = [False] * n
    for chosen in assembly.chosen:
        joint, own = chosen.candidate.joint, chosen.candidate.effect
        present[joint].append(own)
        alone = not problem.layout.folds.by_run and id(chosen.candidate) not in declared
        thermal[joint] |= alone and own.is_thermal
    made = []
    residual = assembly.residual
    for joint in joints:
        for effect in problem.effects:
            there = present[joint]
            if not asks(effect, joint):
                continue
            if not effect.repeatable and any(effect.name in (e.name, *e.contains) for e in there):
                continue
            if not effect.has_parent(there) or (thermal[joint] and effect.is_thermal):
                continue
            if isinstance(effect, MeasurementEffect):
                if problem.prepared.moving[joint]:
                    made.append(problem.measurement_candidate(effect, joint, assembly))
                continue
            if effect.periodic:
                candidate = problem.periodic_candidate(effect, joint, residual[:, joint])
            else:
                candidate = problem.candidate(effect, joint)
            if candidate is not None:
                made.append(candidate)
    return made


def list_subsets(effect: Effect, by_run: bool) -> list[tuple[int, ...]]:
    """Subsets of an effect's coefficients to ask for; of a single run only those that contain no other.

    Those of a body are held by a prior.
    """
    if not by_run and not effect.per_robot:
        return [tuple(int(k) for k in s) for s in effect.plain_subsets()]
    names = [p.name for p in effect.coefficients]
    richer = [tuple(sorted(names.index(name) for name in extension)) for extension in effect.extensions]
    return list(dict.fromkeys([*(tuple(int(k) for k in s) for s in effect.subsets()), *richer]))


def identify(e: Evidence) -> tuple:
    """What it is evidence on, whatever its shape, except for splines, which their shape tells apart."""
    term = e.term
    return (term.effect.name, term.joint, term.subset, term.shape if term.effect.empirical else ())


def tell_candidates(
    step: int,
    joints: Sequence[str],
    weighed: Sequence[Evidence],
    taken: Sequence[Evidence],
    refused: Mapping[tuple, Refusal],
) -> list[dict[str, Any]]:
    """Each candidate of a step, what held-out runs say of it, and why it was or was not taken.

    `refused` is what was said of those that the rule alone would take.
    """
    names = {identify(e) for e in taken}
    rows = []
    for e in weighed:
        term, is_taken = e.term, identify(e) in names
        refusal = refused.get(identify(e), e.refusal) if e.refusal is Refusal.NONE else e.refusal
        rows.append(
            {
                "step": step,
                "joint": joints[term.joint],
                "effect": term.effect.name,
                "coefficients": " ".join(term.effect.coefficients[k].name for k in term.subset),
                "shape": " ".join(f"{v:.6g}" for v in term.shape),
                "cv_gain": e.share,
                "p_value": e.p_value,
                "agreement": e.agreement,
                "isolability": e.sine,
                "taken": is_taken,
                "reason": "taken" if is_taken else (refusal.value or "another candidate was taken"),
            }
        )
    return rows
