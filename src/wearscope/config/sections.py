"""What every section of the configuration is, the kinds of value that several have, and plain sections.

The sections here are on the questions that the surrogates answer, and on the checks of their answers.
"""

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

Model = Literal["main", "full", "simplified"]
AskedModel = Literal["main", "full", "simplified", "chosen"]
SurrogateKind = Literal["quadratic", "polynomial_chaos", "gaussian_process", "bent_gaussian_process"]
CellKey = Literal["robot", "cycle", "axis", "fda"]
_FACTOR_NAME, _NAME = r"^[A-Za-z][A-Za-z0-9_]*$", r"^[A-Za-z0-9][A-Za-z0-9_.-]*$"
#: What the patterns of names ask for, in words.
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
