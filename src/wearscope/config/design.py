"""Sections on what is simulated: factors, design, simulation, detectors, surrogates."""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, WithJsonSchema, model_validator

from wearscope.config.sections import Model, Section, SurrogateKind

#: Kinds of factor in addition to a number of the robot given by its path.
KINDS = ("wear", "temperature", "dwell", "payload_mass_error")
#: Units of their natural values; a number by its path is in the model's unit, whatever it is called.
UNITS = {
    "wear": ("1", "-", ""),
    "temperature": ("degC", "°C"),
    "dwell": ("ms",),
    "payload_mass_error": ("%",),
}
_SECTIONS = "drive|sensors|payload|controller|gravity|home|lower|upper|links|effects|detectors"
_PATH = rf"^({_SECTIONS})\.[^\s.]+(\.[^\s.]+)*$"


def _check_kind(kind: str) -> str:
    if kind not in KINDS and not re.match(_PATH, kind):
        raise ValueError(
            f"'{kind}' is none of {', '.join(KINDS)}, nor the path of a number such as sensors.torque_noise"
        )
    return kind


FactorKind = Annotated[
    str,
    AfterValidator(_check_kind),
    WithJsonSchema({"anyOf": [{"enum": list(KINDS)}, {"type": "string", "pattern": _PATH}]}),
]


class FactorSettings(Section):
    """A factor: a fault or a nuisance, and the natural values of its coded levels."""

    description: str
    """What it is, as figures and the report say it."""
    kind: FactorKind
    """What the simulation does with it: `wear`, `temperature`, `dwell`, `payload_mass_error`, or a number by
    its path: of the robot's model (`sensors.torque_noise`, `controller.bandwidth_hz`, `drive.speed_limit`,
    `links.axis_2.mass`, `effects.joint_elasticity.axis_2.compliance`), or of a detector
    (`detectors.A.OPTION`). Factors of kind `wear` are the wear of the tested axes; the cells of an axis see
    their own axis's wear as `f`."""
    range: tuple[float, float]
    """Natural values at the coded levels -2 and +2 of the identification (Table 1)."""
    unit: str
    """Unit of the natural values. Those of a number by its path are in the model's unit, or with `"%"` a
    change in percent of what the model states."""
    levels: Annotated[int, Field(ge=2)] = 5
    """Number of levels in a full factorial, evenly spread."""
    nominal: Annotated[float, Field(ge=-2, le=2)] | None = None
    """Coded level in the nominal point z0 (18); -2, none, for wear, 0 for all else, where left out."""
    validation: tuple[float, float] | None = None
    """Natural values of the levels -2 and +2 in the validation runs (Table 3); the inner 80 % of
    the range where left out."""
    shift: tuple[float, float] | None = None
    """Natural values between which it moves within a shift: what a detector must stand. The answer is set
    against it; assumed to be `range` where left out."""

    @model_validator(mode="after")
    def _rising(self) -> "FactorSettings":
        for name in ("range", "validation", "shift"):
            pair = getattr(self, name)
            if pair is not None and not pair[0] < pair[1]:
                raise ValueError(f"{name}: its first number {pair[0]:g} is not below its second {pair[1]:g}")
        low, high = self.range
        if self.kind == "temperature" and low < -273.15:
            raise ValueError(f"range: {low:g} degC is below absolute zero; give degC")
        first, last = self.validation or self.range
        if not low <= first < last <= high:
            raise ValueError(
                f"validation: {first:g} to {last:g} lies outside the range {low:g} to {high:g}; move it "
                "inside or leave it out"
            )
        return self

    @model_validator(mode="after")
    def _known_unit(self) -> "FactorSettings":
        units = UNITS.get(self.kind, (self.unit,))
        if self.unit not in units:
            what = self.kind.replace("_", " ")
            raise ValueError(
                f"unit: {what} is in {units[0]}, not '{self.unit}'; give its values in {units[0]}"
            )
        return self

    def full_kind(self) -> str:
        """Kind as the simulation takes it: a path says whether its levels are changes in percent."""
        return f"{self.kind} %" if "." in self.kind and self.unit == "%" else self.kind


