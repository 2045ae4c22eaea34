"""Base of every section of the configuration, shared kinds of value, and the sections.

The first sections are on the questions that the surrogates answer, on the checks of their answers, and on
measured machines: the loop, what it changes, sessions, recordings, export. The others are on what is
simulated: factors, design, simulation, detectors, surrogates.
"""

import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from wearscope import plugins
from wearscope.closed_loop.inference.policy import Policy

Model = Literal["main", "full", "simplified"]
AskedModel = Literal["main", "full", "simplified", "chosen"]
SurrogateKind = Literal["quadratic", "polynomial_chaos", "gaussian_process", "bent_gaussian_process"]
CellKey = Literal["robot", "cycle", "axis", "fda"]
_FACTOR_NAME, _NAME = r"^[A-Za-z][A-Za-z0-9_]*$", r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
#: Patterns of names in words.
PATTERNS = {
    _FACTOR_NAME: "starts with a letter from A to Z and holds only letters, digits and '_'",
    _NAME: "starts with a letter from A to Z or a digit and holds only letters, digits, '_', '-' and '.'",
}
#: Columns of the study's tables, which no factor can be called.
KEYS = ("set", "point", "robot", "cycle", "axis", "fda", "factor", "y", "status")
#: Folders below ``results/`` that hold something else than a study.
TAKEN = ("archive", "closed_loop", "detection", "export", "tracking")
FactorName = Annotated[str, Field(pattern=_FACTOR_NAME, max_length=100)]
Name = Annotated[str, Field(pattern=_NAME, max_length=100)]
Share = Annotated[float, Field(ge=0, le=1)]
Probability = Annotated[float, Field(gt=0, lt=1)]


