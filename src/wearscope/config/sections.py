"""Sections of the configuration, their base class and shared types of values.

The first sections are about the questions that surrogates answer, the checks of their answers, and measured
machines: closed loop, reevaluation, sessions, recordings, export. The others are about the simulated study:
factors, design, simulation, detectors, surrogates.
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
#: Descriptions of the patterns for names, for messages.
PATTERNS = {
    _FACTOR_NAME: "starts with a letter from A to Z and holds only letters, digits and '_'",
    _NAME: "starts with a letter from A to Z or a digit and holds only letters, digits, '_', '-' and '.'",
}
#: Columns of the study's tables; no factor can have such a name.
KEYS = ("set", "point", "robot", "cycle", "axis", "fda", "factor", "y", "status")
#: Folders in ``results/`` that hold other results than those of a study.
TAKEN = ("archive", "closed_loop", "detection", "export", "tracking")
FactorName = Annotated[str, Field(pattern=_FACTOR_NAME, max_length=100)]
Name = Annotated[str, Field(pattern=_NAME, max_length=100)]
Share = Annotated[float, Field(ge=0, le=1)]
Probability = Annotated[float, Field(gt=0, lt=1)]


class Section(BaseModel):
    """A part of the configuration: unknown keys are refused, defaults are filled in."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False)


#: First parts of the path of a robot's number.
_SECTIONS = "drive|sensors|payload|controller|gravity|home|lower|upper|links|effects"


def _check_path(path: str) -> str:
    """Refuse a text that has not the form of a path of a robot's number."""
    if not re.match(rf"^({_SECTIONS})\.[^\s.]+(\.[^\s.]+)*( %)?$", path):
        raise ValueError(f"'{path}' is no path of a number of the robot, such as effects.viscous.all.viscous")
    return path


NumberPath = Annotated[str, AfterValidator(_check_path)]


class SensitivitySettings(Section):
    """Question Q-1: which factors matter."""

    model: Model = "simplified"
    """Quadratic surrogate whose normalised coefficients (8) are compared."""
    group_by: list[CellKey] = Field(default=["fda"])
    """Keys that form the groups (9): cells with equal values of them are one group."""


class SnrSettings(Section):
    """Question Q-2: how the detectors compare by their SNR; the defaults are (20)."""

    model: AskedModel = "chosen"
    """Surrogate in use: the one chosen for each cell, or a quadratic surrogate of the paper."""
    f0: float = -0.5
    """Coded level of the fault before its change."""
    delta: float = 1.0
    """Coded change of the fault."""
    sigma: Annotated[float, Field(gt=0)] = 0.25
    """Coded standard deviation of every nuisance factor."""
    runs: Annotated[int, Field(ge=100)] = 100_000
    """Number of Monte Carlo runs for each cell and hypothesis."""
    group_by: list[CellKey] = Field(default=["fda"])
    """Keys that form the groups: cells with equal values of them are one group."""


class ScopeSettings(Section):
    """Question Q-3: where a detector works; the defaults are those of Sec. 6.4."""

    model: AskedModel = "chosen"
    """Surrogate in use: the one chosen for each cell, or a quadratic surrogate of the paper."""
    factors: Annotated[list[str], Field(min_length=1)] = Field(default=["w3", "w5"])
    """Nuisance factors that vary, one at a time."""
    f0: float = -2.0
    """Coded level of the fault before its change."""
    delta: tuple[float, float] = (0.0, 4.0)
    """First and last coded change of the fault."""
    sigma: tuple[Annotated[float, Field(gt=0)], Annotated[float, Field(gt=0)]] = (0.01, 1.0)
    """First and last coded standard deviation of the factor that varies."""
    grid: tuple[Annotated[int, Field(ge=2)], Annotated[int, Field(ge=2)]] = (30, 30)
    """Number of values of delta and of sigma."""
    p_f: Probability = 0.01
    """Largest allowed probability of a false alarm."""
    p_d: Probability = 0.99
    """Least required probability of detection."""
    runs: Annotated[int, Field(ge=100)] = 100_000
    """Number of Monte Carlo runs for each grid point and hypothesis, for the paper's kernel density
    estimate."""
    group_by: list[CellKey] = Field(default=["fda"])
    """Keys that form the groups: cells with equal values of them share a group scope matrix."""


