"""Random machines of a family: proportions of published arms, scrambled, or nobody's at all."""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from benchmarks.board.machines import write_chain
from benchmarks.board.published import ARMS
from wearscope.demonstration.motions import Machine
from wearscope.errors import InputError

Array = NDArray[np.float64]

AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
FAMILIES = ("serial", "slide", "light_wrist", *ARMS, "scara")
FRICTION = (0.08, 0.5)
"""Range of Coulomb friction, and of viscous friction at top speed, over the joint's torque scale."""


@dataclass
class _Link:
    """A link and the joint before it."""

    mass: float
    centre: Array
    gyration: Array
    offset: Array
    axis: str
    prismatic: bool = False


def _write_urdf(links: list[_Link]) -> str:
    rows = []
    for number, link in enumerate(links, start=1):
        com, offset = (" ".join(f"{c:.5g}" for c in place) for place in (link.centre, link.offset))
        mass, *inertias = (f"{x:.6g}" for x in (link.mass, *(link.mass * link.gyration**2)))
        kind = "prismatic" if link.prismatic else "revolute"
        rows.append((f"j{number}", offset, link.axis, f"l{number}", mass, com, inertias, kind))
    return write_chain("machine", "l0", rows)


def _consistent_gyration(length: float, rng: np.random.Generator) -> Array:
    """Radii of gyration (3,) [m] of a box about its centre, as a real body may have them."""
    sides = length * rng.uniform(0.25, 1.0, 3)
    squares = sides**2
    return np.asarray(np.sqrt((squares.sum() - squares) / 12.0))


def _draw_published(family: str, rng: np.random.Generator) -> list[_Link]:
    arm = ARMS[family]
    size = float(np.exp(0.12 * rng.normal()))
    weight = size**2 * float(np.exp(0.2 * rng.normal()))
    links = []
    for k, mass in enumerate(arm.masses):
        after = arm.offsets[k + 1] if k + 1 < len(arm.offsets) else (0.0, 0.0, 0.06)
        length = max(float(np.linalg.norm(after)), 0.08) * size
        scatter = 0.08 * length * rng.normal(size=3)
        links.append(
            _Link(
                mass * weight * float(np.exp(0.15 * rng.normal())),
                np.asarray(arm.centres[k]) * size + scatter,
                _consistent_gyration(length, rng),
                np.asarray(arm.offsets[k]) * size * np.exp(0.06 * rng.normal()),
                AXES[arm.axes[k]],
            )
        )
    return links


def _draw_serial(rng: np.random.Generator, joints: int, light: int = 0) -> list[_Link]:
    """An arm with axes at random, tapering towards the tip; the last `light` links weigh next to nothing."""
    mass, length = float(np.exp(rng.uniform(np.log(3.0), np.log(120.0)))), float(rng.uniform(0.15, 0.7))
    links = []
    for k in range(joints):
        axis = rng.normal(size=3)
        if rng.uniform() < 0.6:
            axis = np.eye(3)[rng.integers(3)]
        axis /= np.linalg.norm(axis)
        wrist = k >= joints - light
        own = mass * (0.01 if wrist else 1.0) * float(np.exp(0.3 * rng.normal()))
        reach = length * (0.15 if wrist else 1.0)
        links.append(
            _Link(
                own,
                reach * rng.uniform(-0.5, 0.5, 3) * (0.2 if wrist else 1.0),
                _consistent_gyration(reach, rng),
                (length if k else 0.3) * rng.uniform(-1.0, 1.0, 3) if not wrist else 0.1 * rng.normal(size=3),
                " ".join(f"{c:.6g}" for c in axis),
            )
        )
        mass, length = mass * float(rng.uniform(0.4, 0.9)), length * float(rng.uniform(0.7, 1.0))
    return links


def _draw_slide(rng: np.random.Generator) -> list[_Link]:
    axis = "0 0 1" if rng.uniform() < 0.3 else "1 0 0"
    mass = float(np.exp(rng.uniform(np.log(8.0), np.log(120.0))))
    return [_Link(mass, np.array([0, 0, 0.05]), _consistent_gyration(0.4, rng), np.zeros(3), axis, True)]


def _draw_scara(rng: np.random.Generator) -> list[_Link]:
    scale, size = float(np.exp(0.3 * rng.normal())), float(rng.uniform(0.2, 0.4))
    rows = ((11.0, size, False), (7.0, size, False), (2.2, 0.2, True), (0.7, 0.05, False))
    links, offset = [], np.array([0, 0, 0.3])
    for mass, length, slides in rows:
        centre = np.array([0.45 * length, 0, 0]) if length == size else 0.1 * length * rng.normal(size=3)
        own = mass * scale * float(np.exp(0.15 * rng.normal()))
        links.append(_Link(own, centre, _consistent_gyration(length, rng), offset, AXES["z"], slides))
        offset = np.array([length, 0, 0]) if length == size else np.array([0, 0, -0.1])
    return links


