"""Test-cycles: their form, loading by name or file, and the check that a robot can follow them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from wearscope import plugins
from wearscope.effects.base import Signals
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel, add_torques
from wearscope.robots.spatial import Array

# A limit may be exceeded by this share, as planners reach limits up to rounding errors.
TOLERANCE = 1e-6
# Robots with more joints than this are checked in coarser time steps, as their motions take longer.
MANY = 12


@dataclass(frozen=True)
class Reference:
    """Reference motion of all joints.

    Attributes
    ----------
    t : array (N,)
        Time from 0 in equal steps [s].
    q, v, a : array (N, n)
        Position, speed, acceleration [rad or m, per s, per s^2].
    """

    t: Array
    q: Array
    v: Array
    a: Array


@dataclass(frozen=True)
class Cycle:
    """A test-cycle.

    Attributes
    ----------
    name : str
    description : str
        One sentence.
    build : callable
        ``build(model, dwell, step) -> Reference``: `dwell` is the delay before each next move [s], the
        paper's w4, `step` the time step [s]. Equal arguments give equal motions.
    """

    name: str
    description: str
    build: Callable[[RobotModel, float, float], Reference]


def load_cycle(reference: str) -> Cycle:
    """Load a test-cycle by its name, or by the path of a ``.py`` file that defines ``CYCLE``.

    Raises
    ------
    InputError
        Where there is no such test-cycle, or ``CYCLE`` is no `Cycle`.
    """
    cycle = plugins.load(reference, "cycles", "CYCLE")
    if not isinstance(cycle, Cycle):
        raise InputError(f"{reference}: CYCLE is no wearscope.cycles.base.Cycle; make it one.")
    return cycle


def list_cycles() -> list[str]:
    """Return the names of the platform's and the installed test-cycles."""
    return plugins.list_names("cycles", "CYCLE")


def find_coarse_step(model: RobotModel) -> float:
    """Return a time step [s] that resolves a motion's torques; it is coarser for many or slow joints."""
    slowest = float(np.min(model.motion_limits()[1]))
    return 0.01 * max(1.0, model.n / MANY) * max(1.0, slowest**-0.5)


def required_torque(
    reference: Reference, model: RobotModel, temperature: float, wear: float | Array, payload_factor: float
) -> Array:
    """Return the motor torque (N, n) along a reference: rigid body, rotors, and effects at the joints.

    Parameters
    ----------
    reference : Reference
    model : RobotModel
    temperature : float
        Temperature of all joints [deg C].
    wear : float or array (n,)
        Wear index f of the wearing joints [-]; values of other joints are ignored.
    payload_factor : float
        True payload mass over the declared one.
    """
    payload = model.declared_payload
    body = model.rigid_body(None if payload is None else payload.scaled(payload_factor))
    load = body.inverse_dynamics(reference.q, reference.v, reference.a)
    torque = load + model.rotor_inertia * reference.a
    worn = np.where([name in model.wear_joints for name in model.joints], wear, 0.0)
    signals = Signals.along(reference.t, reference.v, reference.q, reference.a, load, temperature, wear=worn)
    return add_torques(torque, model, signals, lambda _: True)


