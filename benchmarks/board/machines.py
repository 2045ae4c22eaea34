"""The board's own machines: URDF texts, drive trains and limits, written apart from `wearscope.robots`."""

from collections.abc import Mapping

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


def _link(name: str, mass: float, com: str, inertia: tuple[float, float, float]) -> str:
    x, y, z = inertia
    return (
        f'  <link name="{name}"><inertial><origin xyz="{com}" rpy="0 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial></link>\n'
    )


def _joint(name: str, parent: str, child: str, xyz: str, axis: str, kind: str = "revolute") -> str:
    return (
        f'  <joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="0 0 0"/><axis xyz="{axis}"/>'
        '<limit lower="-6.3" upper="6.3" effort="20000" velocity="10"/></joint>\n'
    )


def _arm6() -> Machine:
    urdf = '<?xml version="1.0"?>\n<robot name="arm6">\n  <link name="base"/>\n'
    urdf += _link("column", 82.0, "0.05 0.01 0.17", (1.9, 2.1, 1.6))
    urdf += _link("boom", 44.0, "0.02 -0.04 0.36", (3.1, 3.0, 0.45))
    urdf += _link("elbow", 36.0, "0.06 0.02 0.08", (0.62, 0.9, 0.81))
    urdf += _link("forearm", 14.5, "0.31 0.0 0.0", (0.07, 0.55, 0.54))
    urdf += _link("wrist", 4.6, "0.02 0.0 0.01", (0.013, 0.019, 0.017))
    urdf += _link("flange", 1.1, "0.015 0.002 0.0", (0.0012, 0.0008, 0.0008))
    urdf += _joint("j1", "base", "column", "0 0 0.21", "0 0 1")
    urdf += _joint("j2", "column", "boom", "0.16 0 0.28", "0 1 0")
    urdf += _joint("j3", "boom", "elbow", "0 0 0.78", "0 1 0")
    urdf += _joint("j4", "elbow", "forearm", "0.19 0 0.14", "1 0 0")
    urdf += _joint("j5", "forearm", "wrist", "0.62 0 0", "0 1 0")
    urdf += _joint("j6", "wrist", "flange", "0.09 0 0", "1 0 0")
    return Machine(
        name="arm6",
        urdf=urdf + "</robot>\n",
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


def _arm3() -> Machine:
    urdf = '<?xml version="1.0"?>\n<robot name="arm3">\n  <link name="base"/>\n'
    urdf += _link("turret", 18.0, "0.0 0.02 0.11", (0.21, 0.2, 0.12))
    urdf += _link("upper", 9.5, "0.21 0.0 0.02", (0.02, 0.17, 0.17))
    urdf += _link("fore", 5.2, "0.16 0.01 0.0", (0.008, 0.062, 0.061))
    urdf += _joint("waist", "base", "turret", "0 0 0.15", "0 0 1")
    urdf += _joint("shoulder", "turret", "upper", "0 0.08 0.19", "0 1 0")
    urdf += _joint("elbow", "upper", "fore", "0.45 0 0", "0 1 0")
    return Machine(
        name="arm3",
        urdf=urdf + "</robot>\n",
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


def _stage() -> Machine:
    urdf = '<?xml version="1.0"?>\n<robot name="stage">\n  <link name="bed"/>\n'
    urdf += _link("carriage", 62.0, "0 0 0.05", (0.8, 0.9, 1.1))
    urdf += _joint("slide", "bed", "carriage", "0 0 0.3", "1 0 0", "prismatic")
    return Machine(
        name="stage",
        urdf=urdf + "</robot>\n",
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


MACHINES: dict[str, Machine] = {machine.name: machine for machine in (_arm6(), _arm3(), _stage())}


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
