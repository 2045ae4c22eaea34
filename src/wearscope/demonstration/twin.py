"""Simulates a twin of the study's medium robot (Manutec r3) under position control and records it.

The twin shares no code with `wearscope.effects` and `wearscope.simulation`. It uses Pinocchio's forward
dynamics with motor armature and implicit Euler steps of 0.25 ms, solved by Newton's method. Coulomb friction
is a smooth function of speed; viscous friction decreases exponentially with temperature. Axis 2 has one more
effect, which the data set does not declare.
"""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yaml
from numba import njit
from numpy.typing import NDArray

from wearscope.demonstration.motions import Machine, Motion, make_motion
from wearscope.storage.tables import write_table, write_text

Array = NDArray[np.float64]

#: Integration step [s].
STEP = 0.25e-3
#: Sample rate of recordings [Hz].
RATE = 250.0
SECRETS = ("gravity_counterbalance", "load_dependent_friction")
"""Undeclared effects: a twin with an even seed has the first, one with an odd seed the second."""

PLANS: tuple[tuple[str, str, int, float], ...] = (
    ("train", "fourier", 0, 32.0),
    ("train", "sweep", 1, 58.0),
    ("train", "points", 2, 44.0),
    ("train", "fourier", 0, 50.0),
    ("test", "points", 3, 53.0),
    ("test", "sweep", 4, 37.0),
)
"""For each run: use, kind of motion, trajectory (equal numbers: equal motions), start temperature [deg C]."""

# The published values are in axes with y up; (x, y, z) there is (x, -z, y) in the URDF's axes with z up.
_LINKS = (
    # name, mass [kg], centre of mass [m], (Ixx, Iyy, Izz, Ixy) about it [kg m^2], vector from the joint
    # before [m], axis of the joint
    ("b1", 30.0, (0.0, 0.0, 0.0), (1.16, 1.16, 1.16, 0.0), (0.0, 0.351, 0.0), "y"),
    ("b2", 56.5, (0.172, 0.205, 0.0), (2.58, 0.64, 2.73, -0.46), (0.0, 0.324, 0.3), "x"),
    ("b3", 26.4, (0.064, -0.034, 0.0), (0.279, 0.245, 0.413, -0.07), (0.0, 0.65, 0.0), "x"),
    ("b4", 28.7, (0.0, 0.0, 0.0), (1.67, 0.081, 1.67, 0.0), (0.0, 0.414, -0.155), "y"),
    ("b5", 5.2, (0.0, 0.0, 0.0), (1.25, 0.81, 1.53, 0.0), (0.0, 0.186, 0.0), "x"),
    ("b6", 0.5, (0.05, 0.05, 0.05), (1e-3, 1e-3, 1e-3, 0.0), (0.0, 0.125, 0.0), "y"),
)
_AXES = {"x": "1 0 0", "y": "0 0 1"}


def _turn(x: tuple[float, float, float]) -> str:
    """Write a vector for the URDF, turned from axes with y up to axes with z up."""
    return f"{x[0]:g} {-x[2]:g} {x[1]:g}"


def write_urdf() -> str:
    """Return the text of the Manutec r3's URDF: z up, joints ``axis_1`` to ``axis_6``."""
    out = '<?xml version="1.0"?>\n<robot name="twin">\n  <link name="b0"/>\n'
    parent = "b0"
    for number, (name, mass, com, (ixx, iyy, izz, ixy), offset, axis) in enumerate(_LINKS, start=1):
        out += (
            f'  <link name="{name}"><inertial><origin xyz="{_turn(com)}" rpy="0 0 0"/><mass value="{mass}"/>'
            f'<inertia ixx="{ixx}" iyy="{izz}" izz="{iyy}" ixy="0" ixz="{ixy}" iyz="0"/></inertial></link>\n'
            f'  <joint name="axis_{number}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{_turn(offset)}" rpy="0 0 0"/><axis xyz="{_AXES[axis]}"/>'
            '<limit lower="-6.3" upper="6.3" effort="2200" velocity="5"/></joint>\n'
        )
        parent = name
    return out + "</robot>\n"


