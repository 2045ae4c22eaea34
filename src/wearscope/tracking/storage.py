"""The reference in one file, so that a session needs no new identification: numbers and names, no code."""

import io
import json
from collections.abc import Collection
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.filtering import Band
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import load_effect
from wearscope.errors import InputError
from wearscope.files import write_whole
from wearscope.robots.model import make_model
from wearscope.tracking.changes import Change, list_measured
from wearscope.tracking.inference import Belief, Estimate
from wearscope.tracking.reference import Reference
from wearscope.tracking.scatter import Scatter
from wearscope.tracking.session_runs import Frame
from wearscope.tracking.structure import Scales, Structure

_FRAME = ("moving", "top_speed", "reach")
_ESTIMATE = ("value", "noise", "shares", "prior")


def save_reference(path: str | Path, reference: Reference) -> None:
    """Write a reference whole or not at all; equal references give equal bytes."""
    structure, scatter = reference.structure, reference.scatter
    frame = structure.frame
    arrays: dict[str, np.ndarray] = {name: getattr(frame, name) for name in _FRAME}
    arrays |= {"reversal_width": frame.reversals.width, "reversal_form": frame.reversals.form}
    arrays |= {f"scales_{name}": value for name, value in asdict(structure.scales).items()}
    arrays |= {
        "theta": structure.theta,
        "temperature": structure.temperature,
        "warmth": structure.warmth,
        "mean": reference.belief.mean,
        "covariance": reference.belief.covariance,
        "payload_prior": reference.payload_prior,
    }
    held_out: dict[str, dict[str, Any]] = {}
    for k, (session, estimates) in enumerate(reference.held_out.items()):
        held_out[session] = {key: [e.gain, e.torque] for key, e in estimates.items()}
        for key, estimate in estimates.items():
            arrays |= {f"{k}/{key}/{name}": getattr(estimate, name) for name in _ESTIMATE}
    words = {
        "sessions": reference.sessions,
        "joints": structure.joints,
        "position_unit": structure.position_unit,
        "torque_unit": structure.torque_unit,
        "urdf": frame.urdf,
        "band": asdict(frame.band),
        "inertial": structure.inertial,
        "entries": [[e.effect.label, e.joint, e.shape, e.subset] for e in structure.entries],
        "scatter": {**asdict(scatter), "inflation": dict(sorted(scatter.inflation.items()))},
        "held_out": held_out,
        "robot": {"fields": reference.robot.to_mapping(), "urdf": reference.robot.urdf_text},
    }
    arrays["words"] = np.array(json.dumps(words))

    def write(name: str) -> None:
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **{key: np.asarray(x) for key, x in sorted(arrays.items())})
        Path(name).write_bytes(content.getvalue())

    write_whole(path, write)


def load_reference(path: str | Path, own: Collection[str] = (), allow_code: bool = False) -> Reference:
    """Read what `save_reference` wrote.

    Parameters
    ----------
    path : path-like
    own : collection of str
        Files of own effects that may run.
    allow_code : bool
        Whether any effect file that the reference names may run.

    Raises
    ------
    InputError
        Where the file is missing or is no reference, or an effect's file may not run.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
        words = json.loads(str(arrays["words"]))
        return _restore(arrays, words, {str(x) for x in own}, allow_code)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(
            f"{path}: is no reference of a tracked machine ({error}); remove it and track again."
        ) from error


def _restore(
    arrays: dict[str, np.ndarray], words: dict[str, Any], own: set[str], allow_code: bool
) -> Reference:
    n = len(words["joints"])
    entries = tuple(
        ModelTerm(
            load_effect(label, allow_code or label in own).for_robot(n), joint, tuple(shape), tuple(subset)
        )
        for label, joint, shape, subset in words["entries"]
    )
    reversals = Reversals(arrays["reversal_width"], arrays["reversal_form"])
    own_frame = {name: arrays[name] for name in _FRAME}
    frame = Frame(words["urdf"], Band(**words["band"]), reversals=reversals, **own_frame)
    names = ("friction", "torque", "speed", "noise")
    structure = Structure(
        tuple(words["joints"]),
        tuple(words["position_unit"]),
        tuple(words["torque_unit"]),
        frame,
        entries,
        arrays["theta"],
        bool(words["inertial"]),
        arrays["temperature"],
        arrays["warmth"],
        Scales(*(arrays[f"scales_{name}"] for name in names)),
    )
    changes = {change.key: change for change in list_measured(structure)}
    held_out = {
        session: {key: _restore_estimate(arrays, k, changes[key], *sizes) for key, sizes in kept.items()}
        for k, (session, kept) in enumerate(words["held_out"].items())
    }
    return Reference(
        tuple(words["sessions"]),
        structure,
        Belief(arrays["mean"], arrays["covariance"]),
        arrays["payload_prior"],
        Scatter(**words["scatter"]),
        held_out,
        make_model(words["robot"]["fields"], words["robot"]["urdf"], "reference", strict=False),
    )


def _restore_estimate(
    arrays: dict[str, np.ndarray], k: int, change: Change, gain: float, torque: float
) -> Estimate:
    value, noise, shares, prior = (arrays[f"{k}/{change.key}/{name}"] for name in _ESTIMATE)
    return Estimate(change, value, noise, shares, prior, gain, torque)
