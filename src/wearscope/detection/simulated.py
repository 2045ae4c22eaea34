"""Runs of the corrected model along a recorded motion, recorded and prepared as the machine's are."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import qmc

from wearscope.closed_loop.diagnostics.forward import with_payload
from wearscope.closed_loop.intake.filtering import decimate, differentiate_run
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.recording import Run, estimate_quantum
from wearscope.cycles.base import Reference
from wearscope.designs.factors import CODED_HIGH, CODED_LOW, FAULT, Factor
from wearscope.designs.kinds import generator_for, seed_for
from wearscope.detection.recordings import MotionGroup, Recorded, cut_rests, estimate_torque_noise
from wearscope.detectors.base import Array, Batch
from wearscope.errors import InputError, SimulationError
from wearscope.robots.model import RobotModel
from wearscope.simulation.forward import LONGEST_STEP, trace_forward
from wearscope.simulation.plant import build_plant
from wearscope.simulation.run import Trace
from wearscope.simulation.sensors import record

#: Assumed where no temperature is recorded [deg C].
USUAL_TEMPERATURE = 50.0
#: A factor counts as moving a torque where it changes the torque by more than this share of its largest
#: magnitude.
MOVES = 1e-9


@dataclass(frozen=True)
class Draw:
    """What one simulated run is simulated with.

    Attributes
    ----------
    wear : ndarray (n,)
        Level f of each joint [-].
    warmth : float
        Temperature beyond that of the nominal recordings [K].
    payload_error : float
        Error of the declared payload mass, relative to the correct one [-].
    """

    wear: Array
    warmth: float = 0.0
    payload_error: float = 0.0


def draw_runs(
    factors: Sequence[Factor], n: int, unworn: int, worn: int, sigma: float, seed: int
) -> tuple[list[Draw], list[Draw]]:
    """Conditions of runs without wear and with wear, nuisances scattered as the study has them.

    Parameters
    ----------
    factors : sequence of Factor
        Of the study; the point-to-point delay is part of the recorded motion and is left out.
    n : int
        Number of joints.
    unworn, worn : int
        Number of runs. Wear is spread over the fault's range as a Latin hypercube, each joint on its own.
    sigma : float
        Standard deviation of every nuisance, coded, held within -2..2.
    seed : int

    Returns
    -------
    unworn, worn : list of Draw
    """
    fault = next(factor for factor in factors if factor.name == FAULT)
    top = max(fault.high, 0.0)
    levels = qmc.LatinHypercube(n, rng=generator_for(seed, "detect", "wear")).random(worn) * top
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
    """The corrected model along a recorded motion.

    Parameters
    ----------
    prepared : Prepared
    group : MotionGroup
        Its nominal recordings give motion and temperatures, in turn.
    model : RobotModel
        Where it states no torque noise or encoder step, those of the nominal recordings are taken.
    seed : int

    Attributes
    ----------
    idle : list of str
        Kinds of factor that are known to move no torque, from `screen_factors`.
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
        # A whole number of steps a sample, none longer than the simulator takes.
        self.step = 1.0 / (self.rate * np.ceil(1.0 / (self.rate * LONGEST_STEP) - 1e-9))
        self._plain: dict[int, tuple[Trace, float]] = {}
        self.idle: list[str] = []

    def reference(self, recorded: Recorded) -> Reference:
        """Motion of a recording, as filtered."""
        s = recorded.run.signals
        return Reference(np.arange(len(s.t)) / self.band.rate, s.q, s.v, s.a)

    def simulate(self, draw: Draw, number: int, purpose: str, noise: bool = True) -> Batch:
        """One run, along the motion of a nominal recording at its temperature and the draw's beyond.

        Parameters
        ----------
        draw : Draw
        number : int
            Of the run; nominal recordings are taken in turn.
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
        """Run of a draw before the sensors; runs that differ by their noise only are simulated once."""
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
        made = trace_forward(
            model,
            self.reference(recorded),
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
        """Kinds of factor that move no torque of the model: wear, temperature, payload_mass_error.

        Each is changed by a coded unit from the nominal conditions, in a run without noise. They are kept in
        `idle`.
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
    """Where the torque noise comes from, and the model with noise and encoder steps filled in."""
    records = {record.file: record for record in prepared.dataset.runs}
    runs = [records[one.file].load() for one in group.nominal]
    sensors = model.sensors.model_dump(exclude_none=True)
    said = "the model"
    if not np.any(model.torque_noise):
        said = "the nominal recordings"
        sensors["torque_noise"] = estimate_torque_noise([run.tau for run in runs]).tolist()
    if model.sensors.encoder_resolution is None:
        steps = [run.quantum for run in runs if run.quantum is not None]
        sensors["encoder_resolution"] = np.max(steps, axis=0).tolist() if steps else [0.0] * model.n
    sensors["sample_rate"] = prepared.dataset.fields.sample_rate
    return said, model.replace(sensors=sensors)