RATIO = np.array([105.0, 210.0, 60.0, 99.0, 79.2, 99.0])
TWIN = Machine(
    name="twin",
    urdf=write_urdf(),
    joints=tuple(f"axis_{i}" for i in range(1, 7)),
    prismatic=(False,) * 6,
    rotor_inertia=tuple((RATIO**2 * np.array([1.3e-3, 1.3e-3, 1.3e-3, 1.6e-4, 1.8e-4, 4.3e-5])).tolist()),
    gear_ratio=tuple(RATIO.tolist()),
    coulomb=(0.4 * 105, 0.5 * 210, 0.7 * 60, 21.8, 30.1, 10.9),
    viscous=(0.13 / 160 * 105**2, 0.1 / 130 * 210**2, 0.2 / 130 * 60**2, 9.8, 0.03, 3.92),
    centre=(0.0, -0.3, 0.7, 0.0, 0.5, 0.0),
    reach=(1.2, 0.95, 0.9, 1.2, 1.0, 1.5),
    speed=(2.2, 1.2, 2.6, 2.6, 2.6, 3.4),
    acceleration=(7.0, 5.0, 8.0, 18.0, 18.0, 24.0),
    payload_mass=15.0,
    payload_com=(0.1, -0.1, 0.25),
)


def _gas_spring(q: float) -> tuple[float, float]:
    """Return the torque [N m] of a gas spring that balances axis 2, and the spring's force [N].

    Its pins are 0.62 m and 0.17 m from the axis. The relaxed spring has 1.3 kN; the polytropic exponent of
    the gas is 1.2.
    """
    span, arm = 0.62, 0.17
    angle = q + 1.2
    length = np.sqrt(span**2 + arm**2 + 2 * span * arm * np.cos(angle))
    force = 1300.0 * (1.0 / (1.0 - 0.8 * (span + arm - length) / (2 * arm))) ** 1.2
    return -float(force * span * arm * np.sin(angle) / length), float(force)


def _friction(machine: Machine, temperature: Array) -> tuple[Array, Array]:
    """Return Coulomb levels [N m] and viscous slopes [N m s/rad] at the joints' temperatures [deg C]."""
    coulomb = np.asarray(machine.coulomb)
    warm = 0.7 + 0.3 * np.exp(-(temperature - 40.0) / 30.0)
    return coulomb, np.asarray(machine.viscous) * warm


@njit(cache=True)
def _linearise(drive, v, guess, law, rotor, rub, slope, armature, torque):
    """Linearise the friction at speeds `guess`, and write what the forward dynamics take (all (n,)).

    These are the friction torque `rub`, its derivative `slope`, the armature and the torque.
    """
    level, viscous, width = law
    for j in range(len(v)):
        reach = math.sqrt(guess[j] ** 2 + width[j] ** 2)
        slope[j] = level[j] * width[j] ** 2 / math.pow(reach, 3.0) + viscous[j]
        rub[j] = level[j] * guess[j] / reach + viscous[j] * guess[j]
        armature[j] = rotor[j] + STEP * slope[j]
        torque[j] = drive[j] - rub[j] - slope[j] * (v[j] - guess[j])


@njit(cache=True)
def _settle(v, acceleration, guess, width, rub, slope, after):
    """Finish a Newton iteration, in which the speeds `guess` gave an acceleration (all (n,)).

    Writes the speeds `after` the step, the friction `rub` linearised there, and the next guess. Returns
    whether the speeds have converged.
    """
    settled = True
    for j in range(len(v)):
        after[j] = v[j] + STEP * acceleration[j]
        rub[j] += slope[j] * (after[j] - guess[j])
        settled = settled and abs(after[j] - guess[j]) < 0.1 * width[j] + 0.01 * abs(guess[j])
        guess[j] = 0.0 if after[j] * guess[j] < 0.0 else after[j]
    return settled


