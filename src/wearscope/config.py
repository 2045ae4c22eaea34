"""The configuration of a study, validated; the text under each field is its reference manual."""

import difflib
import json
import math
import re
from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    ValidationError,
    field_validator,
    model_validator,
)

from wearscope.closed_loop.selection.policy import Policy
from wearscope.errors import InputError

Model = Literal["main", "full", "simplified"]
AskedModel = Literal["main", "full", "simplified", "chosen"]
SurrogateKind = Literal["quadratic", "polynomial_chaos", "gaussian_process", "bent_gaussian_process"]
CellKey = Literal["robot", "cycle", "axis", "fda"]
FactorName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$")]
Share = Annotated[float, Field(ge=0, le=1)]
Probability = Annotated[float, Field(gt=0, lt=1)]


class Section(BaseModel):
    """A part of the configuration: unknown keys are refused, defaults are filled in."""

    model_config = ConfigDict(extra="forbid", use_attribute_docstrings=True, allow_inf_nan=False)


class FactorSettings(Section):
    """A factor: a fault or a nuisance, and the natural values that its coded levels stand for."""

    description: str
    """What it is, as figures and the report say it."""
    kind: Literal["wear", "temperature", "dwell", "payload_mass_error"]
    """What the simulation does with it. The first, second and third factor of kind `wear` are the wear of
    axes 1, 2 and 3; the cells of an axis see their own axis's wear as `f`."""
    range: tuple[float, float]
    """Natural values at the coded levels -2 and +2 of the identification (Table 1)."""
    unit: str
    """Unit of the natural values."""
    levels: Annotated[int, Field(ge=2)] = 5
    """Number of levels in a full factorial, evenly spread."""
    nominal: Annotated[float, Field(ge=-2, le=2)] | None = None
    """Coded level in the nominal point z0 (18); -2, none, for wear, 0 for all else, where left out."""
    validation: tuple[float, float] | None = None
    """Natural values that the levels -2 and +2 stand for in the validation runs (Table 3); the inner 80 % of
    the range where left out."""

    @model_validator(mode="after")
    def _rising(self) -> "FactorSettings":
        for name in ("range", "validation"):
            pair = getattr(self, name)
            if pair is not None and not pair[0] < pair[1]:
                raise ValueError(f"{name}: its first number {pair[0]:g} is not below its second {pair[1]:g}")
        return self


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

    def points_per_job(self) -> int:
        """Design points that one job simulates."""
        if self.job_seconds is None:
            return self.chunk
        return max(1, round(self.job_seconds / self.point_seconds))

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

    above: Annotated[int, Field(ge=0)] = 100
    """Robots above which a study is divided; 0 divides any."""
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
    """Points simulated beside the paper's design, for the surrogate that is chosen for each cell.

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
    kinds: Annotated[list[SurrogateKind], Field(min_length=1)] = [
        "quadratic",
        "polynomial_chaos",
        "gaussian_process",
        "bent_gaussian_process",
    ]
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

    models: Annotated[list[Model], Field(min_length=1)] = ["main", "full", "simplified"]
    """`main` effects (2), `full` second order (3), `simplified` (19): fitted to the paper's design."""
    filling: FillingSettings = FillingSettings()
    """The surrogate that is chosen for each cell, and the points that it needs."""


class SensitivitySettings(Section):
    """Which factors matter (Q-1)."""

    model: Model = "simplified"
    """The surrogate whose normalised coefficients (8) are compared."""
    group_by: list[CellKey] = ["fda"]
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
    group_by: list[CellKey] = ["fda"]
    """The cells that share these keys form a group."""


class ScopeSettings(Section):
    """Where a detector works (Q-3); defaults are Sec. 6.4."""

    model: AskedModel = "chosen"
    """The surrogate that is asked: the one chosen for each cell, or a quadratic model of the paper."""
    factors: Annotated[list[str], Field(min_length=1)] = ["w3", "w5"]
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
    group_by: list[CellKey] = ["fda"]
    """The cells that share these keys form a group scope matrix."""


