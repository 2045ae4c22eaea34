"""The simulated robot: a model's bodies and drive train with its effects installed."""

import numpy as np

from wearscope.effects.base import Plant, load_effect
from wearscope.effects.rotor_inertia import EFFECT as ROTOR_INERTIA
from wearscope.robots.model import RobotModel, check_effects
from wearscope.simulation.arrays import Gears

#: Effects whose value the drive section of a robot's model may state, in the order of their installation;
#: imported by name, so that whatever simulates a robot is seen to depend on their files.
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
    """Motor sides of a plant's joints.

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
