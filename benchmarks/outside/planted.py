"""What a case is: machine, regime, plants; and the truth that its data set holds."""

import zlib
from dataclasses import dataclass, field

import numpy as np

from benchmarks.outside import forms
from benchmarks.scoring import start_entry

PLAIN = ("rigid_body", "rotor_inertia", "coulomb", "viscous")
#: Effects that are no torque simply added, with their size's meaning.
STRUCTURAL = {
    "joint_elasticity": "resonance with the motor held [Hz]",
    "backlash": "half the lost motion [arc minutes, or mm/100]",
    "presliding_hysteresis": "deflection at which it slides, over the joint's largest speed [s]",
    "payload_error": "[kg]",
    "inertial_error": "share by which the joint's link is heavier than stated",
    "rotor_inertia_error": "share of the stated rotor inertia",
    "torque_constant_error": "gain of the recorded torque, less one",
    "time_delay": "[ms] by which the recorded torque is late",
}
#: Names that hold of the whole robot, wherever the verdict puts them.
ROBOT_WIDE = ("payload_error", "inertial_error")
#: What only steps finer than the recording's show.
FINE = ("joint_elasticity", "backlash", "presliding_hysteresis")


@dataclass(frozen=True)
class Plant:
    """Something that the declared model lacks.

    Attributes
    ----------
    effect : str
        Of `forms.FORMS` or `STRUCTURAL`.
    joint : int
    size : float
        RMS of what plain terms cannot give of it, over the noise's standard deviation; of structural ones as
        `STRUCTURAL` says.
    """

    effect: str
    joint: int
    size: float

    @property
    def added(self):
        """Whether it is a torque added to the others."""
        return self.effect in forms.FORMS


@dataclass(frozen=True)
class Case:
    """A case; `generator.make_case` writes it.

    Attributes
    ----------
    name, arm : str
    plants : tuple of Plant
    declared : tuple of str
    inertials : str
        trusted or approximate.
    stated : float
        Standard deviation of the stated link masses' errors, as a share.
    noise : str
        A kind of `noise.make_noise`.
    level : float
        Noise's standard deviation over the joint's RMS torque.
    rate : float
        [Hz]
    train, test : tuple of (str, float)
        Kind of motion and seconds.
    loop : float
        Disturbance in the position loop over the joint's largest torque; negative where the motion is given.
    counts : int
        Of the encoder a turn of the motor; 0 for none.
    speed : bool
        Whether the recording has speeds.
    width : float
        Speed over which friction changes its sign, over the joint's largest.
    drives : bool
        Whether the data set states rotor inertias.
    load : float
        Declared payload of every second run [kg].
    seed : int
    """

    name: str
    arm: str
    plants: tuple = ()
    declared: tuple = PLAIN
    inertials: str = "trusted"
    stated: float = 0.0
    noise: str = "white"
    level: float = 0.01
    rate: float = 200.0
    train: tuple = (("fourier", 25.0), ("points", 30.0), ("points", 25.0), ("fourier", 25.0))
    test: tuple = (("points", 25.0), ("fourier", 20.0))
    loop: float = -1.0
    counts: int = 4096
    speed: bool = False
    width: float = 0.006
    drives: bool = True
    load: float = 0.0
    seed: int = 0

    def generator(self, *path):
        """Random numbers of one purpose."""
        return np.random.default_rng(
            np.random.SeedSequence([zlib.crc32(self.name.encode()), self.seed, *path])
        )

    def tell(self):
        """The regime and the plants in a few words."""
        planted = ", ".join(f"{plant.effect}@{plant.joint + 1}" for plant in self.plants)
        return f"{self.name}: {self.arm} {self.rate:g} Hz, {self.noise} {100 * self.level:.1f} % [{planted}]"

    @property
    def axes(self):
        """Regime by axis."""
        return {
            "arm": self.arm, "noise": self.noise, "noise_level": self.level, "rate": self.rate,
            "runs": len(self.train), "inertials": self.inertials, "declared": " ".join(self.declared),
            "plants": len(self.plants), "acts": "loop" if self.loop >= 0 else "record",
        }  # fmt: skip

    def make(self, folder):
        """Write the data set; the truth in the form of `benchmarks.scoring`."""
        from benchmarks.outside.arms import ARMS
        from benchmarks.outside.generator import make_case

        truth, arm = make_case(self, folder), ARMS[self.arm]()
        return {"planted": truth.entries(self, arm), "noise": self.noise, "joints": arm.names}

    @property
    def fine(self):
        """Steps of the simulation a sample."""
        steps = self.loop >= 0 or any(plant.effect in FINE for plant in self.plants)
        return max(1, round(4000.0 / self.rate)) if steps else 1


@dataclass
class Truth:
    """What a case holds.

    Attributes
    ----------
    must, may : set of (int, str)
        Joint and effect that have to be found; that are there, but too small to be asked for.
    outside : set of int
        Joints with an effect that no name fits.
    """

    must: set = field(default_factory=set)
    may: set = field(default_factory=set)
    outside: set = field(default_factory=set)

    def entries(self, case, arm):
        """Planted effects in the form of `benchmarks.scoring`."""
        out = []
        for found, effects in ((True, self.must), (False, self.may)):
            for j, effect in sorted(effects):
                known = [p for p in case.plants if (p.joint, p.effect) == (j, effect)]
                parameters = _state_parameters(known[0], arm) if known else {}
                out.append(_make_entry(arm, j, effect, found, parameters))
        return out + [_make_entry(arm, j, "outside", True, {}, True) for j in sorted(self.outside)]


def _make_entry(arm, j, effect, found, parameters, outside=False):
    joints = arm.names if effect in ROBOT_WIDE else [arm.names[j]]
    standard = effect in ("rigid_body", "rotor_inertia", "coulomb", "viscous")
    return start_entry(effect, arm.names[j], joints, standard) | {
        "outside": outside, "measured_size": np.nan, "findable_size": np.nan,
        "times_findable": np.inf if found else 0.0, "separable": not outside, "parameters": parameters,
    }  # fmt: skip


def _state_parameters(plant, arm):
    """Physical parameter of a plant whose size is one."""
    value = {
        "payload_error": ("mass", plant.size, "kg"),
        "torque_constant_error": ("gain", plant.size, "1"),
        "time_delay": ("delay", 1e-3 * plant.size, "s"),
        "rotor_inertia_error": ("inertia", plant.size * arm.joints[plant.joint].rotor, "kg m^2"),
    }.get(plant.effect)
    return {value[0]: {"value": value[1], "unit": value[2]}} if value else {}
