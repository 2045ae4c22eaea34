"""Forward simulation of a model along a measured or planned motion, under a controller of its own."""

import numpy as np

from wearscope.cycles.base import Reference
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array
from wearscope.simulation.plant import build_plant, find_step, make_feedforward, make_law
from wearscope.simulation.recording import Recording
from wearscope.simulation.run import Trace, run_motion
from wearscope.simulation.sensors import record
from wearscope.simulation.world import World, prove_world

#: Longest step of a forward simulation [s].
LONGEST_STEP = 1e-3


def refine_reference(reference: Reference, longest: float = LONGEST_STEP) -> Reference:
    """Reference with whole fractions of its step, none longer than `longest` [s].

    Between two samples the motion is the polynomial of fifth degree that has their positions, speeds and
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
        What the controller knows: its feed-forward and its gains come from it; `model` by default. To compare
        two models under the same controller, give the same one for both.
    temperature : array (N, n), (n,) or float
        Of the joints [deg C]; (N, n) goes with the reference. NaN needs a model without effects of
        temperature.
    controller_temperature : array (n,) or float
        That the controller assumes [deg C].
    feedforward : array (N, n), optional
        Motor torque at the reference's samples to feed forward instead of what `declared` needs, e.g. a
        measured one; the motion then shows what the model lacks.

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
    """As `simulate_forward`, before the sensors: the run at every step, and the step [s].

    The wear (N, n), (n,) or a number goes with the reference, as the temperature does, whose step is divided
    until it is no longer than `longest_step` [s]. With `by_effect` the trace also tells what the torque for
    PyBullet is made of. Without `feedback` the motors give the torque fed forward and nothing else.
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