class AuditSettings(Section):
    """Audit: direct simulation at z0 and the boundaries of the scopes, where surrogates extrapolate."""

    enabled: bool = True
    """Whether the audit runs."""
    points: Annotated[int, Field(ge=1)] = 9
    """Number of points simulated directly for each robot and test-cycle, the most informative first."""
    cycles: Annotated[int, Field(ge=1)] = 2
    """Number of test-cycles that are audited: the first ones of `cycles`."""
    places: Annotated[list[Probability], Field(min_length=1)] = Field(default=[0.25, 0.75])
    """Places along the boundary of each scope, as shares of its length, at which more points are simulated
    where the first points, in its middle, do not decide clearly."""


class DirectSettings(Section):
    """SNR (20) by direct simulation, without a surrogate (the paper's Level 2)."""

    enabled: bool = True
    """Whether it is computed, for one cell of each detector: first robot, test-cycle and axis."""
    runs: Annotated[int, Field(ge=10)] = 1000
    """Number of simulations under each of the two hypotheses; 1000 give the SNR within 5 %, 500 within 7
    %."""
    mismatch: dict[NumberPath, float] = Field(default={})
    """Numbers of the simulated robot that differ from the model that the detectors use, by path, such as
    `effects.friction_wear_temperature.all.alpha: 1.3`; with ` %` after the path it is a change in per cent.
    The SNR of the same cells is then also found with such a robot, whose nominal runs the detectors learn
    from. A
    factor of such a kind would be a mismatch that varies."""
    mismatch_runs: Annotated[int, Field(ge=10)] = 200
    """Number of simulations under each of the two hypotheses with that robot."""


class CarryOverSettings(Section):
    """Dependence of friction on wear and temperature, taken from another robot where a model lacks it."""

    source: str
    """Robot that it is taken from, named as in `robots`. It is scaled to the friction of the model's own
    joints and marked `assumed` in `results/<study>/robots/<robot>.yaml`, the model that is simulated."""
    effects: Annotated[list[Literal["wear", "temperature"]], Field(min_length=1)] = Field(
        default=["wear", "temperature"]
    )
    """Dependences that are carried over, to joints that do not have them."""
    reference: float = 50.0
    """Temperature [deg C] at which the model's own friction is valid."""


class ReevaluateSettings(Section):
    """Reevaluation: the study's answers for the models before and after a correction, side by side."""

    enabled: bool = True
    """Whether it is part of the report; the target `reevaluate` runs it in any case."""
    before: list[str] = Field(default=[])
    """Models before the correction, named as in `robots`. The first is the model itself. The others are
    models that its uncertainty allows, all equally likely. By default they come from the closed loop: that of
    `dataset`, or that of the demonstration."""
    after: list[str] = Field(default=[])
    """Models after the correction, in the same form."""
    carry_over: CarryOverSettings | None = CarryOverSettings(source="medium")
    """Robot from which all these models take wear and temperature; null where they have their own."""
    cycles: list[str] = Field(default=[])
    """Test-cycles, among those of the study; by default the first one."""
    points: Annotated[int, Field(ge=8)] = 12
    """Number of points of a Latin hypercube over the whole region, for each model and test-cycle."""
    local_points: Annotated[int, Field(ge=2)] = 14
    """Number of points around the centre, where the SNR is computed."""
    question_points: Annotated[int, Field(ge=0)] = 3
    """Number of points for each axis on the lines of the scope: one axis worn, one nuisance varied."""
    replicates: Annotated[int, Field(ge=1)] = 5
    """Number of points around the centre that are simulated a second time with other sensor noise."""
    checking_points: Annotated[int, Field(ge=2)] = 8
    """Number of points on which the fit of the surrogates is computed."""
    draws: Annotated[int, Field(ge=0)] = 5
    """Number of models of each side that are drawn from the uncertainty of the closed loop: intervals and
    equivalent names. Each is simulated at few points, 1.5 times the number of coefficients of a linear model.
    At other points its response is that of the side's own model plus the fitted difference."""

    @model_validator(mode="after")
    def _both_sides(self) -> "ReevaluateSettings":
        """Refuse models of one side only, and more replicates than points."""
        if bool(self.before) != bool(self.after):
            missing = "after" if self.before else "before"
            raise ValueError(f"{missing}: is missing; name models of both sides, or of none")
        if self.replicates > self.local_points:
            raise ValueError(
                f"replicates {self.replicates} are more than the {self.local_points} local_points; give fewer"
            )
        return self