def check_reference(
    reference: Reference,
    model: RobotModel,
    cycle: str = "test-cycle",
    temperatures: Sequence[float] = (30.0, 70.0),
    wear: float = 50.0,
    payload_error: float = 0.1,
) -> None:
    """Refuse a motion that the robot cannot follow.

    Parameters
    ----------
    reference : Reference
    model : RobotModel
    cycle : str
        Name of the motion in messages.
    temperatures : sequence of float
        Temperatures at which the torque is checked [deg C].
    wear : float
        Largest wear index f [-].
    payload_error : float
        The torque is checked with the payload mass times 1 minus and 1 plus this share.

    Raises
    ------
    InputError
        Where arrays have a wrong shape, speeds are not the derivative of the positions, the motion does not
        start and end at rest, or it exceeds a limit on position, speed, acceleration or torque. The sentence
        names test-cycle, robot, joint, time and limit.
    """
    where = f"test-cycle '{cycle}' on robot '{model.name}'"
    _check_form(reference, model, where)
    lower, upper = model.position_limits
    speed, acceleration, _ = model.motion_limits()
    q, v, a, units = reference.q, reference.v, reference.a, model.position_units
    room = TOLERANCE * np.maximum(np.nan_to_num(upper - lower, posinf=1.0), 1.0)
    beyond = 1.0 + TOLERANCE
    asked = [
        (lower - room - q, q, lower, "position", units),
        (q - upper - room, q, upper, "position", units),
        (np.abs(v) - speed * beyond, v, speed, "speed", [f"{unit}/s" for unit in units]),
        (np.abs(a) - acceleration * beyond, a, acceleration, "acceleration", [f"{u}/s^2" for u in units]),
    ]
    limit = model.torque_limit
    for factor, temperature in product((1.0 - payload_error, 1.0 + payload_error), temperatures):
        torque = required_torque(reference, model, temperature, wear, factor)
        asked.append((np.abs(torque) - limit, torque, limit, "torque", model.torque_units))
    for excess, values, bound, what, unit in asked:
        row, joint = (int(k) for k in np.unravel_index(np.argmax(excess), excess.shape))
        if excess[row, joint] > 0.0:
            raise InputError(
                f"{where}: joint '{model.joints[joint]}' would need the {what} {values[row, joint]:.4g} "
                f"{unit[joint]} at t = {reference.t[row]:.3f} s, beyond its limit {bound[joint]:.4g}; "
                "slow the test-cycle down, make it smaller, or correct the robot's limits."
            )


def _check_form(reference: Reference, model: RobotModel, where: str) -> None:
    """Refuse wrong shapes, uneven time steps, inconsistent derivatives, and motion at the ends."""
    t = np.asarray(reference.t)
    if t.ndim != 1 or len(t) < 2:
        raise InputError(f"{where}: t has the shape {t.shape}; give at least two instants (N,).")
    for key in ("q", "v", "a"):
        values = np.asarray(getattr(reference, key))
        if values.shape != (len(t), model.n):
            raise InputError(
                f"{where}: {key} has the shape {values.shape}, not {(len(t), model.n)}; correct it."
            )
        if not np.all(np.isfinite(values)):
            row = int(np.where(~np.isfinite(values))[0][0])
            raise InputError(f"{where}: {key} is not finite at t = {t[row]:g} s; correct it.")
    steps = np.diff(t)
    if not np.all(np.isfinite(t)) or steps.min() <= 0.0 or np.ptp(steps) > 1e-6 * steps.mean():
        raise InputError(f"{where}: t does not grow in equal steps; sample the motion at a fixed rate.")
    speed, acceleration, jerk = model.motion_limits()
    for key, values, rate, bound in (
        ("v", reference.q, reference.v, acceleration),
        ("a", reference.v, reference.a, jerk),
    ):
        error = np.abs(np.diff(values, axis=0) / steps[:, None] - 0.5 * (rate[1:] + rate[:-1]))
        # The trapezoidal rule over one step is off by at most the largest slope of the rate times the step.
        row, joint = (int(k) for k in np.unravel_index(np.argmax(error / bound), error.shape))
        if error[row, joint] > bound[joint] * steps[row]:
            raise InputError(
                f"{where}: {key} of joint '{model.joints[joint]}' is not the derivative of the motion at "
                f"t = {t[row]:.3f} s; make q, v and a belong together."
            )
    for index, when in ((0, "start"), (-1, "end")):
        moving = np.abs(reference.v[index]) > 1e-3 * speed
        if np.any(moving):
            joint = int(np.argmax(moving))
            raise InputError(
                f"{where}: joint '{model.joints[joint]}' moves at the {when}; begin and end at rest."
            )