class DesignSettings(Section):
    """Which design points are simulated to identify the surrogates."""

    kind: Literal[
        "central_composite",
        "face_centred",
        "circumscribed",
        "inscribed",
        "full_factorial",
        "fractional_factorial",
        "latin_hypercube",
    ] = "central_composite"
    """`central_composite`: cube at +-1, star points at +-2, centre; `face_centred`: both at +-2;
    `circumscribed`: cube at +-1, star points at `alpha`; `inscribed`: the same scaled into -2..2;
    `full_factorial`; `fractional_factorial`; `latin_hypercube`."""
    generators: list[str] | None = None
    """Defining relations of the cube, e.g. `w5 = f w1 w2 w3 w4`; the full cube where left out."""
    cube_level: Annotated[float, Field(gt=0, le=2)] | None = None
    """Coded level of the cube's corners."""
    star_level: Annotated[float, Field(gt=0, le=2)] | None = None
    """Coded level of the star points of `central_composite`."""
    alpha: Annotated[float, Field(gt=0)] | None = None
    """Star distance in units of the cube; the rotatable one where left out."""
    centre_points: Annotated[int, Field(ge=0)] | None = None
    """Number of centre points, 1 where left out; more only repeat the simulation with other sensor noise."""
    levels: Annotated[int, Field(ge=2)] | None = None
    """Number of levels of every factor of `full_factorial`; each factor's own where left out."""
    points: Annotated[int, Field(ge=2)] | None = None
    """Number of points of `latin_hypercube`."""
    centred: bool | None = None
    """Whether the points of `latin_hypercube` sit in the middle of their cells."""

    def options(self) -> dict[str, Any]:
        """Options of the kind that are given."""
        return self.model_dump(exclude={"kind"}, exclude_none=True)

    def count_points(self, factors: Mapping[str, FactorSettings]) -> int:
        """Number of points of the design matrix, known before it is made."""
        if self.kind == "latin_hypercube":
            return self.points or 45
        if self.kind == "full_factorial":
            return math.prod(self.levels or factor.levels for factor in factors.values())
        cube = 2 ** (len(factors) - len(self.generators or []))
        if self.kind == "fractional_factorial":
            return cube
        return cube + 2 * len(factors) + (1 if self.centre_points is None else self.centre_points)


class SimulationSettings(Section):
    """How a design point is simulated and recorded."""

    step: Annotated[float, Field(gt=0, le=0.01)] = 0.001
    """Integration step [s]."""
    sample_rate: Annotated[float, Field(gt=0)] | None = None
    """Recorded samples per second [Hz]; that of the robot's sensors where left out. The step must fit into
    the sample time a whole number of times."""
    nominal_runs: Annotated[int, Field(ge=1)] = 1
    """Wear-free runs that the detectors learn from, a robot and test-cycle; they differ in sensor noise."""
    chunk: Annotated[int, Field(ge=1)] = 23
    """Design points a job: long enough to outweigh the start of a process, short enough to resume."""
    job_seconds: Annotated[float, Field(gt=0)] | None = None
    """How long a job simulates [s], in place of `chunk`: 300 to 1200 on a cluster. No recording depends on
    it."""
    point_seconds: Annotated[float, Field(gt=0)] = 0.2
    """How long a point takes [s], which cuts `job_seconds` into points; `benchmarks/scale.py` measures it."""
    quantity_seconds: Annotated[float, Field(gt=0)] = 0.04
    """How long a point's test quantities take [s], of all detectors and axes; it cuts their jobs likewise."""

    packed: bool = False
    """Whether the recordings of a chunk are kept as one file, not as a file a point; a chunk that is run
    again then simulates all of its points."""
    keep_recordings: bool = False
    """Whether recordings stay once their test quantities are there; those of nominal runs always do. Where
    they do not, a change of a detector simulates the points again."""

    def points_per_job(self) -> int:
        """Design points that one job simulates."""
        if self.job_seconds is None:
            return self.chunk
        return max(1, round(self.job_seconds / self.point_seconds))

    def quantities_per_job(self) -> int | None:
        """Design points whose test quantities one job computes; None for all of a robot and test-cycle."""
        if self.job_seconds is None:
            return None
        return max(1, round(self.job_seconds / self.quantity_seconds))

    @model_validator(mode="after")
    def _whole_samples(self) -> "SimulationSettings":
        ratio = 1.0 / (self.step * self.sample_rate) if self.sample_rate else 1.0
        if abs(ratio - round(ratio)) > 1e-9 * ratio or round(ratio) < 1:
            raise ValueError(
                f"sample_rate {self.sample_rate or 0:g} Hz is no whole number of steps of {self.step:g} s; "
                "choose a step that divides the sample time"
            )
        return self