class ClosedLoopSettings(Section):
    """The closed loop with measured data."""

    demonstration: bool = True
    """Whether the study records a twin of the medium robot with an undeclared effect, and closes the loop on
    it."""
    demonstration_seconds: Annotated[float, Field(ge=8.0, le=60.0)] = 14.0
    """Length of each of the twin's six recordings [s]."""
    policy: Policy = Policy()
    """Settings of the score that decides which effects are named; `verdict.json` repeats them."""
    effects: list[str] = Field(default=[])
    """The user's own effects, which are candidates in addition to the vocabulary: paths of .py files that
    define `EFFECT`, or names of effects of installed packages."""
    allow_code: bool = False
    """Whether effect files that a data set names may run, as a data set may come from someone else. The
    study's own `allow_code: true` allows it too."""

    @field_validator("effects")
    @classmethod
    def _python_files(cls, value: list[str]) -> list[str]:
        """Refuse effects that are neither .py files nor effects of installed packages."""
        for path in value:
            if not path.endswith(".py") and path not in plugins.list_installed("effects"):
                raise ValueError(
                    f"{path} is no path of a .py file, nor an effect of an installed package; the "
                    "vocabulary's own effects take part anyway"
                )
        return value


class TrackingSettings(Section):
    """Tracking of a machine: what changed since its healthy sessions."""

    false_alarm_rate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.01
    """Share of a healthy machine's sessions in which a change may be named, over all joints and effects."""
    friction_limit: Annotated[float, Field(gt=0.0)] | None = None
    """Allowed rise of a joint's friction, as a share of the healthy friction; the page predicts the number of
    sessions until it is reached. By default 0.3 is assumed, and the page says so."""


class DetectSettings(Section):
    """The study's detectors on the recordings of a data set (target `detect`)."""

    model: str | None = None
    """Path of the corrected model; by default that of the closed loop on the same data set."""
    nominal: Literal["measured", "simulated"] = "measured"
    """What the detectors are fitted to: the nominal recordings (those of the data set's `reference` sessions,
    or else its training runs), or the same number of simulated runs."""
    p_f: Probability = 0.01
    """Wanted probability of false alarm."""
    p_d: Probability = 0.99
    """Least probability of detection at which a wear counts as detected."""
    sigma: Annotated[float, Field(gt=0)] = 0.25
    """Coded standard deviation of temperature and payload mass error in the simulated runs, as in (20)."""
    runs: Annotated[int, Field(ge=10)] = 400
    """Number of simulated runs without wear for each motion; a threshold needs at least 1 / p_f - 1."""
    worn_runs: Annotated[int, Field(ge=20)] = 100
    """Number of simulated runs with wear for each motion, spread over the fault's range."""


class ExportSettings(Section):
    """A corrected model as URDF, MJCF and a table (target `export`)."""

    model: str | None = None
    """Path of the model, or a robot's name; by default the model of the closed loop on the data set."""
    temperature: float = 50.0
    """Temperature [deg C] at which friction that depends on it is written."""


#: Kinds of factor. A kind may also be the path of a number of the robot.
KINDS = ("wear", "temperature", "dwell", "payload_mass_error")
#: Allowed units of a factor, by its kind. A number given by its path has the unit of the robot's model, or %.
UNITS = {
    "wear": ("1", "-", ""),
    "temperature": ("degC", "°C"),
    "dwell": ("ms",),
    "payload_mass_error": ("%",),
}
_PATH = rf"^({_SECTIONS}|detectors)\.[^\s.]+(\.[^\s.]+)*$"


