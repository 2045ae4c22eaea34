"""Friction and cogging that MuJoCo's passive ``dcmotor`` has: LuGre's law, and a wave over the position.

The law's steady friction falls with the square of the speed, as level exp(-(v/speed)^2). A fall with another
exponent up to 2 is a sum of such falls, each a motor of its own.

Source: Canudas de Wit et al. 1995, IEEE T. Automatic Control 40(3); MuJoCo 3.12, XML reference, ``dcmotor``.
"""

import mujoco
import numpy as np
from scipy.optimize import nnls

from wearscope.export.holdings import FASTEST, Holdings

#: Speeds of the falls that a sum is made of, over the fall's own; weights below a share of all are left out.
_SPEEDS, _LEAST = 2.0 ** np.arange(-5.0, 3.1, 0.5), 0.01
#: Share of a fall's level that is left in fast motion where the joint has no Coulomb friction: the law needs
#: some.
_FLOOR = 0.01
#: The bristles' damping ratio with the joint's inertia; of a displacement that the model knows, Dahl's: none.
_DAMPING = 0.05
#: Resistance of a motor that carries no current, and its constant.
_OPEN, _CONSTANT = 1e9, [1.0, 0.0]


def sum_falls(exponent: float) -> list[tuple[float, float]]:
    """Weights and speeds of falls with the square that add up to exp(-x^exponent); one where it is near 2."""
    if exponent > 1.9:
        return [(1.0, 1.0)]
    x = np.concatenate([np.linspace(0.0, 1.0, 60), np.linspace(1.0, 6.0, 60)])
    weights, _ = nnls(np.exp(-((x[:, None] / _SPEEDS) ** 2)), np.exp(-(x**exponent)))
    kept = weights > _LEAST * weights.sum()
    shares = weights[kept] / weights[kept].sum()
    return list(zip(shares.tolist(), _SPEEDS[kept].tolist(), strict=True))


def add_passive_motors(spec: mujoco.MjSpec, name: str, held: Holdings, j: int) -> float:
    """Give a joint the motors that its friction and its waves need; its Coulomb friction that is left.

    Parameters
    ----------
    spec : MjSpec
    name : str
        Of the joint.
    held : Holdings
    j : int
        Number of the joint.
    """
    for k, (cosine, sine, wavenumber) in enumerate(held.wave.get(j, [])):
        size, phase = float(np.hypot(cosine, sine)), float(np.arctan2(-cosine, -sine))
        _add(spec, f"{name}_wave_{k}", name, cogging=[size, float(wavenumber), phase])
    falling, presliding = held.falling.get(j, []), held.presliding.get(j, [])
    if not falling and not presliding:
        return float(held.friction[j])
    level = float(held.friction[j])
    if presliding:
        level = sum(one for one, _ in presliding)
    parts = [
        (share, share * fall, speed * scale)
        for fall, speed, exponent in falling
        for share, scale in sum_falls(exponent)
    ] or [(1.0, 0.0, 1.0)]
    whole = sum(share for share, _, _ in parts)
    inertia = float(held.armature[j]) + float(held.body.mass_matrix(np.zeros(len(held.friction)))[j, j])
    levels = [max(level * share / whole, _FLOOR * fall) for share, fall, _ in parts]
    at_rest = sum(levels) + sum(fall for _, fall, _ in parts)
    displacement = presliding[0][1] if presliding else at_rest / (inertia * FASTEST**2)
    ratio = 0.0 if presliding else _DAMPING
    for k, (coulomb, (_, fall, speed)) in enumerate(zip(levels, parts, strict=True)):
        stiffness = (coulomb + fall) / displacement
        damping = 2.0 * ratio * np.sqrt(stiffness * inertia)
        lugre = [stiffness, damping, coulomb, coulomb + fall, speed]
        _add(spec, f"{name}_friction_{k}", name, lugre=[float(one) for one in lugre])
    return max(float(held.friction[j]) - level, 0.0)


def _add(spec: mujoco.MjSpec, name: str, joint: str, **law: list[float]) -> None:
    motor = spec.add_actuator(name=name, target=joint)
    motor.trntype = mujoco.mjtTrn.mjTRN_JOINT
    motor.set_to_dcmotor(_CONSTANT, _OPEN, ctrlspec=int(mujoco.mjtCtrlInput.mjINPUT_NONE), **law)
