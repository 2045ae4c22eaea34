"""The simulated robot: a model's bodies and drive train with its effects installed, and its controller.

The controller feeds the torque of the declared model forward along the reference. It feeds back position and
speed of each motor at each instant, as an analog controller would: without integrator, delay or quantisation.
"""

import numpy as np

from wearscope.cycles.base import Reference
from wearscope.effects.base import ArmatureEffect, Effect, Plant, Signals, load_effect
from wearscope.effects.rotor_inertia import EFFECT as ROTOR_INERTIA
from wearscope.errors import InputError
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.model import RobotModel, add_torques, check_effects
from wearscope.robots.spatial import Array
from wearscope.simulation.arrays import Gears, Law

#: Effects whose value may stand in the drive section of a robot's model, in the order of their installation.
#: They are imported by name, so that the jobs that simulate a robot depend on the effects' files.
STATED_BY_DRIVE = (ROTOR_INERTIA,)


#: Least elastic deflection of a gear with lost motion at the largest torque, as a share of half the lost
#: motion. It replaces a compliance of 0, at which the deflection law cannot be inverted.
LEAST_DEFLECTION = 1e-3
#: Allowed imbalance of torques, as a share of the largest torque.
BALANCE = 1e-7


def build_plant(model: RobotModel) -> Plant:
    """Build the plant of a model: install its effects.

    An effect whose value the model's drive section states takes that value at every joint that lists no
    parameters of its own.

    Parameters
    ----------
    model : RobotModel

    Returns
    -------
    Plant

    Raises
    ------
    InputError
        Where the model names an effect or a parameter that does not exist.
    """
    check_effects(model)
    plant = Plant(model.n)
    for effect in STATED_BY_DRIVE:
        stated = getattr(model.drive, effect.name)
        if stated is None:
            continue
        (coefficient,) = effect.coefficients
        for joint, name in enumerate(model.joints):
            if not any(e.joint == name and e.effect == effect.name and e.parameters for e in model.effects):
                effect.install(plant, joint, {coefficient.name: stated[joint]})
    for entry in model.effects:
        listed = load_effect(entry.effect)
        if entry.parameters or listed not in STATED_BY_DRIVE:
            listed.install(plant, model.joints.index(entry.joint), entry.parameters)
    return plant


def build_gears(plant: Plant, torque_scale: np.ndarray) -> Gears:
    """Arrays of the gears and motors of a plant for the compiled step.

    Parameters
    ----------
    plant : Plant
    torque_scale : ndarray (n,)
        Largest torque to expect at each joint [N m or N].
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


#: Natural frequency [Hz] and damping ratio of the feedback where the model states none.
DEFAULT_BANDWIDTH_HZ, DEFAULT_DAMPING = 5.0, 1.0
#: Beginnings of the names of the signals that friction depends on. An effect that depends on none of them is
#: always fed forward.
FRICTION_SIGNALS = ("qd_", "sign_qd_", "temp_", "reversal_")


def find_step(t: Array) -> float:
    """Return the step [s] of an evenly spaced time vector (N,).

    Raises
    ------
    InputError
        Where there are fewer than 3 instants or the steps differ.
    """
    steps = np.diff(np.asarray(t, dtype=float))
    # A recorded clock in single precision jitters by some 1e-5 of a step.
    if len(steps) < 2 or not steps.min() > 0.0 or np.ptp(steps) > 1e-3 * steps.mean():
        raise InputError("reference: t does not grow in equal steps; sample the motion at a fixed rate.")
    # The mean step carries rounding errors of t; rounded to 1e-12 s it equals the configured step.
    return float(np.round((t[-1] - t[0]) / len(steps), 12))


def make_feedforward(
    model: RobotModel,
    body: RigidBody,
    plant: Plant,
    reference: Reference,
    friction: bool = False,
    temperature: Array | float = 50.0,
) -> Array:
    """Return the torque (N, n) that the declared model needs along a reference.

    Parameters
    ----------
    model : RobotModel
        The declared model.
    body : RigidBody
        Its bodies with the declared payload.
    plant : Plant
        Its plant, of which only the rotor inertia is used here.
    reference : Reference
    friction : bool
        Whether effects that depend on speed, reversals or temperature are fed forward too; all other effects
        always are.
    temperature : array (n,) or float
        Joint temperature that the controller assumes [deg C].
    """
    q, v, a = reference.q, reference.v, reference.a
    load = body.inverse_dynamics(q, v, a)
    torque = load + plant.armature * a
    signals = Signals.along(reference.t, v, q, a, load, temperature)

    def is_fed(effect: Effect) -> bool:
        rubs = any(name.startswith(FRICTION_SIGNALS) for name in effect.depends_on)
        return not isinstance(effect, ArmatureEffect) and (friction or not rubs)

    return add_torques(torque, model, signals, is_fed)


def make_law(
    model: RobotModel,
    reference: Reference,
    feedforward: Array,
    body: RigidBody,
    armature: Array,
    torque_limit: Array,
) -> Law:
    """Build the controller for one reference.

    Parameters
    ----------
    model : RobotModel
        The declared model; its `controller` sets the natural frequency and damping ratio of each joint.
    reference : Reference
        One sample for each step.
    feedforward : ndarray (N, n)
        Torque at the joints [N m or N].
    body : RigidBody
        With the declared payload. Gains are proportional to the mean inertia of each joint along the
        reference.
    armature : ndarray (n,)
        Rotor inertia at the joints [kg m^2 or kg].
    torque_limit : ndarray (n,)
        Largest motor torque, as joint torque [N m or N].
    """
    given = model.controller
    bandwidth = DEFAULT_BANDWIDTH_HZ if given is None else given.bandwidth_hz
    damping = DEFAULT_DAMPING if given is None else given.damping
    omega = 2.0 * np.pi * np.broadcast_to(np.asarray(bandwidth, dtype=float), model.n)
    some = np.linspace(0, len(reference.q) - 1, 25).astype(int)
    inertia = np.mean([np.diag(body.mass_matrix(q)) for q in reference.q[some]], axis=0) + armature
    dt = find_step(reference.t)
    # The step's speeds are differences of positions. With the reference's central differences as target, a
    # motor that follows its reference exactly gets no feedback torque.
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