def _check_kind(kind: str) -> str:
    """Refuse a kind of factor that is neither known nor a path of a number."""
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
    """A factor: the fault or a nuisance, and the natural values of its coded levels."""

    description: str
    """Description for figures and the report."""
    kind: FactorKind
    """What the factor changes in the simulation: `wear`, `temperature`, `dwell`, `payload_mass_error`, or a
    number given by its path. The number belongs to the robot's model (`sensors.torque_noise`,
    `controller.bandwidth_hz`, `drive.speed_limit`, `links.axis_2.mass`,
    `effects.joint_elasticity.axis_2.compliance`) or to a detector (`detectors.A.OPTION`). Factors of kind
    `wear` are the wear of the tested axes; in the cells of an axis, `f` is the wear of that axis."""
    range: tuple[float, float]
    """Natural values at the coded levels -2 and +2 of the identification (Table 1)."""
    unit: str
    """Unit of the natural values. A number given by its path has the model's unit; with `"%"` its values are
    changes in per cent of the model's value."""
    levels: Annotated[int, Field(ge=2)] = 5
    """Number of levels in a full factorial, evenly spaced."""
    nominal: Annotated[float, Field(ge=-2, le=2)] | None = None
    """Coded level at the nominal point z0 (18); by default -2 (no wear) for wear, 0 for other factors."""
    validation: tuple[float, float] | None = None
    """Natural values of the levels -2 and +2 in the validation runs (Table 3); by default the ends of the
    inner 80 % of the range."""
    shift: tuple[float, float] | None = None
    """Natural values between which the factor moves within a work shift, which a detector has to tolerate.
    The report compares its answer with them; by default they are `range`."""

    @model_validator(mode="after")
    def _rising(self) -> "FactorSettings":
        """Refuse ranges that do not rise, lie below absolute zero, or do not contain the validation."""
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
        """Refuse a unit that the kind of factor does not have."""
        units = UNITS.get(self.kind, (self.unit,))
        if self.unit not in units:
            what = self.kind.replace("_", " ")
            raise ValueError(
                f"unit: {what} is in {units[0]}, not '{self.unit}'; give its values in {units[0]}"
            )
        return self

    def full_kind(self) -> str:
        """Return the kind as the simulation takes it: a path ends in `` %`` where levels are in per cent."""
        return f"{self.kind} %" if "." in self.kind and self.unit == "%" else self.kind


class DesignSettings(Section):
    """Design of the points that are simulated to identify the surrogates."""

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
    """Generators of a fraction of the cube, e.g. `w5 = f w1 w2 w3 w4`; by default the cube is full."""
    cube_level: Annotated[float, Field(gt=0, le=2)] | None = None
    """Coded level of the cube's corners."""
    star_level: Annotated[float, Field(gt=0, le=2)] | None = None
    """Coded level of the star points of `central_composite`."""
    alpha: Annotated[float, Field(gt=0)] | None = None
    """Distance of the star points in units of the cube; by default that of a rotatable design."""
    centre_points: Annotated[int, Field(ge=0)] | None = None
    """Number of centre points, by default 1; more of them only repeat the simulation with other sensor
    noise."""
    levels: Annotated[int, Field(ge=2)] | None = None
    """Number of levels of every factor of `full_factorial`; by default each factor's own."""
    points: Annotated[int, Field(ge=2)] | None = None
    """Number of points of `latin_hypercube`."""
    centred: bool | None = None
    """Whether the points of `latin_hypercube` lie in the middle of their cells."""

    def options(self) -> dict[str, Any]:
        """Return the options of the kind that the configuration states."""
        return self.model_dump(exclude={"kind"}, exclude_none=True)

    def count_points(self, factors: Mapping[str, FactorSettings]) -> int:
        """Return the number of points of the design without making it."""
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
    """Recorded samples per second [Hz]; by default that of the robot's sensors. The sampling interval must be
    a whole number of steps."""
    nominal_runs: Annotated[int, Field(ge=1)] = 1
    """Number of runs without wear that the detectors learn from, for each robot and test-cycle; they differ
    in sensor noise."""
    chunk: Annotated[int, Field(ge=1)] = 23
    """Number of design points of a job. A large number outweighs the start of a process; after an
    interruption, a small number leaves less to repeat."""
    job_seconds: Annotated[float, Field(gt=0)] | None = None
    """Time that a job simulates [s], in place of `chunk`: 300 to 1200 on a cluster. No recording depends on
    it."""
    point_seconds: Annotated[float, Field(gt=0)] = 0.2
    """Time that a point takes [s], by which `job_seconds` is converted to points; `benchmarks/scale.py`
    measures it."""
    quantity_seconds: Annotated[float, Field(gt=0)] = 0.04
    """Time that the test quantities of a point take [s], for all detectors and axes; it sizes their jobs in
    the same way."""

    packed: bool = False
    """Whether the recordings of a chunk are kept in one file instead of a file for each point; a chunk that
    is run again then simulates all of its points."""
    keep_recordings: bool = False
    """Whether recordings are kept after their test quantities are computed; those of nominal runs always are.
    Without them, a change of a detector simulates the points again."""

    def points_per_job(self) -> int:
        """Return the number of design points that one job simulates."""
        if self.job_seconds is None:
            return self.chunk
        return max(1, round(self.job_seconds / self.point_seconds))

    def quantities_per_job(self) -> int | None:
        """Return the number of points whose test quantities one job computes; None for all of them."""
        if self.job_seconds is None:
            return None
        return max(1, round(self.job_seconds / self.quantity_seconds))

    @model_validator(mode="after")
    def _whole_samples(self) -> "SimulationSettings":
        """Refuse a sampling interval that is no whole number of steps."""
        ratio = 1.0 / (self.step * self.sample_rate) if self.sample_rate else 1.0
        if abs(ratio - round(ratio)) > 1e-9 * ratio or round(ratio) < 1:
            raise ValueError(
                f"sample_rate {self.sample_rate or 0:g} Hz is no whole number of steps of {self.step:g} s; "
                "choose a step that divides the sample time"
            )
        return self


