"""Numbers of a robot by joint, each with its origin: given by the user or the URDF, or assumed.

Acceleration limits that nobody gives are chosen so that the drives can follow every test-cycle.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wearscope.cycles.base import find_coarse_step, list_cycles, load_cycle, required_torque
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel, make_model
from wearscope.robots.spatial import Array


@dataclass(frozen=True)
class Figures:
    """One number for each joint, with its origin.

    Attributes
    ----------
    values : ndarray (n,)
    origins : tuple of str
        For each joint ``given: ...`` or ``assumed: ...``.
    """

    values: Array
    origins: tuple[str, ...]

    @property
    def given(self) -> Array:
        """Whether each value (n,) is given rather than assumed."""
        return np.array([origin.startswith("given") for origin in self.origins])

    def describe(self, joints: Sequence[str]) -> str:
        """Describe the origins in one line; the joints are named where the origins differ."""
        kinds = list(dict.fromkeys(self.origins))
        if len(kinds) == 1:
            return kinds[0]
        pairs = list(zip(joints, self.origins, strict=True))
        names = {kind: [joint for joint, origin in pairs if origin == kind] for kind in kinds}
        return "; ".join(f"{kind} ({', '.join(own)})" for kind, own in names.items())

    def replace(self, values: Array, origin: Callable[[int], str]) -> "Figures":
        """Return new values; a value that changes gets the origin that `origin` returns for its joint."""
        changed = ~np.isclose(values, self.values, rtol=1e-12, atol=0.0)
        origins = [origin(k) if changed[k] else one for k, one in enumerate(self.origins)]
        return Figures(np.asarray(values, dtype=float), tuple(origins))


#: Comparison with 0 that is true for a refused number, by the numbers that the option allows.
_REFUSED = {"0 or above": np.less, "above 0": np.less_equal, "other than 0": np.equal}


def take_option(
    name: str, values: Sequence[float] | None, n: int, allowed: str = "0 or above"
) -> Figures | None:
    """Read the numbers of an option: one for all joints, or one for each joint; None without a number.

    Parameters
    ----------
    name : str
        Name of the option.
    values : sequence of float or None
    n : int
        Number of joints.
    allowed : {"0 or above", "above 0", "other than 0"}

    Raises
    ------
    InputError
        Where there are neither one nor n numbers, or one of them is not finite or not `allowed`.
    """
    if values is None or len(values) == 0:
        return None
    if len(values) not in (1, n):
        raise InputError(f"--{name}: has {len(values)} values for {n} joints; give one, or one a joint.")
    taken = np.array(list(values) * (n if len(values) == 1 else 1), dtype=float)
    wrong = taken[~np.isfinite(taken) | _REFUSED[allowed](taken, 0.0)]
    if wrong.size:
        raise InputError(f"--{name}: holds {wrong[0]:g}; give finite numbers, {allowed}.")
    return Figures(taken, (f"given: --{name}",) * n)


def assume(values: Array, why: str) -> Figures:
    """Return values as assumed figures; `why` tells what the assumption rests on."""
    return Figures(np.asarray(values, dtype=float), (f"assumed: {why}",) * len(values))


def choose(*sources: Figures | None) -> Figures:
    """Return for each joint the number of the first source that has one: a source may be None or hold NaN."""
    there = [source for source in sources if source is not None]
    values, origins = there[-1].values.copy(), list(there[-1].origins)
    for source in reversed(there[:-1]):
        for k in np.flatnonzero(np.isfinite(source.values)):
            values[k], origins[k] = source.values[k], source.origins[k]
    return Figures(values, tuple(origins))


def round_figures(values: Any) -> list[float]:
    """Round each value to six digits, as model files hold them."""
    return [float(f"{value:.6g}") for value in np.asarray(values, dtype=float)]


START_TIME = 0.2  # shortest time from rest to the speed limit [s]
JERK_RATE = 10.0  # jerk limit over acceleration limit [1/s]
# Usual extremes of a study [deg C, -, share]: every test-cycle must stay within the limits there.
TEMPERATURES, WEAR, PAYLOAD_ERROR = (30.0, 70.0), 50.0, 0.12
ROOM = 0.9  # share of the torque limit that a test-cycle may use
SLOWER, SLOWEST = 0.8, 11  # each step reduces the accelerations by this factor; most steps


def fit_to_cycles(
    fields: dict[str, Any],
    text: str,
    figures: dict[str, Figures],
    accelerations: Sequence[float],
    holding: Array,
    inertia: Array,
) -> tuple[RobotModel, list[str]]:
    """Give a model acceleration limits at which every test-cycle stays within the torque limits.

    Parameters
    ----------
    fields : dict
        Content of the model file; this function sets its acceleration, jerk and torque limits.
    text : str
        Normalised URDF.
    figures : dict of str to Figures
        ``acceleration_limit`` is added; ``torque_limit`` is raised where even slow motions need more.
    accelerations : sequence of float
        Limits that the user states; empty where there are none.
    holding, inertia : array (n,)
        Largest torque that holds the arm at rest, and largest inertia of the arm at each joint.

    Returns
    -------
    RobotModel
    list of str
        A sentence for each torque limit that was raised.
    """
    speed, torque = figures["speed_limit"].values, figures["torque_limit"]
    friction = figures["coulomb"].values + figures["viscous"].values * speed
    left = np.maximum(torque.values - holding - friction, 0.2 * torque.values)
    total = inertia + figures["rotor_inertia"].values
    option = take_option("acceleration-limit", accelerations, len(speed), "above 0")
    first = np.minimum(0.7 * left / total, speed / START_TIME) if option is None else option.values
    drive = fields["drive"]
    steps = SLOWEST if option is not None else 0
    limits = first
    while True:
        drive["acceleration_limit"] = round_figures(limits)
        drive["jerk_limit"] = round_figures(JERK_RATE * limits)
        model = make_model(fields, text, fields["name"])
        moving, still = _find_peaks(model)
        over = moving > ROOM * torque.values
        if not np.any(over) or steps == SLOWEST:
            break
        # Along the same path, the torque that motion adds is proportional to the acceleration.
        room = (ROOM * torque.values - still)[over] / (moving - still)[over]
        needed = np.log(max(float(room.min()), 1e-9)) / np.log(SLOWER)
        steps = min(SLOWEST, steps + int(np.ceil(needed)))
        limits = SLOWER**steps * first
    raised = np.where(over, moving / ROOM, torque.values)
    notes = [
        f"joint '{model.joints[k]}': the torque limit {torque.values[k]:.4g} ({torque.origins[k]}) "
        f"does not carry the arm through the test-cycles; {raised[k]:.4g} was assumed, so state "
        "the real one with --torque-limit, or a lighter --payload."
        for k in np.flatnonzero(over)
    ]
    if np.any(over):
        figures["torque_limit"] = torque.replace(raised, lambda k: "assumed: what the test-cycles need")
        drive["torque_limit"] = round_figures(raised)
    why = f"every test-cycle stays within {100 * ROOM:g} % of the torque limit"
    figures["acceleration_limit"] = option or assume(limits, why)
    fields["home"] = round_figures(model.home_posture)
    return make_model(fields, text, fields["name"]), notes


def _find_peaks(model: RobotModel) -> tuple[Array, Array]:
    """Return the largest torques (n,) of all test-cycles at a study's extremes: at speed, and very slowly."""
    moving, still = np.zeros(model.n), np.zeros(model.n)
    for name in list_cycles():
        seen = load_cycle(name).build(model, 0.05, find_coarse_step(model))
        rest = replace(seen, v=1e-6 * seen.v, a=0.0 * seen.a)
        for factor in (1.0 - PAYLOAD_ERROR, 1.0 + PAYLOAD_ERROR):
            held = required_torque(rest, model, TEMPERATURES[0], WEAR, factor)
            still = np.maximum(still, np.abs(held).max(axis=0))
            for temperature in TEMPERATURES:
                needed = required_torque(seen, model, temperature, WEAR, factor)
                moving = np.maximum(moving, np.abs(needed).max(axis=0))
    return moving, still
