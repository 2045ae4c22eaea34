"""Which factors move a robot's torque at all, found before anything is simulated."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pandas as pd

from wearscope.cycles.base import Cycle, Reference, find_coarse_step, required_torque
from wearscope.errors import InputError, SimulationError
from wearscope.robots.model import RobotModel
from wearscope.robots.numbers import Number, find_number, is_detectors, set_numbers
from wearscope.robots.spatial import Array
from wearscope.simulation.chunk import DEFAULT_DWELL
from wearscope.simulation.feasibility import Ranges
from wearscope.simulation.study import Conditions, simulate_point

#: A change of torque below this share of the joint's largest torque is rounding.
ROUNDING = 1e-9
#: The torque is computed at every fifth sample.
STRIDE = 5

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
    """Largest change of any joint's torque between the ends of each factor's range.

    The torque is that of inverse dynamics along the test-cycles' reference motions, which every recording
    follows: rigid body with the true payload, rotors and the model's effects. For a number of the robot both
    ends are simulated, and all that is recorded counts. A detector's number moves no recording: its change is
    NaN, and it counts as one that moves.

    Parameters
    ----------
    model : RobotModel
    cycles : mapping of str to Cycle
    ranges : mapping of str to (kind, low, high)
        Natural range by factor, in the design's order.
    step : float
        [s]

    Returns
    -------
    DataFrame
        ``factor``, ``kind``, ``change`` (of the joint where it is largest, over that joint's largest torque),
        ``joint``, ``cycle`` (that shows it; empty where none does), ``moves``.
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
    """Refuse a factor that moves no torque, or mark it as dropped.

    Parameters
    ----------
    screening : DataFrame
        From `screen_factors`.
    robot : str
        As tables call it.
    tested : sequence of str
        Factors that are the fault of a tested axis, which cannot be dropped.
    on_idle : {"refuse", "drop"}

    Returns
    -------
    DataFrame
        With ``robot`` and ``dropped``.

    Raises
    ------
    InputError
        Naming robot and factor, and what to do.
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
    """Change of torque over the largest torque, and the joint where it is largest."""
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
    """Change of what is recorded over its largest magnitude, and the joint where it is largest."""
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
    """Largest change of signals (N, n) over their largest magnitude, and the joint where it is largest."""
    if len(first[0]) != len(second[0]):  # the duration or rate changes, so that every later sample does
        return 1.0, 0
    changes = []
    for one, other in zip(first, second, strict=True):
        largest = np.maximum(np.abs(one), np.abs(other)).max(axis=0)
        changes.append(np.abs(other - one).max(axis=0) / np.maximum(largest, 1e-300))
    by_joint = np.max(changes, axis=0)
    joint = int(np.argmax(by_joint))
    return float(by_joint[joint]), joint