class Section(BaseModel):
    """A part of the configuration: unknown keys are refused, defaults are filled in."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False)


_SECTIONS = "drive|sensors|payload|controller|gravity|home|lower|upper|links|effects"


def _check_path(path: str) -> str:
    if not re.match(rf"^({_SECTIONS})\.[^\s.]+(\.[^\s.]+)*( %)?$", path):
        raise ValueError(f"'{path}' is no path of a number of the robot, such as effects.viscous.all.viscous")
    return path


NumberPath = Annotated[str, AfterValidator(_check_path)]


class SensitivitySettings(Section):
    """Which factors matter (Q-1)."""

    model: Model = "simplified"
    """The surrogate whose normalised coefficients (8) are compared."""
    group_by: list[CellKey] = Field(default=["fda"])
    """The cells that share these keys form a group (9)."""


class SnrSettings(Section):
    """How the detectors compare (Q-2); defaults are (20)."""

    model: AskedModel = "chosen"
    """The surrogate that is asked: the one chosen for each cell, or a quadratic model of the paper."""
    f0: float = -0.5
    """Fault without change, coded."""
    delta: float = 1.0
    """Change of the fault, coded."""
    sigma: Annotated[float, Field(gt=0)] = 0.25
    """Standard deviation of every nuisance factor, coded."""
    runs: Annotated[int, Field(ge=100)] = 100_000
    """Monte Carlo runs a cell and hypothesis."""
    group_by: list[CellKey] = Field(default=["fda"])
    """The cells that share these keys form a group."""


class ScopeSettings(Section):
    """Where a detector works (Q-3); defaults are Sec. 6.4."""

    model: AskedModel = "chosen"
    """The surrogate that is asked: the one chosen for each cell, or a quadratic model of the paper."""
    factors: Annotated[list[str], Field(min_length=1)] = Field(default=["w3", "w5"])
    """Nuisance factors that vary, one at a time."""
    f0: float = -2.0
    """Fault without change, coded."""
    delta: tuple[float, float] = (0.0, 4.0)
    """First and last change of the fault, coded."""
    sigma: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] = (0.01, 1.0)
    """First and last standard deviation of the factor that varies, coded."""
    grid: tuple[Annotated[int, Field(ge=2)], Annotated[int, Field(ge=2)]] = (30, 30)
    """Number of values of delta and of sigma."""
    p_f: Probability = 0.01
    """Highest probability of false alarm that passes."""
    p_d: Probability = 0.99
    """Lowest probability of detection that passes."""
    runs: Annotated[int, Field(ge=100)] = 100_000
    """Monte Carlo runs a grid cell and hypothesis, for the kernel density estimate of the paper."""
    group_by: list[CellKey] = Field(default=["fda"])
    """The cells that share these keys form a group scope matrix."""


class AuditSettings(Section):
    """Surrogates against direct simulation at z0 and at the edges of the scopes, where they extrapolate."""

    enabled: bool = True
    """Whether the audit runs."""
    points: Annotated[int, Field(ge=1)] = 9
    """Points simulated directly a robot and test-cycle, most telling first."""
    cycles: Annotated[int, Field(ge=1)] = 2
    """Number of test-cycles audited, the first ones of `cycles`."""
    places: Annotated[list[Probability], Field(min_length=1)] = Field(default=[0.25, 0.75])
    """Where the evidence is close: places along the edge of each scope at which more points are simulated,
    as shares of its length; the first points lie in its middle."""


class DirectSettings(Section):
    """The SNR's question (20) asked of the simulator itself, without a surrogate (the paper's Level 2)."""

    enabled: bool = True
    """Whether it is asked, of one cell of each detector: first robot, test-cycle and axis."""
    runs: Annotated[int, Field(ge=10)] = 1000
    """Simulations under each of the two hypotheses; 1000 give the ratio to 5 %, 500 to 7 %."""
    mismatch: dict[NumberPath, float] = Field(default={})
    """Numbers of the simulated robot that differ from the model that the detectors hold, by path, such as
    `effects.friction_wear_temperature.all.alpha: 1.3`; with ` %` after the path a change in percent. The same
    cells are asked once more with a robot like that, from its nominal runs on. A factor of such a kind is a
    mismatch that varies."""
    mismatch_runs: Annotated[int, Field(ge=10)] = 200
    """Simulations under each of the two hypotheses with that robot."""


class CarryOverSettings(Section):
    """Wear and temperature that a robot's model lacks, taken from another robot."""

    source: str
    """Robot that lends them, as `robots` names one. What it lends is scaled to the joint's own friction and
    marked `assumed` in `results/<study>/robots/<robot>.yaml`, which is what is simulated."""
    effects: Annotated[list[Literal["wear", "temperature"]], Field(min_length=1)] = Field(
        default=["wear", "temperature"]
    )
    """What is carried over, to joints that do not depend on it yet."""
    reference: float = 50.0
    """Temperature [deg C] at which the model's own friction holds."""


class ReevaluateSettings(Section):
    """What a correction changes: the study's questions asked of models before and after, side by side."""

    enabled: bool = True
    """Whether it is part of the report; the target `reevaluate` runs it either way."""
    before: list[str] = Field(default=[])
    """Models before, as `robots` names one: the first is the model, the others are what its uncertainty
    allows, each as likely. Left out, they are the closed loop's: of `dataset`, or of the demonstration."""
    after: list[str] = Field(default=[])
    """Models after, in the same way."""
    carry_over: CarryOverSettings | None = CarryOverSettings(source="medium")
    """Where all these models take wear and temperature from; null where they have their own."""
    cycles: list[str] = Field(default=[])
    """Test-cycles, among the study's; the first one where left out."""
    points: Annotated[int, Field(ge=8)] = 12
    """Points of a Latin hypercube over the whole region, a model and test-cycle."""
    local_points: Annotated[int, Field(ge=2)] = 14
    """Points about the centre, where the SNR is asked."""
    question_points: Annotated[int, Field(ge=0)] = 3
    """Points for each axis on the lines that the scope asks about."""
    replicates: Annotated[int, Field(ge=1)] = 5
    """Points about the centre that are simulated once more with other sensor noise."""
    checking_points: Annotated[int, Field(ge=2)] = 8
    """Points on which the surrogates' fit is stated."""
    draws: Annotated[int, Field(ge=0)] = 5
    """Models of each side drawn from what the closed loop leaves open: intervals and equivalent names.
    Each is simulated at few points, half as many again as a linear model has coefficients, and takes the rest
    of its response from the side's own model."""

    @model_validator(mode="after")
    def _both_sides(self) -> "ReevaluateSettings":
        if bool(self.before) != bool(self.after):
            missing = "after" if self.before else "before"
            raise ValueError(f"{missing}: is missing; name models of both sides, or of none")
        if self.replicates > self.local_points:
            raise ValueError(
                f"replicates {self.replicates} are more than the {self.local_points} local_points; give fewer"
            )
        return self


