"""Published arms as URDF text, with drives.

Sources. Puma 560: Armstrong, Khatib and Burdick 1986, as in Corke's toolbox. UR5, UR10: the maker's DH table
and masses. Panda: Gaz et al., RA-L 2019. iiwa 14: `iiwa_stack`. Manutec r3: Otter and Tuerk 1988, y upwards.
The SCARA, the TX40's inertias and what no source gives (cross-sections of UR links, rotors and friction of
Panda, UR and iiwa) are of the size that such machines have.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class Joint:
    """A joint with its link and its drive; torque units are N m, or N where it is prismatic.

    Attributes
    ----------
    name : str
    origin : ndarray (4, 4)
        Joint frame in the frame of the link before.
    axis : tuple of 3 float
    mass : float
        [kg]
    com : ndarray (3,)
        [m]
    inertia : ndarray (3, 3)
        About the centre of mass [kg m^2].
    lower, upper, speed, acceleration, effort : float
    ratio : float
        Gear ratio.
    rotor : float
        Rotor inertia at the joint.
    coulomb, viscous : float
    prismatic : bool
    """

    name: str
    origin: np.ndarray
    axis: tuple
    mass: float
    com: np.ndarray
    inertia: np.ndarray
    lower: float
    upper: float
    speed: float
    acceleration: float
    effort: float
    ratio: float
    rotor: float
    coulomb: float
    viscous: float
    prismatic: bool = False


@dataclass(frozen=True)
class Arm:
    """A serial arm.

    Attributes
    ----------
    name : str
    joints : tuple of Joint
    gravity : tuple of 3 float
        [m/s^2], base frame.
    """

    name: str
    joints: tuple
    gravity: tuple = (0.0, 0.0, -9.81)

    @property
    def names(self):
        """Joint names."""
        return [joint.name for joint in self.joints]

    def column(self, field):
        """One value a joint (n,)."""
        return np.array([getattr(joint, field) for joint in self.joints], dtype=float)

    def with_inertials(self, masses=None, shifts=None):
        """The arm with masses and inertias times `masses` (n,), centres of mass moved by `shifts` (n, 3)."""
        n = len(self.joints)
        masses = np.ones(n) if masses is None else masses
        shifts = np.zeros((n, 3)) if shifts is None else shifts
        joints = tuple(
            replace(j, mass=float(j.mass * f), inertia=j.inertia * f, com=j.com + d)
            for j, f, d in zip(self.joints, masses, shifts, strict=True)
        )
        return replace(self, joints=joints)

    def with_load(self, mass, com):
        """The arm with a point mass [kg] at `com` [m] on its last link."""
        last = self.joints[-1]
        com = np.asarray(com, dtype=float)
        total = last.mass + mass
        mean = (last.mass * last.com + mass * com) / total
        inertia = last.inertia + _steiner(last.mass, last.com - mean) + _steiner(mass, com - mean)
        return replace(self, joints=(*self.joints[:-1], replace(last, mass=total, com=mean, inertia=inertia)))

    def urdf(self):
        """The arm as URDF text."""
        parts = [f'<robot name="{self.name}"><link name="base"/>']
        parent = "base"
        for k, joint in enumerate(self.joints, 1):
            link, i = f"link{k}", joint.inertia
            kind = "prismatic" if joint.prismatic else "revolute"
            parts.append(
                f'<link name="{link}"><inertial><origin xyz="{_text(joint.com)}" rpy="0 0 0"/>'
                f'<mass value="{float(joint.mass)!r}"/><inertia ixx="{float(i[0, 0])!r}" '
                f'ixy="{float(i[0, 1])!r}" ixz="{float(i[0, 2])!r}" iyy="{float(i[1, 1])!r}" '
                f'iyz="{float(i[1, 2])!r}" izz="{float(i[2, 2])!r}"/></inertial></link>'
                f'<joint name="{joint.name}" type="{kind}"><parent link="{parent}"/><child link="{link}"/>'
                f'<origin xyz="{_text(joint.origin[:3, 3])}" rpy="{_text(_to_rpy(joint.origin[:3, :3]))}"/>'
                f'<axis xyz="{_text(joint.axis)}"/><limit lower="{joint.lower}" upper="{joint.upper}" '
                f'effort="{joint.effort}" velocity="{joint.speed}"/></joint>'
            )
            parent = link
        return "\n".join([*parts, "</robot>"])


def _text(values):
    return " ".join(repr(float(v)) for v in values)


def _to_rpy(turn):
    return Rotation.from_matrix(turn).as_euler("xyz")


def _steiner(mass, d):
    return mass * (d @ d * np.eye(3) - np.outer(d, d))


def _move(x=0.0, y=0.0, z=0.0):
    t = np.eye(4)
    t[:3, 3] = x, y, z
    return t


def _turn_x(angle):
    t = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    t[1:3, 1:3] = [[c, -s], [s, c]]
    return t


def _tensor(values):
    """Symmetric matrix of (xx, yy, zz) or (xx, yy, zz, xy, xz, yz)."""
    xx, yy, zz, xy, xz, yz = (*values, 0.0, 0.0, 0.0)[:6]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _build(name, origins, axes, masses, coms, tensors, drives, prismatic=(), gravity=(0.0, 0.0, -9.81)):
    """An arm of columns; rows of `drives` are `Joint`'s fields from `lower` to `viscous`."""
    joints = tuple(
        Joint(
            f"joint_{k + 1}", np.asarray(origins[k]), tuple(axes[k]), float(masses[k]),
            np.asarray(coms[k], float), np.asarray(tensors[k]), *(float(v) for v in drives[k]),
            prismatic=k in prismatic,
        )
        for k in range(len(masses))
    )  # fmt: skip
    return Arm(name, joints, gravity)


