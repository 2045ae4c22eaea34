"""Checks before a study is simulated: motions that a robot cannot do, and factors that change no torque."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pandas as pd

from wearscope.cycles.base import Cycle, Reference, check_reference, find_coarse_step, required_torque
from wearscope.errors import InputError, SelfTestError, SimulationError, tell_error
from wearscope.robots.model import RobotModel, check_effects, check_temperature
from wearscope.robots.numbers import SAMPLE_RATE, Number, find_number, is_detectors, set_numbers
from wearscope.robots.spatial import Array
from wearscope.simulation.chunk import DEFAULT_DWELL
from wearscope.simulation.sensors import check_rate, find_stride
from wearscope.simulation.study import Conditions, simulate_point, simulate_points

#: Length of the beginning of a test-cycle that `check_start` simulates [s].
START = 0.1

#: Kind and natural range (kind, low, high) by factor.
Ranges = Mapping[str, tuple[str, float, float]]


def check_robot(model: RobotModel, ranges: Ranges, step: float, sample_rate: float | None = None) -> None:
    """Refuse factor ranges that lie outside what a robot's model covers.

    Parameters
    ----------
    model : RobotModel
    ranges : mapping of str to (kind, low, high)
        Natural range by factor.
    step : float
        Step of the simulation [s].
    sample_rate : float, optional
        [Hz]; that of the robot's sensors by default.

    Raises
    ------
    InputError
        Where a joint's friction law does not cover a temperature, a wear level or delay is negative, a wear
        factor has no joint, a mass error leaves no positive mass, an effect is wrong, or the sampling
        interval is no whole number of steps.
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
    """Refuse a level of a robot's number that makes its effects or its sample rate wrong."""
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
    """Refuse a test-cycle that one model cannot follow; return its duration at the longest dwell [s]."""
    of_kind: dict[str, list[float]] = {}
    for kind, low, high in ranges.values():
        of_kind.setdefault(kind, []).extend((low, high))
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
            of_kind.get("temperature", (Conditions.temperature,)),
            max(of_kind.get("wear", (0.0,))),
            error,
        )
        duration = float(reference.t[-1])
    return duration


