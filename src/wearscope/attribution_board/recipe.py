"""What a generated data set is asked to be: plants, runs, noise; and the random streams that fill it."""

from dataclasses import dataclass

import numpy as np

OVERSAMPLING = 4
"""Steps of the fine grid, on which the machine's physics is worked out, by recorded sample."""


@dataclass(frozen=True)
class Planted:
    """One effect to plant: name, joint name, and size (RMS of its torque over the noise RMS, train runs)."""

    effect: str
    joint: str
    size: float


@dataclass(frozen=True)
class RunPlan:
    """One run: its use, kind of motion, which drawn trajectory (equal numbers repeat), start temperature."""

    use: str
    kind: str
    trajectory: int
    start_temperature: float


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
    plans : tuple of RunPlan
    """

    noise: str = "plain"
    noise_level: float = 0.01
    duration: float = 16.0
    rate: float = 250.0
    temperatures: bool | None = None
    inertia_error: float = 0.0
    locked: tuple[str, ...] = ()
    plans: tuple[RunPlan, ...] = PLANS


def make_stream(seed: int, *identity: str) -> np.random.Generator:
    """Random stream of a named thing: seed and identity, never the order of execution."""
    key = [int(byte) for byte in "/".join(identity).encode()]
    return np.random.default_rng(np.random.SeedSequence([seed, *key]))
