"""Models before and after as files that the simulator loads."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.dataset_fields import state_payload
from wearscope.closed_loop.intake.prepared import Prepared, known_inertia
from wearscope.closed_loop.model.delays import find_shift
from wearscope.closed_loop.model.estimation import Estimate
from wearscope.closed_loop.model.inertials import nearest_consistent
from wearscope.closed_loop.model.regression import Regression
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.model import RobotModel, make_model, save_model

#: Least room between the limits of a joint that never moves [rad or m].
_LEAST_ROOM = 1e-3


def _limits(prepared: Prepared) -> dict[str, list[float]]:
    """Motion limits from the measured ranges, with a margin, so that test-cycles can be planned."""

    def largest(name: str) -> np.ndarray:
        return np.max([np.abs(getattr(run.signals, name)).max(axis=0) for run in prepared.runs], axis=0)

    speed = np.maximum(1.1 * largest("v"), 1e-3)
    acceleration = np.maximum(1.1 * largest("a"), 1e-2)
    torque = np.max([np.abs(run.tau).max(axis=0) for run in prepared.runs], axis=0)
    torque = np.where(torque > 0.0, torque, torque.max())  # a joint that rests may record none
    stated = prepared.dataset.fields.robot.torque_limit
    return {
        "speed_limit": speed.tolist(),
        "acceleration_limit": acceleration.tolist(),
        "jerk_limit": (20.0 * acceleration).tolist(),
        "torque_limit": list(stated) if stated is not None else (2.0 * torque).tolist(),
    }


def estimate_torque_noise(torques: Sequence[np.ndarray], kept: float = 1.0) -> list[float]:
    """Standard deviation of white noise on each joint's recorded torque, from its third differences.

    Motion is smooth from sample to sample, noise is not; the median is robust against reversals. Noise that
    the drive has filtered is underestimated.

    Parameters
    ----------
    torques : sequence of ndarray (N, n)
    kept : float
        Share of the recorded rate that was kept: thinned recordings lost the noise above their new rate.
    """
    differences = [np.diff(tau, 3, axis=0) for tau in torques]
    size = np.median(np.abs(np.concatenate(differences)), axis=0) * 1.4826 / np.sqrt(20.0)
    return [float(value) for value in size / np.sqrt(min(kept, 1.0))]


def make_corrected_model(
    prepared: Prepared,
    model: Regression,
    estimates: Sequence[Estimate | Mapping[str, float]],
    stage: str,
    theta: np.ndarray | None = None,
) -> RobotModel:
    """Complete robot model of one stage.

    Parameters
    ----------
    prepared : Prepared
    model : Regression
    estimates : sequence of Estimate or of mapping
        Estimates of the model's entries, or their parameters alone.
    stage : str
        ``before`` or ``after``; part of the name.
    theta : ndarray (p,), optional
        Coefficients; those of the fit within their physical bounds where left out.
    """
    dataset = prepared.dataset
    robot = dataset.fields.robot
    drive = _limits(prepared)
    if robot.gear_ratio is not None:
        drive["gear_ratio"] = [abs(g) for g in robot.gear_ratio]
    drive["rotor_inertia"] = known_inertia(dataset).tolist()
    train = prepared.runs_for("train")
    effects: list[dict[str, object]] = [
        {"joint": joint, "effect": "rigid_body", "source": "declared"} for joint in dataset.joints
    ]
    theta = model.solve_bounded() if theta is None else theta
    for entry, estimate, span in zip(model.entries, estimates, model.spans, strict=True):
        names = [entry.effect.coefficients[k].name for k in entry.subset]
        values: Mapping[str, float] = estimate.values if isinstance(estimate, Estimate) else estimate
        told = _tell_intervals(estimate) if isinstance(estimate, Estimate) else {}
        fitted = dict(zip(names, theta[span].tolist(), strict=True))
        if entry.is_measurement_error and "delay" in fitted:
            fitted["delay"] += find_shift(prepared, entry.joint)
        effects.append(
            {
                "joint": dataset.joints[entry.joint],
                "effect": entry.effect.label,
                "parameters": {**values, **fitted},
                "source": f"fitted on {', '.join(run.file for run in train)}",
                **told,
            }
        )
    lowest = np.min([run.signals.q.min(axis=0) for run in prepared.runs], axis=0)
    highest = np.max([run.signals.q.max(axis=0) for run in prepared.runs], axis=0)
    payload, *others = (run.payload for run in dataset.runs)
    words = [dataset.fields.description, f"Model {stage} closing the loop."]
    if any(other != payload for other in others):
        payload, words = None, [*words, "Its recordings carry different payloads; it carries none."]
    fields = {
        "name": f"{safe_name(dataset)}-{stage}",
        "description": " ".join(words).strip(),
        "source": dataset.fields.source,
        "urdf": f"model_{stage}.urdf",
        "joints": list(dataset.joints),
        "gravity": list(robot.gravity),
        "drive": drive,
        "sensors": {
            "torque_noise": estimate_torque_noise(
                [run.tau for run in prepared.runs], prepared.band.rate / dataset.fields.sample_rate
            ),
            "sample_rate": dataset.fields.sample_rate,
        },
        "payload": state_payload(payload),
        "home": train[0].signals.q[0].tolist(),
        "lower": lowest.tolist(),
        "upper": np.maximum(highest, lowest + _LEAST_ROOM).tolist(),
        "effects": effects,
    }
    return make_model(fields, corrected_urdf(prepared, model, theta), f"model_{stage}.yaml", strict=False)


def _tell_intervals(estimate: Estimate) -> dict[str, object]:
    """Fields of an effect in a model file that hold its intervals; empty for a generic term."""
    ends = {name: [float(x) for x in pair] for name, pair in estimate.intervals.items()}
    kept = {name: pair for name, pair in ends.items() if np.isfinite(pair).all()}
    if estimate.entry.effect.empirical or not kept:
        return {}
    return {"identified": True, "intervals": kept}


def corrected_urdf(prepared: Prepared, model: Regression, theta: np.ndarray) -> str:
    """URDF with the inertial parameters of `theta` (p,), made physically consistent.

    It is unchanged where the model does not fit them.
    """
    if not model.inertial:
        return prepared.urdf
    dataset = prepared.dataset
    body = RigidBody(prepared.urdf, dataset.joints, tuple(dataset.fields.robot.gravity))
    parameters = body.inertial_parameters + theta[: 10 * prepared.n]
    hessian = model.moments()[0][: 10 * prepared.n, : 10 * prepared.n]
    return body.with_inertial_parameters(
        nearest_consistent(parameters, body.inertial_parameters, hessian)
    ).urdf_text()


def safe_name(dataset: Dataset) -> str:
    """Name of a data set with characters that a file name may have."""
    kept = "".join(c if c.isalnum() or c in "_.-" else "-" for c in dataset.name)
    return kept.lstrip("-_.") or "dataset"


def write_models(folder: Path, models: dict[str, RobotModel]) -> None:
    """Write each stage's model and its URDF."""
    for stage, model in models.items():
        save_model(model, folder / f"model_{stage}.yaml")
