"""Simulation of design points: conditions in, recordings out; and of one model along a given motion."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from wearscope.cycles.base import Reference
from wearscope.effects.base import Plant
from wearscope.errors import InputError, SelfTestError, SimulationError, tell_error
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.model import RobotModel, check_temperature
from wearscope.robots.numbers import SAMPLE_RATE, Number, find_number, is_detectors, set_numbers
from wearscope.robots.spatial import Array
from wearscope.simulation.arrays import Law
from wearscope.simulation.plant import build_plant, find_step, make_feedforward, make_law
from wearscope.simulation.recording import Recording
from wearscope.simulation.run import Trace, run_motion
from wearscope.simulation.sensors import find_stride, record
from wearscope.simulation.world import World, prove_world, pybullet

T = TypeVar("T")

#: Number of references (with their controllers) and of payloads that are kept for later points. It covers the
#: levels of a design whose points share them, and bounds the memory where each point has its own.
KEPT = 8
#: Kinds of factor that the simulation knows; the dwell acts through the reference motion.
KINDS = ("wear", "temperature", "dwell", "payload_mass_error")
#: Errors that mean that a run's physics cannot be computed: the point has failed. Any other error, such as a
#: full disk or too little memory, says nothing about the point and ends the job.
PHYSICS_ERRORS = (ArithmeticError, RuntimeError, ValueError, pybullet.error)
#: Numbers of a robot's model that a run changes, each with its new value.
Numbers = tuple[tuple[Number, float], ...]


@dataclass(frozen=True)
class Conditions:
    """Conditions of a design point, apart from its reference motion.

    Attributes
    ----------
    wear : tuple of float
        Wear index f of eq. (17) of each wearing joint [-], in the order of `RobotModel.wear_joints`; joints
        beyond its end have no wear.
    temperature : float
        Of all joints [deg C].
    payload_mass_error : float
        Error of the declared mass relative to the true mass [-]: the robot carries
        ``declared / (1 + error)``, and the controller uses the declared payload.
    numbers : tuple of (Number, float)
        Numbers of the robot whose true value differs from its model. The controller uses the model's value,
        except for the numbers of `wearscope.robots.numbers.KNOWN`, whose true value it knows.
    """

    wear: tuple[float, ...] = ()
    temperature: float = 50.0
    payload_mass_error: float = 0.0
    numbers: Numbers = ()


def make_conditions(levels: Mapping[str, float], kinds: Mapping[str, str]) -> Conditions:
    """Return the conditions that natural factor levels describe.

    Parameters
    ----------
    levels : mapping of str to float
        Natural level by factor, in the order of the factors: the k-th wear factor is the wear of the k-th
        wearing joint. Temperature in deg C, payload mass error in % of the correct mass.
    kinds : mapping of str to str
        Kind by factor: wear, temperature, payload_mass_error, or the path of a number of the robot. Dwell and
        a detector's numbers are ignored: they do not act through the conditions.

    Raises
    ------
    InputError
        Where a kind is unknown.
    """
    wear, temperature, error = [], 50.0, 0.0
    numbers = []
    for name, level in levels.items():
        kind = kinds[name]
        number = find_number(kind)
        if number is not None:
            numbers.append((number, float(level)))
        elif kind == "wear":
            wear.append(float(level))
        elif kind == "temperature":
            temperature = float(level)
        elif kind == "payload_mass_error":
            error = float(level) / 100.0
        elif kind != "dwell" and not is_detectors(kind):
            raise InputError(
                f"factor '{name}': the simulation knows no kind '{kind}'; use one of {', '.join(KINDS)}, or "
                "the path of a number."
            )
    return Conditions(tuple(wear), temperature, error, tuple(numbers))


def _keep(kept: dict, key: object, value: T) -> T:
    """Store a value and return it; beyond `KEPT` values the oldest is dropped."""
    kept[key] = value
    if len(kept) > KEPT:
        del kept[next(iter(kept))]
    return value


@dataclass(frozen=True)
class Machine:
    """The true robot of one point, with the payload that its model declares.

    Attributes
    ----------
    model : RobotModel
    plant : Plant
    body : RigidBody
        With the payload that the model declares.
    """

    model: RobotModel
    plant: Plant
    body: RigidBody


class Simulator:
    """A robot with its controller that runs design points; use it as a context manager.

    Parameters
    ----------
    model : RobotModel
        Its payload is the declared one.
    sample_rate : float, optional
        [Hz]; that of the model's sensors by default.

    Notes
    -----
    PyBullet's robot is built anew for each run, so that a recording does not depend on the runs before it.
    """

    def __init__(self, model: RobotModel, sample_rate: float | None = None) -> None:
        self.model = model
        self.sample_rate = model.sensors.sample_rate if sample_rate is None else sample_rate
        self.plant: Plant = build_plant(model)
        self.declared: RigidBody = model.rigid_body(model.declared_payload)
        self.world = World()
        self._proven: set[float] = set()
        self._laws: dict[tuple, tuple[Reference, Law, float]] = {}
        self._bodies: dict[float, RigidBody] = {}

    def __enter__(self) -> "Simulator":
        return self

    def __exit__(self, *_: object) -> None:
        self.world.close()

    def renew_world(self) -> None:
        """Replace the PyBullet client after a run that ended in an error."""
        self.world.close()
        self.world = World()

    def _law(self, reference: Reference, numbers: Numbers = ()) -> tuple[Law, float]:
        """Return the controller along a reference, and the step [s]."""
        # Points of equal dwell share their reference. Its feed-forward costs a tenth of a run, so it is kept.
        known = tuple(one for one in numbers if one[0].is_known)
        kept = self._laws.get((id(reference), known))
        if kept is None:
            _check_reference(reference, self.model)
            dt = find_step(reference.t)
            feedforward = make_feedforward(self.model, self.declared, self.plant, reference)
            believed = set_numbers(self.model, known)
            law = make_law(
                believed,
                reference,
                feedforward,
                self.declared,
                self.plant.armature,
                believed.torque_limit,
            )
            kept = _keep(self._laws, (id(reference), known), (reference, law, dt))
        return kept[1:]

    def rate(self, machine: Machine, numbers: Numbers, dt: float) -> float:
        """Return the sample rate [Hz].

        Unless a factor sets the rate, the sampling interval must be a whole number of steps.
        """
        if any(number.path == SAMPLE_RATE for number, _ in numbers):
            return machine.model.sensors.sample_rate
        find_stride(dt, self.sample_rate)
        return self.sample_rate

    def machine(self, numbers: Numbers) -> Machine:
        """Return the true robot: that of the model, with the given numbers changed."""
        if not numbers:
            return Machine(self.model, self.plant, self.declared)
        model = set_numbers(self.model, numbers)
        return Machine(model, build_plant(model), model.rigid_body(model.declared_payload))

    def body(self, payload_mass_error: float, machine: Machine | None = None) -> RigidBody:
        """Return the bodies with the true payload, whose mass is ``declared / (1 + payload_mass_error)``."""
        machine = machine or self.machine(())
        payload = machine.model.declared_payload
        if payload_mass_error == 0.0 or payload is None:
            return machine.body
        if not payload_mass_error > -1.0:
            raise InputError(
                f"payload_mass_error = {payload_mass_error:g}: a mass declared {payload_mass_error:.0%} off "
                "the correct one is none; use a level above -100 %."
            )
        own = machine.body is self.declared
        if own and payload_mass_error in self._bodies:
            return self._bodies[payload_mass_error]
        body = machine.body.with_payload(payload.scaled(1.0 / (1.0 + payload_mass_error)))
        if own:
            _keep(self._bodies, payload_mass_error, body)
        return body

    def wear(self, levels: Sequence[float]) -> Array:
        """Return the wear (n,) of all joints from the levels of the wearing joints."""
        joints = self.model.wear_joints
        if len(levels) > len(joints):
            raise InputError(
                f"robot '{self.model.name}': {len(levels)} wear levels for its {len(joints)} wearing joints "
                f"({', '.join(joints)}); list more under wear_axes or drop a wear factor."
            )
        wear = np.zeros(self.model.n)
        for name, level in zip(joints, levels, strict=False):
            wear[self.model.joints.index(name)] = level
        return wear

    def run(
        self,
        reference: Reference,
        conditions: Conditions,
        seed: int | np.random.SeedSequence | None,
    ) -> Recording:
        """Simulate and record one point.

        Parameters
        ----------
        reference : Reference
            One sample for each step.
        conditions : Conditions
        seed : int or SeedSequence or None
            Seed of the sensor noise, see `wearscope.simulation.sensors.seed_of`; None records without noise.

        Raises
        ------
        InputError
            Where reference or conditions do not fit the robot.
        SimulationError
            Where the run fails (see `wearscope.simulation.run.run_motion`), a joint leaves its limits, or a
            recorded value is not finite.
        """
        machine = self.machine(conditions.numbers)
        model, plant = machine.model, machine.plant
        law, dt = self._law(reference, conditions.numbers)
        rate = self.rate(machine, conditions.numbers, dt)
        check_temperature(model, conditions.temperature)
        wear = self.wear(conditions.wear)
        body = self.body(conditions.payload_mass_error, machine)
        if dt not in self._proven:
            prove_world(self.world, self.declared, dt)
            self._proven.add(dt)
        trace = run_motion(
            self.world,
            body,
            plant,
            law,
            dt,
            conditions.temperature,
            wear,
            (reference.q[0], reference.v[0]),
            float(reference.t[0]),
        )
        lower, upper = model.position_limits
        outside = (trace.q < lower) | (trace.q > upper)
        if np.any(outside):
            row, j = (int(k) for k in np.argwhere(outside)[0])
            raise SimulationError(
                f"joint '{model.joints[j]}' leaves its limits {lower[j]:g} to {upper[j]:g} at "
                f"t = {row * dt:.3f} s."
            )
        recording = record(
            trace,
            dt,
            rate,
            model.encoder_resolution,
            model.torque_noise,
            plant.torque_gain,
            plant.torque_delay,
            seed,
        )
        for name in ("q", "qd", "tau"):
            finite = np.isfinite(getattr(recording, name))
            if not finite.all():
                first = finite.all(axis=1).argmin()
                raise SimulationError(f"the recorded {name} is not finite at t = {recording.t[first]:.3f} s.")
        return recording


def _check_reference(reference: Reference, model: RobotModel) -> None:
    """Refuse a reference whose arrays have the wrong shape or are not finite."""
    shape = (len(reference.t), model.n)
    for key in ("q", "v", "a"):
        values = np.asarray(getattr(reference, key))
        if values.shape != shape or not np.all(np.isfinite(values)):
            raise InputError(
                f"robot '{model.name}': the reference's {key} has the shape {values.shape}, not {shape}, or "
                "is not finite; correct the test-cycle."
            )


def simulate_point(
    model: RobotModel,
    reference: Reference,
    conditions: Conditions | None = None,
    seed: int | np.random.SeedSequence | None = None,
    sample_rate: float | None = None,
) -> Recording:
    """Simulate and record one design point; see `Simulator` and `Simulator.run`."""
    with Simulator(model, sample_rate) as simulator:
        return simulator.run(reference, conditions or Conditions(), seed)


def simulate_points(
    model: RobotModel,
    points: Iterable[tuple[Reference, Conditions, int | np.random.SeedSequence | None]],
    sample_rate: float | None = None,
) -> Iterator[Recording | SimulationError]:
    """Simulate a chunk of design points; each result is byte for byte that of `simulate_point`.

    Parameters
    ----------
    model : RobotModel
    points : iterable of (Reference, Conditions, seed)
        Points that share a reference should share the object, so that its torque is computed once.
    sample_rate : float, optional

    Yields
    ------
    Recording or SimulationError
        One for each point, in the order of `points`; the points after a failed run are still simulated.

    Raises
    ------
    InputError
        Where a point does not fit the robot.
    SelfTestError
        Where PyBullet fails its self-test with this robot.
    """
    with Simulator(model, sample_rate) as simulator:
        for reference, conditions, seed in points:
            yield _run_or_fail(simulator, reference, conditions, seed)


def _run_or_fail(
    simulator: Simulator,
    reference: Reference,
    conditions: Conditions,
    seed: int | np.random.SeedSequence | None,
) -> Recording | SimulationError:
    """Run one point; return the error where its physics cannot be computed."""
    try:
        return simulator.run(reference, conditions, seed)
    except (InputError, SelfTestError):
        raise
    except SimulationError as error:
        return error
    except PHYSICS_ERRORS as error:
        simulator.renew_world()
        return SimulationError(tell_error(error))


#: Longest step of a forward simulation [s].
LONGEST_STEP = 1e-3


def refine_reference(reference: Reference, longest: float = LONGEST_STEP) -> Reference:
    """Return the reference with its step divided by a whole number, so that it is at most `longest` [s].

    Between two samples the motion is the quintic polynomial through their positions, speeds and
    accelerations.
    """
    dt = find_step(reference.t)
    parts = int(np.ceil(dt / longest - 1e-9))
    if parts <= 1:
        return reference
    s = np.arange(parts) / parts
    powers = np.stack([s**k for k in range(6)])
    # Columns: position, dt speed, dt^2 acceleration at the start, then at the end, of a quintic on [0, 1].
    quintic = np.array(
        [
            [1, 0, 0, 0, 0, 0],
            [0, 1, 0, 0, 0, 0],
            [0, 0, 0.5, 0, 0, 0],
            [-10, -6, -1.5, 10, -4, 0.5],
            [15, 8, 1.5, -15, 7, -1],
            [-6, -3, -0.5, 6, -3, 0.5],
        ]
    )
    first = np.stack([np.zeros_like(s) if k < 1 else k * s ** (k - 1) for k in range(6)])
    second = np.stack([np.zeros_like(s) if k < 2 else k * (k - 1) * s ** (k - 2) for k in range(6)])
    q, v, a = (np.asarray(x, dtype=float) for x in (reference.q, reference.v, reference.a))
    ends = np.stack([q[:-1], dt * v[:-1], dt**2 * a[:-1], q[1:], dt * v[1:], dt**2 * a[1:]])
    coefficients = np.einsum("kc,cij->kij", quintic, ends)

    def sample(basis: Array, scale: float, last: Array) -> Array:
        inner = np.einsum("ks,kij->isj", basis, coefficients).reshape(-1, q.shape[1]) / scale
        return np.vstack([inner, last])

    t = reference.t[0] + dt / parts * np.arange(parts * (len(q) - 1) + 1)
    return Reference(t, sample(powers, 1.0, q[-1:]), sample(first, dt, v[-1:]), sample(second, dt**2, a[-1:]))


def simulate_forward(
    model: RobotModel,
    reference: Reference,
    declared: RobotModel | None = None,
    temperature: Array | float = 50.0,
    controller_temperature: Array | float = 50.0,
    feedforward: Array | None = None,
) -> Recording:
    """Simulate a model forward along a reference motion.

    Parameters
    ----------
    model : RobotModel
        The robot that moves, with its effects and its payload. Any joints, revolute or prismatic.
    reference : Reference
        Motion to follow, e.g. a measured one with its derivatives; evenly sampled.
    declared : RobotModel, optional
        Model from which the controller's feed-forward and gains are computed; `model` by default. To compare
        two models under the same controller, give the same `declared` for both.
    temperature : array (N, n), (n,) or float
        Joint temperature [deg C]; (N, n) has one row for each sample of the reference. It may be NaN only
        where no effect of the model depends on temperature.
    controller_temperature : array (n,) or float
        Joint temperature that the controller assumes [deg C].
    feedforward : array (N, n), optional
        Motor torque at the reference's samples to feed forward instead of that of `declared`, e.g. a measured
        torque; the deviation from the reference then shows what the model lacks.

    Returns
    -------
    Recording
        At the rate of the reference, without noise and encoder steps.

    Raises
    ------
    InputError
        Where reference, models and conditions do not fit together.
    SimulationError
        Where the run fails.
    """
    trace, dt = trace_forward(
        model,
        reference,
        declared,
        temperature,
        controller_temperature=controller_temperature,
        feedforward=feedforward,
    )
    rate = 1.0 / find_step(reference.t)
    plant = build_plant(model)
    exact = np.zeros(model.n)
    return record(trace, dt, rate, exact, exact, plant.torque_gain, plant.torque_delay, None)


def trace_forward(
    model: RobotModel,
    reference: Reference,
    declared: RobotModel | None = None,
    temperature: Array | float = 50.0,
    wear: Array | float = 0.0,
    controller_temperature: Array | float = 50.0,
    longest_step: float = LONGEST_STEP,
    feedforward: Array | None = None,
    by_effect: bool = False,
    feedback: bool = True,
) -> tuple[Trace, float]:
    """Simulate as `simulate_forward` does, and return the run before the sensors, and its step [s].

    The step is that of the reference, divided by a whole number until it is at most `longest_step` [s]. The
    wear is (N, n) with one row for each sample of the reference, (n,) or a number. With `by_effect` the trace
    also splits the torque for PyBullet into its parts. Without `feedback` the motors give only the torque fed
    forward.
    """
    declared = model if declared is None else declared
    if declared.joints != model.joints:
        raise InputError(
            f"models '{model.name}' and '{declared.name}' have different joints; the controller must know "
            "the same robot."
        )
    fine = refine_reference(reference, longest_step)
    dt = find_step(fine.t)
    body, plant = model.rigid_body(model.declared_payload), build_plant(model)
    known_body, known_plant = declared.rigid_body(declared.declared_payload), build_plant(declared)
    if feedforward is None:
        feedforward = make_feedforward(declared, known_body, known_plant, fine, True, controller_temperature)
    else:
        given = np.asarray(feedforward, dtype=float)
        feedforward = np.column_stack([np.interp(fine.t, reference.t, torque) for torque in given.T])
    law = make_law(declared, fine, feedforward, known_body, known_plant.armature, model.torque_limit)
    if not feedback:
        law = law._replace(stiffness=np.zeros(model.n), damping=np.zeros(model.n))
    parts = (len(fine.t) - 1) // (len(reference.t) - 1)
    repeat = lambda x: np.repeat(x, parts, axis=0) if np.ndim(x) == 2 else x  # noqa: E731
    start = (fine.q[0], fine.v[0])
    with World() as world:
        prove_world(world, body, dt)
        trace = run_motion(
            world, body, plant, law, dt, repeat(temperature), repeat(wear), start, float(fine.t[0]),
            by_effect=by_effect,
        )  # fmt: skip
    return trace, dt
