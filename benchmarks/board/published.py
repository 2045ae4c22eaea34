"""Links of published arms, rounded: what the board's random machines take their proportions from."""

from dataclasses import dataclass


@dataclass(frozen=True)
class PublishedArm:
    """An arm with all frames parallel to the base's at zero.

    Attributes
    ----------
    masses : tuple of float
        By link [kg].
    offsets : tuple of triples
        From the joint before to this joint [m].
    axes : tuple of str
        Axis of each joint.
    centres : tuple of triples
        Centre of mass by link, from its joint [m].
    payload : float
        Rated payload [kg].
    speed : float
        Typical top speed of the main axes [rad/s].
    rotor : tuple of float
        Rotor inertia reflected to the joint over the link-side inertia there, a typical value.
    """

    masses: tuple[float, ...]
    offsets: tuple[tuple[float, float, float], ...]
    axes: tuple[str, ...]
    centres: tuple[tuple[float, float, float], ...]
    payload: float
    speed: float
    rotor: tuple[float, ...]


ARMS: dict[str, PublishedArm] = {
    # Universal Robots UR5: maker's kinematics and masses
    "ur": PublishedArm(
        (3.7, 8.4, 2.3, 1.2, 1.2, 0.19),
        ((0, 0, 0.089), (0, 0.136, 0), (0, -0.12, 0.425), (0, 0, 0.392), (0, 0.093, 0), (0, 0, 0.095)),
        ("z", "y", "y", "y", "z", "y"),
        ((0, 0.0, 0.0), (0, 0, 0.21), (0, 0, 0.2), (0, 0.02, 0), (0, 0, 0.01), (0, 0.02, 0.01)),
        4.0, 2.6, (0.5, 0.5, 0.8, 2.0, 3.0, 5.0),
    ),
    # Franka Panda: dynamic parameters of Gaz et al. 2019, rounded
    "panda": PublishedArm(
        (5.0, 0.65, 3.2, 3.6, 1.2, 1.7, 0.74),
        ((0, 0, 0.333), (0, 0, 0), (0, 0, 0.316), (0.083, 0, 0), (-0.083, 0, 0.384), (0, 0, 0),
         (0.088, 0, 0)),
        ("z", "y", "z", "y", "z", "y", "z"),
        ((0, 0.0, -0.1), (0, 0.03, 0.0), (0.03, 0.04, -0.07), (-0.05, 0.1, 0.03), (0, 0.04, -0.14),
         (0.06, -0.01, -0.01), (0.01, 0.0, -0.08)),
        2.0, 2.0, (0.6, 0.5, 0.8, 0.8, 2.0, 2.0, 4.0),
    ),
    # KUKA LBR iiwa 7: maker's kinematics and masses, rounded
    "iiwa": PublishedArm(
        (3.5, 3.5, 4.1, 3.5, 2.2, 2.3, 0.7),
        ((0, 0, 0.158), (0, 0, 0.183), (0, 0, 0.205), (0, 0, 0.216), (0, 0, 0.185), (0, 0, 0.216),
         (0, 0, 0.081)),
        ("z", "y", "z", "y", "z", "y", "z"),
        ((0, -0.03, 0.12), (0, 0.04, 0.06), (0, 0.03, 0.13), (0, 0.03, 0.07), (0, 0.02, 0.08),
         (0, 0, 0.0), (0, 0, 0.02)),
        5.0, 1.7, (0.6, 0.4, 0.8, 0.6, 2.0, 2.0, 4.0),
    ),
    # Manutec r3: Otter and Tuerk, rounded
    "manutec": PublishedArm(
        (30.0, 56.5, 26.4, 28.7, 5.2, 0.5),
        ((0, 0, 0.351), (0, -0.3, 0.324), (0, 0, 0.65), (0, 0.155, 0.414), (0, 0, 0.186), (0, 0, 0.125)),
        ("z", "x", "x", "z", "x", "z"),
        ((0, 0, 0), (0.17, 0, 0.2), (0.06, 0, -0.03), (0, 0, 0), (0, 0, 0), (0.05, -0.05, 0.05)),
        15.0, 2.0, (0.4, 1.3, 0.5, 1.0, 1.0, 2.0),
    ),
    # KUKA KR300 R2500 ultra: Weigand et al., rounded
    "kr300": PublishedArm(
        (395.0, 339.0, 105.0, 36.0, 31.0, 18.0),
        ((0, 0, 0.3), (0.35, 0, 0.375), (0, 0, 1.15), (0.19, 0, 0.041), (0.81, 0, 0), (0.19, 0, 0)),
        ("z", "y", "y", "x", "y", "x"),
        ((0, 0, 0.1), (0, -0.17, 0.44), (0.21, 0, 0.08), (0.24, 0, 0), (0.08, 0, 0), (0.05, 0, 0)),
        150.0, 1.4, (0.8, 0.8, 1.2, 2.0, 2.0, 4.0),
    ),
    # Staubli TX90 class: maker's kinematics, masses estimated from the arm's 111 kg
    "staubli": PublishedArm(
        (32.0, 24.0, 14.0, 7.5, 2.6, 0.4),
        ((0, 0, 0.35), (0.05, 0.1, 0.128), (0, 0, 0.425), (0, -0.05, 0.2), (0, 0, 0.225), (0, 0, 0.1)),
        ("z", "y", "y", "z", "y", "z"),
        ((0.02, 0.03, 0.05), (0, 0.06, 0.18), (0.0, 0.02, 0.05), (0, 0, 0.12), (0, 0.01, 0.02),
         (0, 0, -0.02)),
        7.0, 3.0, (0.5, 0.6, 0.7, 1.5, 2.5, 5.0),
    ),
}  # fmt: skip
