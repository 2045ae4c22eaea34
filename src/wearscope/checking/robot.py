"""Checks a robot: its model file, URDF and effects, and whether it can perform the built-in test-cycles."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from wearscope import limits
from wearscope.cycles.base import Cycle, find_coarse_step, list_cycles, load_cycle
from wearscope.errors import Findings, InputError, SelfTestError, SimulationError
from wearscope.robots.model import RobotModel, check_effects, list_breaches, load_model
from wearscope.robots.model_file import Allowed, find_model, read_model_file
from wearscope.simulation.feasibility import Ranges, check_cycle, check_robot, check_screening, screen_factors
from wearscope.simulation.study import Conditions, simulate_points

#: Factors for checking a robot without a study: kind, and range [-, deg C, ms, %] as in the paper.
USUAL: dict[str, tuple[str, float, float]] = {
    "f": ("wear", 0.0, 50.0),
    "w3": ("temperature", 30.0, 70.0),
    "w4": ("dwell", 25.0, 75.0),
    "w5": ("payload_mass_error", -10.0, 10.0),
}
#: Integration step [s].
STEP = 0.001
#: Test-cycle that the check simulates.
TRIED = "point_to_point"


def check_model(reference: str | Path, found: Findings, allow_code: Allowed = False) -> RobotModel | None:
    """Load a robot's model and add its problems to `found`; return None if the model cannot be used."""
    path = found.attempt(lambda: find_model(reference))
    fields = found.attempt(lambda: read_model_file(path)) if path is not None else None
    if path is None or fields is None:
        return None
    found.add(*list_breaches(fields, str(path)))
    model = found.attempt(lambda: load_model(path, allow_code=allow_code))
    if model is None:
        return None
    for entry in model.effects:
        alone = model.model_copy(update={"effects": [entry]})
        found.attempt(lambda alone=alone: check_effects(alone))  # type: ignore[misc]
    found.attempt(lambda: check_effects(model))
    for name, most in limits.DRIVE.items():
        if max(map(abs, getattr(model.drive, name) or [0.0])) > most:
            found.add(f"{path}: drive.{name} holds a value above {most:g}, which no joint has; correct it.")
    if any(model.torque_noise > model.torque_limit):
        found.add(
            f"{path}: sensors.torque_noise is above drive.torque_limit; give its standard deviation in N m."
        )
    if not any(model.gravity):
        found.notes.append(f"{path}: gravity is 0; where the robot is not in orbit, give m/s^2.")
    return model


def find_idle_factors(
    model: RobotModel, ranges: Ranges, cycles: Mapping[str, Cycle] | None = None
) -> dict[str, str]:
    """Find the factors whose range does not change any joint torque of the robot along test-cycles.

    Parameters
    ----------
    model : RobotModel
    ranges : mapping of str to (kind, low, high)
    cycles : mapping of str to Cycle, optional
        Test-cycles; the built-in point-to-point moves by default.

    Returns
    -------
    dict of str to str
        A sentence for each such factor, by the factor's name.

    Raises
    ------
    InputError
        If a test-cycle cannot be planned.
    """
    table = screen_factors(model, cycles or {TRIED: load_cycle(TRIED)}, ranges, STEP)
    idle: dict[str, str] = {}
    for name in ranges:
        try:
            check_screening(table[table["factor"] == name], model.name, [])
        except InputError as error:
            idle[name] = str(error)
    return idle


def check_factors(
    model: RobotModel,
    ranges: Ranges,
    found: Findings,
    sample_rate: float | None = None,
    cycles: Mapping[str, Cycle] | None = None,
    may_drop: Sequence[str] = (),
    dropped: str = "it will be dropped",
) -> None:
    """Add a problem for each factor that a robot's model does not cover, or that changes no torque.

    Parameters
    ----------
    model : RobotModel
    ranges : mapping of str to (kind, low, high)
    found : Findings
    sample_rate : float, optional
        Sample rate of recordings [Hz].
    cycles : mapping of str to Cycle, optional
        Test-cycles; the built-in point-to-point moves by default.
    may_drop : sequence of str
        Factors that get a note instead of a problem if they change no torque.
    dropped : str
        End of that note: the consequence.
    """
    known = len(found.problems)
    wear = {name: one for name, one in ranges.items() if one[0] == "wear"}
    parts: list[Mapping] = [wear, *({name: one} for name, one in ranges.items() if one[0] != "wear")]
    for part in parts:
        found.attempt(lambda part=part: check_robot(model, part, STEP, sample_rate))  # type: ignore[misc]
    idle = (
        found.attempt(lambda: find_idle_factors(model, ranges, cycles))
        if len(found.problems) == known
        else None
    )
    for name, sentence in (idle or {}).items():
        if name in may_drop:
            found.notes.append(f"factors.{name}: moves no torque of robot '{model.name}'; {dropped}.")
        else:
            found.add(sentence)


def simulate_extremes(model: RobotModel, ranges: Ranges, found: Findings) -> None:
    """Simulate a robot unworn, and worn at both ends of the other factors; add a problem for each failure."""
    of_kind = {kind: (low, high) for kind, low, high in ranges.values()}
    wear = (of_kind.get("wear", (0.0, 0.0))[1],) * min(len(model.wear_joints), 3)
    cold, warm = of_kind.get("temperature", (50.0, 50.0))
    light, heavy = (one / 100.0 for one in of_kind.get("payload_mass_error", (0.0, 0.0)))
    motion = load_cycle(TRIED).build(model, of_kind.get("dwell", (25.0, 25.0))[0] / 1000.0, STEP)
    points = [
        (motion, one, 1)
        for one in (Conditions(), Conditions(wear, cold, light), Conditions(wear, warm, heavy))
    ]
    try:
        outcomes = list(simulate_points(model, points))
    except SelfTestError as error:
        outcomes = [error]
    for outcome in outcomes:
        if isinstance(outcome, SimulationError):
            told = str(outcome).rstrip(".")
            found.add(f"{model.name}: simulating {TRIED} fails, {told}; correct the model.")


def check_robot_folder(reference: str | Path, allow_code: Allowed = False) -> Findings:
    """Check a robot without a study, with the factors of `USUAL` and the built-in test-cycles."""
    found = Findings(f"robot {reference}")
    model = check_model(reference, found, allow_code)
    if model is None:
        return found
    ranges = {name: one for name, one in USUAL.items() if one[0] != "payload_mass_error" or model.payload}
    # A study may leave out any factor but wear, so only wear must change the torque.
    may_drop = [name for name, one in ranges.items() if one[0] != "wear"]
    check_factors(model, ranges, found, may_drop=may_drop, dropped="a study of it cannot ask for it")
    for name in list_cycles():
        found.attempt(
            lambda name=name: check_cycle(model, load_cycle(name), name, ranges, find_coarse_step(model))  # type: ignore[misc]
        )
    if not found.problems:
        found.attempt(lambda: simulate_extremes(model, ranges, found))
    if not model.torque_noise.all():
        found.notes.append(
            f"{model.name}: sensors.torque_noise is 0 or missing; without noise an SNR means little."
        )
    if not found.problems:
        done = ", ".join(list_cycles())
        found.notes.append(f"{model.n} joints, {len(model.effects)} effects; can do {done}.")
    return found
