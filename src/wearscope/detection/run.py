"""Detectors on the recordings of a data set, and the same detectors on its simulated model.

The corrected model runs along each recorded motion; its runs are recorded and prepared as the machine's are.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy

from wearscope.closed_loop.diagnostics.forward import with_payload
from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.filtering import decimate, differentiate_run
from wearscope.closed_loop.intake.plausibility import check_plausibility
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.intake.recording import Run, estimate_quantum
from wearscope.closed_loop.model.correction import estimate_torque_noise
from wearscope.closed_loop.model.events import Event
from wearscope.closed_loop.posing import read_measured
from wearscope.cycles.base import Reference
from wearscope.designs.factors import CODED_HIGH, CODED_LOW, FAULT, PAPER_FACTORS, Factor
from wearscope.designs.kinds import generator_for, seed_for
from wearscope.detection.recordings import (
    MotionGroup,
    Refused,
    bridge_events,
    cut_rests,
    sort_recordings,
)
from wearscope.detection.thresholds import Cell, fit_panel, least_runs, read_units
from wearscope.detectors.base import Array, Batch
from wearscope.detectors.questions import OK, Answer, DetectorSpec
from wearscope.errors import InputError, SimulationError
from wearscope.robots.model import RobotModel, load_model
from wearscope.simulation.plant import build_plant
from wearscope.simulation.run import Trace
from wearscope.simulation.sensors import record
from wearscope.simulation.study import LONGEST_STEP, trace_forward
from wearscope.supervision import ProcessLost, run_supervised

#: Temperature that is assumed where none is recorded [deg C].
USUAL_TEMPERATURE = 50.0
#: A factor counts as moving a torque where it changes the torque by more than this share of its largest
#: magnitude.
MOVES = 1e-9


@dataclass(frozen=True)
class Draw:
    """Conditions of one simulated run.

    Attributes
    ----------
    wear : ndarray (n,)
        Wear level f of each joint [-].
    warmth : float
        Temperature less that of the nominal recordings [K].
    payload_error : float
        Error of the declared payload mass, relative to the correct one [-].
    """

    wear: Array
    warmth: float = 0.0
    payload_error: float = 0.0


def draw_runs(
    factors: Sequence[Factor], n: int, unworn: int, worn: int, sigma: float, seed: int
) -> tuple[list[Draw], list[Draw]]:
    """Conditions of runs without wear and with wear; nuisances scatter as in the study.

    Parameters
    ----------
    factors : sequence of Factor
        Factors of the study; the point-to-point delay is part of the recorded motion and is left out.
    n : int
        Number of joints.
    unworn, worn : int
        Numbers of runs. Wear covers the fault's range as a Latin hypercube with one dimension per joint.
    sigma : float
        Standard deviation of every nuisance in coded levels, which are clipped to -2..2.
    seed : int

    Returns
    -------
    unworn, worn : list of Draw
    """
    fault = next(factor for factor in factors if factor.name == FAULT)
    top = max(fault.high, 0.0)
    levels = scipy.stats.qmc.LatinHypercube(n, rng=generator_for(seed, "detect", "wear")).random(worn) * top
    wears = [np.zeros(n)] * unworn + list(levels)
    rng = generator_for(seed, "detect", "nuisances")
    scattered = {"temperature": np.zeros(len(wears)), "payload_mass_error": np.zeros(len(wears))}
    for factor in factors:
        if factor.kind in scattered:
            coded = np.clip(sigma * rng.standard_normal(len(wears)), CODED_LOW, CODED_HIGH)
            scattered[factor.kind] = factor.to_natural(coded) - factor.to_natural(0.0)
    draws = [
        Draw(wear, float(warmth), float(error) / 100.0)
        for wear, warmth, error in zip(
            wears, scattered["temperature"], scattered["payload_mass_error"], strict=True
        )
    ]
    return draws[:unworn], draws[unworn:]


class Simulated:
    """Simulation of the corrected model along a recorded motion.

    Parameters
    ----------
    prepared : Prepared
    group : MotionGroup
        Group whose nominal recordings give motion and temperatures, in turn.
    model : RobotModel
        Corrected model. Where it states no torque noise or encoder step, those of the nominal recordings are
        taken.
    seed : int

    Attributes
    ----------
    idle : list of str
        Kinds of factor that change no torque, from `screen_factors`.
    """

    def __init__(self, prepared: Prepared, group: MotionGroup, model: RobotModel, seed: int) -> None:
        if model.joints != prepared.dataset.joints:
            raise InputError(
                f"{model.name}: its joints are {', '.join(model.joints)}, those of the data set "
                f"{', '.join(prepared.dataset.joints)}; give the corrected model of this data set."
            )
        self.group, self.seed = group, seed
        self.rate = prepared.dataset.fields.sample_rate
        self.factor = round(self.rate / prepared.band.rate)
        self.band = prepared.band
        first = group.nominal[0]
        self.noise_from, model = _complete_sensors(prepared, group, model)
        self.model = with_payload(model, prepared, first.run)
        # A sample is a whole number of steps, none longer than the simulator takes.
        self.step = 1.0 / (self.rate * np.ceil(1.0 / (self.rate * LONGEST_STEP) - 1e-9))
        self._plain: dict[int, tuple[Trace, float]] = {}
        self.idle: list[str] = []

    def simulate(self, draw: Draw, number: int, purpose: str, noise: bool = True) -> Batch:
        """One run along the motion of a nominal recording, at its temperature plus that of the draw.

        Parameters
        ----------
        draw : Draw
        number : int
            Number of the run; nominal recordings are taken in turn.
        purpose : str
            Part of the seed.
        noise : bool
            Whether the sensors' noise is recorded.

        Raises
        ------
        SimulationError
            Where the run fails.
        """
        which = number % len(self.group.nominal)
        trace, dt = self._trace(draw, which)
        plant = build_plant(self.model)
        recording = record(
            trace,
            dt,
            self.rate,
            self.model.encoder_resolution,
            self.model.torque_noise,
            plant.torque_gain,
            plant.torque_delay,
            seed_for(self.seed, "detect", self.group.name, purpose, number) if noise else None,
        )
        return self.prepare(recording.t, recording.q, recording.tau)

    def _trace(self, draw: Draw, which: int) -> tuple[Trace, float]:
        """Run of a draw without sensors, and its step [s]; runs that differ only by noise are made once."""
        plain = (
            ("wear" in self.idle or not np.any(draw.wear))
            and ("temperature" in self.idle or draw.warmth == 0.0)
            and ("payload_mass_error" in self.idle or draw.payload_error == 0.0)
        )
        if plain and which in self._plain:
            return self._plain[which]
        recorded = self.group.nominal[which]
        known = np.where(np.isfinite(recorded.temperature), recorded.temperature, USUAL_TEMPERATURE)
        model, payload = self.model, self.model.payload
        if payload is not None and draw.payload_error != 0.0:
            true = payload.to_payload().scaled(1.0 / (1.0 + draw.payload_error))
            stated = {"mass": true.mass, "com": list(true.com), "inertia": list(true.inertia)}
            model = model.replace(payload=stated)
        s = recorded.run.signals
        made = trace_forward(
            model,
            Reference(np.arange(len(s.t)) / self.band.rate, s.q, s.v, s.a),
            declared=self.model,
            temperature=known + draw.warmth,
            wear=draw.wear,
            controller_temperature=known,
            longest_step=self.step,
        )
        if plain:
            self._plain[which] = made
        return made

    def prepare(self, t: Array, q: Array, tau: Array) -> Batch:
        """Batch of a simulated recording, filtered as the measured ones are."""
        run = Run("simulated", "test", t, q, tau, None, None, None, quantum=estimate_quantum(q))
        made = differentiate_run(run, self.rate, self.band.motion)
        q, v, tau = (decimate(x, self.factor) for x in (made.q, made.v, tau))
        return cut_rests(Batch(np.arange(len(q)) / self.band.rate, q, v, tau, self.band.rate))

    def simulate_all(self, draws: Sequence[Draw], purpose: str) -> Iterator[Batch | SimulationError]:
        """Runs of several draws; one that fails does not end the others."""
        for number, draw in enumerate(draws):
            try:
                yield self.simulate(draw, number, purpose)
            except SimulationError as error:
                yield error

    def screen_factors(self, factors: Sequence[Factor]) -> list[str]:
        """Kinds of factor that change no torque of the model: wear, temperature, payload_mass_error.

        Each is changed by one coded level from the nominal conditions, in a run without noise. They are kept
        in `idle`.
        """
        n = self.model.n
        step = {factor.kind: factor.step for factor in factors}
        changed = {
            "wear": Draw(np.full(n, step.get("wear", 0.0))),
            "temperature": Draw(np.zeros(n), warmth=step.get("temperature", 0.0)),
            "payload_mass_error": Draw(np.zeros(n), payload_error=step.get("payload_mass_error", 0.0) / 100),
        }
        usual = self.simulate(Draw(np.zeros(n)), 0, "idle", noise=False).tau
        idle = []
        for kind, draw in changed.items():
            if kind in step:
                other = self.simulate(draw, 0, "idle", noise=False).tau
                same = len(other) == len(usual) and np.abs(other - usual).max() <= MOVES * np.abs(usual).max()
                if same:
                    idle.append(kind)
        self.idle = idle
        return idle


def _complete_sensors(prepared: Prepared, group: MotionGroup, model: RobotModel) -> tuple[str, RobotModel]:
    """Source of the torque noise in words, and the model with noise and encoder steps filled in."""
    records = {record.file: record for record in prepared.dataset.runs}
    runs = [records[one.file].load() for one in group.nominal]
    sensors = model.sensors.model_dump(exclude_none=True)
    said = "the model"
    if not np.any(model.torque_noise):
        said = "the nominal recordings"
        sensors["torque_noise"] = estimate_torque_noise([run.tau for run in runs])
    if model.sensors.encoder_resolution is None:
        steps = [run.quantum for run in runs if run.quantum is not None]
        sensors["encoder_resolution"] = np.max(steps, axis=0).tolist() if steps else [0.0] * model.n
    sensors["sample_rate"] = prepared.dataset.fields.sample_rate
    return said, model.replace(sensors=sensors)


#: Kinds of run, in the column `kind`.
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
        Simulated runs per motion, without wear and with wear.
    sigma : float
        Standard deviation of the study's nuisances, in coded levels.
    nominal : str
        ``measured`` or ``simulated``: the nominal runs to which the detectors are fitted for the recordings.
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
        Conditions of a simulated run; None for a recording.
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
        Unit of y, by joint and detector.
    idle : dict of str to list of str
        Kinds of factor that change no torque of the model, by motion.
    noise_from : str
        Source of the simulated torque noise.
    joints : list of str
        Tested joints: those that move.
    model : str
        Name of the model.
    events : list of dict
        Short events, as ``verdict.json`` has them, whose torque is taken out of the recordings.
    detectors : dict of str to str
        Reference (built-in name or file) of each detector, by its name.
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
        Factors of the study, whose nuisances scatter in the simulated runs.
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
            if kind == "begin":  # sent again when a killed process is started anew
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
        Where the data set breaks the format, or nothing in it can be judged.
    """
    sort_recordings(prepare(read_measured(dataset)))


@dataclass(frozen=True)
class _Work:
    """All simulations and questions to detectors as a generator, which may run in its own process."""

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
        """Fit the detectors to one motion's nominal runs, and yield their answers; see `ask_all`."""
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
        # Each nominal recording is judged by detectors fitted to the others. For a fair comparison, one
        # nominal simulated run is left out too.
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
                            "Correct the model, or raise max_failed_share."
                        )
                    continue
                yield ask(kind, str(number), None, draws[number], panel, batch)
                if kind == UNWORN and fewer is not panel and number < _COMPARED:
                    yield ask(COMPARED, str(number), None, draws[number], fewer, batch)
                if number % 50 == 49:
                    yield "say", f"{group.name}: {number + 1}/{len(draws)} {kind.replace('_', ' ')} runs"


__all__ = ["OK", "Asked", "Setting", "Tested", "ask_recordings", "check_recordings"]
