"""Runs of a case: motion, and torque with all that is planted, before the recorder adds its noise."""

from dataclasses import dataclass

import numpy as np

from benchmarks.outside import forms
from benchmarks.outside.machine import bend, follow, inverse_dynamics, slide
from benchmarks.outside.motions import KINDS, Motion

_ARC_MINUTE = np.pi / 180 / 60
#: Resonance of a gear that only has lost motion [Hz].
_STIFF = 45.0


@dataclass(frozen=True)
class Run:
    """A run without added effects.

    Attributes
    ----------
    number : int
    use : str
    fine : Motion
        At the simulation's rate.
    scene : forms.Scene
        At the recording's.
    plain : ndarray (M, n)
        Torque of body as it is, rotors, Coulomb and viscous friction.
    stated : ndarray (M, n)
        The same without what is planted in the bodies.
    bent : ndarray (M, n)
        `plain` with the gears that bend and the friction that slides late.
    payload : float
        Declared [kg].
    """

    number: int
    use: str
    fine: Motion
    scene: forms.Scene
    plain: np.ndarray
    stated: np.ndarray
    bent: np.ndarray
    payload: float


def seat(arm):
    """Centre of mass of a declared payload, in the last link's frame [m]."""
    return [0.0, 0.0, 0.0] if arm.joints[-1].prismatic else [0.02, 0.0, 0.06]


def plant_bodies(case, arm):
    """The arm with the plants in its bodies."""
    for plant in case.plants:
        if plant.effect == "payload_error":
            arm = arm.with_load(plant.size, [0.03, -0.02, 0.09])
        if plant.effect == "inertial_error":
            factor = np.ones(len(arm.joints))
            factor[plant.joint] += plant.size
            arm = arm.with_inertials(factor)
    return arm


def make_run(case, arm, r):
    """Run r of a case on an arm as stated.

    Parameters
    ----------
    case : Case
    arm : Arm
        Without plants.
    r : int
        Training runs come first.
    """
    kind, seconds = [*case.train, *case.test][r]
    rng = case.generator(4, r)
    fine = KINDS[kind](arm, rng, seconds, case.rate * case.fine)
    motion = _thin(fine, case.fine)
    payload = case.load if r % 2 else 0.0
    heat = rng.uniform(24.0, 40.0) + 14.0 * (1 - np.exp(-motion.t / 25.0))[:, None] * rng.uniform(
        0.5, 1, len(arm.joints)
    )
    top = arm.column("speed") * 0.9
    drive = arm.column("rotor") * motion.a + arm.column("viscous") * motion.v
    drive += arm.column("coulomb") * np.tanh(motion.v / (case.width * top))
    body = _with_payload(plant_bodies(case, arm), payload)
    load = inverse_dynamics(body, motion.q, motion.v, motion.a)
    stated = (
        load if body is arm else inverse_dynamics(_with_payload(arm, payload), motion.q, motion.v, motion.a)
    )
    scene = forms.Scene(motion.t, motion.q, motion.v, motion.a, load, heat, top, case.width)
    plain = drive + load
    bent = plain + _bend(case, body, fine, scene)
    use = "train" if r < len(case.train) else "test"
    return Run(r, use, fine, scene, plain, drive + stated, bent, payload)


def _with_payload(arm, mass):
    return arm.with_load(mass, seat(arm)) if mass else arm


def _thin(motion, fine):
    return Motion(*(x[::fine] for x in (motion.t, motion.q, motion.v, motion.a)))


def _bend(case, arm, fine, scene):
    """What gears that bend or have lost motion, and friction that slides late, change (M, n)."""
    change = np.zeros_like(scene.q)
    gears = {}
    for plant in case.plants:
        j = plant.joint
        if plant.effect == "presliding_hysteresis":
            state = slide(fine.v[:, j], fine.t[1] - fine.t[0], plant.size * scene.top[j])[:: case.fine]
            change[:, j] += arm.joints[j].coulomb * (state - scene.sign(j))
        if plant.effect in ("joint_elasticity", "backlash"):
            gears.setdefault(j, {})[plant.effect] = plant.size
    for j, gear in gears.items():
        stiffness = find_stiffness(arm, j, gear.get("joint_elasticity", _STIFF))
        lost = gear.get("backlash", 0.0) * (1e-5 if arm.joints[j].prismatic else _ARC_MINUTE)
        links, through = bend(arm, fine, j, stiffness, lost)
        links = _thin(links, case.fine)
        felt = inverse_dynamics(arm, links.q, links.v, links.a)
        felt[:, j] = through[:: case.fine]
        change += felt - scene.load
    return change


def find_stiffness(arm, j, hertz):
    """Stiffness of a gear that lets its link swing at `hertz`, the arm being in the middle of its range."""
    q = (arm.column("lower") + arm.column("upper")) / 2
    zero, unit = np.zeros(len(q)), np.eye(len(q))[j]
    torque = inverse_dynamics(arm, [q, q], [zero, zero], [unit, zero])
    return float((torque[0] - torque[1])[j] * (2 * np.pi * hertz) ** 2)


def apply_plants(case, arm, run, scales, shapes):
    """Motion and torque (M, n) of a run with all that is planted.

    Parameters
    ----------
    case : Case
    arm : Arm
        As stated.
    run : Run
    scales : list of float
        Of each plant.
    shapes : list of ndarray (4,)
    """
    named = list(zip(case.plants, scales, shapes, strict=True))
    if case.loop >= 0:
        motion, torque = _follow(case, _with_payload(plant_bodies(case, arm), run.payload), run, named)
    else:
        motion, torque = run.scene, run.bent.copy()
        for plant, scale, shape in named:
            if plant.added:
                torque[:, plant.joint] += scale * forms.FORMS[plant.effect](run.scene, plant.joint, shape)
    for plant, scale, _ in named:
        torque = torque + change_record(arm, motion, torque, plant, scale)
    return motion, torque


def change_record(arm, motion, torque, plant, size):
    """What a wrong rotor, a wrong gain or a late channel changes of the torque (M, n)."""
    change, j = np.zeros_like(torque), plant.joint
    if plant.effect == "rotor_inertia_error":
        change[:, j] = size * arm.joints[j].rotor * motion.a[:, j]
    if plant.effect == "torque_constant_error":
        change[:, j] = size * torque[:, j]
    if plant.effect == "time_delay":
        change[:, j] = np.interp(motion.t - 1e-3 * size, motion.t, torque[:, j]) - torque[:, j]
    return change


def _follow(case, arm, run, named):
    added = [x for x in named if x[0].added]

    def extra(t, q, v, a, load):
        out = np.zeros(len(q))
        if added:
            heat = np.full((1, len(q)), 35.0)
            scene = forms.Scene(
                np.array([t]), q[None], v[None], a[None], load[None], heat, run.scene.top, case.width
            )
            for plant, scale, shape in added:
                out[plant.joint] += scale * forms.FORMS[plant.effect](scene, plant.joint, shape)[0]
        return out

    motion, torque = follow(arm, run.fine, extra, case.generator(5, run.number), disturbance=case.loop)
    return _thin(motion, case.fine), torque[:: case.fine]