class AuditSettings(Section):
    """Surrogates against direct simulation at z0 and at the edges of the scopes, where they extrapolate."""

    enabled: bool = True
    """Whether the audit runs."""
    points: Annotated[int, Field(ge=1)] = 9
    """Points simulated directly a robot and test-cycle, most telling first."""
    cycles: Annotated[int, Field(ge=1)] = 2
    """Number of test-cycles audited, the first ones of `cycles`."""


class DirectSettings(Section):
    """The SNR's question (20) asked of the simulator itself, without a surrogate (the paper's Level 2)."""

    enabled: bool = True
    """Whether it is asked, of one cell of each detector: first robot, test-cycle and axis."""
    runs: Annotated[int, Field(ge=10)] = 60
    """Simulations under each of the two hypotheses; 1000 give the ratio to 3 %, 60 to 12 %."""


class CarryOverSettings(Section):
    """Wear and temperature that a robot's model lacks, taken from another robot."""

    source: str
    """Robot that lends them, as `robots` names one. What it lends is scaled to the joint's own friction and
    marked `assumed` in `results/<study>/robots/<robot>.yaml`, which is what is simulated."""
    effects: Annotated[list[Literal["wear", "temperature"]], Field(min_length=1)] = ["wear", "temperature"]
    """What is carried over, to joints that do not depend on it yet."""
    reference: float = 50.0
    """Temperature [deg C] at which the model's own friction holds."""


class ReevaluateSettings(Section):
    """What a correction changes: the study's questions asked of models before and after, side by side."""

    enabled: bool = True
    """Whether it is part of the report; the target `reevaluate` runs it either way."""
    before: list[str] = []
    """Models before, as `robots` names one: the first is the model, the others are what its uncertainty
    allows, each as likely. Left out, they are the closed loop's: of `dataset`, or of the demonstration."""
    after: list[str] = []
    """Models after, in the same way."""
    carry_over: CarryOverSettings | None = CarryOverSettings(source="medium")
    """Where all these models take wear and temperature from; null where they have their own."""
    cycles: list[str] = []
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
    policy: Policy = Policy()
    """Numbers of the rule that accepts, ties and names; `verdict.json` repeats them."""
    effects: list[str] = []
    """Paths of .py files that define `EFFECT`: own effects, candidates beside the vocabulary."""
    allow_code: bool = False
    """Whether effect files that a data set names may run: a data set may come from someone else. The
    study's own `allow_code: true` allows it too."""

    @field_validator("effects")
    @classmethod
    def _python_files(cls, value: list[str]) -> list[str]:
        for path in value:
            if not path.endswith(".py"):
                raise ValueError(
                    f"{path} is no path of a .py file; the vocabulary's own effects take part anyway"
                )
        return value


class TrackingSettings(Section):
    """What changed since a machine was healthy."""

    false_alarm_rate: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.01
    """Share of sessions of a healthy machine in which a change may be named, over all joints and effects."""


class BoardSettings(Section):
    """The attribution board: planted effects over regimes, their verdicts scored."""

    part: Literal["development", "held_out"] = "held_out"
    """Which part: what the tracer may be tuned on, or what is kept out of it by seed and family."""
    cases: Annotated[int, Field(ge=2)] = 300
    """Number of cases, points of a Latin hypercube; a case takes a minute or so."""
    limit: Annotated[float, Field(gt=0.0)] = 300.0
    """Wall time of a case in seconds; beyond it the case counts as failed."""


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


def _short_detectors(value: Any) -> Any:
    """Allow `A: residual_energy` for `A: {use: residual_energy}`."""
    if not isinstance(value, Mapping):
        return value
    return {name: {"use": one} if isinstance(one, str) else one for name, one in value.items()}


def _short_sources(value: Any) -> Any:
    """Allow `model_after: medium` for `model_after: {source: medium}`."""
    if not isinstance(value, Mapping):
        return value
    return {name: {"source": one} if isinstance(one, str) else one for name, one in value.items()}


#: Settings of earlier releases that are no more, by section.
RETIRED = {"attribution_board": ("nulls", "size")}


def drop_retired(mapping: Mapping[str, Any]) -> dict[str, Any]:
    """An archived configuration without the settings of earlier releases that are no more."""
    return {
        name: {key: own for key, own in value.items() if key not in RETIRED[name]}
        if name in RETIRED and isinstance(value, Mapping)
        else value
        for name, value in mapping.items()
    }


