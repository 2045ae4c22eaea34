"""Candidates: every effect that a joint may lack, with the shapes worth trying, as regression rows."""

from dataclasses import dataclass

import numpy as np

from wearscope import plugins
from wearscope.closed_loop.intake.preprocessing import Prepared, PreparedRun
from wearscope.closed_loop.model.regression import Entry
from wearscope.effects.base import Effect, MeasurementEffect, Signals, TransmissionEffect

#: Effects that contain others: declaring the first leaves nothing of the second to find.
_CONTAINS = {
    "friction_wear_temperature": ("coulomb", "viscous", "stribeck", "temperature_dependent_friction"),
    "rotor_inertia": (),
    "joint_spring": ("torque_offset",),
    "gravity_counterbalance": ("joint_spring",),
}
_NEVER = ("rigid_body", "friction_wear_temperature", "unknown")


@dataclass
class Family:
    """One effect at one joint with all shapes worth trying.

    Attributes
    ----------
    effect : Effect
    joint : int
    shapes : ndarray (S, k)
    columns : list of ndarray (M, S*m), or (M, n, S*m) where the effect spreads
        Reduced regressors of each training run.
    """

    effect: Effect
    joint: int
    shapes: np.ndarray
    columns: list[np.ndarray]

    @property
    def count(self) -> int:
        """Columns of each shape."""
        return len(self.effect.coefficients)

    def entry(self, shape: int, subset: np.ndarray) -> Entry:
        """Model entry of one shape and subset."""
        return Entry(self.effect, self.joint, tuple(self.shapes[shape]), tuple(int(i) for i in subset))


def candidate_names(declared: list[str], rotor_inertia_given: bool) -> list[str]:
    """Effects that a model with the declared effects may lack."""
    gone = set(declared) | set(_NEVER)
    for name in declared:
        gone.update(_CONTAINS.get(name, ()))
    if "rotor_inertia" not in declared or not rotor_inertia_given:
        gone.add("rotor_inertia_error")
    return [name for name in plugins.list_names("effects", "EFFECT") if name not in gone]


def applies(effect: Effect, joint: int, prepared: Prepared) -> bool:
    """Whether the runs have the signals that the effect needs at the joint."""
    if not prepared.moving[joint]:
        return False
    train = prepared.runs_for("train")
    if effect.name == "temperature_dependent_friction":
        temperature = np.concatenate([run.signals.temperature[:, joint] for run in train])
        return bool(np.isfinite(temperature).all() and np.ptp(temperature) > 0.5)
    if effect.name == "cross_coupling":
        return prepared.n > 1
    # One payload for all joints: the last joint stands for it.
    if effect.name == "payload_error":
        return joint == prepared.n - 1
    return True


def joined_signals(runs: list[PreparedRun]) -> Signals:
    """Signals of several runs end to end, to choose shapes from."""

    def join(name: str) -> np.ndarray:
        return np.concatenate([getattr(run.signals, name) for run in runs])

    first = runs[0]
    return Signals(
        t=join("t"),
        q=join("q"),
        v=join("v"),
        a=join("a"),
        sign=join("sign"),
        load=join("load"),
        temperature=join("temperature"),
        wear=join("wear"),
        rigid_body=first.signals.rigid_body,
        bandwidth=first.band.torque,
    )


def reduce_columns(effect: Effect, joint: int, shapes: np.ndarray, run: PreparedRun) -> np.ndarray:
    """Reduced regressors of all shapes for one run, (M, S*m) or (M, n, S*m)."""
    chunks = []
    for start in range(0, len(shapes), 64):
        chunks.append(run.reduce(effect.stack(run.signals, joint, shapes[start : start + 64])))
    return np.concatenate(chunks, axis=-1)


def make_family(effect: Effect, joint: int, prepared: Prepared, joined: Signals) -> Family:
    """Candidate family of an effect at a joint."""
    train = prepared.runs_for("train")
    shapes = effect.shapes(joined, joint)
    columns = [reduce_columns(effect, joint, shapes, run) for run in train]
    return Family(effect, joint, shapes, columns)


def follows_torque(family: Family) -> bool:
    """Whether a family's regressors change with the model's prediction."""
    return isinstance(family.effect, MeasurementEffect | TransmissionEffect)
