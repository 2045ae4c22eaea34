"""The one door: `diagnose(dataset)` reads, searches, fits and marks, and returns a `Diagnosis`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.closed_loop.corrected import withdraw_worse
from wearscope.closed_loop.diagnostics.contradictions import Contradiction, find_contradictions
from wearscope.closed_loop.diagnostics.outcome import Attribution, Outcome
from wearscope.closed_loop.inference.answer import Answer, Found, find_terms
from wearscope.closed_loop.inference.delays import is_lag
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.score import Model
from wearscope.closed_loop.inference.status import Marked, mark_delays, mark_terms
from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.thinning import Budget
from wearscope.closed_loop.intake.threads import keep_to_one_thread
from wearscope.closed_loop.model.correction import write_models
from wearscope.closed_loop.model.declared import fit_declared, fit_declared_model
from wearscope.closed_loop.model.delays import move_by_delays, undo_shifts
from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.model.events import Event, find_events, leave_out, take_out_common, take_out_state
from wearscope.closed_loop.model.loads import find_other_loads, take_loads
from wearscope.closed_loop.model.possible import keep_possible
from wearscope.closed_loop.model.prediction import find_repeats, refit, residual_table
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.rests import settle_at_rest
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.closed_loop.posing import pose_problem
from wearscope.closed_loop.verdict import make_verdict
from wearscope.storage import tables

RESIDUAL_UNITS = {"t": "s"}
#: Delay, in periods of the cut-off, from which a torque is far from linear in it.
_FAR = 0.1
#: Delays of several joints count as one delay where they differ by less than this share.
_ALIKE = 0.2
#: Times that the search goes on with another load.
_LOADS = 3
#: Quantile of a normal distribution that 5 % exceed.
_ONE_SIDED = 1.645


@dataclass(frozen=True)
class Diagnosis(Outcome):
    """Outcome of closing the loop on a data set, as it is told and written."""

    @cached_property
    @keep_to_one_thread
    def verdict(self) -> dict[str, Any]:
        """The content of ``verdict.json``."""
        return make_verdict(self)

    def summary(self) -> pd.DataFrame:
        """One row a named term: joint, effect, status, equivalents, share of the error it removes."""
        rows = [
            {
                "joint": entry["joint"],
                "effect": entry["effect"],
                "status": entry["status"],
                "equivalent": ", ".join(entry["equivalent"]),
                "error_reduction": entry["error_reduction"],
            }
            for entry in self.verdict["verdict"]
        ]
        return pd.DataFrame(rows, columns=["joint", "effect", "status", "equivalent", "error_reduction"])

    def write(self, folder: str | Path, extra: dict[str, Any] | None = None) -> dict[str, Any]:
        """Write the files of the contract; ``verdict.json`` last.

        Parameters
        ----------
        folder : path-like
        extra : dict, optional
            Further entries of ``verdict.json``.
        """
        out = Path(folder)
        unit = self.prepared.dataset.torque_unit
        columns = ("measured", "predicted_before", "predicted_after", "residual_before", "residual_after")
        units = dict.fromkeys(columns, unit[0] if len(set(unit)) == 1 else "N m or N, by joint")
        write_models(out, self.models)
        table = residual_table(self.prepared, self.predicted)
        tables.write_table(out / "residual.parquet", table, RESIDUAL_UNITS | units)
        tables.write_table(out / "candidates.parquet", self.candidates)
        verdict = self.verdict | (extra or {})
        tables.write_json(out / "verdict.json", verdict)
        return verdict


@keep_to_one_thread
def diagnose(
    dataset: str | Path | Dataset,
    policy: Policy | None = None,
    progress: Callable[[str], None] = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
    budget: Budget | None = None,
) -> Diagnosis:
    """Name what the declared model of a measured machine lacks, correct it, and say how sure that is.

    Parameters
    ----------
    dataset : path-like or Dataset
        The data set's folder, its ``dataset.yaml``, or what `read_dataset` gave.
    policy : Policy, optional
        Numbers of the score.
    progress : callable
        Called with a line of text at each step.
    effects : sequence of path-like
        Files of own effects, candidates in addition to the vocabulary.
    allow_code : bool
        Whether effect files that the data set itself names may run.
    budget : Budget, optional
        How much of the runs is used, at most.

    Returns
    -------
    Diagnosis

    Raises
    ------
    InputError
        Where the data set breaks the format or cannot be what it says.
    """
    problem = pose_problem(dataset, progress, effects, allow_code, budget)
    ask = partial(conclude, policy=policy or Policy(), progress=progress)
    found = ask(problem)
    revisions: list[Callable[[Diagnosis], Revised | None]] = [partial(move_delays, budget=budget)]
    for revise in (*revisions, leave_out_events, *[take_load] * _LOADS):
        revised = revise(found)
        if revised is None:
            continue
        told, problem, late, events = revised
        progress(told)
        again = replace(ask(problem, late=late, start=found.answer.model), events=events)
        if revise is leave_out_events:
            again = replace(again, events=[*events, *list_events(again)])
        if late is not found.late or explains_as_well(found, again):
            found = again
    return found


Revised = tuple[str, Problem, Sequence[Attribution], list[Event]]


def move_delays(found: Diagnosis, budget: Budget | None = None) -> Revised | None:
    """The problem with torque channels moved by delays, if any must be.

    A channel is moved where the torque that is compared is far from linear in its delay. Where several joints
    have one delay, it is the recorder's, and all channels are moved by it.
    """
    common = find_common_delay(found)
    late = common or list_delays(found)
    if not late:
        return None
    names = ", ".join(found.prepared.dataset.joints[a.term.joint] for a in late)
    terms = [a.term for a in late]
    rest = [term for term in found.after.entries if not term.is_measurement_error]
    joints = [term.joint for term in terms]
    moved = move_by_delays(refit(found.after, rest), joints, budget)
    problem = Problem(moved, found.problem.declared, found.problem.own, terms)
    told = "one delay of the recorder" if common else "their delays"
    return f"{names}: the torque channels are moved by {told}", problem, late, []


def find_common_delay(found: Diagnosis) -> list[Attribution]:
    """The delays of all joints that move, where those that were found are one; none where they are not."""
    lags = {a.term.joint: a for a in found.attributions if is_lag(a.term.effect)}
    if len(lags) < 2:
        return []
    own = {id(a.term) for a in lags.values()}
    every = [e for e in found.estimates["proposed"] if id(e.entry) in own]
    values = np.array([e.values["delay"] for e in every])
    widths = np.array([np.ptp(e.intervals["delay"]) / 2.0 if e.intervals else 0.0 for e in every])
    mean = float(np.median(values))
    if not np.all(np.abs(values - mean) <= np.maximum(widths, _ALIKE * abs(mean))):
        return []
    one = next(iter(lags.values()))
    return [
        lags.get(j, replace(one, term=replace(one.term, joint=j), share=0.0, equivalent=[], withdrawn=""))
        for j in np.flatnonzero(found.prepared.moving).tolist()
    ]


def leave_out_events(found: Diagnosis) -> Revised | None:
    """The problem without the rows of short events, if there are any: they may hide what the machine has."""
    events = list_events(found)
    if not events:
        return None
    prepared = found.problem.prepared
    calm = leave_out(prepared.runs, events, prepared.dataset.joints)
    problem = Problem(
        replace(prepared, runs=calm), found.problem.declared, found.problem.own, found.problem.late
    )
    return (
        f"{len(events)} short events are left: the search goes on without their rows",
        problem,
        found.late,
        events,
    )


def take_load(found: Diagnosis) -> Revised | None:
    """The problem with effects along the corrected bodies' load, where this load differs from the first."""
    others = find_other_loads(found.after, [a.term for a in found.attributions if a.kept])
    if not others:
        return None
    names = ", ".join(found.prepared.dataset.joints[term.joint] for term in others)
    prepared = take_loads(found.problem.prepared, found.after)
    problem = Problem(prepared, found.problem.declared, found.problem.own, found.problem.late)
    return f"{names}: the search goes on with the corrected bodies' load", problem, found.late, found.events


