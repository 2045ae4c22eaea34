"""The healthy machine: structure from the closed loop on the reference, parameters, scatter of sessions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wearscope.closed_loop.diagnosis import Diagnosis, diagnose
from wearscope.closed_loop.model.inertials import payload_penalty
from wearscope.closed_loop.model.prediction import refit
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.selection.policy import Policy
from wearscope.effects.vocabulary import plain_friction
from wearscope.robots.model import RobotModel
from wearscope.tracking.changes import Change, list_changes, list_measured, plain_term
from wearscope.tracking.inference import Belief, Estimate, Sample, estimate_change, make_sample
from wearscope.tracking.rows import RunRows, make_rows, stack_rows
from wearscope.tracking.scatter import PRIOR_FRICTION, Scatter, measure_scatter
from wearscope.tracking.session_names import Sessions
from wearscope.tracking.session_runs import Frame
from wearscope.tracking.sessions import read_reference
from wearscope.tracking.structure import Scales, Structure
from wearscope.tracking.tracked_model import make_healthy_model

#: Least friction of a joint, as a share of its torque, and of its residual: what a change is measured by.
_LEAST_FRICTION, _LEAST_OF_NOISE = 0.02, 1.0


@dataclass(frozen=True, eq=False)
class Reference:
    """What later sessions are compared with.

    Attributes
    ----------
    sessions : tuple of str
        Of the reference.
    structure : Structure
    belief : Belief
        Of all training runs.
    payload_prior : ndarray (10,)
    scatter : Scatter
    held_out : dict of str to dict of str to Estimate
        Each change in each healthy session, held out; by session (run where there is one), then by key.
    robot : RobotModel
        The healthy machine, as the simulator has it.
    """

    sessions: tuple[str, ...]
    structure: Structure
    belief: Belief
    payload_prior: np.ndarray
    scatter: Scatter
    held_out: dict[str, dict[str, Estimate]]
    robot: RobotModel

    @property
    def changes(self) -> list[Change]:
        """What may change."""
        return list_changes(self.structure)

    @property
    def measured(self) -> list[Change]:
        """What may change, and what only has a size."""
        return list_measured(self.structure)


def identify_reference(
    sessions: Sessions,
    policy: Policy | None = None,
    progress: Callable[[str], None] = lambda _: None,
    effects: Sequence[str | Path] = (),
    allow_code: bool = False,
) -> Reference:
    """Identify the healthy machine; parameters as of `wearscope.closed_loop.diagnosis.diagnose`.

    Raises
    ------
    InputError
        Where the reference's runs break the format or cannot be what they say.
    """
    diagnosis = diagnose(read_reference(sessions), policy, progress, effects, allow_code)
    model = choose_terms(diagnosis)
    structure, made, prior = lay_out(diagnosis, model)
    belief = fit_belief(structure, [r for r in made if r.run.use == "train"], prior)
    payload_prior = np.diag(payload_penalty(diagnosis.prepared))
    changes = list_measured(structure)
    held_out: dict[str, dict[str, Estimate]] = {}
    for name, rest, own in split_healthy(made):
        believed = fit_belief(structure, rest, prior)
        stacked = stack_rows(structure, changes, own)
        sample = make_sample(stacked, changes, believed, payload_prior)
        known = make_sample(stacked, changes, believed, payload_prior, structure.of_temperature)
        estimates = {
            change.key: estimate_change(choose_sample(structure, change, sample, known), change)
            for change in changes
        }
        held_out[name] = {key: e for key, e in estimates.items() if e is not None}
    moving = int(structure.frame.moving.sum())
    scatter = measure_scatter(list(held_out.values()), moving, len(sessions.reference) > 1)
    progress(
        f"healthy sessions scatter by {100 * scatter.friction:.2g} % of friction, "
        f"{100 * scatter.torque:.2g} % of torque ({scatter.sessions} held out)"
    )
    robot = make_healthy_model(diagnosis, model, structure, belief)
    return Reference(sessions.reference, structure, belief, payload_prior, scatter, held_out, robot)


def choose_sample(structure: Structure, change: Change, sample: Sample, known: Sample) -> Sample:
    """The sample that a change is estimated from; `known` is as if what temperature does were known.

    The size of a joint's friction whose temperature was not recorded is shown as it was felt, by whatever
    cause; an unknown temperature may be all of any change.
    """
    return known if not change.asked and np.isnan(structure.temperature[change.joint]) else sample


def choose_terms(diagnosis: Diagnosis) -> Regression:
    """The closed loop's model with plain friction at every joint, without generic terms that do not help.

    What changes may be friction that the loop did not need to name. A generic term may take the part of what
    differs between sessions, temperature above all, which here has columns of its own: it is kept where
    healthy sessions, held out, are predicted better with it.
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


