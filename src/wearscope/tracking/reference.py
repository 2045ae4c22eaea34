"""The healthy machine: terms that the closed loop finds on the reference, parameters, scatter of sessions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from wearscope.closed_loop.diagnosis import Diagnosis, diagnose
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.model.events import measure_tails, take_out_state
from wearscope.closed_loop.model.inertials import payload_penalty
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.vocabulary import plain_friction
from wearscope.robots.model import RobotModel
from wearscope.tracking.changes import BODY, Change, list_changes, plain_term
from wearscope.tracking.evidence import (
    FALSE_ALARM_RATE,
    PRIOR_FRICTION,
    Evidence,
    Fit,
    invert,
    measure_scatter,
    prior_scatter,
)
from wearscope.tracking.rows import RunRows, make_rows
from wearscope.tracking.session_names import Sessions
from wearscope.tracking.session_runs import Frame, read_reference
from wearscope.tracking.structure import Belief, Scales, Structure
from wearscope.tracking.tracked_model import make_healthy_model

#: The friction by which changes are measured is at least the first share of the joint's torque, and the
#: second share of its residual.
_LEAST_FRICTION, _LEAST_OF_NOISE = 0.02, 1.0
#: A healthy session does not belong with the others from the first ratio of mean square residuals on; the
#: test needs at least the second number of sessions. In it, friction and a torque's factor and level may
#: differ by the third number times their prior scatter.
_BAD, _FEWEST, _FREE = 25.0, 3, 30.0
#: Chance that healthy sessions show a term alike which they do not have; most terms that are added.
_CHANCE, _MOST_SHOWN = 0.01, 8
#: How far beyond a link a body may be [m].
_BEYOND = 0.1


@dataclass(frozen=True, eq=False)
class Reference:
    """The healthy machine, with which later sessions are compared.

    Attributes
    ----------
    sessions : tuple of str
        Sessions of the reference, without those that were left out.
    structure : Structure
    belief : Belief
        Parameters from all training runs.
    payload_prior : ndarray (10,)
        Prior precision of a body's parameters.
    scatter : ndarray (k,)
        Standard deviation of each of `wearscope.tracking.rows.scatter_columns` between healthy sessions.
    usual : ndarray (n,)
        Held-out mean square residual of each joint, in the healthy session in which it is largest.
    tails : ndarray (n, k)
        Noise of healthy sessions, from `wearscope.closed_loop.model.events.measure_tails`.
    reach : float
        Reach of the arm [m].
    centres : ndarray (n, 3)
        Centre of mass of each link in its frame [m].
    scattering : list of dict
        Sessions that were left out: `session`, `joint`, `rms` of its residual against the others' prediction,
        and the same of the `others`, with the error of that prediction.
    robot : RobotModel
        The healthy machine as a model that can be simulated.
    """

    sessions: tuple[str, ...]
    structure: Structure
    belief: Belief
    payload_prior: np.ndarray
    scatter: np.ndarray
    usual: np.ndarray
    tails: np.ndarray
    reach: float
    centres: np.ndarray
    scattering: list[dict[str, Any]]
    robot: RobotModel

    @cached_property
    def changes(self) -> list[Change]:
        """Changes that a session may show."""
        return list_changes(self.structure, self.belief.mean)

    def weigh(
        self,
        made: Sequence[RunRows],
        level: float = FALSE_ALARM_RATE,
        belief: Belief | None = None,
        of_temperature: bool = True,
    ) -> Evidence:
        """Evidence of a session's rows, compared with the reference or with another belief."""
        return Evidence(
            self.structure, self.changes, belief or self.belief, self.payload_prior, made, self.scatter,
            of_temperature, level,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Healthy:
    """A healthy session that is held out: its rows, and the belief from the other sessions."""

    name: str
    made: list[RunRows]
    belief: Belief


def identify_reference(
    sessions: Sessions,
    policy: Policy | None = None,
    progress: Callable[[str], None] = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
) -> tuple[Reference, list[Healthy]]:
    """Identify the healthy machine; for the parameters see `wearscope.closed_loop.diagnosis.diagnose`.

    Where there are three or more healthy sessions, one that the others do not predict is left out and named.

    Returns
    -------
    Reference
    list of Healthy
        Each healthy session that counts; each run where there is only one session.

    Raises
    ------
    InputError
        Where the reference's runs break the format, or hold something else than they state.
    """
    scattering: list[dict[str, Any]] = []
    while True:
        diagnosis = diagnose(read_reference(sessions), policy, progress, effects, allow_code)
        model = add_shown(diagnosis, choose_terms(diagnosis))
        structure, made, prior = lay_out(diagnosis, model)
        healthy = hold_out(structure, made, prior)
        worst = find_scattering(structure, healthy)
        rest = tuple(name for name in sessions.reference if not worst or name != worst["session"])
        if worst is None or not any(r.run.use == "train" and r.run.session in rest for r in made):
            break
        progress(f"session {worst['session']} is not one with the other healthy ones; it is left out")
        scattering.append(worst)
        sessions = replace(sessions, reference=rest)
    belief = fit_belief(structure, [r for r in made if r.run.use == "train"], prior)
    payload_prior = np.diag(payload_penalty(diagnosis.prepared))
    # The influence of temperatures that were not recorded is part of the scatter of healthy sessions.
    rows = [[replace(r, unrecorded=r.unrecorded[..., :0]) for r in h.made] for h in healthy]
    plain = [Evidence(structure, (), h.belief, payload_prior, m) for h, m in zip(healthy, rows, strict=True)]
    scatter = measure_scatter(structure, plain, rows)
    body = made[0].signals.rigid_body
    parameters = body.inertial_parameters.reshape(-1, 10)
    centres = parameters[:, 1:4] / np.maximum(parameters[:, :1], 1e-9)
    reference = Reference(
        sessions.reference, structure, belief, payload_prior, scatter, np.zeros(structure.n),
        np.zeros((structure.n, 0)), body.reach + _BEYOND,
        centres, scattering,
        make_healthy_model(diagnosis, model, structure, belief),
    )  # fmt: skip
    usual, left = np.full(structure.n, 1e-300), []
    for one in healthy:
        evidence = reference.weigh(one.made, belief=one.belief)
        usual = np.maximum(usual, evidence.fit(()).held)
        left += leave_changes(evidence, [r.run for r in one.made])
    runs = [r.run for one in healthy for r in one.made]
    tails = measure_tails(runs, left, structure.frame.moving, structure.frame.top_speed)
    return replace(reference, usual=usual, tails=tails), healthy


def leave_changes(evidence: Evidence, runs: Sequence[PreparedRun]) -> list[np.ndarray]:
    """Residual (M, n) of each run after all changes and all that depends on a joint's state are taken out."""
    ends = np.cumsum([len(run.t) for run in runs])[:-1]
    return take_out_state(runs, np.split(evidence.take_out(), ends))


def find_scattering(structure: Structure, healthy: Sequence[Healthy]) -> dict[str, Any] | None:
    """The healthy session that the others predict worst, if it does not belong with them; else None.

    The test needs three sessions. Residuals are compared with friction and each torque's factor and level
    free, since these differ by temperature. The error of the others' prediction is added to their residual.
    """
    if len({r.run.session for h in healthy for r in h.made}) < _FEWEST:
        return None
    found = []
    free = _FREE * prior_scatter(structure)
    for one in healthy:
        known = Belief(one.belief.mean, np.zeros_like(one.belief.covariance))
        own = Evidence(structure, (), known, np.ones(10), one.made, free)
        unknown = np.zeros(structure.n)
        for r in one.made:
            spread = np.einsum("rjp,pq,rjq->rj", r.columns, one.belief.covariance, r.columns, optimize=True)
            unknown += (spread * (r.weights > 0)).sum(axis=0)
        square = [
            Evidence(structure, (), known, np.ones(10), h.made, free).fit(()).fitted
            for h in healthy
            if h is not one
        ]
        others = np.mean(square, axis=0) + unknown / own.count
        ratio = np.where(structure.frame.moving, own.fit(()).fitted / np.maximum(others, 1e-300), 0.0)
        j = int(np.argmax(ratio))
        told = {"session": one.name, "joint": structure.joints[j]}
        found.append((ratio[j], told | {"rms": float(np.sqrt(own.fit(()).fitted[j])),
                                        "others": float(np.sqrt(others[j]))}))  # fmt: skip
    ratio, worst = max(found, key=lambda pair: pair[0])
    return worst if ratio > _BAD else None


def choose_terms(diagnosis: Diagnosis) -> Regression:
    """The closed loop's model with plain friction at every joint, without generic terms that do not help.

    Friction may change that the loop did not need to name. A generic term may explain differences between
    sessions, most of all by temperature, for which tracking has columns. So it is kept only where held-out
    healthy sessions are predicted better with it.
    """
    after, moving = diagnosis.after, np.flatnonzero(diagnosis.prepared.moving)
    added = []
    for friction in plain_friction():
        for joint in map(int, moving):
            own = [entry.effect for entry in after.entries if entry.joint == joint]
            if not any(friction.name in (effect.name, *effect.contains) for effect in own):
                added.append(plain_term(friction, joint))
    model = refit(after, [*after.entries, *added]) if added else after
    for term in [entry for entry in model.entries if entry.effect.empirical]:
        less = refit(model, [entry for entry in model.entries if entry is not term])
        if held_out_loss(diagnosis, less) <= held_out_loss(diagnosis, model):
            model = less
    return model


def add_shown(diagnosis: Diagnosis, model: Regression) -> Regression:
    """The model with terms that the healthy sessions show alike, each against the others.

    The closed loop may leave out what few sessions show weakly. In a session whose motion shows it better, it
    would look like a change.
    """
    payload_prior = np.diag(payload_penalty(diagnosis.prepared))
    for _ in range(_MOST_SHOWN):
        structure, made, prior = lay_out(diagnosis, model)
        able = [
            change
            for change in list_changes(structure, structure.theta)
            if change.kind != BODY and len(change.terms) == 1 and _may_be_missing(structure, change.terms[0])
        ]
        held = [
            Evidence(structure, able, one.belief, payload_prior, one.made, prior_scatter(structure))
            for one in hold_out(structure, made, prior)
        ]
        chances = [_find_chance([evidence.fit([change]) for evidence in held], change) for change in able]
        k = int(np.argmin([*chances, _CHANCE / max(len(able), 1)]))
        if k == len(able):
            return model
        more = refit(model, [*model.entries, able[k].terms[0]])
        if held_out_loss(diagnosis, more) >= held_out_loss(diagnosis, model):
            return model
        model = more
    return model


def _find_chance(fits: Sequence[Fit], change: Change) -> float:
    """p-value of the hypothesis that a change is zero in all sessions."""
    weights = [invert(fit.covariances[change.key]) for fit in fits]
    score = sum(w @ fit.values[change.key] for w, fit in zip(weights, fits, strict=True))
    return float(stats.chi2.sf(score @ invert(np.sum(weights, axis=0)) @ score, change.count))


def _may_be_missing(structure: Structure, term: ModelTerm) -> bool:
    """Whether a healthy machine may have a term that its structure lacks."""
    present = [(entry.effect.name, entry.joint) for entry in structure.entries]
    later = term.effect.needs_wear or term.is_measurement_error
    return not later and (term.effect.name, term.joint) not in present


def hold_out(structure: Structure, made: Sequence[RunRows], prior: np.ndarray) -> list[Healthy]:
    """Each healthy session, with the belief from the others."""
    return [Healthy(n, own, fit_belief(structure, rest, prior)) for n, rest, own in split_healthy(made)]


def held_out_loss(diagnosis: Diagnosis, model: Regression) -> float:
    """Sum of squared residuals of all healthy sessions, each held out, over the residual's variance."""
    structure, made, prior = lay_out(diagnosis, model)
    total = 0.0
    for _, rest, own in split_healthy(made):
        mean = fit_belief(structure, rest, prior).mean
        for r in own:
            left = (r.target - r.columns @ mean) * (r.weights > 0) / diagnosis.after.sigma
            total += float(np.sum(left**2))
    return total


def lay_out(diagnosis: Diagnosis, model: Regression) -> tuple[Structure, list[RunRows], np.ndarray]:
    """Structure of a model, rows of all healthy runs in it, and prior precision of its columns (P, P)."""
    structure = hold_structure(diagnosis, model)
    made, seen = [], set()
    for run in diagnosis.prepared.runs:
        if run.label not in seen:
            seen.add(run.label)
            made.append(make_rows(structure, run))
    prior = np.eye(structure.width)
    prior[: structure.count, : structure.count] = model.weak_prior
    return structure, made, prior


def split_healthy(rows: Sequence[RunRows]) -> list[tuple[str, list[RunRows], list[RunRows]]]:
    """For each healthy session: its name, the others' training runs, its own runs.

    Where there is only one session, each of its runs is taken as one.
    """

    def split(by: Callable[[RunRows], str]) -> list[tuple[str, list[RunRows], list[RunRows]]]:
        found = []
        for name in dict.fromkeys(by(r) for r in rows):
            rest = [r for r in rows if by(r) != name and r.run.use == "train"]
            if rest:
                found.append((name, rest, [r for r in rows if by(r) == name]))
        return found

    units = split(lambda r: r.run.session or "")
    return units if len(units) > 1 else split(lambda r: r.run.file)


def hold_structure(diagnosis: Diagnosis, model: Regression) -> Structure:
    """The structure of a model that the closed loop found, with fixed shapes and filters."""
    prepared = diagnosis.prepared
    train = prepared.runs_for("train")
    warmth = np.concatenate([run.signals.temperature for run in train])
    known = np.isfinite(warmth).all(axis=0)
    filled = np.where(known, warmth, 0.0)
    span = np.array([filled.min(axis=0), filled.max(axis=0)])
    n = prepared.n
    structure = Structure(
        tuple(prepared.dataset.joints),
        tuple(prepared.dataset.position_unit),
        tuple(prepared.dataset.torque_unit),
        Frame.of(prepared),
        tuple(model.entries),
        model.solve(),
        model.inertial,
        np.where(known, filled.mean(axis=0), np.nan),
        np.where(known, span, np.nan),
        Scales(*np.ones((4, n))),
    )
    return replace(structure, scales=measure_scales(structure, diagnosis))


def measure_scales(structure: Structure, diagnosis: Diagnosis) -> Scales:
    """Sizes of the torques and of the noise along the training runs.

    Autocorrelation makes sums of the noise over blocks larger. The noise is increased accordingly, by the
    largest factor of the sums for an offset, Coulomb and viscous friction.
    """
    train = [make_rows(structure, run) for run in diagnosis.prepared.runs_for("train")]
    keep = np.concatenate([r.weights > 0 for r in train])
    columns = np.concatenate([r.columns[..., : structure.count] for r in train])
    known = np.concatenate([r.run.measured - r.target for r in train])
    rubbing = np.zeros_like(structure.theta)
    for entry, span in zip(structure.entries, structure.spans, strict=True):
        rubbing[span] = structure.theta[span] * entry.effect.is_friction
    friction, torque = columns @ rubbing, known + columns @ structure.theta
    left = (np.concatenate([r.run.measured for r in train]) - torque) * keep
    speed = np.concatenate([r.run.reduce(r.signals.v) for r in train])
    sign = np.concatenate([r.run.reduce(r.signals.sign) for r in train])
    firsts = np.cumsum([0, *(len(r.target) for r in train[:-1])])
    starts = np.concatenate([first + r.starts for first, r in zip(firsts, train, strict=True)])
    memory = np.ones(structure.n)
    for direction in (np.ones_like(sign), sign, speed):
        together = (np.add.reduceat(direction * left, starts, axis=0) ** 2).sum(axis=0)
        memory = np.maximum(memory, together / np.maximum(((direction * left) ** 2).sum(axis=0), 1e-300))
    count = np.maximum(keep.sum(axis=0), 1)
    sizes = [np.sqrt((x**2 * keep).sum(axis=0) / count) for x in (friction, torque, speed, left)]
    white = np.maximum(sizes[3], 1e-9)
    usual = np.maximum.reduce([sizes[0], _LEAST_FRICTION * sizes[1], _LEAST_OF_NOISE * white])
    return Scales(usual, np.maximum(sizes[1], usual), np.maximum(sizes[2], 1e-9), white * np.sqrt(memory))


def fit_belief(structure: Structure, rows: Sequence[RunRows], prior: np.ndarray) -> Belief:
    """Weights of the structure's columns from training runs, with friction that scatters between sessions.

    Parameters
    ----------
    structure : Structure
    rows : sequence of RunRows
    prior : ndarray (P, P)
        Precision of the weights about zero.
    """
    p, moving = structure.width, np.flatnonzero(structure.frame.moving)
    names = list(dict.fromkeys(r.run.session for r in rows))
    extra = 2 * len(moving)
    size = p + extra * len(names)
    hessian = np.eye(size)
    hessian[:p, :p] = prior
    score = np.zeros(size)
    parts = []
    for r in rows:
        x = np.zeros((*r.target.shape, size))
        x[..., :p] = r.columns
        start = p + extra * names.index(r.run.session)
        for k, j in enumerate(moving):
            for i, column in enumerate(structure.friction_columns(r.signals, int(j))):
                x[:, j, start + 2 * k + i] = PRIOR_FRICTION * r.run.reduce_columns(column, int(j))
        x = (x * r.weights[:, :, None]).reshape(-1, size)
        y = (r.target * r.weights).ravel()
        hessian += x.T @ x
        score += x.T @ y
        parts.append((x, y, r.starts * structure.n))
    inverse = invert(hessian, 1e-13)
    mean = inverse @ score
    blocks = [np.add.reduceat(x * (y - x @ mean)[:, None], starts, axis=0) for x, y, starts in parts]
    every = np.concatenate(blocks)
    known = np.eye(size)
    known[:p, :p] = prior
    meat = every.T @ every + known
    covariance = inverse @ meat @ inverse
    return Belief(mean[:p], 0.5 * (covariance + covariance.T)[:p, :p])
