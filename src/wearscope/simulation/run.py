"""One run: the compiled step solves a block of steps, PyBullet applies their torques, and both must agree."""

from dataclasses import dataclass

import numpy as np

from wearscope.effects.base import Plant
from wearscope.errors import SimulationError
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.spatial import Array
from wearscope.simulation.arrays import (
    Gears,
    Law,
    Log,
    Motion,
    State,
    make_log,
    make_motion,
    make_state,
    make_work,
)
from wearscope.simulation.balance import deflection
from wearscope.simulation.chain import build_chain, write_plant_urdf
from wearscope.simulation.dynamics import make_scratch, mass_and_bias
from wearscope.simulation.plant import build_gears
from wearscope.simulation.step import advance_block
from wearscope.simulation.terms import order_terms, pack_terms
from wearscope.simulation.world import World

#: Steps between two readings of PyBullet's state.
BLOCK = 200
#: Largest difference between PyBullet's state and the solution at a block's end, over 1 + its magnitude.
AGREEMENT = 1e-7
#: A run fails where a motor is further than this from its reference [rad or m].
LOST = 0.5


@dataclass(frozen=True)
class Trace:
    """A run at every step, before the sensors.

    Attributes
    ----------
    t : ndarray (N,)
        [s]
    q : ndarray (N + 1, n)
        Motor position, as joint position.
    v : ndarray (N, n)
        Motor speed.
    torque : ndarray (N, n)
        Motor torque, as joint torque.
    applied : ndarray (N, n)
        Joint torque that PyBullet got for the step from half a step before `t` to half a step after it.
    shares : dict of str to ndarray (N, n), or None
        Parts of `applied`, as means over that step: ``motor``, ``rotor``, ``bias`` and each effect by its
        name. ``applied = motor - rotor + bias - (sum of the effects)``.
    """

    t: Array
    q: Array
    v: Array
    torque: Array
    applied: Array
    shares: dict[str, Array] | None = None


def start_state(state: State, motion: Motion, gears: Gears, chain, q: Array, v: Array) -> None:
    """Set the motors to `q`, `v`, and the links to the deflection of the gears under gravity."""
    scratch = make_scratch(len(q))
    still = np.zeros(len(q))
    gap = np.zeros(len(q))
    flexible = np.flatnonzero(gears.flexible)
    for _ in range(20 if len(flexible) else 0):
        mass_and_bias(chain, q - gap, still, still, scratch)
        for j in flexible:
            gap[j] = deflection(
                scratch.bias[j], gears.compliance[j], gears.lost_motion[j], gears.mesh_torque[j]
            )
    state.q[:], state.gap[:] = q - gap, gap
    state.v[:], state.y[:] = v, v
    state.mode[:] = np.sign(v).astype(int)


def as_rows(values: Array | float, n: int) -> Array:
    """Return values that are (N, n), (n,) or a number as an array (N or 1, n)."""
    array = np.asarray(values, dtype=float)
    if array.ndim < 2:
        array = np.broadcast_to(array, (1, n))
    return np.array(array, order="C")


