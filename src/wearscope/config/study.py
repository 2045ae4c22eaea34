"""The configuration of a study as a whole, and the checks that concern several of its sections."""

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
    """Return a validator that allows ``name: text`` for ``name: {field: text}`` in a mapping of sections."""

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
    """Root seed of all random numbers."""
    robots: Annotated[list[str], Field(min_length=1)]
    """Names of folders of `config/robots/`, or paths of a robot folder or model file."""
    carry_over: Annotated[dict[str, CarryOverSettings], _allow_short("source")] = Field(default={})
    """Robots whose friction does not depend on wear or temperature, by their name in tables, and the robot
    from which they take this dependence. For the `model_after.yaml` of a closed loop, `model_after: medium`
    takes it from the robot `medium`."""
    screening: Literal["refuse", "drop"] = "refuse"
    """What happens where a factor changes no torque of a robot: the study is refused, or the factor is
    dropped from that robot's answers and the report says so. The wear of a tested axis is never dropped."""
    cycles: Annotated[list[str], Field(min_length=1)]
    """Names of modules of `wearscope.cycles`, or paths of .py files that define `CYCLE`."""
    axes: Annotated[list[Annotated[int, Field(ge=1, le=100)]], Field(min_length=1)] = Field(default=[1, 2, 3])
    """Tested axes. The axes count the joints in the model's `wear_axes` first, then the others. The wear of
    an axis is `f` in its own cells, and `w1` or `w2` in those of the other axes. Where there are more wear
    factors than tested axes, the further ones are the wear of the first other axes."""
    detectors: Annotated[dict[Name, DetectorSettings], Field(min_length=1), _allow_short("use")]
    """Detectors by their name in tables and figures."""
    factors: Annotated[dict[FactorName, FactorSettings], Field(min_length=1)]
    """Factors of the design by column name, in the design's order; the fault is `f` and comes before other
    wear factors. Whatever no factor varies stays at its nominal value."""
    design: DesignSettings = DesignSettings()
    """Design of the points that are simulated."""
    simulation: SimulationSettings = SimulationSettings()
    """How design points are simulated and recorded."""
    partitions: PartitionSettings = PartitionSettings()
    """Division of a study of many robots."""
    max_failed_share: Share = 0.05
    """Largest share of a cell's points in a set that may fail, in the simulation or in a detector; above it
    the study is refused."""
    time_limit: Annotated[float, Field(gt=0)] = 300.0
    """Longest time [s] for the check of a robot and test-cycle, the simulation of a design point, the fit of
    a detector, or a test quantity. A simulation or test quantity that takes longer is a failed point; a check
    or fit that takes longer refuses the study."""
    surrogates: SurrogateSettings = SurrogateSettings()
    """Surrogates that are fitted, and the points for choosing and checking them."""
    sensitivity: SensitivitySettings = SensitivitySettings()
    """Question Q-1: which factors disturb a detector more than wear."""
    snr: SnrSettings = SnrSettings()
    """Question Q-2: how the detectors compare by their SNR."""
    scope: ScopeSettings = ScopeSettings()
    """Question Q-3: at which wear and variation a detector works."""
    audit: AuditSettings = AuditSettings()
    """Comparison of the surrogates with direct simulation."""
    direct: DirectSettings = DirectSettings()
    """SNR by direct simulation, without a surrogate."""
    closed_loop: ClosedLoopSettings = ClosedLoopSettings()
    """Closed loop: diagnosis and correction of a model by measured data."""
    detect: DetectSettings = DetectSettings()
    """Detectors on measured recordings."""
    export: ExportSettings = ExportSettings()
    """Export of the corrected model to other simulators."""
    tracking: TrackingSettings = TrackingSettings()
    """Tracking of changes between sessions of a machine."""
    reevaluate: ReevaluateSettings = ReevaluateSettings()
    """Reevaluation: how the correction changes the study's answers."""
    allow_code: bool | list[str] = False
    """Whether a robot's model or a data set, which may come from someone else, may name effects by the path
    of a .py file, whose code then runs. It is `true`, as in `--config dataset=PATH allow_code=true`, or, for
    models, a list of the allowed paths."""
    dataset: str | None = None
    """Folder of a measured data set for the targets `closed_loop`, `detect` and `track`; usually given as
    `--config dataset=PATH`. Without it, `closed_loop` runs the demonstration."""

    def wear_factors(self) -> dict[int, str]:
        """Return the factor that is the wear of an axis, by axis: tested axes, and others if needed."""
        wear = [name for name, factor in self.factors.items() if factor.kind == "wear"]
        others = (axis for axis in count(1) if axis not in self.axes)
        axes = [*self.axes, *islice(others, max(len(wear) - len(self.axes), 0))]
        return dict(zip(sorted(axes), wear, strict=False))

    def worn_axes(self) -> list[int]:
        """Return the axes that wear, in the order of their factors; the tested axes without wear factors."""
        return list(self.wear_factors()) or sorted(self.axes)

    def tested_factors(self) -> list[str]:
        """Return the factors that are the fault of a tested axis."""
        wear = self.wear_factors()
        return [wear.get(axis, "f") for axis in self.axes]

    def may_run_code(self) -> bool:
        """Return whether effect files that the data set names may run."""
        return self.allow_code is True or self.closed_loop.allow_code

    def count_audit_points(self) -> int:
        """Return the number of audit points for each robot and test-cycle.

        They are z0, and H0 and H1 of every tested axis at both sides of each factor, at most `audit.points`.
        """
        return min(self.audit.points, 1 + len(self.scope.factors) * (2 + 2 * len(self.axes)))

    def count_filling_points(self) -> tuple[int, int]:
        """Return the numbers of filling and of checking points for each robot and test-cycle."""
        asked, axes = self.surrogates.filling, len(self.axes)
        return (
            asked.points + asked.question_points * axes + asked.replicates,
            asked.checking_points + asked.checking_question_points * axes,
        )

    def factor_kinds(self, set_name: str = "") -> dict[str, str]:
        """Return the kind by factor as the simulation takes it, in mismatch sets also for the mismatch."""
        kinds = {name: factor.full_kind() for name, factor in self.factors.items()}
        return kinds | {path: path for path in self.direct.mismatch if set_name.startswith("mismatch")}

    def factor_ranges(self) -> dict[str, list[Any]]:
        """Return kind and natural range by factor, including the validation's range."""
        ranges = {}
        for name, factor in self.factors.items():
            ends = [*factor.range, *(factor.validation or ())]
            ranges[name] = [factor.full_kind(), min(ends), max(ends)]
        return ranges

    def factor_table(self) -> list[dict[str, Any]]:
        """Return the factors as keyword arguments of `wearscope.designs.factors.Factor`, in their order."""
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
        """Refuse a name whose folder of results is used for something else."""
        if value in TAKEN:
            raise ValueError(f"results/{value}/ holds something else; choose another name")
        return value

    @field_validator("robots", "cycles", "axes")
    @classmethod
    def _no_repeats(cls, value: list[Any]) -> list[Any]:
        """Refuse a list that names something twice."""
        for one, times in Counter(value).items():
            if times > 1:
                raise ValueError(f"{one} is named twice; name it once")
        return value

    @model_validator(mode="after")
    def _consistent(self) -> "StudyConfig":
        """Refuse settings that contradict each other across sections."""
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
        """Return the partitions, each a study of some of the robots; none where the study is not divided.

        The closed loop and the reevaluation belong to the whole study, not to a partition. Direct simulation,
        which concerns one robot only, is not made in a divided study.
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
    """Return the name in tables and folders of a robot or test-cycle that is given by name or path.

    ``medium`` -> ``medium``; ``path/to/arm`` and ``path/to/arm/model.yaml`` -> ``arm``;
    ``path/model_after.yaml`` -> ``model_after``; ``my/slow.py`` -> ``slow``.
    """
    parts = [part for part in reference.replace("\\", "/").split("/") if part not in ("", ".")]
    name = parts[-1] if parts else reference
    if name == "model.yaml" and len(parts) > 1:
        return parts[-2]
    return re.sub(r"\.(ya?ml|py)$", "", name)