class PartitionSettings(Section):
    """Division of a study of many robots: one job plans and runs each part, in a folder of its own."""

    above: Annotated[int, Field(ge=0)] = 4
    """Number of robots above which a study is divided; 0 always divides it. A page of all cells would take
    0.4 GiB of memory for each robot."""
    robots: Annotated[int, Field(ge=1)] = 1
    """Number of robots in a partition."""
    threads: Annotated[int, Field(ge=1)] = 1
    """Number of cores of the job that runs a partition."""
    number: Annotated[int, Field(ge=0)] | None = None
    """Number of the partition to run alone; the job that runs it sets this."""


class DetectorSettings(Section):
    """One detector under its configured name."""

    use: Annotated[str, Field(min_length=1)]
    """Name of a module of `wearscope.detectors`, or the path of a .py file that defines `DETECTOR`."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Keyword arguments of the detector."""


class FillingSettings(Section):
    """Points that are simulated in addition to the paper's design, for the chosen surrogate of each cell.

    The chosen surrogate learns from these and from the paper's identification and validation runs. Its fit is
    computed on checking points, which are used for no fit and no choice.
    """

    enabled: bool = True
    """Whether they are simulated and a surrogate is chosen; otherwise SNR and scope use a quadratic
    surrogate."""
    points: Annotated[int, Field(ge=2)] = 36
    """Number of points of a Latin hypercube, for each robot and test-cycle."""
    question_points: Annotated[int, Field(ge=0)] = 8
    """Number of points for each axis on the lines of the scope: one axis worn, one nuisance varied."""
    replicates: Annotated[int, Field(ge=0)] = 6
    """Number of points of the hypercube that are simulated a second time with other sensor noise; they show
    how far noise limits the fit."""
    checking_points: Annotated[int, Field(ge=2)] = 24
    """Number of checking points of a Latin hypercube, for each robot and test-cycle."""
    checking_question_points: Annotated[int, Field(ge=0)] = 2
    """Number of checking points for each axis on the lines of the scope."""
    kinds: Annotated[list[SurrogateKind], Field(min_length=1)] = Field(
        default=["quadratic", "polynomial_chaos", "gaussian_process", "bent_gaussian_process"]
    )
    """Kinds among which cross-validation chooses; `bent_gaussian_process` needs `gaussian_process`."""
    goal: Annotated[float, Field(gt=0, lt=100)] = 95.0
    """Wanted fit [%] on the checking points."""

    @model_validator(mode="after")
    def _few_replicates(self) -> "FillingSettings":
        """Refuse more replicates than points, and a bent process without the plain one."""
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
    """Surrogates that are fitted to each cell."""

    models: Annotated[list[Model], Field(min_length=1)] = Field(default=["main", "full", "simplified"])
    """Quadratic surrogates fitted to the paper's design: `main` effects (2), `full` second order (3),
    `simplified` (19)."""
    filling: FillingSettings = FillingSettings()
    """The chosen surrogate of each cell, and the points that it needs."""