def _from_dh(name, table, masses, coms, tensors, drives):
    """An arm of standard DH rows (a, d, alpha), bodies given in the frame at their link's end."""
    origins, placed, turned, before = [], [], [], np.eye(4)
    for (a, d, alpha), com, tensor in zip(table, coms, tensors, strict=True):
        origins.append(before)
        before = _move(z=d) @ _move(x=a) @ _turn_x(alpha)
        placed.append(before[:3, :3] @ np.asarray(com) + before[:3, 3])
        turned.append(before[:3, :3] @ _tensor(tensor) @ before[:3, :3].T)
    return _build(name, origins, [(0, 0, 1)] * len(masses), masses, placed, turned, drives)


def make_puma560():
    """Unimation Puma 560; its first and third link with inertias that a body may have."""
    h = np.pi / 2
    ratio = [62.6111, 107.815, 53.7063, 76.0364, 71.923, 76.686]
    motor = [2e-4, 2e-4, 2e-4, 33e-6, 33e-6, 33e-6]
    b = [1.48e-3, 0.817e-3, 1.38e-3, 71.2e-6, 82.6e-6, 36.7e-6]
    c = [0.415, 0.0985, 0.1185, 14e-3, 11.9e-3, 7.2e-3]
    effort = [97, 186, 89, 24, 20, 21]
    span = [(-2.7, 2.7), (-1.9, 1.9), (-2.3, 2.3), (-1.9, 2.9), (-1.7, 1.7), (-4.6, 4.6)]
    drives = [
        (*span[k], (1.4, 0.9, 2.1, 4.0, 4.2, 5.4)[k], (5, 4, 8, 20, 20, 25)[k], effort[k], ratio[k],
         ratio[k] ** 2 * motor[k], ratio[k] * c[k], ratio[k] ** 2 * b[k])
        for k in range(6)
    ]  # fmt: skip
    return _from_dh(
        "puma560",
        [(0, 0, h), (0.4318, 0, 0), (0.0203, 0.15005, -h), (0, 0.4318, h), (0, 0, -h), (0, 0, 0)],
        [13.0, 17.4, 4.8, 0.82, 0.34, 0.09],
        [(0, 0, 0), (-0.3638, 0.006, 0.2275), (-0.0203, -0.0141, 0.07), (0, 0.019, 0), (0, 0, 0),
         (0, 0, 0.032)],
        [(0.2, 0.35, 0.2), (0.13, 0.524, 0.539), (0.066, 0.078, 0.0125), (1.8e-3, 1.3e-3, 1.8e-3),
         (0.3e-3, 0.4e-3, 0.3e-3), (0.15e-3, 0.15e-3, 0.04e-3)],
        drives,
    )  # fmt: skip