class ClosedLoopSettings(Section):
    """The loop closed with measured data."""

    demonstration: bool = True
    """Whether the study records a twin of the medium robot with an effect that nobody declared, and closes
    the loop on it."""
    demonstration_seconds: Annotated[float, Field(ge=8.0, le=60.0)] = 14.0
    """Length of each of the twin's six recordings [s]."""
    policy: Policy = Policy()
    """Numbers of the score that names; `verdict.json` repeats them."""
    effects: list[str] = Field(default=[])
    """Own effects, candidates in addition to the vocabulary: paths of .py files that define `EFFECT`, or
    names of effects of installed packages."""
    allow_code: bool = False
    """Whether effect files that a data set names may run: a data set may come from someone else. The
    study's own `allow_code: true` allows it too."""

    @field_validator("effects")
    @classmethod
    def _python_files(cls, value: list[str]) -> list[str]:
        for path in value:
            if not path.endswith(".py") and path not in plugins.list_installed("effects"):
                raise ValueError(
                    f"{path} is no path of a .py file, nor an effect of an installed package; the "
                    "vocabulary's own effects take part anyway"
                )
        return value


class TrackingSettings(Section):
    """What changed since a machine was healthy."""

    false_alarm_rate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.01
    """Share of sessions of a healthy machine in which a change may be named, over all joints and effects."""
    friction_limit: Annotated[float, Field(gt=0.0)] | None = None
    """Rise of a joint's friction, as a share of the healthy one, until which the sessions left are told; left
    out, 0.3 is assumed, and the page says so."""


class DetectSettings(Section):
    """The study's detectors on the recordings of a data set (target `detect`)."""

    model: str | None = None
    """Path of the corrected model; that of the loop closed on the same data set where left out."""
    nominal: Literal["measured", "simulated"] = "measured"
    """What the detectors are fitted to before they judge: the nominal recordings (those of the data set's
    `reference` sessions, or else its training runs), or as many simulated runs."""
    p_f: Probability = 0.01
    """Wanted probability of false alarm."""
    p_d: Probability = 0.99
    """Probability of detection from which on a wear counts as detected."""
    sigma: Annotated[float, Field(gt=0)] = 0.25
    """Standard deviation of temperature and payload mass error in the simulated runs, coded, as in (20)."""
    runs: Annotated[int, Field(ge=10)] = 400
    """Simulated runs without wear of each motion; a threshold takes at least 1 / p_f - 1."""
    worn_runs: Annotated[int, Field(ge=20)] = 100
    """Simulated runs with wear of each motion, spread over the fault's range."""


class ExportSettings(Section):
    """A corrected model as URDF, MJCF and a table (target `export`)."""

    model: str | None = None
    """Path of the model, or a robot's name; that of the loop closed on the data set where left out."""
    temperature: float = 50.0
    """At which friction that depends on it is written [deg C]."""


#: Kinds of factor in addition to a number of the robot given by its path.
KINDS = ("wear", "temperature", "dwell", "payload_mass_error")
#: Units of their natural values; a number by its path is in the model's unit, whatever it is called.
UNITS = {
    "wear": ("1", "-", ""),
    "temperature": ("degC", "°C"),
    "dwell": ("ms",),
    "payload_mass_error": ("%",),
}
_PATH = rf"^({_SECTIONS}|detectors)\.[^\s.]+(\.[^\s.]+)*$"


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