class StudyConfig(Section):
    """A study: a design over factors, crossed with robots, test-cycles, axes and detectors."""

    study: Name
    """Name of the study; its results go to `results/<study>/`."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Root of all random numbers."""
    robots: Annotated[list[str], Field(min_length=1)]
    """Names of folders of `config/robots/`, or paths of a robot folder or model file."""
    carry_over: Annotated[dict[str, CarryOverSettings], BeforeValidator(_short_sources)] = {}
    """Robots, by the name they have in tables, whose model lacks wear or temperature, e.g. the
    `model_after.yaml` of a closed loop: `model_after: medium` lets the robot `medium` lend them."""
    screening: Literal["refuse", "drop"] = "refuse"
    """What becomes of a factor that moves no torque of a robot: the study is refused, or the factor is
    dropped from that robot's answers and the report says so. The wear of a tested axis is never dropped."""
    cycles: Annotated[list[str], Field(min_length=1)]
    """Names of modules of `wearscope.cycles`, or paths of .py files that define `CYCLE`."""
    axes: Annotated[list[Annotated[int, Field(ge=1, le=3)]], Field(min_length=1)] = [1, 2, 3]
    """Axes under test; the wear of each is `f` of its own cells, `w1` or `w2` of the others'."""
    detectors: Annotated[dict[Name, DetectorSettings], Field(min_length=1), BeforeValidator(_short_detectors)]
    """Detectors by the name they have in tables and figures."""
    factors: Annotated[dict[FactorName, FactorSettings], Field(min_length=1)]
    """Factors of the design by column name, in the design's order; the fault is `f` and comes before other
    wear. What no factor is about stays at its nominal value."""
    design: DesignSettings = DesignSettings()
    """The design matrix."""
    simulation: SimulationSettings = SimulationSettings()
    """The simulation."""
    partitions: PartitionSettings = PartitionSettings()
    """How a study of many robots is divided."""
    max_failed_share: Share = 0.05
    """Largest share of a cell's points that may fail in a set, in simulation or in a detector; above it the
    study is refused."""
    time_limit: Annotated[float, Field(gt=0)] = 300.0
    """Longest time [s] for the check of a robot and test-cycle, the simulation of a design point, and a
    detector's fit or answer. What takes longer is ended: a simulation or an answer is then a failed point, a
    check or a fit refuses the study."""
    surrogates: SurrogateSettings = SurrogateSettings()
    """The surrogates."""
    sensitivity: SensitivitySettings = SensitivitySettings()
    """Question Q-1."""
    snr: SnrSettings = SnrSettings()
    """Question Q-2."""
    scope: ScopeSettings = ScopeSettings()
    """Question Q-3."""
    audit: AuditSettings = AuditSettings()
    """The audit."""
    direct: DirectSettings = DirectSettings()
    """Direct Monte Carlo."""
    closed_loop: ClosedLoopSettings = ClosedLoopSettings()
    """The closed loop."""
    detect: DetectSettings = DetectSettings()
    """Detectors on recordings."""
    export: ExportSettings = ExportSettings()
    """The corrected model taken to other simulators."""
    tracking: TrackingSettings = TrackingSettings()
    """Sessions tracked."""
    reevaluate: ReevaluateSettings = ReevaluateSettings()
    """What the correction changes."""
    attribution_board: BoardSettings = BoardSettings()
    """The attribution board."""
    allow_code: bool | list[str] = False
    """Whether a robot's model or a data set may name effects by the path of a .py file, whose code then runs:
    `true`, as in `--config dataset=PATH allow_code=true`, or, for models, the paths that may be named. Either
    may come from someone else."""
    dataset: str | None = None
    """Folder of a measured data set for the targets `closed_loop`, `detect` and `track`; usually given as
    `--config dataset=PATH`. Left out, `closed_loop` runs the demonstration."""

    def tested_factors(self) -> list[str]:
        """Wear factors that are the fault of a tested axis."""
        wear = [name for name, factor in self.factors.items() if factor.kind == "wear"]
        return [wear[axis - 1] for axis in self.axes]

    def may_run_code(self) -> bool:
        """Whether effect files that the data set names may run."""
        return self.allow_code is True or self.closed_loop.allow_code

    def count_audit_points(self) -> int:
        """Number of audit points a robot and test-cycle: z0, then H0 and H1 at both sides of each factor."""
        return min(self.audit.points, 1 + len(self.scope.factors) * (2 + 2 * len(self.axes)))

    def count_filling_points(self) -> tuple[int, int]:
        """Number of filling and of checking points a robot and test-cycle."""
        asked, axes = self.surrogates.filling, len(self.axes)
        return (
            asked.points + asked.question_points * axes + asked.replicates,
            asked.checking_points + asked.checking_question_points * axes,
        )

    def factor_ranges(self) -> dict[str, list[Any]]:
        """Kind and natural range by factor, validation included."""
        ranges = {}
        for name, factor in self.factors.items():
            ends = [*factor.range, *(factor.validation or ())]
            ranges[name] = [factor.kind, min(ends), max(ends)]
        return ranges

    def factor_table(self) -> list[dict[str, Any]]:
        """Factors as the keyword arguments of `wearscope.designs.factors.Factor`, in the design's order."""
        table = []
        for name, factor in self.factors.items():
            low, high = factor.validation or (None, None)
            fields = factor.model_dump(include={"description", "kind", "unit", "levels", "nominal"})
            table.append(
                {
                    "name": name,
                    "role": "fault" if name == "f" else "nuisance",
                    "low": factor.range[0],
                    "high": factor.range[1],
                    "validation_low": low,
                    "validation_high": high,
                    **fields,
                }
            )
        return table

    @field_validator("study")
    @classmethod
    def _not_taken(cls, value: str) -> str:
        if value in ("archive", "attribution_board", "closed_loop", "detection", "export", "tracking"):
            raise ValueError(f"results/{value}/ holds something else; choose another name")
        return value

    @field_validator("robots", "cycles", "axes")
    @classmethod
    def _no_repeats(cls, value: list[Any]) -> list[Any]:
        for one in value:
            if value.count(one) > 1:
                raise ValueError(f"{one} is named twice; name it once")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> "StudyConfig":
        if "f" not in self.factors:
            raise ValueError("factors: f, the fault, is missing; add it")
        wear = [factor.range for factor in self.factors.values() if factor.kind == "wear"]
        if max(self.axes) > len(wear):
            raise ValueError(
                f"axes: axis {max(self.axes)} has no wear factor; add a factor of kind wear, or drop the axis"
            )
        if len(self.axes) > 1 and len(set(wear)) > 1:
            raise ValueError(
                "factors: those of kind wear have different ranges, but the same simulations serve every "
                "axis; give them one range, or test one axis"
            )
        nuisances = [name for name in self.factors if name != "f"]
        for name in self.scope.factors:
            if name not in nuisances:
                raise ValueError(
                    f"scope.factors: {name} is no nuisance factor of this study; choose among "
                    f"{', '.join(nuisances)}"
                )
        for section in ("sensitivity", "snr", "scope"):
            model = getattr(self, section).model
            if model == "chosen":
                if not self.surrogates.filling.enabled:
                    raise ValueError(
                        f"{section}.model: no surrogate is chosen while surrogates.filling.enabled is false; "
                        "enable it, or name one of surrogates.models"
                    )
            elif model not in self.surrogates.models:
                raise ValueError(f"{section}.model: {model} is not among surrogates.models; add it there")
        names = [label(robot) for robot in self.robots], [label(cycle) for cycle in self.cycles]
        for robot in self.carry_over:
            if robot not in names[0]:
                raise ValueError(
                    f"carry_over.{robot}: there is no such robot in this study; choose among "
                    f"{', '.join(names[0])}"
                )
        for cycle in self.reevaluate.cycles:
            if cycle not in names[1]:
                raise ValueError(
                    f"reevaluate.cycles: {cycle} is no test-cycle of this study; choose among "
                    f"{', '.join(names[1])}"
                )
        for field, labels in zip(("robots", "cycles"), names, strict=True):
            for one in labels:
                if labels.count(one) > 1:
                    raise ValueError(f"{field}: two of them would both be called {one}; rename one")
        return self

    def divide(self) -> list["StudyConfig"]:
        """Partitions, each a study of some of the robots; none where the study is not divided.

        What a closed loop or a correction asks is asked of the whole study, not of a partition.
        """
        size = self.partitions.robots
        if self.partitions.number is not None or len(self.robots) <= self.partitions.above:
            return []
        rest = {
            "closed_loop": self.closed_loop.model_copy(update={"demonstration": False}),
            "reevaluate": self.reevaluate.model_copy(update={"enabled": False}),
            "dataset": None,
        }
        parts = []
        for number, start in enumerate(range(0, len(self.robots), size)):
            robots = self.robots[start : start + size]
            labels = {label(robot) for robot in robots}
            own = {
                "robots": robots,
                "carry_over": {name: one for name, one in self.carry_over.items() if name in labels},
                "partitions": self.partitions.model_copy(update={"number": number}),
            }
            parts.append(self.model_copy(update=rest | own))
        return parts