def _make_ur(name, a2, a3, d1, d4, d5, d6, masses, coms, radius, drives):
    h = np.pi / 2
    lengths = [0.14, abs(a2), abs(a3), 0.1, 0.1, 0.05]
    tensors = []
    for k, (mass, r, length) in enumerate(zip(masses, radius, lengths, strict=True)):
        along, across = mass * r**2 / 2, mass * (3 * r**2 + length**2) / 12
        tensors.append((along, across, across) if k in (1, 2) else (across, across, along))
    return _from_dh(
        name, [(0, d1, h), (a2, 0, 0), (a3, 0, 0), (0, d4, h), (0, d5, -h), (0, d6, 0)], masses, coms,
        tensors, drives
    )  # fmt: skip


def make_ur5():
    """Universal Robots UR5."""
    drives = [
        (-6.2, 6.2, 3.1, 12, 150, 101, 1.12, 9.5, 12.1), (-3.1, 0.0, 3.1, 10, 150, 101, 1.12, 10.3, 11.0),
        (-2.6, 2.6, 3.1, 12, 150, 101, 0.72, 6.1, 7.4), (-6.2, 6.2, 3.1, 20, 28, 101, 0.21, 1.4, 1.9),
        (-6.2, 6.2, 3.1, 20, 28, 101, 0.21, 1.2, 2.1), (-6.2, 6.2, 3.1, 20, 28, 101, 0.21, 1.6, 1.7),
    ]  # fmt: skip
    return _make_ur(
        "ur5", -0.425, -0.39225, 0.089159, 0.10915, 0.09465, 0.0823, [3.7, 8.393, 2.33, 1.219, 1.219, 0.1879],
        [(0, -0.02561, 0.00193), (0.2125, 0, 0.11336), (0.15, 0, 0.0265), (0, -0.0018, 0.01634),
         (0, 0.0018, 0.01634), (0, 0, -0.001159)],
        [0.06, 0.054, 0.06, 0.045, 0.045, 0.0375], drives,
    )  # fmt: skip


def make_ur10():
    """Universal Robots UR10."""
    drives = [
        (-6.2, 6.2, 2.1, 8, 330, 101, 3.4, 17.0, 21.0), (-3.1, 0.0, 2.1, 7, 330, 101, 3.4, 19.0, 24.0),
        (-2.6, 2.6, 3.1, 10, 150, 101, 1.12, 10.4, 12.0), (-6.2, 6.2, 3.1, 18, 56, 101, 0.35, 2.9, 3.1),
        (-6.2, 6.2, 3.1, 18, 56, 101, 0.35, 2.5, 3.4), (-6.2, 6.2, 3.1, 18, 56, 101, 0.35, 2.2, 2.3),
    ]  # fmt: skip
    return _make_ur(
        "ur10", -0.612, -0.5723, 0.1273, 0.163941, 0.1157, 0.0922, [7.1, 12.7, 4.27, 2.0, 2.0, 0.365],
        [(0.021, 0, 0.027), (0.38, 0, 0.158), (0.24, 0, 0.068), (0, 0.007, 0.018), (0, 0.007, 0.018),
         (0, 0, -0.026)],
        [0.075, 0.075, 0.075, 0.05, 0.05, 0.045], drives,
    )  # fmt: skip


def make_panda():
    """Franka Emika Panda, identified by Gaz et al."""
    h = np.pi / 2
    rows = [(0, 0, 0.333), (-h, 0, 0), (h, 0, 0.316), (h, 0.0825, 0), (-h, -0.0825, 0.384), (h, 0, 0),
            (h, 0.088, 0)]  # fmt: skip
    masses = [4.970684, 0.646926, 3.228604, 3.587895, 1.225946, 1.666555, 0.735522]
    coms = [(0.003875, 0.002081, -0.04762), (-0.003141, -0.02872, 0.003495), (0.027518, 0.039252, -0.066502),
            (-0.05317, 0.104419, 0.027454), (-0.011953, 0.041065, -0.038437),
            (0.060149, -0.014117, -0.010517), (0.010517, -0.004252, 0.061597)]  # fmt: skip
    tensors = [
        (0.70337, 0.70661, 0.009117, -0.000139, 0.006772, 0.019169),
        (0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704),
        (0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805),
        (0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641),
        (0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229),
        (0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341),
        (0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741),
    ]
    lower = [-2.9, -1.76, -2.9, -3.07, -2.9, -0.02, -2.9]
    upper = [2.9, 1.76, 2.9, -0.07, 2.9, 3.75, 2.9]
    speed, torque = [2.1, 2.1, 2.1, 2.1, 2.6, 2.6, 2.6], [87, 87, 87, 87, 12, 12, 12]
    coulomb = [0.55, 0.87, 0.64, 1.28, 0.84, 0.30, 0.56]
    viscous = [0.6, 0.5, 0.45, 0.4, 0.22, 0.15, 0.2]
    drives = [
        (lower[k], upper[k], speed[k], 9.0, torque[k], 100, 0.35 if k < 4 else 0.12, coulomb[k], viscous[k])
        for k in range(7)
    ]
    origins = [_turn_x(alpha) @ _move(x=a) @ _move(z=d) for alpha, a, d in rows]
    return _build("panda", origins, [(0, 0, 1)] * 7, masses, coms, [_tensor(t) for t in tensors], drives)


