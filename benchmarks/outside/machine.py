"""Torque of a machine: along a given motion, through a gear that bends, or while a controller drives it."""

import numpy as np
import pinocchio as pin

from benchmarks.outside.motions import Motion

#: Stiffness within a gear's lost motion, over that beyond it.
_SOFT = 0.05


def make_model(arm):
    """Pinocchio's model of an arm."""
    model = pin.buildModelFromXML(arm.urdf())
    model.gravity.linear = np.asarray(arm.gravity, dtype=float)
    return model


def inverse_dynamics(arm, q, v, a):
    """Rigid-body torque (M, n) along a motion."""
    model = make_model(arm)
    data = model.createData()
    return np.array(
        [pin.rnea(model, data, *row) for row in zip(*np.asarray([q, v, a], dtype=float), strict=True)]
    )


def inertial_regressor(arm, motion, rows):
    """Columns (len(rows) n, 10 n) of all inertial parameters, row by row of the motion."""
    model = make_model(arm)
    data = model.createData()
    parts = [
        pin.computeJointTorqueRegressor(model, data, motion.q[k], motion.v[k], motion.a[k]).copy()
        for k in rows
    ]
    return np.vstack(parts)


def slide(v, dt, presliding):
    """Bristle deflection over its largest (M,) of LuGre friction with a constant level.

    Parameters
    ----------
    v : ndarray (M,)
    dt : float
    presliding : float
        Deflection at which it slides.
    """
    z, out = 0.0, np.empty(len(v))
    for k, speed in enumerate(v):
        z = (z + speed * dt) / (1.0 + abs(speed) * dt / presliding)
        out[k] = z / presliding
    return out


def bend(arm, motion, j, stiffness, lost=0.0, damping=0.1):
    """Motion of the links behind a gear at joint j that bends, the motor being where `motion` says.

    The link of joint j is simulated, all other joints are where `motion` says.

    Parameters
    ----------
    arm : Arm
    motion : Motion
        At a rate fine enough to integrate with.
    j : int
    stiffness : float
        [torque/position]
    lost : float
        Half the lost motion, within which the gear is soft.
    damping : float
        Of the link on its gear, over the critical one.

    Returns
    -------
    Motion
        Of the links.
    gear : ndarray (M,)
        Torque through the gear.
    """
    model = make_model(arm)
    data = model.createData()
    still = make_model(arm)
    still.gravity.linear = np.zeros(3)
    dt = motion.t[1] - motion.t[0]
    q, v, a = motion.q.copy(), motion.v.copy(), motion.a.copy()
    gear = np.empty(len(q))
    unit, zero = np.eye(len(arm.joints))[j], np.zeros(len(arm.joints))
    load = pin.rnea(model, data, q[0], v[0], a[0])[j]
    x, speed = q[0, j] - load / stiffness - lost * np.sign(load), v[0, j]
    for k in range(len(q)):
        q[k, j], v[k, j], a[k, j] = x, speed, 0.0
        rest = pin.rnea(model, data, q[k], v[k], a[k])[j]
        inertia = pin.rnea(still, data, q[k], zero, unit)[j]
        wound = motion.q[k, j] - x
        wound -= (1.0 - _SOFT) * np.clip(wound, -lost, lost)
        drag = 2 * damping * np.sqrt(stiffness * inertia) * (motion.v[k, j] - speed)
        gear[k] = stiffness * wound + drag
        a[k, j] = (gear[k] - rest) / inertia
        speed += dt * a[k, j]
        x += dt * speed
    return Motion(motion.t, q, v, a), gear


def follow(arm, wanted, extra, rng, stiffness=30.0, disturbance=0.0, presliding=3e-5):
    """A controller makes the arm follow a motion; friction sticks, and a torque disturbance is in the loop.

    Parameters
    ----------
    arm : Arm
    wanted : Motion
        At the integration's rate.
    extra : callable
        Torque (n,) that further effects take, of (t, q, v, a, load);
        `a` and `load` are those of the step before.
    rng : Generator
    stiffness : float
        Bandwidth of the position loop [rad/s].
    disturbance : float
        Standard deviation, over the joint's largest wanted torque, of a disturbance with 20 ms memory.
    presliding : float
        Deflection at which LuGre friction slides, over the joint's largest speed [s]; its bristles are
        damped.

    Returns
    -------
    Motion
    torque : ndarray (M, n)
        That the motors give.
    """
    model = make_model(arm)
    data = model.createData()
    dt = wanted.t[1] - wanted.t[0]
    rotor, coulomb, viscous = (arm.column(f) for f in ("rotor", "coulomb", "viscous"))
    size = np.abs(inverse_dynamics(arm, wanted.q[::50], wanted.v[::50], wanted.a[::50])).max(0) + coulomb
    top = np.abs(wanted.v).max(0)
    deflection = presliding * top
    memory = np.exp(-dt / 0.02)
    q, v = wanted.q[0].copy(), wanted.v[0].copy()
    z, summed, pushed, acceleration = np.zeros((4, len(q)))
    load = pin.rnea(model, data, q, v, acceleration)
    out, torque = np.empty((3, len(wanted.t), len(q))), np.empty((len(wanted.t), len(q)))
    for k in range(len(wanted.t)):
        mass = pin.crba(model, data, q)
        mass = np.triu(mass) + np.triu(mass, 1).T + np.diag(rotor)
        error, slip = wanted.q[k] - q, wanted.v[k] - v
        summed += dt * error
        feed = wanted.a[k] + stiffness**2 * error + 2 * stiffness * slip + stiffness**3 / 4 * summed
        command = np.diag(mass) * feed + 0.9 * load + 0.8 * coulomb * np.tanh(wanted.v[k] / (0.01 * top))
        pushed = memory * pushed + np.sqrt(1 - memory**2) * disturbance * size * rng.normal(size=len(q))
        before = z.copy()
        z = (z + v * dt) / (1.0 + np.abs(v) * dt / deflection)
        bristle = coulomb * z / deflection + np.sqrt(coulomb / deflection * np.diag(mass)) * (z - before) / dt
        friction = bristle + viscous * v + extra(wanted.t[k], q, v, acceleration, load)
        bias = pin.rnea(model, data, q, v, np.zeros_like(q))
        acceleration = np.linalg.solve(mass, command + pushed - bias - friction)
        out[:, k], torque[k] = (q, v, acceleration), command
        load = bias + (mass - np.diag(rotor)) @ acceleration
        v = v + dt * acceleration
        q = q + dt * v
    return Motion(wanted.t, *out), torque
