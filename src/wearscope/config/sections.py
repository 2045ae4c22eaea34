"""Base of every section of the configuration, shared kinds of value, and the plain sections.

The sections here are on the questions that the surrogates answer, on the checks of their answers, and on
measured machines: the loop, what it changes, sessions, recordings, export.
"""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, field_validator, model_validator

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