class PartitionSettings(Section):
    """How a study of many robots is divided: one job plans and runs each part, in a folder of its own."""

    above: Annotated[int, Field(ge=0)] = 4
    """Robots above which a study is divided; 0 divides any. One page of all cells takes 0.4 GiB a robot."""
    robots: Annotated[int, Field(ge=1)] = 1
    """Robots in a partition."""
    threads: Annotated[int, Field(ge=1)] = 1
    """Cores of the job that runs a partition."""
    number: Annotated[int, Field(ge=0)] | None = None
    """The partition to run alone; the job that runs it says so."""


class DetectorSettings(Section):
    """One detector under its configured name."""

    use: Annotated[str, Field(min_length=1)]
    """Name of a module of `wearscope.detectors`, or the path of a .py file that defines `DETECTOR`."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Keyword arguments of the detector."""


class FillingSettings(Section):
    """Points simulated in addition to the paper's design, for the surrogate that is chosen for each cell.

    The chosen surrogate learns from these and from the paper's identification and validation runs; its fit
    is stated on checking points, which no fit and no choice sees.
    """

    enabled: bool = True
    """Whether they are simulated and a surrogate is chosen; without, SNR and scope ask a quadratic model."""
    points: Annotated[int, Field(ge=2)] = 36
    """Points of a Latin hypercube, a robot and test-cycle."""
    question_points: Annotated[int, Field(ge=0)] = 8
    """Points for each axis on the lines that the scope asks about."""
    replicates: Annotated[int, Field(ge=0)] = 6
    """Points of the hypercube simulated once more with other sensor noise: they state the noise ceiling."""
    checking_points: Annotated[int, Field(ge=2)] = 24
    """Checking points of a Latin hypercube, a robot and test-cycle."""
    checking_question_points: Annotated[int, Field(ge=0)] = 2
    """Checking points for each axis on the lines that the scope asks about."""
    kinds: Annotated[list[SurrogateKind], Field(min_length=1)] = Field(
        default=["quadratic", "polynomial_chaos", "gaussian_process", "bent_gaussian_process"]
    )
    """Kinds among which cross-validation chooses; `bent_gaussian_process` needs `gaussian_process`."""
    goal: Annotated[float, Field(gt=0, lt=100)] = 95.0
    """Fit [%] on the checking points that counts as reached."""

    @model_validator(mode="after")
    def _few_replicates(self) -> "FillingSettings":
        if self.replicates > self.points:
            raise ValueError(
                f"replicates {self.replicates} are more than the {self.points} points; give fewer"
            )
        if self.kinds == ["bent_gaussian_process"]:
            raise ValueError(
                "kinds: bent_gaussian_process alone; add gaussian_process, which says what to bend"
            )
        return self


class SurrogateSettings(Section):
    """Which surrogates are fitted to each cell."""

    models: Annotated[list[Model], Field(min_length=1)] = Field(default=["main", "full", "simplified"])
    """`main` effects (2), `full` second order (3), `simplified` (19): fitted to the paper's design."""
    filling: FillingSettings = FillingSettings()
    """The surrogate that is chosen for each cell, and the points that it needs."""
