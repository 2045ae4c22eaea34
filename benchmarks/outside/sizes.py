"""How large a plant is, and whether it has to be found: by what plain terms cannot give of it."""

import numpy as np
from scipy.signal import butter, sosfiltfilt

from benchmarks.outside import forms
from benchmarks.outside.machine import inertial_regressor
from benchmarks.outside.noise import make_noise
from benchmarks.outside.planted import ROBOT_WIDE
from benchmarks.outside.runs import change_record

#: Least share of a joint's torque, RMS, that something planted makes of it where it has to be found.
MATERIAL = 0.02
#: Band in which a plant is compared with noise as the loop may see it [Hz], and how far it has to stand out.
SEEN, CLEAR = 5.0, 3.0
#: Least size of what is left over, in the noise's standard deviations; of undeclared plain terms.
LEAST, LEAST_PLAIN = 1.5, 0.5
#: Largest believable scale of friction's forms, over plain friction at full speed; of load on friction.
MOST_FRICTION, MOST_LOAD = 1.0, 0.25
_FRICTION = ("stribeck", "coulomb_asymmetry", "viscous_asymmetry", "quadratic_viscous", "concave_viscous",
             "temperature_dependent_friction", "warm_up_drift", "cross_coupling")  # fmt: skip


def rms(parts):
    """RMS of all rows of all parts."""
    return float(np.sqrt(np.mean(np.concatenate(parts) ** 2)))


def left_over(case, arm, runs, j, parts, scaled=True):
    """What offset, plain friction, rotor and body cannot give of a torque at joint j, by run.

    Parameters
    ----------
    case : Case
    arm : Arm
    runs : list of Run
    j : int
    parts : list of ndarray (M,)
    scaled : bool
        Whether a body that is trusted counts too, times a factor.
    """
    columns = []
    for run in runs:
        s = run.scene
        own = [s.a[:, j], np.ones(len(s.t)), s.sign(j), s.v[:, j]]
        body = s.load[:, [j] if scaled else []]
        if case.inertials == "approximate":
            body = inertial_regressor(arm, s, range(len(s.t)))[j :: len(arm.joints)]
        columns.append(np.hstack([np.column_stack(own), body]))
    theta = np.linalg.lstsq(np.vstack(columns), np.concatenate(parts), rcond=1e-9)[0]
    return [part - c @ theta for part, c in zip(parts, columns, strict=True)]


def _in_band(parts, rate):
    sos = butter(4, min(SEEN, 0.45 * rate), fs=rate, output="sos")
    return [sosfiltfilt(sos, part) for part in parts]


def is_clear(case, left, sigma, base, least=LEAST):
    """Whether what is left over of a plant is clear of noise and material."""
    noise = make_noise(case.noise, case.generator(9), 8000, 1, case.rate)[:, 0]
    ratio = rms(_in_band(left, case.rate)) / max(sigma * rms(_in_band([noise], case.rate)), 1e-12)
    size = rms(left)
    return size >= 0.99 * max(least * sigma, MATERIAL * base) and ratio >= CLEAR


def size_plants(case, arm, runs, sigma, base, shapes, truth):
    """Scale of each plant; what has to be found goes into `truth`.

    Parameters
    ----------
    case : Case
    arm : Arm
        As stated.
    runs : list of Run
        Training runs.
    sigma, base : ndarray (n,)
        Standard deviation of the noise, RMS torque.
    shapes : list of ndarray (4,)
    truth : Truth
    """
    scales = []
    for plant, shape in zip(case.plants, shapes, strict=True):
        j, joint = plant.joint, arm.joints[plant.joint]
        scale = plant.size
        if plant.added:
            unit = [forms.FORMS[plant.effect](run.scene, j, shape) for run in runs]
            left = unit if plant.effect == "torque_offset" else left_over(case, arm, runs, j, unit)
            scale = max(plant.size * sigma[j], MATERIAL * base[j]) / rms(left)
            if plant.effect in _FRICTION:
                scale = min(scale, MOST_FRICTION * (joint.coulomb + joint.viscous * joint.speed))
            if plant.effect == "load_dependent_friction":
                scale = min(scale, MOST_LOAD)
            left = {j: [scale * x for x in left]}
        elif plant.effect in ROBOT_WIDE:
            felt = [run.plain - run.stated for run in runs]
            left = {
                k: left_over(case, arm, runs, k, [x[:, k] for x in felt], scaled=False)
                for k in range(len(arm.joints))
            }
        elif plant.effect in ("joint_elasticity", "backlash", "presliding_hysteresis"):
            left = {j: left_over(case, arm, runs, j, [(run.bent - run.plain)[:, j] for run in runs])}
        else:
            parts = [change_record(arm, run.scene, run.bent, plant, plant.size)[:, j] for run in runs]
            # A gain of the torque is told by the stated body alone, and so is a rotor where it is stated.
            left = {
                j: parts
                if case.inertials == "trusted" and case.drives
                else left_over(case, arm, runs, j, parts)
            }
        scales.append(scale)
        clear = [is_clear(case, left[k], sigma[k], base[k]) for k in left]
        if plant.effect in forms.OUTSIDERS:
            truth.outside.add(j)
        else:
            (truth.must if any(clear) else truth.may).add((j, plant.effect))
    return scales


def judge_plain(case, arm, runs, sigma, base, truth):
    """Which undeclared plain terms each joint has materially: what the others cannot give of them."""
    if case.loop >= 0:  # its friction sticks elastically
        truth.may.update((j, "presliding_hysteresis") for j in range(len(arm.joints)))
    if "rigid_body" not in case.declared:
        truth.may.update((j, "rigid_body") for j in range(len(arm.joints)))
    friction = ("coulomb", "viscous")
    known = {*case.declared, *(friction if "friction_wear_temperature" in case.declared else ())}
    if known >= {"rotor_inertia", *friction}:
        return
    s = [run.scene for run in runs]
    for j, joint in enumerate(arm.joints):
        terms = {
            "rotor_inertia": np.concatenate([joint.rotor * x.a[:, j] for x in s]),
            "coulomb": np.concatenate([joint.coulomb * x.sign(j) for x in s]),
            "viscous": np.concatenate([joint.viscous * x.v[:, j] for x in s]),
        }
        body = np.concatenate([x.load[:, [j]] for x in s])
        if case.inertials == "approximate":
            every = [inertial_regressor(arm, x, range(len(x.t))) for x in s]
            body = np.vstack(every)[j :: len(arm.joints)]
        for name in set(terms) - known:
            others = np.hstack([np.column_stack([terms[k] for k in terms if k != name]), body])
            left = terms[name] - others @ np.linalg.lstsq(others, terms[name], rcond=1e-9)[0]
            clear = is_clear(case, [left], sigma[j], base[j], LEAST_PLAIN)
            (truth.must if clear else truth.may).add((j, name))
