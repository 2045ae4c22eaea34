"""Levels that one recording does not tell from a drift's: named where the test runs have them too."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.model.prediction import predict_reduced, refit
from wearscope.closed_loop.selection.evidence import Found, weigh
from wearscope.closed_loop.selection.revision import is_needed
from wearscope.closed_loop.selection.search import Search


def take_levels(search: Search, found: Sequence[Found]) -> bool:
    """Whether from now on any model has a level that one recording does not tell from a drift's, unnamed.

    Where it is as much of what is left as structure is, it would be taken for structure that displaces names.
    """
    problem = search.problem
    if len(np.unique(problem.layout.folds.recording)) > 1:
        return False
    search.sigma = search.scale(found)
    given = search.assemble(found, standard=True)
    offered = search.candidates(given, found, range(problem.prepared.n), lambda effect, _: effect.is_offset)
    weighed = [weigh(given, c, (0,), search.policy) for c in offered]
    much = [e for e in weighed if e.share >= search.policy.structure_share]
    levels = [e.joint for e in much if is_needed(search, given, e, drifting=True)]
    if levels:
        search.progress(f"levels of the torque at joints {levels}: offsets, or drifts")
        search.go_on(problem.level_at(levels))
    return bool(levels)


def name_levels(search: Search, found: Sequence[Found]) -> list[Found]:
    """Offsets: the levels that every test run has in about the same size. The others stay unnamed."""
    problem, policy = search.problem, search.policy
    if not problem.levels:
        return []
    search.go_on(problem.level_at([]))
    given = search.assemble(found)
    levels = [Found(k, weigh(given, k.candidate, k.subset, policy)) for k in problem.levels.values()]
    declared = fit_declared_model(
        problem.prepared, problem.declared_terms, problem.inertial, problem.layout.blocks
    )
    model = refit(declared, [*declared.entries, *(f.evidence.term for f in [*found, *levels])])
    theta, test = model.solve(), problem.prepared.runs_for("test")
    left = [run.measured - predict_reduced(model, theta, run) for run in test]
    named = []
    for f, span in zip(levels, model.spans[-len(levels) :], strict=True):
        rows = [x[run.keep[:, f.joint], f.joint] for x, run in zip(left, test, strict=True)]
        ratios = [1.0 + float(x.mean() / theta[span][0]) for x in rows if len(x)]
        if ratios and all(1.0 / policy.alike <= ratio <= policy.alike for ratio in ratios):
            named.append(f)
    search.go_on(problem.level_at(set(problem.levels) - {f.joint for f in named}))
    return named


def take_out_levels(search: Search, found: Sequence[Found]) -> Prepared:
    """The data set without its levels in the training runs' torque, as models are then fitted to it."""
    problem, model = search.problem, search.assemble(found)
    prepared, out = problem.prepared, np.zeros(problem.prepared.n)
    if not problem.levels:
        return prepared
    for joint, level in problem.levels.items():
        k = next(k for k, chosen in enumerate(model.chosen) if chosen is level)
        out[joint] = model.theta[model.spans[k]][0]
    runs = [
        replace(run, measured=run.measured - out, tau=run.tau - out) if run.use == "train" else run
        for run in prepared.runs
    ]
    return replace(prepared, runs=runs, levelled=tuple(problem.levels))