def label(reference: str) -> str:
    """Name that a robot or test-cycle given by name or path has in tables and folders.

    ``medium`` -> ``medium``; ``path/to/arm`` and ``path/to/arm/model.yaml`` -> ``arm``;
    ``path/model_after.yaml`` -> ``model_after``; ``my/slow.py`` -> ``slow``.
    """
    parts = [part for part in reference.replace("\\", "/").split("/") if part not in ("", ".")]
    name = parts[-1] if parts else reference
    if name == "model.yaml" and len(parts) > 1:
        return parts[-2]
    return re.sub(r"\.(ya?ml|py)$", "", name)


def load_config(mapping: Mapping[str, Any]) -> StudyConfig:
    """Validate a configuration and fill in its defaults.

    Parameters
    ----------
    mapping : mapping
        As read from YAML. Numbers may be text (YAML reads ``1e-3`` as text).

    Raises
    ------
    InputError
        With the path of the first field that is wrong, what is wrong with it, and what would be right.
    """
    try:
        return StudyConfig.model_validate(dict(mapping))
    except ValidationError as error:
        raise InputError(_explain(error)) from error


def list_breaches(mapping: Mapping[str, Any]) -> list[str]:
    """Everything that is wrong with a configuration, a sentence each; misspelt settings first."""
    try:
        StudyConfig.model_validate(dict(mapping))
    except ValidationError as error:
        return [_explain_one(one, "") for one in _order(error)]
    return []