def list_delays(diagnosis: Diagnosis) -> list[Attribution]:
    """Delays of a corrected model in which the torque that is compared is far from linear."""
    after = diagnosis.after
    theta, far = after.solve(), _FAR / diagnosis.prepared.band.torque
    late = {
        id(term)
        for term, span in zip(after.entries, after.spans, strict=True)
        if is_lag(term.effect) and abs(theta[span][0]) > far
    }
    return [a for a in diagnosis.attributions if id(a.term) in late]


def explains_as_well(first: Diagnosis, again: Diagnosis) -> bool:
    """Whether a model that was fitted without events explains the other training rows as well.

    Where it explains them worse beyond chance, by blocks of the training runs, the events' rows showed what
    the machine has: they are no events.
    """
    pairs = [(p, q) for p, q in zip(first.predicted, again.predicted, strict=True) if p.run.use == "train"]
    squares = [
        [np.where(q.run.keep, q.run.measured - one.after, 0.0) ** 2 for one in (p, q)] for p, q in pairs
    ]
    scale = sum(before.sum(axis=0) for before, _ in squares)
    grown = [
        np.divide(after - before, scale, out=0.0 * after, where=scale > 0.0) for before, after in squares
    ]
    worse = np.array([grown[b.run][b.start : b.stop].sum() for b in first.problem.layout.blocks])
    return bool(worse.mean() <= _ONE_SIDED * worse.std(ddof=1) / np.sqrt(len(worse)))


def list_events(diagnosis: Diagnosis) -> list[Event]:
    """Short events in what the corrected model leaves of the rows that count."""
    prepared = diagnosis.prepared
    runs = [p.run for p in diagnosis.predicted]
    left = take_out_state(runs, [p.run.measured - p.after for p in diagnosis.predicted])
    left = take_out_common(runs, left, find_repeats(prepared))
    change = [p.after - p.before for p in diagnosis.predicted]
    return find_events(runs, left, prepared.dataset.joints, prepared.moving, prepared.top_speed, change)