def draw_machine(family: str, rng: np.random.Generator, joints: int | None = None) -> Machine:
    """Random machine of a family.

    Parameters
    ----------
    family : str
        One of `FAMILIES`.
    rng : numpy Generator
    joints : int, optional
        Number of joints of a ``serial`` or ``light_wrist`` machine (1 to 7); drawn where left out.

    Raises
    ------
    InputError
        For an unknown family.
    """
    if family not in FAMILIES:
        raise InputError(
            f"attribution board: there is no family of machines '{family}'; choose one of "
            f"{', '.join(FAMILIES)}."
        )
    speed, load = float(rng.uniform(1.2, 3.0)), 0.0
    if family == "serial":
        links = _draw_serial(rng, joints or int(rng.integers(1, 8)))
        load = 0.3 * links[-1].mass
    elif family == "light_wrist":
        links = _draw_serial(rng, max(3, joints or int(rng.integers(4, 8))), light=2)
    elif family == "slide":
        links = _draw_slide(rng)
    elif family == "scara":
        links, load = _draw_scara(rng), 1.0
    else:
        links = _draw_published(family, rng)
        speed, load = ARMS[family].speed * float(rng.uniform(0.8, 1.2)), ARMS[family].payload
    n = len(links)
    slides = np.array([link.prismatic for link in links])
    top = np.where(slides, rng.uniform(0.2, 0.9, n), speed * np.linspace(1.0, 1.6, n))
    acceleration = top * np.where(slides, rng.uniform(5.0, 10.0, n), rng.uniform(3.0, 7.0, n))
    reach = np.where(slides, rng.uniform(0.08, 0.25, n), rng.uniform(0.6, 1.5, n))
    centre = np.where(slides, 0.1, rng.uniform(-0.5, 0.5, n))
    payload = load * float(rng.uniform(0.2, 1.0)) if rng.uniform() < 0.6 else 0.0
    com = tuple(float(c) for c in links[-1].centre + 0.08 * rng.normal(size=3)) if payload else (0.0,) * 3
    urdf = _write_urdf(links)
    scale, weight = _measure(urdf, centre, reach, top, acceleration, rng)
    usual = np.asarray(ARMS[family].rotor) if family in ARMS else np.linspace(0.6, 2.0, n)
    # a light link is still turned by a motor of some size
    rotor = np.maximum(usual * weight, 0.004 * weight.max()) * np.exp(0.3 * rng.normal(size=n))
    scale = np.sqrt(scale**2 + (0.4 * rotor * acceleration) ** 2)
    if family == "light_wrist":
        rotor[-2:] = rotor[:-2].min() * rng.uniform(0.01, 0.1, 2)
        # seals and bearings of a wrist do not shrink with its weight
        scale[-2:] = np.maximum(scale[-2:], np.maximum(0.05 * scale.max(), 40.0 * scale[-2:]))
    low, high = FRICTION
    return Machine(
        name=family,
        urdf=urdf,
        joints=tuple(f"j{k}" for k in range(1, n + 1)),
        prismatic=tuple(bool(s) for s in slides),
        rotor_inertia=tuple(rotor.tolist()),
        gear_ratio=tuple(np.where(slides, rng.uniform(300, 1300, n), rng.uniform(50, 160, n)).tolist()),
        coulomb=tuple((scale * rng.uniform(low, high, n)).tolist()),
        viscous=tuple((scale * rng.uniform(low, high, n) / top).tolist()),
        centre=tuple(centre.tolist()),
        reach=tuple(reach.tolist()),
        speed=tuple(top.tolist()),
        acceleration=tuple(acceleration.tolist()),
        payload_mass=round(payload, 4),
        payload_com=com,  # type: ignore[arg-type]
        gravity=(0.0, 0.0, 9.81) if family == "serial" and rng.uniform() < 0.15 else (0.0, 0.0, -9.81),
    )


def _measure(
    urdf: str, centre: Array, reach: Array, speed: Array, acceleration: Array, rng: np.random.Generator
) -> tuple[Array, Array]:
    """RMS torque (n,) over states at random, and the mass matrix's mean diagonal (n,)."""
    model = pin.buildModelFromXML(urdf)
    data = model.createData()
    torques, weights = [], []
    for _ in range(60):
        q, v, a = (rng.uniform(-1.0, 1.0, len(centre)) for _ in range(3))
        q = centre + reach * q
        torques.append(pin.rnea(model, data, q, 0.6 * speed * v, 0.5 * acceleration * a).copy())
        weights.append(np.diag(pin.crba(model, data, q)).copy())
    return np.sqrt(np.mean(np.square(torques), axis=0)), np.mean(weights, axis=0)