def _explain(error: ValidationError) -> str:
    more = error.error_count() - 1
    return _explain_one(_order(error)[0], f" ({more} more like this)" if more else "")


def _order(error: ValidationError) -> list[Any]:
    """Errors, unknown settings first: what is missing is often misspelt."""
    return sorted(error.errors(), key=lambda one: one["type"] != "extra_forbidden")


def _explain_one(breach: Any, tail: str) -> str:
    path = ".".join(str(part) for part in breach["loc"] if part != "[key]")
    if breach["type"] == "extra_forbidden":
        known = _known_keys(breach["loc"][:-1])
        close = difflib.get_close_matches(str(breach["loc"][-1]), known, n=1)
        remedy = f"did you mean {close[0]}?" if close else f"known here: {', '.join(known)}."
        return f"config: {path} is no known setting{tail}; {remedy}"
    if breach["type"] == "missing":
        return f"config: {path} is missing{tail}; add it."
    message = breach["msg"].removeprefix("Value error, ")
    where = f"{path}: " if path else ""
    given = "" if breach["type"] == "value_error" else f", not {breach['input']!r}"
    return f"config: {where}{message[0].lower() if where else message[0]}{message[1:]}{given}{tail}."


def _known_keys(path: tuple[int | str, ...]) -> list[str]:
    """Keys known in the section at `path`."""
    section: Any = StudyConfig
    for part in path:
        if isinstance(section, type) and issubclass(section, BaseModel):
            section = section.model_fields[str(part)].annotation
        else:  # the name of an entry of a mapping
            section = get_args(section)[1]
    return sorted(section.model_fields)


def make_schema() -> str:
    """JSON Schema of the configuration as text; `config/schema.json` is this, for editors."""
    return json.dumps(StudyConfig.model_json_schema(), indent=2) + "\n"


if __name__ == "__main__":
    print(make_schema(), end="")