def conclude(
    problem: Problem,
    policy: Policy,
    progress: Callable[[str], None],
    late: Sequence[Attribution] = (),
    start: Model | None = None,
) -> Diagnosis:
    """Find what the declared model lacks, fit it, and mark each name by the evidence of rests and test runs.

    Parameters
    ----------
    problem : Problem
    policy : Policy
    progress : callable
    late : sequence of Attribution
        Delays that were found before, by which the problem's channels are moved.
    start : Model, optional
        From whose terms the search goes on.
    """
    answer = find_terms(problem, policy, progress, start)
    # What is fitted, marked and told goes along the reversals that were found.
    problem, sigma = answer.problem, answer.sigma
    prepared = problem.prepared
    declared = fit_declared_model(prepared, problem.declared_terms, problem.inertial, problem.layout.blocks)
    if any(term.is_measurement_error for term in declared.entries):
        declared = refit(declared, declared.entries)
    answer, proposed, determined = drop_undetermined(declared, answer)
    equivalent = [f.equivalent for f in determined]
    proposed, equivalent = settle_rests(problem, proposed, len(declared.entries), equivalent)
    terms = proposed.entries[len(declared.entries) :]
    marked = mark_terms(prepared, proposed, terms)
    aligned, impossible = keep_possible(declared, len(declared.entries))
    before = undo_shifts(aligned, problem.late)
    after, why, beyond, helped = withdraw_worse(declared, aligned, sigma, terms, marked)
    apart = find_contradictions(after)
    marked = [_withhold(term, mark, apart) for term, mark in zip(terms, marked, strict=True)]
    named = [
        Attribution(term, f.share, f.probability, names, mark, withdrawn)
        for term, f, names, mark, withdrawn in zip(terms, determined, equivalent, marked, why, strict=True)
    ]
    delays = mark_delays(proposed, problem.late)
    named = [*(replace(a, marked=mark) for a, mark in zip(late, delays, strict=True)), *named]
    impossible = beyond if any(a.kept for a in named) else impossible
    return Diagnosis(
        prepared, policy, named, before, proposed, after, problem, answer, apart,
        [one for one in impossible if one.is_significant], helped, late=late,
    )  # fmt: skip


def _withhold(term: ModelTerm, mark: Marked, apart: Mapping[int, Contradiction]) -> Marked:
    """What test runs say of a name; at a joint whose runs contradict each other none counts as confirmed."""
    touched = bool(apart) if term.effect.spread else term.joint in apart
    return replace(mark, status="not_confirmed") if touched and mark.status == "confirmed" else mark


def settle_rests(
    problem: Problem, after: Regression, first: int, equivalent: Sequence[Sequence[str]]
) -> tuple[Regression, list[list[str]]]:
    """The model, and the equivalents of each of its names, after what the joints' rests say of them.

    Parameters
    ----------
    problem : Problem
    after : Regression
    first : int
        Of the named terms among its entries.
    equivalent : sequence of sequence of str
        Equivalent names of each.
    """
    effects = {effect.name: effect for effect in problem.effects}
    left = []
    for k, names in enumerate(equivalent):
        term = after.entries[first + k]
        rivals = [
            None
            if effects[name].spread or term.effect.spread or term.effect.is_in_every_drive
            else fit_declared(problem.prepared, effects[name], term.joint, problem.joined)
            for name in names
        ]
        stays = list(range(1 + len(names)))
        if any(rival is not None for rival in rivals):
            after, stays = settle_at_rest(after, first + k, rivals)
        every = [term.effect.name, *names]
        left.append([every[one] for one in stays[1:]])
    return after, left


def drop_undetermined(before: Regression, answer: Answer) -> tuple[Answer, Regression, list[Found]]:
    """The answer, the declared model with its names, and the names whose coefficients differ from zero.

    Held-out runs test a prediction; a name states a parameter, which must differ from zero next to the other
    names. Plain friction without a name is in the interval that is told: the search has weighed it against
    the name. The rows are weighed by the residual with the terms found: that of the declared model would
    weigh them too little against the prior of the inertial parameters.
    """
    found, most_rows = list(answer.found), answer.score.policy.most_rows
    base = Regression(before.prepared, before.entries, answer.sigma, before.inertial, before.blocks)
    while found:
        after = refit(base, [*base.entries, *(f.term.model_term for f in found)])
        estimates = estimate(after, most_rows, conditional=True)[len(before.entries) :]
        doubtful = [
            (e.sureness, k)
            for k, (e, f) in enumerate(zip(estimates, found, strict=True))
            if not (f.term.effect.empirical or f.term.effect.per_robot) and e.sureness < 1.0
        ]
        if not doubtful:
            break
        del found[min(doubtful)[1]]
    kept = {id(f.term) for f in found}
    lost = [t for t in answer.model.terms if not (id(t) in kept or t.effect.is_in_every_drive)]
    return answer.without(lost, "its coefficients may be zero"), after if found else before, found