def run_motion(
    world: World,
    body: RigidBody,
    plant: Plant,
    law: Law,
    dt: float,
    temperature: Array | float,
    wear: Array | float,
    start: tuple[Array, Array],
    t0: float = 0.0,
    by_effect: bool = False,
) -> Trace:
    """Simulate one run.

    Parameters
    ----------
    world : World
    body : RigidBody
        The true bodies, with the true payload.
    plant : Plant
        Drive train and effects of the robot.
    law : Law
        Controller; one row for each step.
    dt : float
        Step [s].
    temperature, wear : array (N, n), (n,) or float
    start : tuple of ndarray (n,)
        Motor position and speed.
    t0 : float
        Time of the first step [s].
    by_effect : bool
        Whether the trace splits the torque for PyBullet into its parts.

    Raises
    ------
    SimulationError
        Where a step has no solution, a motor loses its reference, or PyBullet's state differs from the
        solution.
    """
    n, count = body.n, len(law.feedforward)
    scale = np.where(np.isfinite(law.limit), law.limit, 0.0)
    scale = np.where(scale > 0.0, scale, np.abs(law.feedforward).max(axis=0) + 1.0)
    gears = build_gears(plant, scale)
    rows, terms = pack_terms(plant)
    ghost = bool(np.any(plant.inertials))
    bodies = build_chain(body)
    chain = build_chain(body, plant.inertials) if ghost else bodies
    state, work, motion = make_state(n), make_work(n), make_motion(n)
    w, v = make_scratch(n), make_scratch(n)
    log = make_log(count, n, len(plant.terms), by_effect)
    start_state(state, motion, gears, chain, *start)
    warm, worn = as_rows(temperature, n), as_rows(wear, n)
    world.load(write_plant_urdf(body), body.names, body.gravity, dt)
    world.set_state(state.q, state.v)
    rigid = ~gears.flexible
    for first in range(0, count, BLOCK):
        last = min(first + BLOCK, count)
        failed = advance_block(
            rows, terms, law, gears, chain, bodies, ghost, state, work, motion, w, v, log, warm, worn,
            t0, dt, first, last,
        )  # fmt: skip
        if failed >= 0:
            raise SimulationError(f"the torques do not balance at t = {t0 + failed * dt:.4f} s.")
        world.advance(log.applied[first:last])
        q, speed = world.read_state()
        _compare(q, speed, state, body.names, t0 + last * dt)
        state.q[:], state.v[:] = q, speed
        np.copyto(state.y, np.where(state.mode == 0, 0.0, speed), where=rigid)
        _check_tracking(log.position[last - 1], law, last - 1, body.names, t0 + last * dt)
    end = state.q + state.gap
    return Trace(
        t=t0 + dt * np.arange(count, dtype=np.float64),
        q=np.vstack([log.position, end]),
        v=log.speed,
        torque=log.torque,
        applied=log.applied,
        shares=_name_shares(log, plant) if by_effect else None,
    )


def _name_shares(log: Log, plant: Plant) -> dict[str, Array]:
    """Return the parts of the applied torque (N, n) by name; the terms of one effect are added up."""
    shares = {"motor": log.motor, "rotor": log.rotor, "bias": log.bias}
    for column, term in enumerate(order_terms(plant)):
        share = shares.setdefault(term.effect, np.zeros_like(log.motor))
        share[:, term.joint] += log.terms[:, column]
    return shares


# Joint by joint: numpy takes several times as long for a few joints.
def _compare(q: Array, v: Array, state: State, names: list[str], t: float) -> None:
    """Refuse a state of PyBullet that differs from the solution of the step."""
    solved = zip(names, q.tolist(), state.q.tolist(), v.tolist(), state.v.tolist(), strict=True)
    for name, position, own_position, speed, own_speed in solved:
        if not (
            abs(position - own_position) <= AGREEMENT * (1.0 + abs(own_position))
            and abs(speed - own_speed) <= AGREEMENT * (1.0 + abs(own_speed))
        ):
            raise SimulationError(
                f"PyBullet arrives at q = {position}, v = {speed} of joint '{name}' at t = {t:.4f} s, where "
                f"the step's solution has {own_position}, {own_speed}."
            )


def _check_tracking(q: Array, law: Law, row: int, names: list[str], t: float) -> None:
    """Refuse a motor position that is too far from its reference."""
    wanted = zip(names, q.tolist(), law.position[row].tolist(), law.stiffness.tolist(), strict=True)
    for name, position, reference, stiffness in wanted:
        # Without position feedback a motor need not follow its reference; then only NaN is refused.
        off = abs(position - reference) if stiffness > 0.0 else 0.0 * position
        if not off < LOST:
            raise SimulationError(
                f"joint '{name}' is {off:.3g} rad or m off its reference at t = {t:.3f} s; the motor may be "
                "too weak or the controller too soft."
            )