def held_out_loss(diagnosis: Diagnosis, model: Regression) -> float:
    """Sum of squared residuals of all healthy sessions, each held out, in the residual's scale."""
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
    """Name, training runs of the rest, own runs of each healthy session; of each run where there is one."""

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
    """The structure of a model that the closed loop found, its shapes and filters held."""
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
    """Sizes of the torques along the training runs; what autocorrelation adds to a block's sum of the noise.

    The latter is the largest of those of an offset, of Coulomb and of viscous friction.
    """
    size, count, left = np.zeros((3, structure.n)), np.zeros(structure.n), np.zeros(structure.n)
    together, apart = np.zeros((3, structure.n)), np.zeros((3, structure.n))
    for run in diagnosis.prepared.runs_for("train"):
        rows = make_rows(structure, run)
        signals, keep = rows.signals, rows.weights > 0
        friction = np.zeros_like(signals.q)
        for entry, span in zip(structure.entries, structure.spans, strict=True):
            if entry.effect.is_friction:
                friction += entry.columns(signals) @ structure.theta[span]
        predicted = rows.columns[..., : structure.count] @ structure.theta
        residual = (rows.target - predicted) * keep
        speed, sign = run.reduce(signals.v), run.reduce(signals.sign)
        torque = run.reduce(run.known) + predicted
        for k, x in enumerate((run.reduce(friction), torque, speed)):
            size[k] += (x**2 * keep).sum(axis=0)
        for k, direction in enumerate((np.ones_like(sign), sign, speed)):
            together[k] += (np.add.reduceat(direction * residual, rows.starts, axis=0) ** 2).sum(axis=0)
            apart[k] += ((direction * residual) ** 2).sum(axis=0)
        count += keep.sum(axis=0)
        left += (residual**2).sum(axis=0)
    friction, torque, speed = np.sqrt(size / np.maximum(count, 1))
    white = np.sqrt(np.maximum(left / np.maximum(count, 1), 1e-18))
    memory = np.maximum((together / np.maximum(apart, 1e-300)).max(axis=0), 1.0)
    friction = np.maximum.reduce([friction, _LEAST_FRICTION * torque, _LEAST_OF_NOISE * white])
    return Scales(friction, np.maximum(torque, friction), np.maximum(speed, 1e-9), white * np.sqrt(memory))


def fit_belief(structure: Structure, rows: Sequence[RunRows], prior: np.ndarray) -> Belief:
    """Weights of the structure's columns from training runs, whose sessions' friction scatters.

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
            for viscous in (False, True):
                column = structure.friction_column(r.signals, int(j), viscous)
                x[:, j, start + 2 * k + viscous] = PRIOR_FRICTION * r.run.reduce(column)
        x = (x * r.weights[:, :, None]).reshape(-1, size)
        y = (r.target * r.weights).ravel()
        hessian += x.T @ x
        score += x.T @ y
        parts.append((x, y, r.starts * structure.n))
    scale = np.sqrt(np.diag(hessian))
    inverse = np.linalg.pinv(hessian / np.outer(scale, scale), rcond=1e-13, hermitian=True)
    inverse /= np.outer(scale, scale)
    mean = inverse @ score
    blocks = [np.add.reduceat(x * (y - x @ mean)[:, None], starts, axis=0) for x, y, starts in parts]
    every = np.concatenate(blocks)
    known = np.eye(size)
    known[:p, :p] = prior
    meat = every.T @ every + known
    covariance = inverse @ meat @ inverse
    return Belief(mean[:p], 0.5 * (covariance + covariance.T)[:p, :p])
