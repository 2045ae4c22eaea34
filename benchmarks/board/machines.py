"""The board's own machines: URDF texts, drive trains and limits, written apart from `wearscope.robots`."""

from collections.abc import Iterable, Iterator, Mapping

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wearscope.demonstration.motions import Machine
from wearscope.errors import InputError

Array = NDArray[np.float64]


class Body:
    """Inverse dynamics of a URDF text with a payload on its last link, by Pinocchio.

    Parameters
    ----------
    urdf : str
        URDF text; every movable joint is used, in the URDF's order.
    gravity : sequence of float
        Gravity in the base frame [m/s^2].
    mass : float
        Payload mass [kg]; may be negative where an error of the payload is meant.
    com : sequence of float
        Its centre of mass in the last link's frame [m].
    link_errors : mapping of int to float
        Relative error of mass and inertia by link, the link counted from 0 behind the first joint.
    """

    def __init__(
        self, urdf: str, gravity: tuple[float, ...], mass: float, com: tuple[float, ...],
        link_errors: Mapping[int, float] | None = None,
    ):  # fmt: skip
        self.model = pin.buildModelFromXML(urdf)
        self.model.gravity.linear = np.asarray(gravity, dtype=float)
        if mass != 0.0:
            last = self.model.njoints - 1
            load = pin.Inertia(mass, np.asarray(com, dtype=float), np.zeros((3, 3)))
            self.model.inertias[last] = self.model.inertias[last] + load
        for link, error in (link_errors or {}).items():
            stated = self.model.inertias[link + 1]
            factor = 1.0 + error
            self.model.inertias[link + 1] = pin.Inertia(
                factor * stated.mass, stated.lever, factor * stated.inertia
            )
        self.data = self.model.createData()
        self._pool = pin.ModelPool(self.model, 1)

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Rigid-body torque (N, n) along a motion q, v, a (N, n)."""
        turned = (np.asfortranarray(x.T) for x in (q, v, a))
        torque = pin.rneaInParallel(1, self._pool, *turned)
        return np.ascontiguousarray(torque.reshape(q.shape[1], len(q)).T)


def write_chain(name: str, base: str, rows: Iterable[tuple], kind: str = "revolute") -> str:
    """URDF text of a chain; a row is a joint, its place and axis, its link, mass, centre and inertias.

    A joint's `kind` may end its row.
    """
    parts, parent = [f'<?xml version="1.0"?>\n<robot name="{name}">\n  <link name="{base}"/>\n'], base
    for joint, place, axis, link, mass, centre, (x, y, z), *own in rows:
        (moves,) = own or [kind]
        parts.append(
            f'  <link name="{link}"><inertial><origin xyz="{centre}" rpy="0 0 0"/><mass value="{mass}"/>'
            f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
            f'  <joint name="{joint}" type="{moves}"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{place}" rpy="0 0 0"/><axis xyz="{axis}"/>'
            '<limit lower="-6.3" upper="6.3" effort="20000" velocity="10"/></joint>\n'
        )
        parent = link
    return "".join([*parts, "</robot>\n"])


_ARM6 = (
    ("j1", "0 0 0.21", "0 0 1", "column", 82.0, "0.05 0.01 0.17", (1.9, 2.1, 1.6)),
    ("j2", "0.16 0 0.28", "0 1 0", "boom", 44.0, "0.02 -0.04 0.36", (3.1, 3.0, 0.45)),
    ("j3", "0 0 0.78", "0 1 0", "elbow", 36.0, "0.06 0.02 0.08", (0.62, 0.9, 0.81)),
    ("j4", "0.19 0 0.14", "1 0 0", "forearm", 14.5, "0.31 0.0 0.0", (0.07, 0.55, 0.54)),
    ("j5", "0.62 0 0", "0 1 0", "wrist", 4.6, "0.02 0.0 0.01", (0.013, 0.019, 0.017)),
    ("j6", "0.09 0 0", "1 0 0", "flange", 1.1, "0.015 0.002 0.0", (0.0012, 0.0008, 0.0008)),
)
_ARM3 = (
    ("waist", "0 0 0.15", "0 0 1", "turret", 18.0, "0.0 0.02 0.11", (0.21, 0.2, 0.12)),
    ("shoulder", "0 0.08 0.19", "0 1 0", "upper", 9.5, "0.21 0.0 0.02", (0.02, 0.17, 0.17)),
    ("elbow", "0.45 0 0", "0 1 0", "fore", 5.2, "0.16 0.01 0.0", (0.008, 0.062, 0.061)),
)
_STAGE = (("slide", "0 0 0.3", "1 0 0", "carriage", 62.0, "0 0 0.05", (0.8, 0.9, 1.1)),)


def _list_machines() -> Iterator[Machine]:
    yield Machine(
        name="arm6",
        urdf=write_chain("arm6", "base", _ARM6),
        joints=("j1", "j2", "j3", "j4", "j5", "j6"),
        prismatic=(False,) * 6,
        rotor_inertia=(19.0, 31.0, 11.0, 1.4, 1.1, 0.5),
        gear_ratio=(121.0, 153.0, 101.0, 81.0, 80.0, 51.0),
        coulomb=(48.0, 71.0, 33.0, 11.5, 9.0, 5.2),
        viscous=(31.0, 44.0, 19.0, 6.1, 4.4, 1.9),
        centre=(0.0, 0.15, -0.1, 0.0, 0.2, 0.0),
        reach=(1.3, 0.65, 0.75, 1.6, 1.2, 2.0),
        speed=(1.7, 1.4, 1.8, 2.8, 2.8, 3.6),
        acceleration=(6.0, 5.0, 7.0, 18.0, 18.0, 25.0),
        payload_mass=11.0,
        payload_com=(0.14, 0.03, 0.06),
    )
    yield Machine(
        name="arm3",
        urdf=write_chain("arm3", "base", _ARM3),
        joints=("waist", "shoulder", "elbow"),
        prismatic=(False,) * 3,
        rotor_inertia=(1.9, 2.3, 0.8),
        gear_ratio=(100.0, 100.0, 80.0),
        coulomb=(6.5, 8.2, 4.1),
        viscous=(5.1, 6.0, 2.6),
        centre=(0.0, -0.5, 0.7),
        reach=(1.6, 0.9, 1.1),
        speed=(2.2, 2.0, 2.6),
        acceleration=(11.0, 9.0, 14.0),
        payload_mass=3.0,
        payload_com=(0.33, 0.0, 0.02),
    )
    yield Machine(
        name="stage",
        urdf=write_chain("stage", "bed", _STAGE, "prismatic"),
        joints=("slide",),
        prismatic=(True,),
        rotor_inertia=(38.0,),
        gear_ratio=(628.3185307179587,),
        coulomb=(23.0,),
        viscous=(160.0,),
        centre=(0.12,),
        reach=(0.2,),
        speed=(0.35,),
        acceleration=(2.6,),
    )


MACHINES: dict[str, Machine] = {machine.name: machine for machine in _list_machines()}


def find_machine(name: str) -> Machine:
    """Machine by its name.

    Raises
    ------
    InputError
        Where the board has no such machine.
    """
    if name not in MACHINES:
        raise InputError(
            f"attribution board: there is no machine '{name}'; choose one of {', '.join(MACHINES)}."
        )
    return MACHINES[name]
