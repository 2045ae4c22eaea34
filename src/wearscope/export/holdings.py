"""Numbers of a model that each format can hold, and the effects that it cannot hold."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from wearscope.effects.base import Effect, Plant, load_effect
from wearscope.effects.kinds import (
    ArmatureEffect,
    InertialEffect,
    PayloadEffect,
    RigidBodyEffect,
    TransmissionEffect,
)
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array, Inertia
from wearscope.simulation.plant import build_plant

URDF, MJCF, ISAAC = "URDF", "MJCF", "Isaac Lab"
FORMATS = (URDF, MJCF, ISAAC)
#: Effects that are part of the model's bodies and rotors.
BODIES = (RigidBodyEffect, ArmatureEffect, PayloadEffect, InertialEffect)
#: Passive terms that each format lacks.
LACKS = {
    URDF: {
        "quadratic": "URDF's damping is linear in the speed",
        "stiffness": "URDF has no joint spring",
        "falling": "URDF's friction does not fall with the speed",
        "presliding": "URDF's friction has no memory",
        "wave": "URDF has no torque that goes with the position",
    },
    ISAAC: {
        "quadratic": "its viscous friction is linear in the speed",
        "stiffness": "its actuators have no passive spring",
        "falling": "its static friction holds at rest only, whatever the speed from which friction falls",
        "presliding": "its friction has no memory",
        "wave": "it has no torque that goes with the position",
    },
}
#: Signals on which a passive joint cannot depend, and where each is held.
_HELD_AT = {
    "temp_{joint}": "at {temperature} deg C",
    "wear_{joint}": "without wear",
    "load_{joint}": "at one load, the mean of the motion compared, and does not fall",
}
#: Highest frequency [rad/s] of a gear with the inertias on its two sides, and of a joint's inertia on the
#: bristles of its friction where the model states no displacement. Eight coupled joints of this frequency
#: stay below the 2000 rad/s that a step of 1 ms can follow.
FASTEST = 700.0
#: Least radius of gyration of a corrected body [m].
LEAST_RADIUS = 1e-3


@dataclass(frozen=True)
class Left:
    """An effect, or a part of it, that a format cannot hold.

    Attributes
    ----------
    format : str
    joint, effect : str
    reason : str
    """

    format: str
    joint: str
    effect: str
    reason: str


@dataclass
class Holdings:
    """Numbers of a model that formats can hold, by joint, and the effects that they leave out.

    Attributes
    ----------
    friction : ndarray (n,)
        Coulomb level [N m or N].
    damping, quadratic : ndarray (n,)
        Factors of v and of v abs(v).
    armature : ndarray (n,)
        Inertia of the rotor at the joint.
    stiffness, preload : ndarray (n,)
        Spring against which the motor needs the torque stiffness q + preload.
    body : RigidBody
        Corrected bodies with the corrected payload.
    corrected : ndarray (n, 10)
        Corrections of the links' inertial parameters; those of the payload are at the last link.
    by_load : ndarray (n,)
        Coulomb friction over the load; `friction` includes it at one load.
    left : list of Left
    falling : dict of int to list
        Level, speed and exponent of each friction that falls with the speed, by joint.
    presliding : dict of int to list
        Level of each presliding friction, and the displacement over which it reverses, by joint.
    wave : dict of int to list
        Cosine, sine and wavenumber of each torque wave over the position, by joint.
    gear : dict of int to tuple
        Compliance, lost motion and the torque that takes it up, by joint.
    """

    friction: Array
    damping: Array
    quadratic: Array
    armature: Array
    stiffness: Array
    preload: Array
    body: RigidBody
    corrected: Array
    by_load: Array
    left: list[Left] = field(default_factory=list)
    falling: dict[int, list[tuple[float, float, float]]] = field(default_factory=dict)
    presliding: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    wave: dict[int, list[tuple[float, float, float]]] = field(default_factory=dict)
    gear: dict[int, tuple[float, float, float]] = field(default_factory=dict)

    def gear_inertia(self, j: int) -> float:
        """Reduced inertia of a gear's two sides [kg m^2 or kg], all joints at 0 and the other links free."""
        mobility = np.linalg.inv(self.body.mass_matrix(np.zeros(len(self.friction))))
        return 1.0 / float(mobility[j, j] + 1.0 / self.armature[j])

    def torque(self, v: Array, a: Array, q: Array, load: Array, format: str = MJCF) -> Array:
        """Torque (N, n) of the numbers that a format holds, including the rigid body's `load` (N, n)."""
        held = load + self.friction * np.sign(v) + self.damping * v
        if format == MJCF:
            held = (
                held + self.quadratic * v * np.abs(v) + self.armature * a + self.stiffness * q + self.preload
            )
            for j, terms in self.falling.items():
                for level, speed, exponent in terms:
                    falls = np.exp(-((np.abs(v[:, j]) / speed) ** exponent))
                    held[:, j] += level * falls * np.sign(v[:, j])
            for j, waves in self.wave.items():
                for cosine, sine, wavenumber in waves:
                    held[:, j] += cosine * np.cos(wavenumber * q[:, j]) + sine * np.sin(wavenumber * q[:, j])
        return held


