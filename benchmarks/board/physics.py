"""What a planted machine does along an exact motion: motor-side positions, motor torque, declared torque.

The link follows the exact motion. Torque that the link asks for is rigid-body inverse dynamics with the true
payload; compliance and lost motion put the motor ahead of the link; rotor inertia and friction act at the
motor's own speed; gain and delay act on the recorded torque.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.board.machines import Body, Machine
from benchmarks.board.outside import OUTSIDE, TWO_JOINTS
from benchmarks.board.terms import NAMED, Signals, Term
from wearscope.demonstration.motions import Motion
from wearscope.errors import InputError

Array = NDArray[np.float64]

STRUCTURAL = (
    "payload_error",
    "inertial_error",
    "joint_elasticity",
    "backlash",
    "torque_constant_error",
    "time_delay",
)


@dataclass(frozen=True)
class Structural:
    """A planted effect that is no additive torque, as a direction; its amplitude is given when it acts."""

    kind: str
    joint: int
    detail: dict[str, float] = field(default_factory=dict)

    def parameters(self, amplitude: float) -> dict[str, tuple[float, str]]:
        """Planted parameters as ``name: (value, unit)``, with units as those of a `Term`."""
        if self.kind == "payload_error":
            return {"mass": (amplitude, "kg"), "com_shift_x": (self.detail["shift"] * amplitude, "m")}
        if self.kind == "inertial_error":
            return {f"mass_factor_link{int(self.detail['link']) + 1}": (1.0 + amplitude, "1")}
        if self.kind == "joint_elasticity":
            stiffness = 1.0 / amplitude, "{tau}/{pos}"
            return {"stiffness": stiffness, "compliance": (amplitude, "{pos}/({tau})")}
        name, unit = {"backlash": ("gap", "{pos}"), "time_delay": ("delay", "s")}.get(
            self.kind, ("gain", "1")
        )
        return {name: (amplitude, unit)}


@dataclass(frozen=True)
class Active:
    """A planted effect with its amplitude."""

    plant: Term | Structural
    amplitude: float


@dataclass(frozen=True)
class Behaviour:
    """One run on the fine grid: motor-side `q`, `v`, `a`, torque `tau` and `declared`."""

    t: Array
    q: Array
    v: Array
    a: Array
    tau: Array
    declared: Array
    temperature: Array

    @property
    def plant_torque(self) -> Array:
        """What the plants are worth in the record (N, n)."""
        return self.tau - self.declared


@dataclass(frozen=True)
class Setting:
    """A machine as this case has it: friction levels, rotor inertia and the smoothness of its sign change.

    `rigid_declared` False leaves the rigid body out of what is declared.
    """

    machine: Machine
    coulomb: Array
    viscous: Array
    rotor: Array
    grain: Array
    offset: float | Array = 0.0
    rigid_declared: bool = True


def make_plant(effect: str, machine: Machine, joint: int, rng: np.random.Generator) -> Term | Structural:
    """Plant of a name, its form and shape parameters drawn by `rng`.

    Raises
    ------
    InputError
        Where the generator has no such effect.
    """
    if len(machine.joints) == 1 and effect in ("cross_coupling", *TWO_JOINTS):
        raise InputError(
            f"attribution board: {machine.name} has one joint, so nothing can couple into it; choose an arm."
        )
    builder = NAMED.get(effect) or OUTSIDE.get(effect)
    if builder is not None:
        return builder(machine, joint, rng)
    if effect not in STRUCTURAL:
        known = ", ".join([*NAMED, *STRUCTURAL, *OUTSIDE])
        raise InputError(f"attribution board: effect '{effect}' cannot be planted; choose one of {known}.")
    detail = {"sign": float(rng.choice([-1.0, 1.0]))}
    if effect == "payload_error":
        if machine.payload_mass <= 0:
            raise InputError(
                f"attribution board: {machine.name} carries no payload, so it can have no payload error; "
                "choose another machine."
            )
        detail["shift"] = float(rng.uniform(-0.8, 0.8)) * abs(machine.payload_com[0]) / machine.payload_mass
    if effect == "inertial_error":
        detail["link"] = float(joint)
    return Structural(effect, joint, detail)


def _friction(setting: Setting, v: Array) -> Array:
    return setting.coulomb * np.tanh(v / setting.grain) + setting.viscous * v


def _lost_motion(load: Array, gap: float) -> Array:
    """Motor ahead of the link by +-gap/2 with the load's sign, the gap crossed softly around reversal."""
    soft = 0.08 * float(np.sqrt(np.mean(load**2)))
    return 0.5 * gap * load / np.sqrt(load**2 + soft**2)