def make_iiwa14():
    """KUKA LBR iiwa 14 R820."""
    h = np.pi / 2
    turns = [0, h, -h, -h, h, h, -h]
    steps = [(0, 0, 0.1575), (0, 0, 0.2025), (0, 0.2045, 0), (0, 0, 0.2155), (0, 0.1845, 0), (0, 0, 0.2155),
             (0, 0.081, 0)]  # fmt: skip
    masses = [4.0, 4.0, 3.0, 2.7, 1.7, 1.8, 0.3]
    coms = [(0, -0.03, 0.12), (0.0003, 0.059, 0.042), (0, 0.03, 0.13), (0, 0.067, 0.034),
            (0.0001, 0.021, 0.076), (0, 0.0006, 0.0004), (0, 0, 0.02)]  # fmt: skip
    tensors = [(0.1, 0.09, 0.02), (0.05, 0.018, 0.044), (0.08, 0.075, 0.01), (0.03, 0.01, 0.029),
               (0.02, 0.018, 0.005), (0.005, 0.0036, 0.0047), (0.001, 0.001, 0.001)]  # fmt: skip
    rotor = [3.19, 3.05, 1.98, 2.05, 0.787, 0.391, 0.394]
    coulomb = [8.8, 8.6, 5.2, 6.1, 3.4, 2.3, 1.9]
    viscous = [9.2, 8.7, 4.4, 5.6, 2.1, 1.7, 1.1]
    span = [2.9, 2.0, 2.9, 2.0, 2.9, 2.0, 3.0]
    drives = [
        (-span[k], span[k], (1.4, 1.4, 1.7, 1.3, 2.2, 2.3, 2.3)[k], 6.0,
         (320, 320, 176, 176, 110, 40, 40)[k], 160, rotor[k], coulomb[k], viscous[k])
        for k in range(7)
    ]  # fmt: skip
    origins = [_move(*step) @ _turn_x(turn) for step, turn in zip(steps, turns, strict=True)]
    return _build("iiwa14", origins, [(0, 0, 1)] * 7, masses, coms, [_tensor(t) for t in tensors], drives)


def make_manutec():
    """Manutec r3, 15 kg class; y points up."""
    steps = [(0, 0.351, 0), (0, 0.324, 0.3), (0, 0.65, 0), (0, 0.414, -0.155), (0, 0.186, 0), (0, 0.125, 0)]
    axes = [(0, 1, 0), (1, 0, 0), (1, 0, 0), (0, 1, 0), (1, 0, 0), (0, 1, 0)]
    masses = [60.0, 56.5, 26.4, 28.7, 5.2, 0.5]
    coms = [(0, 0, 0), (0.172, 0.205, 0), (0.064, -0.034, 0), (0, -0.2, 0), (0, 0.05, 0), (0, 0.01, 0)]
    tensors = [(1.0, 1.16, 1.0), (2.58, 0.64, 2.73, -0.46), (0.279, 0.245, 0.413, -0.07), (0.7, 0.081, 0.7),
               (0.05, 0.03, 0.05), (2e-3, 1e-3, 2e-3)]  # fmt: skip
    ratio = [105, 210, 60, 99, 79.2, 99]
    rotor = [14.3, 57.3, 4.7, 1.57, 1.13, 0.42]
    coulomb = [42.0, 105.0, 42.0, 21.8, 30.1, 10.9]
    viscous = [8.96, 33.9, 5.54, 9.8, 6.0, 3.92]
    span = [2.9, 1.5, 2.2, 3.0, 1.8, 3.1]
    drives = [
        (-span[k], span[k], (3, 1.5, 5, 3.1, 3.1, 4.1)[k] * 0.6, (6, 5, 8, 15, 15, 20)[k],
         (1097, 2194, 627, 500, 400, 300)[k], ratio[k], rotor[k], coulomb[k], viscous[k])
        for k in range(6)
    ]  # fmt: skip
    tensors = [_tensor(t) for t in tensors]
    return _build(
        "manutec", [_move(*s) for s in steps], axes, masses, coms, tensors, drives, gravity=(0, -9.81, 0)
    )