def without_motors(held: Holdings) -> Holdings:
    """Holdings of MJCF without passive motors and gears."""
    return replace(held, falling={}, presliding={}, wave={}, gear={})


def held_by(held: Holdings, format: str) -> Holdings:
    """Holdings reduced to what a format can hold, so that MuJoCo can simulate any format."""
    if format == MJCF:
        return held
    zero = np.zeros_like(held.friction)
    bare = replace(without_motors(held), quadratic=zero, stiffness=zero, preload=zero)
    return replace(bare, armature=zero) if format == URDF else bare


def take_holdings(model: RobotModel, temperature: float, load: Array | None = None) -> Holdings:
    """Numbers of a model without wear that the formats can hold.

    Parameters
    ----------
    model : RobotModel
    temperature : float
        Temperature for friction that depends on it [deg C].
    load : ndarray (n,), optional
        Load for friction that depends on it [N m or N]; that in the home posture by default.
    """
    plant = build_plant(model)
    body = model.rigid_body(model.declared_payload)
    zero = ("friction", "damping", "quadratic", "stiffness", "preload", "by_load")
    nothing: dict[str, Any] = {name: np.zeros(model.n) for name in zero}
    held = Holdings(armature=plant.armature.copy(), body=body, corrected=plant.inertials, **nothing)
    for j in np.flatnonzero(held.armature):
        _leave(held, [URDF], model.joints[j], "rotor_inertia", "URDF has no rotor inertia")
    for entry in model.effects:
        effect = load_effect(entry.effect).for_robot(model.n)
        _take(
            held, model, model.joints.index(entry.joint), entry.joint, effect, entry.parameters, temperature
        )
    if load is None:
        load = np.abs(body.bias(model.home_posture, np.zeros(model.n)))
    held.friction += held.by_load * load
    for number, terms in held.presliding.items():
        if sum(level for level, _ in terms) > held.friction[number] or min(level for level, _ in terms) < 0.0:
            reason = "its level is not one of the Coulomb friction, of which it is a part"
            _leave(held, [MJCF], model.joints[number], "presliding_hysteresis", reason)
            terms.clear()
    _take_inertials(held, model)
    _refuse_negative(held, model)
    _take_gears(held, model, plant)
    return held


def _take_gears(held: Holdings, model: RobotModel, plant: Plant) -> None:
    """Add the gears that yield; one that is too stiff for MuJoCo's step is made softer."""
    for j in np.flatnonzero((plant.compliance > 0.0) | (plant.lost_motion > 0.0)).tolist():
        if not held.armature[j] > 0.0:
            _leave(
                held, [MJCF], model.joints[j], "transmission", "a gear needs the rotor's inertia, which is 0"
            )
            continue
        least = 1.0 / (held.gear_inertia(j) * FASTEST**2)
        own = float(plant.compliance[j])
        if least > own:
            unit = f"{model.position_units[j]}/({model.torque_units[j]})"
            reason = f"its compliance is {least:.3g} {unit}, not {own:.3g}: as stiff as a step of 1 ms takes"
            _leave(held, [MJCF], model.joints[j], "transmission", reason)
        held.gear[j] = (max(own, least), float(plant.lost_motion[j]), float(plant.mesh_torque[j]))


