"""The reference in one file of numbers and names without code, so that it is identified only once."""

import io
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.filtering import Band
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.effects.base import load_effect
from wearscope.errors import InputError
from wearscope.robots.model import make_model
from wearscope.storage.files import write_whole
from wearscope.tracking.reference import Reference
from wearscope.tracking.session_runs import Frame
from wearscope.tracking.structure import Belief, Scales, Structure

_FRAME = ("moving", "top_speed", "reach")
_STRUCTURE = ("theta", "temperature", "warmth")
_REFERENCE = ("payload_prior", "scatter", "usual", "tails", "centres")


def save_reference(path: str | Path, reference: Reference, healthy: Sequence[Mapping[str, Any]] = ()) -> None:
    """Write a reference with the records of its sessions, whole or not at all.

    Equal references give equal bytes.
    """
    structure = reference.structure
    frame = structure.frame
    words = {
        "sessions": reference.sessions,
        "joints": structure.joints,
        "position_unit": structure.position_unit,
        "torque_unit": structure.torque_unit,
        "urdf": frame.urdf,
        "band": asdict(frame.band),
        "inertial": structure.inertial,
        "reach": reference.reach,
        "entries": [[e.effect.label, e.joint, e.shape, e.subset] for e in structure.entries],
        "scattering": reference.scattering,
        "healthy": list(healthy),
        "robot": {"fields": reference.robot.to_mapping(), "urdf": reference.robot.urdf_text},
    }
    arrays = {
        **{name: getattr(frame, name) for name in _FRAME},
        "reversal_width": frame.reversals.width,
        "reversal_form": frame.reversals.form,
        **{f"scales_{name}": value for name, value in asdict(structure.scales).items()},
        **{name: getattr(structure, name) for name in _STRUCTURE},
        **{name: getattr(reference, name) for name in _REFERENCE},
        "mean": reference.belief.mean,
        "covariance": reference.belief.covariance,
        "words": np.array(json.dumps(words)),
    }

    def write(name: str) -> None:
        content = io.BytesIO()
        np.savez(content, allow_pickle=False, **{key: np.asarray(x) for key, x in sorted(arrays.items())})
        Path(name).write_bytes(content.getvalue())

    write_whole(path, write)


def load_reference(
    path: str | Path, own: Collection[str] = (), allow_code: bool = False
) -> tuple[Reference, list[dict[str, Any]]]:
    """Read what `save_reference` wrote: the reference, and the records of its sessions.

    Parameters
    ----------
    path : path-like
    own : collection of str
        Effect files that may run.
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
) -> tuple[Reference, list[dict[str, Any]]]:
    """Reference and its sessions' records, from the arrays and the texts of a file."""
    n = len(words["joints"])
    entries = tuple(
        ModelTerm(
            load_effect(label, allow_code or label in own).for_robot(n), joint, tuple(shape), tuple(subset)
        )
        for label, joint, shape, subset in words["entries"]
    )
    reversals = Reversals(arrays["reversal_width"], arrays["reversal_form"])
    parts = {name: arrays[name] for name in _FRAME}
    frame = Frame(words["urdf"], Band(**words["band"]), reversals=reversals, **parts)
    structure = Structure(
        tuple(words["joints"]),
        tuple(words["position_unit"]),
        tuple(words["torque_unit"]),
        frame,
        entries,
        inertial=bool(words["inertial"]),
        scales=Scales(**{field.name: arrays[f"scales_{field.name}"] for field in fields(Scales)}),
        **{name: arrays[name] for name in _STRUCTURE},
    )
    reference = Reference(
        tuple(words["sessions"]),
        structure,
        Belief(arrays["mean"], arrays["covariance"]),
        reach=float(words["reach"]),
        scattering=words["scattering"],
        robot=make_model(words["robot"]["fields"], words["robot"]["urdf"], "reference", strict=False),
        **{name: arrays[name] for name in _REFERENCE},
    )
    return reference, words["healthy"]
