"""Which factors move a robot's torque at all, found before anything is simulated."""

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pandas as pd

from wearscope.cycles.base import Cycle, Reference, required_torque
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array
from wearscope.simulation.chunk import DEFAULT_DWELL
from wearscope.simulation.feasibility import Ranges
from wearscope.simulation.study import Conditions

#: Change of torque, over the largest torque of the joint, below which it is rounding.
ROUNDING = 1e-9
#: The torque is looked at along one sample of so many.
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
    follows: rigid body with the true payload, rotors and the model's effects.

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
            if found[name][0] > ROUNDING:
                continue
            for dwell in (low / 1000.0, high / 1000.0) if kind == "dwell" else (DEFAULT_DWELL,):
                if dwell not in references:
                    references[dwell] = _thin(cycle.build(model, dwell, step))
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
                "moves": change > ROUNDING,
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
        remedy = REMEDIES[str(row.kind)]
        remedy += "." if row.factor in tested else ", or set 'screening: drop'."
        raise InputError(
            f"factors.{row.factor}: {str(row.kind).replace('_', ' ')} moves no recorded torque of robot "
            f"'{robot}', so every answer about it would be about noise; {remedy}"
        )
    return screening.assign(robot=robot, dropped=~screening["moves"])


def drop_idle(table: pd.DataFrame, screening: pd.DataFrame, column: str) -> pd.DataFrame:
    """Rows of a table by robot without those about factors that were dropped there.

    Parameters
    ----------
    table : DataFrame
        With ``robot`` and `column`.
    screening : DataFrame
        ``robot``, ``factor``, ``dropped``.
    column : str
        Holds a factor, or a term of factors (``w3``, ``f:w3``, ``w3^2``).
    """
    dropped = {(row.robot, row.factor) for row in screening[screening["dropped"]].itertuples()}
    if not dropped:
        return table
    kept = [
        not any((robot, part.partition("^")[0]) in dropped for part in term.split(":"))
        for robot, term in zip(table["robot"], table[column].astype(str), strict=True)
    ]
    return table[kept].reset_index(drop=True)


def _thin(reference: Reference) -> Reference:
    rows = slice(None, None, STRIDE)
    return Reference(reference.t[rows], reference.q[rows], reference.v[rows], reference.a[rows])


def _largest_change(
    model: RobotModel, references: Mapping[float, Reference], name: str, ranges: Ranges
) -> tuple[float, int]:
    """Change of torque over the largest torque, and the joint where it is largest."""
    kind, low, high = ranges[name]
    if kind == "dwell":
        first, second = (references[level / 1000.0] for level in (low, high))
        if len(first.t) != len(second.t):  # another duration: every later sample is another one
            return 1.0, 0
        torques = [_torque(model, one) for one in (first, second)]
    else:
        reference = references[DEFAULT_DWELL]
        torques = []
        for level in (low, high):
            if kind == "wear":
                wear = np.zeros(model.n)
                worn = [factor for factor, (k, _, _) in ranges.items() if k == "wear"].index(name)
                wear[model.joints.index(model.wear_joints[worn])] = level
                torques.append(_torque(model, reference, wear=wear))
            elif kind == "temperature":
                torques.append(_torque(model, reference, temperature=level))
            else:
                torques.append(_torque(model, reference, error=level / 100.0))
    largest = np.maximum(np.abs(torques).max(axis=(0, 1)), 1e-300)
    change = np.abs(torques[1] - torques[0]).max(axis=0) / largest
    joint = int(np.argmax(change))
    return float(change[joint]), joint


def _torque(
    model: RobotModel,
    reference: Reference,
    temperature: float = Conditions.temperature,
    wear: float | Array = 0.0,
    error: float = 0.0,
) -> Array:
    return required_torque(reference, model, temperature, wear, 1.0 / (1.0 + error))
