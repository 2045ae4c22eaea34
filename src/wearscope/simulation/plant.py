"""The simulated robot: a model's bodies and drive train with its effects installed, and its controller.

The controller feeds the declared model's torque forward along the reference, and feeds back each motor's
position and speed at each instant, as an analog one would; it has no integrator, no delay and no quantisation
of its own.
"""

import numpy as np

from wearscope.cycles.base import Reference
from wearscope.effects.base import ArmatureEffect, Plant, Signals, load_effect
from wearscope.effects.rotor_inertia import EFFECT as ROTOR_INERTIA
from wearscope.errors import InputError
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.model import RobotModel, check_effects
from wearscope.robots.spatial import Array
from wearscope.simulation.arrays import Gears, Law

#: Effects whose value the drive section of a robot's model may state, in the order of their installation.
#: They are imported by name, so that jobs that simulate a robot depend on their files.
STATED_BY_DRIVE = (ROTOR_INERTIA,)


#: Where a gear has lost motion but no compliance: deflection at the largest torque, as a share of half the
#: lost motion, so that the deflection law can be inverted.
LEAST_DEFLECTION = 1e-3
#: Torques balance to this share of the largest torque.
BALANCE = 1e-7


def build_plant(model: RobotModel) -> Plant:
    """Plant with a model's effects.

    Parameters
    ----------
    model : RobotModel

    Returns
    -------
    Plant
        An effect whose value the drive states has it wherever a joint lists no parameters of its own.

    Raises
    ------
    InputError
        Where an effect or a parameter is not in the vocabulary.
    """
    check_effects(model)
    plant = Plant(model.n)
    for effect in STATED_BY_DRIVE:
        stated = getattr(model.drive, effect.given_by)
        if stated is None:
            continue
        (coefficient,) = effect.coefficients
        for joint, name in enumerate(model.joints):
            if not any(e.joint == name and e.effect == effect.name and e.parameters for e in model.effects):
                effect.install(plant, joint, {coefficient.name: stated[joint]})
    for entry in model.effects:
        listed = load_effect(entry.effect)
        if entry.parameters or not listed.given_by:
            listed.install(plant, model.joints.index(entry.joint), entry.parameters)
    return plant


def build_gears(plant: Plant, torque_scale: np.ndarray) -> Gears:
    """Gears and motors of a plant's joints, as the step takes them.

    Parameters
    ----------
    plant : Plant
    torque_scale : ndarray (n,)
        Largest torque to expect.
    """
    flexible = (plant.compliance > 0.0) | (plant.lost_motion > 0.0)
    least = 0.5 * plant.lost_motion * LEAST_DEFLECTION / torque_scale
    return Gears(
        armature=plant.armature.copy(),
        flexible=flexible,
        compliance=np.maximum(plant.compliance, least),
        lost_motion=plant.lost_motion.copy(),
        mesh_torque=plant.mesh_torque.copy(),
        tolerance=BALANCE * torque_scale,
    )


#: Feedback where the model states none.
DEFAULT_BANDWIDTH_HZ, DEFAULT_DAMPING = 5.0, 1.0
#: Signals of friction: an effect that depends on none of them is part of the feed-forward in any case.
FRICTION_SIGNALS = ("qd_", "sign_qd_", "temp_", "reversal_")


def find_step(t: Array) -> float:
    """Step of an even time vector (N,) [s].

    Raises
    ------
    InputError
        Where there are fewer than 3 instants or the steps differ.
    """
    steps = np.diff(np.asarray(t, dtype=float))
    # A recorded clock in single precision jitters by some 1e-5 of a step.
    if len(steps) < 2 or not steps.min() > 0.0 or np.ptp(steps) > 1e-3 * steps.mean():
        raise InputError("reference: t does not grow in equal steps; sample the motion at a fixed rate.")
    # Digits below the clock's resolution are rounding errors of t; rounded off, the step equals the
    # configured one.
    return float(np.round((t[-1] - t[0]) / len(steps), 12))


def make_feedforward(
    model: RobotModel,
    body: RigidBody,
    plant: Plant,
    reference: Reference,
    friction: bool = False,
    temperature: Array | float = 50.0,
) -> Array:
    """Torque (N, n) that the declared model needs along a reference.

    Parameters
    ----------
    model : RobotModel
        The declared model.
    body : RigidBody
        Its bodies with the declared payload.
    plant : Plant
        Its effects, of which the rotor inertia is taken.
    reference : Reference
    friction : bool
        Whether effects that depend on speed, reversals or temperature are fed forward too; others always are.
    temperature : array (n,) or float
        That the controller assumes for them [deg C].
    """
    q, v, a = reference.q, reference.v, reference.a
    load = body.inverse_dynamics(q, v, a)
    torque = load + plant.armature * a
    signals = Signals.along(reference.t, v, q, a, load, temperature)
    for entry in model.effects:
        effect = load_effect(entry.effect)
        rubs = any(name.startswith(FRICTION_SIGNALS) for name in effect.depends_on)
        if effect.row is None or isinstance(effect, ArmatureEffect) or (rubs and not friction):
            continue
        joint = model.joints.index(entry.joint)
        torque[:, joint] += effect.torque(signals, joint, entry.parameters)
    return torque


def make_law(
    model: RobotModel,
    reference: Reference,
    feedforward: Array,
    body: RigidBody,
    armature: Array,
    torque_limit: Array,
) -> Law:
    """Controller for one reference.

    Parameters
    ----------
    model : RobotModel
        The declared model; its `controller` sets the natural frequency and damping ratio of each joint.
    reference : Reference
        One sample a step.
    feedforward : ndarray (N, n)
    body : RigidBody
        With the declared payload: gains go with the mean inertia that it has along the reference.
    armature : ndarray (n,)
    torque_limit : ndarray (n,)
        Of the motor, at the joint.
    """
    given = model.controller
    bandwidth = DEFAULT_BANDWIDTH_HZ if given is None else given.bandwidth_hz
    damping = DEFAULT_DAMPING if given is None else given.damping
    omega = 2.0 * np.pi * np.broadcast_to(np.asarray(bandwidth, dtype=float), model.n)
    some = np.linspace(0, len(reference.q) - 1, 25).astype(int)
    inertia = np.mean([np.diag(body.mass_matrix(q)) for q in reference.q[some]], axis=0) + armature
    dt = find_step(reference.t)
    # Speeds as the steps have them, means over two: a motor on its reference then needs no feedback.
    ends = dt * np.stack([reference.v[0], reference.v[-1]])
    around = np.vstack([reference.q[1] - 2.0 * ends[0], reference.q, reference.q[-2] + 2.0 * ends[1]])
    contiguous = np.ascontiguousarray
    return Law(
        feedforward=contiguous(feedforward, dtype=float),
        position=contiguous(reference.q, dtype=float),
        speed=contiguous((around[2:] - around[:-2]) / (2.0 * dt)),
        stiffness=contiguous(omega**2 * inertia),
        damping=contiguous(2.0 * damping * omega * inertia),
        limit=contiguous(torque_limit, dtype=float),
    )
