"""Refuses a study that its robots cannot do, before anything is simulated."""

from collections.abc import Mapping

from wearscope.cycles.base import Cycle, Reference, check_reference
from wearscope.errors import InputError, SelfTestError, SimulationError, tell_error
from wearscope.robots.model import RobotModel, check_effects, check_temperature
from wearscope.robots.numbers import SAMPLE_RATE, Number, find_number, set_numbers
from wearscope.simulation.chunk import DEFAULT_DWELL
from wearscope.simulation.sensors import check_rate, find_stride
from wearscope.simulation.study import Conditions, simulate_points

_NOMINAL_TEMPERATURE = 50.0
#: Length of the beginning of a test-cycle that `check_start` simulates [s].
START = 0.1

Ranges = Mapping[str, tuple[str, float, float]]


def check_robot(model: RobotModel, ranges: Ranges, step: float, sample_rate: float | None = None) -> None:
    """Refuse factor ranges that a robot's model does not cover.

    Parameters
    ----------
    model : RobotModel
    ranges : mapping of str to (kind, low, high)
        Natural range by factor.
    step : float
        [s]
    sample_rate : float, optional
        [Hz]; that of the robot's sensors by default.

    Raises
    ------
    InputError
        Where a joint's friction does not hold at a temperature, a wear level is negative, a wear factor has
        no joint, a mass error makes no mass, an effect is wrong, or the sampling interval is no whole number
        of steps.
    """
    check_effects(model)
    find_stride(step, model.sensors.sample_rate if sample_rate is None else sample_rate)
    wear = [name for name, (kind, _, _) in ranges.items() if kind == "wear"]
    if len(wear) > len(model.wear_joints):
        raise InputError(
            f"factors.{wear[-1]}: robot '{model.name}' has {len(model.wear_joints)} joints that wear for "
            f"{len(wear)} factors of kind wear; list more under wear_axes of its model, or drop the factor."
        )
    for name, (kind, low, high) in ranges.items():
        if kind == "wear" and low < 0:
            raise InputError(f"factors.{name}: a wear of {low:g} is none; start the range at 0 or above.")
        if kind == "dwell" and low < 0:
            raise InputError(f"factors.{name}: a delay of {low:g} ms is none; start the range at 0 or above.")
        if kind == "payload_mass_error" and low <= -100:
            raise InputError(f"factors.{name}: {low:g} % leaves no mass; start the range above -100 %.")
        number = find_number(kind)
        try:
            for level in (low, high):
                if kind == "temperature":
                    check_temperature(model, level)
                if number is not None:
                    _check_number(model, number, level, step)
        except InputError as error:
            raise InputError(f"factors.{name}: {error}") from None


def _check_number(model: RobotModel, number: Number, level: float, step: float) -> None:
    changed = set_numbers(model, [(number, level)])
    check_effects(changed)
    if number.path == SAMPLE_RATE:
        check_rate(step, changed.sensors.sample_rate)


def check_cycle(model: RobotModel, cycle: Cycle, label: str, ranges: Ranges, step: float) -> float:
    """Refuse a test-cycle that a robot cannot follow at the ends of the factor ranges.

    Parameters
    ----------
    model : RobotModel
    cycle : Cycle
    label : str
        What messages call the test-cycle.
    ranges : mapping of str to (kind, low, high)
    step : float
        [s]

    Returns
    -------
    float
        Duration at the longest dwell [s].

    Raises
    ------
    InputError
        See `wearscope.cycles.base.check_reference`.
    """
    limits = [
        (number, level)
        for kind, low, high in ranges.values()
        if (number := find_number(kind)) is not None and number.is_known
        for level in (low, high)
    ]
    return max(
        _check_motion(one, cycle, label, ranges, step)
        for one in [model, *(set_numbers(model, [limit]) for limit in limits)]
    )


def _check_motion(model: RobotModel, cycle: Cycle, label: str, ranges: Ranges, step: float) -> float:
    of_kind = {kind: (low, high) for kind, low, high in ranges.values()}
    dwells = sorted({value / 1000.0 for value in of_kind.get("dwell", ())} or {DEFAULT_DWELL})
    # The robot carries declared / (1 + error).
    error = max(abs(1.0 / (1.0 + value / 100.0) - 1.0) for value in of_kind.get("payload_mass_error", (0.0,)))
    duration = 0.0
    for dwell in dwells:
        try:
            reference = cycle.build(model, dwell, step)
        except InputError:
            raise
        except (Exception, SystemExit) as problem:
            raise InputError(
                f"test-cycle '{label}' on robot '{model.name}': build raised "
                f"{tell_error(problem)}; correct the test-cycle."
            ) from problem
        check_reference(
            reference,
            model,
            label,
            of_kind.get("temperature", (_NOMINAL_TEMPERATURE,)),
            of_kind.get("wear", (0.0, 0.0))[1],
            error,
        )
        duration = float(reference.t[-1])
    return duration


def check_start(
    model: RobotModel, cycle: Cycle, label: str, step: float, sample_rate: float | None = None
) -> None:
    """Refuse a robot whose simulation does not even start, by its first tenth of a second.

    This proves PyBullet with the robot (`wearscope.simulation.world.prove_world`). It also leaves the step
    compiled for the jobs that follow: two of them at once would each compile it.

    Parameters
    ----------
    model : RobotModel
    cycle : Cycle
    label : str
        What messages call the test-cycle.
    step : float
        [s]
    sample_rate : float, optional
        [Hz]

    Raises
    ------
    InputError
        Where the self-test or the run fails.
    """
    whole = cycle.build(model, DEFAULT_DWELL, step)
    few = slice(0, max(round(START / step), 2) + 1)
    start = Reference(whole.t[few], whole.q[few], whole.v[few], whole.a[few])
    try:
        (outcome,) = simulate_points(model, [(start, Conditions(), None)], sample_rate)
    except SelfTestError as error:
        outcome = error
    if isinstance(outcome, SimulationError):
        raise InputError(
            f"test-cycle '{label}' on robot '{model.name}': the simulation fails at its start, "
            f"{str(outcome).rstrip('.')}; correct the robot or the test-cycle."
        )