def check_start(
    model: RobotModel, cycle: Cycle, label: str, step: float, sample_rate: float | None = None
) -> None:
    """Refuse a robot whose simulation fails within the first tenth of a second.

    This runs PyBullet's self-test with the robot (`wearscope.simulation.world.prove_world`). It also compiles
    the step once for the jobs that follow: two of them at the same time would each compile it.

    Parameters
    ----------
    model : RobotModel
    cycle : Cycle
    label : str
        What messages call the test-cycle.
    step : float
        Step of the simulation [s].
    sample_rate : float, optional
        [Hz]; that of the robot's sensors by default.

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


#: A change of torque below this share of the joint's largest torque is a rounding error.
ROUNDING = 1e-9
#: The screening samples a motion at least this many steps of the simulation apart, to save time.
STRIDE = 5

#: What a user can do where a factor of a kind changes no torque.
REMEDIES = {
    "wear": "give the joint that it wears an effect that depends on wear (carry_over does), drop the factor "
    "from the study",
    "temperature": "give the joints an effect that depends on temperature (carry_over does), drop the factor "
    "from the study",
    "dwell": "add a test-cycle that pauses between moves, drop the factor from the study",
    "payload_mass_error": "declare the payload in the robot's model, drop the factor from the study",
}


def screen_factors(
    model: RobotModel, cycles: Mapping[str, Cycle], ranges: Ranges, step: float
) -> pd.DataFrame:
    """Find for each factor the largest change of a joint's torque between the ends of the factor's range.

    The torque comes from inverse dynamics along the test-cycles' reference motions, which every recording
    follows: rigid body with the true payload, rotors and the model's effects. For a number of the robot both
    ends are simulated instead, and a change of any recorded signal counts. A detector's number changes no
    recording: its change is NaN, and it passes the screening. A factor that one test-cycle shows is not
    computed for the test-cycles that follow.

    Parameters
    ----------
    model : RobotModel
    cycles : mapping of str to Cycle
    ranges : mapping of str to (kind, low, high)
        Natural range by factor, in the design's order.
    step : float
        Step of the simulation [s].

    Returns
    -------
    DataFrame
        ``factor``, ``kind``, ``change`` (at the joint where it is largest, over that joint's largest torque),
        ``joint``, ``cycle`` (the first that shows the factor; empty where none does), ``moves`` (whether the
        change exceeds rounding errors).
    """
    found: dict[str, tuple[float, str, str]] = {name: (0.0, "", "") for name in ranges}
    for label, cycle in cycles.items():
        references = {}
        for name, (kind, low, high) in ranges.items():
            if is_detectors(kind):
                found[name] = np.nan, "", ""
            if not found[name][0] <= ROUNDING:
                continue
            number = find_number(kind)
            if number is not None:
                change, joint = _recorded_change(model, cycle, step, number, (low, high))
                if change > found[name][0]:
                    found[name] = change, model.joints[joint], label
                continue
            for dwell in (low / 1000.0, high / 1000.0) if kind == "dwell" else (DEFAULT_DWELL,):
                if dwell not in references:
                    coarse = max(STRIDE * step, 0.5 * find_coarse_step(model))
                    references[dwell] = cycle.build(model, dwell, coarse)
            change, joint = _largest_change(model, references, name, ranges)
            if change > found[name][0]:
                found[name] = change, model.joints[joint], label
    return pd.DataFrame(
        [
            {
                "factor": name,
                "kind": ranges[name][0],
                "change": change,
                "joint": joint,
                "cycle": label,
                "moves": not change <= ROUNDING,
            }
            for name, (change, joint, label) in found.items()
        ]
    )


def check_screening(
    screening: pd.DataFrame, robot: str, tested: Sequence[str], on_idle: Literal["refuse", "drop"] = "refuse"
) -> pd.DataFrame:
    """Refuse a factor that changes no torque, or mark it as dropped.

    Parameters
    ----------
    screening : DataFrame
        From `screen_factors`.
    robot : str
        Name of the robot in tables.
    tested : sequence of str
        Factors that are the fault of a tested axis; these cannot be dropped.
    on_idle : {"refuse", "drop"}

    Returns
    -------
    DataFrame
        With ``robot`` and ``dropped``.

    Raises
    ------
    InputError
        Where a factor changes no torque and cannot be dropped, or `on_idle` is ``"refuse"``.
    """
    for row in screening.itertuples():
        if row.moves or (on_idle == "drop" and row.factor not in tested):
            continue
        remedy = REMEDIES.get(
            str(row.kind), "widen its range, name another number, drop the factor from the study"
        )
        remedy += "." if row.factor in tested else ", or set 'screening: drop'."
        number = find_number(str(row.kind))
        what = str(row.kind).replace("_", " ") if number is None else number.path
        raise InputError(
            f"factors.{row.factor}: {what} moves no recorded torque of robot "
            f"'{robot}', so every answer about it would be about noise; {remedy}"
        )
    return screening.assign(robot=robot, dropped=~screening["moves"])


def _largest_change(
    model: RobotModel, references: Mapping[float, Reference], name: str, ranges: Ranges
) -> tuple[float, int]:
    """Return the largest relative change of torque between a factor's ends, and the joint's index."""
    kind, low, high = ranges[name]
    torques = []
    for level in (low, high):
        reference = references[level / 1000.0 if kind == "dwell" else DEFAULT_DWELL]
        temperature, wear, error = Conditions.temperature, np.zeros(model.n), 0.0
        if kind == "wear":
            worn = [factor for factor, (k, _, _) in ranges.items() if k == "wear"].index(name)
            wear[model.joints.index(model.wear_joints[worn])] = level
        elif kind == "temperature":
            temperature = level
        elif kind == "payload_mass_error":
            error = level / 100.0
        torques.append(required_torque(reference, model, temperature, wear, 1.0 / (1.0 + error)))
    return _compare(torques[:1], torques[1:])


def _recorded_change(
    model: RobotModel, cycle: Cycle, step: float, number: Number, levels: tuple[float, float]
) -> tuple[float, int]:
    """Return the largest relative change of a recorded signal between two levels, and the joint's index."""
    runs = []
    for level in levels:
        numbers = ((number, level),)
        planned = set_numbers(model, numbers) if number.sets_motion else model
        reference = cycle.build(planned, DEFAULT_DWELL, step)
        try:
            run = simulate_point(
                model, reference, Conditions(numbers=numbers), seed=0, sample_rate=1.0 / step
            )
        except SimulationError as error:
            unit = " %" if number.relative else ""
            raise InputError(
                f"{number.path}: at {level:g}{unit}, robot '{model.name}' cannot be simulated, "
                f"{str(error).rstrip('.')}; narrow the range of the factor."
            ) from error
        runs.append(run)
    return _compare(*([run.q, run.qd, run.tau] for run in runs))


def _compare(first: Sequence[Array], second: Sequence[Array]) -> tuple[float, int]:
    """Return the largest change of signals (N, n) over their largest magnitude, and the joint's index."""
    if len(first[0]) != len(second[0]):  # another duration or rate: every later sample differs
        return 1.0, 0
    changes = []
    for one, other in zip(first, second, strict=True):
        largest = np.maximum(np.abs(one), np.abs(other)).max(axis=0)
        changes.append(np.abs(other - one).max(axis=0) / np.maximum(largest, 1e-300))
    by_joint = np.max(changes, axis=0)
    joint = int(np.argmax(by_joint))
    return float(by_joint[joint]), joint
