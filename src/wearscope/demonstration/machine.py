"""A robot as a generator of recordings knows it, written apart from `wearscope.robots`."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Machine:
    """A robot as the generator knows it; lists run over the joints, base to tip.

    Attributes
    ----------
    name : str
    urdf : str
        The URDF text that goes into the data set's folder.
    joints : tuple of str
    prismatic : tuple of bool
        True where a joint's positions are in m and its torques in N.
    rotor_inertia : tuple of float
        Reflected to the joint [kg m^2 or kg].
    gear_ratio : tuple of float
        Motor turns (prismatic: motor radians) by joint unit.
    coulomb, viscous : tuple of float
        Declared friction, joint side [N m, N m s/rad or N, N s/m].
    centre, reach : tuple of float
        Middle of the working range and half its width [rad or m].
    speed, acceleration : tuple of float
        Limits of the excitation motion.
    payload_mass : float
        Declared payload [kg]; 0 where the machine carries none.
    payload_com : tuple of float
        Its centre of mass in the last link's frame [m].
    """

    name: str
    urdf: str
    joints: tuple[str, ...]
    prismatic: tuple[bool, ...]
    rotor_inertia: tuple[float, ...]
    gear_ratio: tuple[float, ...]
    coulomb: tuple[float, ...]
    viscous: tuple[float, ...]
    centre: tuple[float, ...]
    reach: tuple[float, ...]
    speed: tuple[float, ...]
    acceleration: tuple[float, ...]
    payload_mass: float = 0.0
    payload_com: tuple[float, float, float] = (0.0, 0.0, 0.0)
    gravity: tuple[float, float, float] = field(default=(0.0, 0.0, -9.81))

    def torque_unit(self, joint: int) -> str:
        """Unit of a joint's torque."""
        return "N" if self.prismatic[joint] else "N m"

    def position_unit(self, joint: int) -> str:
        """Unit of a joint's position."""
        return "m" if self.prismatic[joint] else "rad"