def _take(
    held: Holdings,
    model: RobotModel,
    j: int,
    joint: str,
    effect: Effect,
    values: dict[str, float],
    warmth: float,
) -> None:
    """Add an effect's values at a joint to the holdings, or note the formats that leave it out."""
    name = effect.name
    if isinstance(effect, BODIES):
        return
    if isinstance(effect, TransmissionEffect):
        _leave(held, (URDF, ISAAC), joint, name, "its joints have no gear that yields")
        return
    if effect.passive is None:
        reason = "it has no such term"
        if effect.row is None or effect.n_states:
            reason = "it has no memory of the kind and no such sensor"
        elif any("temp" in signal or signal == "t" for signal in effect.depends_on):
            reason = "it knows no temperature and no time"
        _leave(held, FORMATS, joint, name, reason)
        return
    for term, value in effect.passive(effect.fill(values), warmth).items():
        if isinstance(value, tuple):
            getattr(held, term).setdefault(j, []).append(value)
        else:
            getattr(held, term)[j] += value
        for format, lacks in LACKS.items():
            if term in lacks:
                _leave(held, [format], joint, name, lacks[term])
    fixed = [
        text.format(temperature=f"{warmth:g}")
        for signal, text in _HELD_AT.items()
        if signal in effect.depends_on
    ]
    if fixed:
        _leave(held, FORMATS, joint, name, f"it is held {' and '.join(fixed)}")


def _leave(held: Holdings, formats: Sequence[str], joint: str, effect: str, reason: str) -> None:
    """Note that some formats leave out an effect."""
    held.left += [Left(format, joint, effect, reason) for format in formats]


def _take_inertials(held: Holdings, model: RobotModel) -> None:
    """Correct the inertial parameters of links and payload, each to those of a body that can exist."""
    if not np.any(held.corrected):
        return
    links = held.body.inertial_parameters.reshape(model.n, -1)
    for j in np.flatnonzero(np.any(held.corrected, axis=1)):
        last = j == model.n - 1
        own = np.zeros(10) if held.body.payload is None else held.body.payload.parameters
        wanted = (own if last else links[j]) + held.corrected[j]
        if not wanted[0] > 0.0:
            reason = f"the corrected body would weigh {wanted[0]:.4g} kg; the correction is left out"
        else:
            body, grown = make_possible(wanted)
            if last:
                held.body = held.body.with_payload(_as_payload(body))
            else:
                links[j] = body.to_parameters()
                held.body = held.body.with_inertial_parameters(links.ravel())
            if grown == 0.0:
                continue
            reason = (
                f"no body has its inertia with its mass and centre of mass; its moments are raised by "
                f"{grown:.3g} kg m^2"
            )
        _leave(held, FORMATS, model.joints[j], "payload_error" if last else "inertial_error", reason)


def make_possible(parameters: Array) -> tuple[Inertia, float]:
    """Body with given mass and centre of mass, its moments raised until such a body can exist.

    Parameters
    ----------
    parameters : ndarray (10,)
        Inertial parameters, the mass positive.

    Returns
    -------
    body : Inertia
    grown : float
        Largest change of a moment of inertia [kg m^2]; 0 where the stated body can exist.
    """
    stated = Inertia.from_parameters(parameters)
    # Second moments of the mass: a body exists where none of them is negative.
    spread = 0.5 * np.trace(stated.tensor) * np.eye(3) - stated.tensor
    values, turn = np.linalg.eigh(0.5 * (spread + spread.T))
    least = LEAST_RADIUS**2 * stated.mass
    if values[0] >= least:
        return stated, 0.0
    spread = turn @ np.diag(np.maximum(values, least)) @ turn.T
    body = Inertia(stated.mass, stated.com, np.trace(spread) * np.eye(3) - spread)
    return body, float(np.abs(body.tensor - stated.tensor).max())


def _as_payload(body: Inertia) -> Payload:
    moments = body.tensor[np.triu_indices(3)].tolist()
    return Payload(float(body.mass), tuple(body.com.tolist()), tuple(moments))


def _refuse_negative(held: Holdings, model: RobotModel) -> None:
    """Leave out negative values that a format refuses."""
    for values, what in (
        (held.friction, "Coulomb friction"),
        (held.damping, "viscous friction"),
        (held.armature, "rotor inertia"),
    ):
        for j in np.flatnonzero(values < 0.0):
            _leave(held, FORMATS, model.joints[j], what, f"{values[j]:.4g} is negative")
            values[j] = 0.0
    for j in np.flatnonzero((held.stiffness <= 0.0) & ((held.stiffness != 0.0) | (held.preload != 0.0))):
        reason = f"its stiffness {held.stiffness[j]:.4g} is not positive"
        _leave(held, [MJCF], model.joints[j], "joint_spring", reason)
        held.stiffness[j] = held.preload[j] = 0.0