def make_tx40():
    """An arm of the Staubli TX40's size: friction and rotors as Janot et al. identified them, bodies not."""
    steps = [(0, 0, 0.32), (0, 0, 0), (0, 0.035, 0.225), (0, 0, 0.05), (0, 0, 0.175), (0, 0, 0.065)]
    axes = [(0, 0, 1), (0, 1, 0), (0, 1, 0), (0, 0, 1), (0, 1, 0), (0, 0, 1)]
    masses = [7.0, 6.5, 4.2, 2.8, 0.9, 0.25]
    coms = [(0, 0.02, -0.05), (0.0, 0.03, 0.1), (0.01, -0.01, 0.03), (0, 0, 0.07), (0, 0.01, 0.01),
            (0.004, 0, 0.01)]  # fmt: skip
    tensors = [(0.06, 0.06, 0.03), (0.07, 0.07, 0.02), (0.02, 0.02, 0.012), (0.02, 0.02, 0.005),
               (1.6e-3, 1.6e-3, 1e-3), (2e-4, 2e-4, 2e-4)]  # fmt: skip
    drives = [
        (-3.1, 3.1, 4.9, 20, 60, 32, 0.37, 7.1, 8.0), (-2.1, 2.1, 4.0, 15, 60, 32, 0.37, 8.3, 5.7),
        (-2.4, 2.4, 5.0, 20, 40, 45, 0.093, 6.4, 2.0), (-4.6, 4.6, 7.0, 40, 15, 48, 0.03, 2.5, 1.1),
        (-2.0, 2.3, 7.0, 40, 15, 45, 0.044, 3.1, 1.8), (-4.6, 4.6, 9.0, 60, 10, 32, 0.011, 0.9, 0.65),
    ]  # fmt: skip
    tensors = [_tensor(t) for t in tensors]
    return _build("tx40", [_move(*s) for s in steps], axes, masses, coms, tensors, drives)


def make_scara():
    """A SCARA of 600 mm: two levers, a quill that slides, and its rotation."""
    origins = [_move(z=0.3), _move(x=0.325), _move(x=0.275), np.eye(4)]
    coms = [(0.17, 0, 0), (0.12, 0, 0.03), (0, 0, -0.05), (0, 0.004, -0.16)]
    tensors = [(0.03, 0.12, 0.13), (0.02, 0.07, 0.07), (4e-3, 4e-3, 3e-4), (8e-4, 8e-4, 4e-4)]
    drives = [
        (-2.0, 2.0, 5.0, 30, 120, 50, 0.55, 5.2, 2.6), (-2.5, 2.5, 7.0, 40, 60, 30, 0.16, 2.1, 0.9),
        (-0.2, 0.0, 0.9, 8, 400, 400, 3.1, 18.0, 24.0), (-6.0, 6.0, 12.0, 80, 12, 20, 0.012, 0.32, 0.045),
    ]  # fmt: skip
    tensors = [_tensor(t) for t in tensors]
    axes = [(0, 0, 1)] * 4
    return _build("scara", origins, axes, [8.5, 6.2, 1.1, 0.6], coms, tensors, drives, prismatic=(2,))


def make_planar():
    """Two links in a vertical plane."""
    drives = [(-2.6, 2.6, 3.0, 14, 120, 50, 0.25, 2.8, 1.6), (-2.4, 2.4, 4.0, 25, 50, 50, 0.08, 1.1, 0.7)]
    tensors = [_tensor((0.01, 0.06, 0.06)), _tensor((0.004, 0.02, 0.02))]
    origins, axes = [_turn_x(0.0), _move(x=0.4)], [(0, 1, 0)] * 2
    return _build("planar", origins, axes, [5.2, 3.1], [(0.19, 0, 0.01), (0.14, 0, 0)], tensors, drives)


ARMS = {
    make().name: make
    for make in (make_puma560, make_ur5, make_ur10, make_panda, make_iiwa14, make_manutec, make_tx40,
                 make_scara, make_planar)
}  # fmt: skip
