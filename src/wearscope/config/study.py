"""The configuration of a study as a whole, and what its sections must agree on."""

import re
from collections import Counter
from collections.abc import Mapping
from itertools import count, islice
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from wearscope.config.sections import (
    KEYS,
    TAKEN,
    AuditSettings,
    CarryOverSettings,
    ClosedLoopSettings,
    DesignSettings,
    DetectorSettings,
    DetectSettings,
    DirectSettings,
    ExportSettings,
    FactorName,
    FactorSettings,
    Name,
    PartitionSettings,
    ReevaluateSettings,
    ScopeSettings,
    Section,
    SensitivitySettings,
    Share,
    SimulationSettings,
    SnrSettings,
    SurrogateSettings,
    TrackingSettings,
)


def _allow_short(field: str) -> BeforeValidator:
    """Allow ``name: text`` for ``name: {field: text}`` in a mapping of sections."""

    def lengthen(value: Any) -> Any:
        if not isinstance(value, Mapping):
            return value
        return {name: {field: one} if isinstance(one, str) else one for name, one in value.items()}

    return BeforeValidator(lengthen)


class StudyConfig(Section):
    """A study: a design over factors, crossed with robots, test-cycles, axes and detectors."""

    study: Name
    """Name of the study; its results go to `results/<study>/`."""
    seed: Annotated[int, Field(ge=0)] = 0
    """Root of all random numbers."""
    robots: Annotated[list[str], Field(min_length=1)]
    """Names of folders of `config/robots/`, or paths of a robot folder or model file."""
    carry_over: Annotated[dict[str, CarryOverSettings], _allow_short("source")] = Field(default={})
    """Robots, by the name they have in tables, whose model lacks wear or temperature, e.g. the
    `model_after.yaml` of a closed loop: `model_after: medium` lets the robot `medium` lend them."""
    screening: Literal["refuse", "drop"] = "refuse"
    """What becomes of a factor that moves no torque of a robot: the study is refused, or the factor is
    dropped from that robot's answers and the report says so. The wear of a tested axis is never dropped."""
    cycles: Annotated[list[str], Field(min_length=1)]
    """Names of modules of `wearscope.cycles`, or paths of .py files that define `CYCLE`."""
    axes: Annotated[list[Annotated[int, Field(ge=1, le=100)]], Field(min_length=1)] = Field(default=[1, 2, 3])
    """Axes under test, any of the robots': the joints that `wear_axes` of the model names count first, then
    the others. The wear of each is `f` of its own cells, `w1` or `w2` of the others'; wear factors beyond the
    tested axes are the wear of the first other axes."""
    detectors: Annotated[dict[Name, DetectorSettings], Field(min_length=1), _allow_short("use")]
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
    allow_code: bool | list[str] = False
    """Whether a robot's model or a data set may name effects by the path of a .py file, whose code then runs:
    `true`, as in `--config dataset=PATH allow_code=true`, or, for models, the paths that may be named. Either
    may come from someone else."""
    dataset: str | None = None
    """Folder of a measured data set for the targets `closed_loop`, `detect` and `track`; usually given as
    `--config dataset=PATH`. Left out, `closed_loop` runs the demonstration."""

    def wear_factors(self) -> dict[int, str]:
        """Factor that is the wear of an axis, by axis: the tested ones, and the first others."""
        wear = [name for name, factor in self.factors.items() if factor.kind == "wear"]
        others = (axis for axis in count(1) if axis not in self.axes)
        axes = [*self.axes, *islice(others, max(len(wear) - len(self.axes), 0))]
        return dict(zip(sorted(axes), wear, strict=False))

    def worn_axes(self) -> list[int]:
        """Axes that wear, in the order of their factors; the axes under test where no factor is wear."""
        return list(self.wear_factors()) or sorted(self.axes)

    def tested_factors(self) -> list[str]:
        """Factors that are the fault of a tested axis."""
        wear = self.wear_factors()
        return [wear.get(axis, "f") for axis in self.axes]

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

    def factor_kinds(self, set_name: str = "") -> dict[str, str]:
        """Kind by factor, as the simulation takes it; with the mismatch in the sets of that name."""
        kinds = {name: factor.full_kind() for name, factor in self.factors.items()}
        return kinds | {path: path for path in self.direct.mismatch if set_name.startswith("mismatch")}

    def factor_ranges(self) -> dict[str, list[Any]]:
        """Kind and natural range by factor, validation included."""
        ranges = {}
        for name, factor in self.factors.items():
            ends = [*factor.range, *(factor.validation or ())]
            ranges[name] = [factor.full_kind(), min(ends), max(ends)]
        return ranges

    def factor_table(self) -> list[dict[str, Any]]:
        """Factors as the keyword arguments of `wearscope.designs.factors.Factor`, in the design's order."""
        table = []
        axes = {name: axis for axis, name in self.wear_factors().items()}
        for name, factor in self.factors.items():
            low, high = factor.validation or (None, None)
            fields = factor.model_dump(include={"description", "unit", "levels", "nominal"})
            table.append(
                {
                    "name": name,
                    "kind": factor.full_kind(),
                    "role": "fault" if name == "f" else "nuisance",
                    "low": factor.range[0],
                    "high": factor.range[1],
                    "validation_low": low,
                    "validation_high": high,
                    "axis": axes.get(name),
                    **fields,
                }
            )
        return table

    @field_validator("study")
    @classmethod
    def _not_taken(cls, value: str) -> str:
        if value in TAKEN:
            raise ValueError(f"results/{value}/ holds something else; choose another name")
        return value

    @field_validator("robots", "cycles", "axes")
    @classmethod
    def _no_repeats(cls, value: list[Any]) -> list[Any]:
        for one, times in Counter(value).items():
            if times > 1:
                raise ValueError(f"{one} is named twice; name it once")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> "StudyConfig":
        if "f" not in self.factors:
            raise ValueError("factors: f, the fault, is missing; add it")
        for name, factor in self.factors.items():
            if name in KEYS:
                raise ValueError(
                    f"factors.{name}: tables have a column of this name; call the factor another"
                )
            section, _, rest = factor.kind.partition(".")
            detector = rest.partition(".")[0]
            if section == "detectors" and detector not in self.detectors:
                raise ValueError(
                    f"factors.{name}.kind: there is no detector {detector}; choose among "
                    f"{', '.join(self.detectors)}"
                )
            if factor.kind == "sensors.sample_rate" and self.simulation.sample_rate is not None:
                raise ValueError(
                    f"factors.{name}.kind: simulation.sample_rate sets one rate for all runs; remove it or "
                    "this factor"
                )
        wear = [factor.range for factor in self.factors.values() if factor.kind == "wear"]
        if wear and len(self.axes) > len(wear):
            raise ValueError(
                f"axes: axis {max(self.axes)} has no wear factor; add a factor of kind wear, or drop the axis"
            )
        if len(self.axes) > 1 and len(set(wear)) > 1:
            raise ValueError(
                "factors: those of kind wear have different ranges, but the same simulations serve every "
                "axis; give them one range, or test one axis"
            )
        for section in ("scope", "detect"):
            if getattr(self, section).p_f >= getattr(self, section).p_d:
                raise ValueError(
                    f"{section}.p_f: is not below {section}.p_d; false alarms are to be the rarer"
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
        nuisances = [name for name in self.factors if name != "f"]
        for where, what, asked, known in (
            ("scope.factors", "nuisance factor", self.scope.factors, nuisances),
            ("carry_over", "robot", self.carry_over, names[0]),
            ("reevaluate.cycles", "test-cycle", self.reevaluate.cycles, names[1]),
        ):
            for one in asked:
                if one not in known:
                    raise ValueError(
                        f"{where}: {one} is no {what} of this study; choose among {', '.join(known)}"
                    )
        for field, labels in zip(("robots", "cycles"), names, strict=True):
            for one, times in Counter(labels).items():
                if any(mark in one for mark in "{}\n/"):
                    raise ValueError(f"{field}: {one} holds a brace or the end of a line; rename it")
                if times > 1:
                    raise ValueError(f"{field}: two of them would both be called {one}; rename one")
        return self

    def divide(self) -> list["StudyConfig"]:
        """Partitions, each a study of some of the robots; none where the study is not divided.

        A closed loop or a correction belongs to the whole study, not to a partition; direct Monte Carlo,
        which is about one robot, to neither.
        """
        size = self.partitions.robots
        if self.partitions.number is not None or len(self.robots) <= self.partitions.above:
            return []
        rest = {
            "closed_loop": self.closed_loop.model_copy(update={"demonstration": False}),
            "reevaluate": self.reevaluate.model_copy(update={"enabled": False}),
            "direct": self.direct.model_copy(update={"enabled": False}),
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