def find_body(setting: Setting, actives: Sequence[Active], declared_body: Body) -> Body:
    """The rigid body as it is, with the errors of payload and links that these plants are."""
    machine = setting.machine
    structural = [(a.plant, a.amplitude) for a in actives if isinstance(a.plant, Structural)]
    faults = {int(p.detail["link"]): x for p, x in structural if p.kind == "inertial_error"}
    body = declared_body
    if faults:
        body = Body(machine.urdf, machine.gravity, machine.payload_mass, machine.payload_com, faults)
    for plant, amplitude in structural:
        if plant.kind == "payload_error":
            mass = machine.payload_mass + amplitude
            com = np.asarray(machine.payload_com) + np.array([plant.detail["shift"] * amplitude, 0.0, 0.0])
            body = Body(machine.urdf, machine.gravity, mass, tuple(com), faults)
    return body


def _drive(
    setting: Setting, actives: Sequence[Active], t: Array, q: Array, v: Array, a: Array, load: Array,
    temperature: Array,
) -> tuple[Array, Array]:  # fmt: skip
    """Torque (N, n) of rotor, friction and offset on the motor's side; and with load and planted terms."""
    own = setting.rotor * a + _friction(setting, v) + setting.offset
    signals = Signals(t, q, v, a, load, temperature, np.asarray(setting.machine.speed), setting.grain)
    torque = load + own
    for active in actives:
        if isinstance(active.plant, Term):
            torque[:, active.plant.joint] += active.amplitude * active.plant.shape(signals)
    return own, torque


def ask_torque(
    setting: Setting, actives: Sequence[Active], body: Body, motion: Motion, temperature: Array
) -> Array:
    """Torque (N, n) that a motion of the motors asks for, were the gears rigid and the record in time.

    Parameters
    ----------
    setting : Setting
    actives : sequence of Active
        Those that bend a gear or delay the record have no part in it.
    body : Body
        As `find_body` gives it.
    motion : Motion
        Of the motors, on a uniform grid.
    temperature : array (N, n)
    """
    load = body.torque(motion.q, motion.v, motion.a)
    _, torque = _drive(setting, actives, motion.t, motion.q, motion.v, motion.a, load, temperature)
    for active in actives:
        if isinstance(active.plant, Structural) and active.plant.kind == "torque_constant_error":
            torque[:, active.plant.joint] *= 1.0 + active.amplitude
    return torque


def behave(
    setting: Setting, motion: Motion, temperature: Array, actives: Sequence[Active], declared_body: Body,
    declared_load: Array | None = None,
) -> Behaviour:  # fmt: skip
    """What the machine's recorder would see without noise, along one motion.

    Parameters
    ----------
    setting : Setting
    motion : Motion
        Exact link-side motion on a uniform grid.
    temperature : array (N, n)
        Joint temperatures [deg C].
    actives : sequence of Active
    declared_body : Body
        The rigid body as declared.
    declared_load : array (N, n), optional
        Its torque along the motion, where it is known already.

    Returns
    -------
    Behaviour
        `declared` is the true machine's torque without the plants, along the motor-side motion that a
        recorder sees: tau - declared is what the plants are worth.
    """
    structural = [(a.plant, a.amplitude) for a in actives if isinstance(a.plant, Structural)]
    body = find_body(setting, actives, declared_body)
    if declared_load is None or body is not declared_body:
        load = body.torque(motion.q, motion.v, motion.a)
    else:
        load = declared_load
    ahead = np.zeros_like(load)
    for plant, amplitude in structural:
        if plant.kind == "joint_elasticity":
            ahead[:, plant.joint] += amplitude * load[:, plant.joint]
        elif plant.kind == "backlash":
            ahead[:, plant.joint] += _lost_motion(load[:, plant.joint], amplitude)
    q, v, a, rigid = motion.q, motion.v, motion.a, load
    if np.any(ahead):
        step = motion.t[1] - motion.t[0]
        speed = np.gradient(ahead, step, axis=0, edge_order=2)
        q, v, a = q + ahead, v + speed, a + np.gradient(speed, step, axis=0, edge_order=2)
    if np.any(ahead) or body is not declared_body:
        rigid = declared_body.torque(q, v, a)
    own, tau = _drive(setting, actives, motion.t, q, v, a, load, temperature)
    for plant, amplitude in structural:
        column = tau[:, plant.joint]
        if plant.kind == "torque_constant_error":
            tau[:, plant.joint] = (1.0 + amplitude) * column
        elif plant.kind == "time_delay":
            tau[:, plant.joint] = np.interp(motion.t - amplitude, motion.t, column)
    declared = rigid + own if setting.rigid_declared else own
    return Behaviour(motion.t, q, v, a, tau, declared, temperature)


def first_amplitude(plant: Term | Structural, machine: Machine) -> float:
    """A small amplitude to start the scaling from (+-1 for additive terms), with its sign."""
    if isinstance(plant, Term):
        return plant.sign
    sign = plant.detail["sign"]
    if plant.kind == "payload_error":
        return sign * 0.1 * machine.payload_mass
    if plant.kind == "inertial_error":
        return sign * 0.05
    if plant.kind == "backlash":
        return 1e-3 * machine.reach[plant.joint]
    if plant.kind == "joint_elasticity":
        return 1e-6 if not machine.prismatic[plant.joint] else 1e-7
    return sign * (0.01 if plant.kind == "torque_constant_error" else 0.002)
