"""Detectors on the recordings of a data set, and the same detectors on its simulated model."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.model.events import Event
from wearscope.closed_loop.posing import read_measured
from wearscope.designs.factors import PAPER_FACTORS, Factor
from wearscope.detection.recordings import MotionGroup, Refused, bridge_events, sort_recordings
from wearscope.detection.simulated import Draw, Simulated, draw_runs
from wearscope.detection.thresholds import Cell, fit_panel, least_runs, read_units
from wearscope.detectors.base import Batch
from wearscope.detectors.questions import OK, Answer, DetectorSpec
from wearscope.errors import InputError, SimulationError
from wearscope.robots.model import RobotModel, load_model
from wearscope.supervision import ProcessLost, run_supervised

#: Purposes of a run's test quantities, in the column `kind`.
NOMINAL, JUDGED, UNWORN, WORN, COMPARED = "nominal", "judged", "simulated", "simulated_worn", "compared"

#: Largest number of simulated runs that are also used to compare the scatter.
_COMPARED = 100


@dataclass(frozen=True)
class Setting:
    """Settings of a detection.

    Attributes
    ----------
    p_f, p_d : float
        Wanted false-alarm rate; share of faults to detect.
    runs, worn_runs : int
        Simulated runs a motion, without wear and with wear.
    sigma : float
        Standard deviation of the study's nuisances, coded.
    nominal : str
        ``measured`` or ``simulated``: what the detectors are fitted to before they are asked for the
        recordings.
    max_failed_share : float
        Largest share of the simulated runs that may fail.
    seed : int
    time_limit : float or None
        Longest time of a simulated run, a detector's fits, or its answers to a batch [s].
    """

    p_f: float = 0.01
    p_d: float = 0.99
    runs: int = 400
    worn_runs: int = 100
    sigma: float = 0.25
    nominal: str = "measured"
    max_failed_share: float = 0.05
    seed: int = 0
    time_limit: float | None = None


@dataclass(frozen=True)
class Asked:
    """Test quantities of one run.

    Attributes
    ----------
    motion, kind, run : str
    session : str or None
    draw : Draw or None
        Of a simulated run.
    answers : dict
        Test quantity and status by joint and detector.
    """

    motion: str
    kind: str
    run: str
    session: str | None
    draw: Draw | None
    answers: dict[Cell, Answer]


@dataclass(frozen=True)
class Tested:
    """All test quantities of a data set.

    Attributes
    ----------
    prepared : Prepared
    groups : list of MotionGroup
    refused : list of Refused
    asked : list of Asked
    units : dict
        Of y, by joint and detector.
    idle : dict of str to list of str
        Kinds of factor that move no torque of the model, by motion.
    noise_from : str
        What the simulated torque noise was taken from.
    joints : list of str
        Tested: those that move.
    model : str
        Its name.
    events : list of dict
        Short events, as ``verdict.json`` has them, whose torque is taken out of the recordings.
    detectors : dict of str to str
        What each detector uses, by its name.
    """

    prepared: Prepared
    groups: list[MotionGroup]
    refused: list[Refused]
    asked: list[Asked]
    units: dict[Cell, str]
    idle: dict[str, list[str]]
    noise_from: str
    joints: list[str]
    model: str
    events: list[Event]
    detectors: dict[str, str]


def ask_recordings(
    dataset: str | Path | Dataset,
    model: str | Path | RobotModel,
    detectors: Sequence[DetectorSpec],
    factors: Sequence[Factor] = PAPER_FACTORS,
    setting: Setting | None = None,
    progress: Callable[[str], None] = lambda _: None,
    allow_code: bool | list[str] = False,
) -> Tested:
    """Test quantities of a data set's recordings, and of its simulated model along the same motion.

    Parameters
    ----------
    dataset : path-like or Dataset
    model : path-like or RobotModel
        The corrected model, e.g. ``model_after.yaml``.
    detectors : sequence of DetectorSpec
    factors : sequence of Factor
        Of the study, whose nuisances scatter in the simulated runs.
    setting : Setting, optional
    progress : callable
    allow_code : bool or list of str
        Whether the model may name effects by the path of a .py file.

    Raises
    ------
    InputError
        Where the data set breaks the format, nothing in it can be judged, the model does not fit, or a
        detector hangs.
    """
    setting = setting or Setting()
    if setting.runs < least_runs(setting.p_f):
        raise InputError(
            f"detect: a false-alarm rate of {setting.p_f:g} takes {least_runs(setting.p_f)} runs without "
            f"wear, but detect.runs is {setting.runs}; raise it, or detect.p_f."
        )
    dataset = dataset if isinstance(dataset, Dataset) else read_measured(dataset)
    prepared = prepare(dataset)
    check_plausibility(prepared)
    prepared, events = bridge_events(prepared)
    groups, refused = sort_recordings(prepared)
    if not isinstance(model, RobotModel):
        model = load_model(model, strict=False, allow_code=allow_code)
    joints = {name: j for j, name in enumerate(dataset.joints) if prepared.moving[j]}
    units = dict(zip(dataset.joints, dataset.torque_unit, strict=True))
    work = _Work(prepared, groups, model, detectors, factors, setting, joints, units)
    at = ""
    found: list[Asked] = []
    results: dict[str, Any] = {}
    try:
        steps = (
            work.ask_all() if setting.time_limit is None else run_supervised(work.ask_all, setting.time_limit)
        )
        for kind, content in steps:
            if kind == "begin":  # also again, where somebody else killed the process
                found.clear()
            elif kind == "at":
                at = content
            elif kind == "say":
                progress(content)
            elif kind == "asked":
                found.append(content)
            else:
                results[kind] = content
    except ProcessLost as error:
        raise InputError(f"{at} {error}; correct it, leave it out, or raise time_limit.") from None
    return Tested(
        prepared, groups, refused, found, results["units"], results["idle"], results["noise"], list(joints),
        model.name, events, {one.name: one.reference for one in detectors},
    )  # fmt: skip


def check_recordings(dataset: str | Path) -> None:
    """Refuse a data set without anything to judge, before any computation.

    Raises
    ------
    InputError
        As of `ask_recordings`.
    """
    sort_recordings(prepare(read_measured(dataset)))


@dataclass(frozen=True)
class _Work:
    """All questions as a generator, which may run in its own process."""

    prepared: Prepared
    groups: list[MotionGroup]
    model: RobotModel
    detectors: Sequence[DetectorSpec]
    factors: Sequence[Factor]
    setting: Setting
    joints: Mapping[str, int]
    torque_units: Mapping[str, str]

    def ask_all(self) -> Iterator[tuple[str, Any]]:
        """Yield ``begin``, progress (``at``, ``say``), runs (``asked``), ``units``, ``idle``, ``noise``."""
        units: dict[Cell, str] = {}
        idle, noise = {}, ""
        yield "begin", None
        for group in self.groups:
            yield "at", f"{group.name}: the simulation of the model"
            simulated = Simulated(self.prepared, group, self.model, self.setting.seed)
            noise = simulated.noise_from
            idle[group.name] = simulated.screen_factors(self.factors)
            yield from self._ask_group(group, simulated, units)
        yield "units", units
        yield "idle", idle
        yield "noise", noise

    def _ask_group(
        self, group: MotionGroup, simulated: Simulated, units: dict[Cell, str]
    ) -> Iterator[tuple[str, Any]]:
        n, count = self.model.n, len(group.nominal)
        nominal = [simulated.simulate(Draw(np.zeros(n)), k, "nominal") for k in range(count)]
        declared = simulated.model
        yield "at", f"{group.name}: the fit of the detectors"
        panel = fit_panel(self.detectors, self.joints, nominal, declared)
        measured = [one.batch for one in group.nominal]
        alone = self.setting.nominal == "simulated"
        whole = panel if alone else fit_panel(self.detectors, self.joints, measured, declared)
        units |= read_units(whole, self.torque_units) | read_units(panel, self.torque_units)

        def ask(kind: str, name: str, session: str | None, draw: Draw | None, who: Any, batch: Batch) -> Any:
            return "asked", Asked(group.name, kind, name, session, draw, who.ask(batch))

        for one in group.judged:
            yield "at", f"{group.name}: the answers to {one.file}"
            yield ask(JUDGED, one.file, one.session, None, whole, one.batch)
        for k, one in enumerate(group.nominal):
            yield "at", f"{group.name}: the answers to {one.file}"
            if alone:
                yield ask(NOMINAL, one.file, one.session, None, whole, one.batch)
            elif count > 1:  # a detector's scatter shows only in recordings that it was not fitted to
                others = fit_panel(self.detectors, self.joints, measured[:k] + measured[k + 1 :], declared)
                yield ask(NOMINAL, one.file, one.session, None, others, one.batch)
        # The nominal recordings are left out in turn; to be comparable, so is one of the simulated ones.
        fewer = panel
        if count > 1 and not alone:
            fewer = fit_panel(self.detectors, self.joints, nominal[:-1], declared)
        unworn, worn = draw_runs(
            self.factors, n, self.setting.runs, self.setting.worn_runs, self.setting.sigma, self.setting.seed
        )
        if "wear" in simulated.idle:
            worn = []
        failed = 0
        for kind, draws in ((UNWORN, unworn), (WORN, worn)):
            for number, batch in enumerate(simulated.simulate_all(draws, kind)):
                yield "at", f"{group.name}: the answers to simulated run {number}"
                if isinstance(batch, SimulationError):
                    failed += 1
                    if failed > self.setting.max_failed_share * (len(unworn) + len(worn)):
                        raise InputError(
                            f"{group.name}: {failed} simulated runs failed, the last with: {batch} "
                            "Correct the "
                            "model, or raise max_failed_share."
                        )
                    continue
                yield ask(kind, str(number), None, draws[number], panel, batch)
                if kind == UNWORN and fewer is not panel and number < _COMPARED:
                    yield ask(COMPARED, str(number), None, draws[number], fewer, batch)
                if number % 50 == 49:
                    yield "say", f"{group.name}: {number + 1}/{len(draws)} {kind.replace('_', ' ')} runs"


__all__ = ["OK", "Asked", "Setting", "Tested", "ask_recordings", "check_recordings"]
