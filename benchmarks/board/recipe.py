"""What a generated data set is asked to be: plants, runs, noise; and the random streams that fill it."""

from dataclasses import dataclass

import numpy as np

OVERSAMPLING = 4
"""Steps of the fine grid, on which the machine's physics is worked out, by recorded sample."""


@dataclass(frozen=True)
class Planted:
    """One effect to plant: name, joint name, and size (RMS of its torque over the noise RMS, train runs).

    Where an `amplitude` is given the effect acts with it, whatever its size comes to.
    """

    effect: str
    joint: str
    size: float
    amplitude: float | None = None


@dataclass(frozen=True)
class RunPlan:
    """One run: its use, kind of motion, which drawn trajectory (equal numbers repeat), start temperature.

    `pace` is the share of the machine's top speed that the motion may use.
    """

    use: str
    kind: str
    trajectory: int
    start_temperature: float
    pace: float = 1.0


PLANS: tuple[RunPlan, ...] = (
    RunPlan("train", "fourier", 0, 24.0),
    RunPlan("train", "fourier", 0, 43.0),
    RunPlan("train", "sweep", 1, 52.0),
    RunPlan("train", "points", 2, 31.0),
    RunPlan("test", "points", 3, 47.0),
    RunPlan("test", "sweep", 4, 28.0),
)


@dataclass(frozen=True)
class Recipe:
    """How a data set is recorded.

    Attributes
    ----------
    noise : str
        A kind of `disturbances.NOISES`.
    noise_level : float
        Torque noise RMS over the RMS of the declared torque, by joint.
    duration : float
        Length of a run [s].
    rate : float
        [Hz]
    temperatures : bool or None
        Whether temperature channels are recorded; None lets the seed decide (always where they matter).
    inertia_error : float
        Standard deviation of the factor by which the folder's URDF misses every link's mass and inertia;
        where it is not 0, the data set says ``inertials: approximate``.
    locked : tuple of str
        Joints that never move.
    memory : float
        Time constant of coloured noise [s].
    frequency : float or None
        Frequency of a hum [Hz]; None lets the seed decide.
    loop_bandwidth : float or None
        Natural frequency of the position loop inside which the torque noise acts [Hz]; None adds the noise to
        the record instead.
    encoder_step : float or None
        Resolution of the positions as a share of the joint's reach; None takes 17 bits by motor turn.
    reversal : float or None
        Speed over which friction changes sign, as a share of the joint's top speed; None draws it by joint.
    declared : tuple of str or None
        Declared effects; None declares rigid body, rotor inertia, Coulomb and viscous friction but for what
        is planted. What is declared acts in the machine; what is not acts only where it is planted.
    rotor_given : bool
        Whether the data set states the rotor inertias.
    approximate : bool or None
        Whether the data set calls its inertials approximate; None where they are off.
    oversampling : int
        Steps of the fine grid by recorded sample.
    bounded : bool
        Whether a plant keeps to what such a machine may physically have, its size then being what comes out.
    plans : tuple of RunPlan
    """

    noise: str = "plain"
    noise_level: float = 0.01
    duration: float = 16.0
    rate: float = 250.0
    temperatures: bool | None = None
    inertia_error: float = 0.0
    locked: tuple[str, ...] = ()
    memory: float = 0.06
    frequency: float | None = None
    loop_bandwidth: float | None = None
    encoder_step: float | None = None
    reversal: float | None = None
    declared: tuple[str, ...] | None = None
    rotor_given: bool = True
    approximate: bool | None = None
    oversampling: int = OVERSAMPLING
    bounded: bool = False
    plans: tuple[RunPlan, ...] = PLANS


def make_stream(seed: int, *identity: str) -> np.random.Generator:
    """Random stream of a named thing: seed and identity, never the order of execution."""
    key = [int(byte) for byte in "/".join(identity).encode()]
    return np.random.default_rng(np.random.SeedSequence([seed, *key]))