def _step(
    model: pin.Model, data: pin.Data, rotor: Array, q: Array, v: Array, drive: Array, law: tuple[Array, ...]
) -> tuple[Array, Array]:
    """Return the speeds v+ (n,) after an implicit step, and the friction torque (n,) at these speeds.

    Newton's method solves (M + J)(v+ - v)/dt + h + friction(v+) = drive. In each iteration the friction is
    linear, so that its slope acts like armature in the forward dynamics. An iterate whose sign changes is
    set to zero, because the friction law is steep there.
    """
    guess, (rub, slope, armature, torque, after) = v.copy(), np.empty((5, len(v)))
    for _ in range(8):
        _linearise(drive, v, guess, law, rotor, rub, slope, armature, torque)
        model.armature = armature
        if _settle(v, pin.aba(model, data, q, v, torque), guess, law[2], rub, slope, after):
            break
    return after, rub


def simulate_run(
    machine: Machine, motion: Motion, start: float, secret: str, gain: float
) -> dict[str, Array]:
    """Simulate the twin along a reference motion and record it at 250 Hz, without sensor errors.

    Parameters
    ----------
    machine : Machine
    motion : Motion
        Reference motion on a grid of `STEP`.
    start : float
        Temperature of the joints at the start [deg C].
    secret : str
        Undeclared effect, one of `SECRETS`.
    gain : float
        Factor on the nominal strength of that effect (0 switches it off).

    Returns
    -------
    dict
        `t` (N,) [s]; `q` [rad], `v` [rad/s], motor torque `tau` [N m], torque of the undeclared effect
        `secret` [N m] and `temperature` [deg C], each (N, n).
    """
    model = pin.buildModelFromXML(machine.urdf)
    last = model.njoints - 1
    load = pin.Inertia(machine.payload_mass, np.asarray(machine.payload_com), np.zeros((3, 3)))
    model.inertias[last] = model.inertias[last] + load
    data = model.createData()
    rotor = np.asarray(machine.rotor_inertia)
    every = round(1.0 / (RATE * STEP))
    count, n = motion.q.shape
    # The controller has feed-forward of rigid body and rotor, and critically damped feedback of 6 Hz.
    rigid = pin.rneaInParallel(1, pin.ModelPool(model, 1), motion.q.T, motion.v.T, motion.a.T)
    ahead = rigid.T + rotor * motion.a
    bandwidth = 2 * np.pi * 6.0
    weight = np.diag(pin.crba(model, data, np.asarray(machine.centre))) + rotor
    stiff, damp = weight * bandwidth**2, weight * 2 * bandwidth
    width = 2e-4 * np.asarray(machine.speed)
    q, v = motion.q[0].copy(), motion.v[0].copy()
    passed = ahead[0, 1]
    command = ahead[0].copy()
    out = {key: np.empty((-(-count // every), n)) for key in ("q", "v", "tau", "secret", "temperature")}
    temperature = np.full(n, start)
    for i in range(count):
        if i % every == 0:
            temperature = start + 5.0 * (1 - np.exp(-motion.t[i] / 25.0)) * np.linspace(1.0, 0.6, n)
            coulomb, viscous = _friction(machine, temperature)
        # A torque is constant over a step. At the time of a sample one step ends and the next begins, so the
        # recording has the mean of both torques.
        before = command
        command = ahead[i] + stiff * (motion.q[i] - q) + damp * (motion.v[i] - v)
        level = coulomb.copy()
        extra = np.zeros(n)
        if secret == "load_dependent_friction":
            level[1] += gain * 0.045 * abs(passed)
        else:
            extra[1] = gain * _gas_spring(q[1])[0]
        if i % every == 0:
            row = i // every
            out["q"][row], out["v"][row], out["tau"][row] = q, v, (before + command) / 2
            out["secret"][row] = extra + (level - coulomb) * v / np.sqrt(v**2 + width**2)
            out["temperature"][row] = temperature
        after, rub = _step(model, data, rotor, q, v, command - extra, (level, viscous, width))
        passed = command[1] - extra[1] - rub[1] - rotor[1] * (after[1] - v[1]) / STEP
        v = after
        q = q + STEP * v
    return {"t": motion.t[::every]} | out


def quantise(q: Array, resolution: Array, rng: np.random.Generator) -> Array:
    """Return encoder readings (N, n): noise of half a count is added, then `resolution` (n,) rounds."""
    return np.round((q + rng.normal(size=q.shape) * 0.5 * resolution) / resolution) * resolution


def record_twin(
    folder: str | Path, seed: int, duration: float = 14.0, truth_path: str | Path | None = None
) -> dict[str, Any]:
    """Record six runs of the twin at several temperatures and write them as a data set.

    Parameters
    ----------
    folder : path-like
        Folder of the data set.
    seed : int
        Seed of the motions and the sensor noise; it also selects the undeclared effect of axis 2.
    duration : float
        Duration of each run [s].
    truth_path : path-like, optional
        File for the truth, outside of `folder`.

    Returns
    -------
    dict
        The truth: `dataset`, `robot`, `seed`, `joints`, `noise_rms` of the torque by joint [N m], and the
        `planted` effects. The `size` of a planted effect is its RMS torque divided by the noise [-].
    """
    secret = SECRETS[seed % 2]
    folder = Path(folder)
    machine, n = TWIN, len(TWIN.joints)
    limit = np.array([1097.25, 2194.5, 627.0, 396.0, 396.0, 198.0])
    sigma = 0.0025 * limit
    resolution = 2 * np.pi / (65536 * RATIO)
    listing: list[dict[str, Any]] = []
    worth = []
    for number, (use, kind, trajectory, start) in enumerate(PLANS):
        motion_seed = int(np.random.SeedSequence([seed, trajectory]).generate_state(1)[0])
        motion = make_motion(machine, kind, motion_seed, duration, 1.0 / STEP)
        run = simulate_run(machine, motion, start, secret, 1.0)
        rng = np.random.default_rng(np.random.SeedSequence([seed, 1000 + number]))
        q = quantise(run["q"], resolution, rng)
        tau = run["tau"] + rng.normal(size=run["tau"].shape) * sigma
        columns, units = {"t": run["t"]}, {"t": "s"}
        for j, joint in enumerate(machine.joints):
            columns[f"q_{joint}"], units[f"q_{joint}"] = q[:, j], "rad"
            columns[f"tau_{joint}"], units[f"tau_{joint}"] = tau[:, j], "N m"
            columns[f"temp_{joint}"] = np.round(run["temperature"][:, j], 1)
            units[f"temp_{joint}"] = "degC"
        file = f"runs/r{number + 1}.parquet"
        write_table(folder / file, columns, units)
        payload = {"mass": machine.payload_mass, "com": list(machine.payload_com)}
        listing.append({"file": file, "use": use, "payload": payload})
        if use == "train":
            worth.append(run["secret"][:, 1])
    document = {
        "name": folder.name,
        "description": "Twin of the medium robot under its own controller, six runs at 32 to 63 deg C.",
        "source": "wearscope.demonstration.twin",
        "robot": {
            "urdf": "robot.urdf",
            "joints": list(machine.joints),
            "inertials": "trusted",
            "gravity": list(machine.gravity),
            "torque_limit": limit.tolist(),
            "gear_ratio": list(machine.gear_ratio),
            "rotor_inertia": list(machine.rotor_inertia),
        },
        "sample_rate": RATE,
        "units": {"q": "rad", "tau": "N m"},
        "declared_effects": [
            "rigid_body", "rotor_inertia", "coulomb", "viscous", "temperature_dependent_friction",
        ],
        "runs": listing,
    }  # fmt: skip
    write_text(folder / "robot.urdf", machine.urdf)
    write_text(folder / "dataset.yaml", yaml.safe_dump(document, sort_keys=False))
    size = float(np.sqrt(np.mean(np.concatenate(worth) ** 2)) / sigma[1])
    truth: dict[str, Any] = {
        "dataset": folder.name,
        "robot": "twin",
        "seed": seed,
        "joints": list(machine.joints),
        "noise_rms": dict(zip(machine.joints, sigma[:n].tolist(), strict=True)),
        "planted": [{"effect": secret, "joint": "axis_2", "size": size}],
    }
    if truth_path is not None:
        write_text(truth_path, json.dumps(truth, indent=1))
    return truth
