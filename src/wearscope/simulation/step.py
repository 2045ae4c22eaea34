"""The compiled step: friction, rotors, gears and controller solved for the speed at the step's end.

At step k from state (q, v), with M, h the links' mass matrix and bias torque there, the speeds of links x and
of motors y at the end of the step solve, joint by joint,

    M (x - v)/dt + h = g                                  links
    J (y - v_motor)/dt + tau(y) + g = u(y)                motors
    x = y                     where the gear is rigid, g is then what the links need
    deflection(g) = gap + dt (y - x)  where it is not

with J the rotor inertia, tau the effects' torque, u the saturated controller torque and g the torque through
the gear. tau is set-valued at y = 0: a motor stays at rest exactly where the torque that holds it there lies
between tau(0-) and tau(0+). The torques g are what the bodies in PyBullet get. A Newton iteration with an
active set of motors at rest solves this; slopes of tau come from the iterates themselves.

Otter, Elmqvist, Mattsson 1999, IEEE CACSD, for friction as a set; Anitescu and Potra 1997, Nonlinear Dynamics
14(3), for taking it at the step's end.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit

from wearscope.simulation.arrays import INNER
from wearscope.simulation.dynamics import mass_and_bias
from wearscope.simulation.gear import deflection_slope, invert_deflection
from wearscope.simulation.terms import evaluate_terms

#: Modules of this room that the compiled step is made of.
SOURCES = ("arrays", "chain", "dynamics", "gear", "step", "terms")
MAX_ITERATIONS = 80
#: After these iterations only the joint that is furthest beyond break-away is released at a time.
PATIENCE = 25
#: A correction is trusted where it leaves this many times less than the tolerance, if the last rate of
#: convergence still holds; that is looked at after this many steps at the latest.
SAFETY, TRUST = 3.0, 50.0


@njit(**INNER)
def _solve(a, b):
    """Solve a x = b in place, without pivoting; False where a pivot vanishes or is negative."""
    n = len(b)
    for i in range(n):
        pivot = a[i, i]
        if not pivot > 0.0:
            return False
        for r in range(i + 1, n):
            if a[r, i] != 0.0:
                factor = a[r, i] / pivot
                for c in range(i + 1, n):
                    a[r, c] -= factor * a[i, c]
                b[r] -= factor * b[i]
    for i in range(n - 1, -1, -1):
        for c in range(i + 1, n):
            b[i] -= a[i, c] * b[c]
        b[i] /= a[i, i]
    return True


@njit(**INNER)
def _set_speed(motion, state, j, speed, dt):
    motion.speed[j] = speed
    motion.acceleration[j] = (speed - state.y[j]) / dt


@njit(**INNER)
def _learn_slopes(terms, state, work, motion):
    """Take the slopes of the effects' torques from the last two iterates."""
    mode, y = state.mode, motion.speed
    for j in range(len(mode)):
        moved = y[j] - work.old_speed[j]
        if mode[j] != 0 and work.old_mode[j] == mode[j] and abs(moved) > 1e-9 and not terms.coupled[j]:
            state.slope[j] = (work.high[j] - work.old_torque[j]) / moved
        work.old_speed[j], work.old_torque[j], work.old_mode[j] = y[j], work.high[j], mode[j]


@njit(**INNER)
def _balance(law, gears, state, work, motion, w, k, dt):
    """Torques of motors and gears at the iterate; what the links miss, over its tolerance."""
    n = len(state.mode)
    mass, bias, y, x = w.mass_matrix, w.bias, motion.speed, work.x
    missing = 0.0
    for j in range(n):
        ahead = law.position[k + 1, j] - state.q[j] - state.gap[j] - dt * y[j]
        motor = law.feedforward[k, j] + law.stiffness[j] * ahead + law.damping[j] * (law.speed[k, j] - y[j])
        work.free[j] = law.damping[j] + dt * law.stiffness[j]
        if abs(motor) > law.limit[j]:
            motor = np.copysign(law.limit[j], motor)
            work.free[j] = 0.0
        work.motor[j] = motor
        links = bias[j]
        for c in range(n):
            links += mass[j, c] * (x[c] - state.v[c]) / dt
        if gears.flexible[j]:
            gap = state.gap[j] + dt * (y[j] - x[j])
            gear = invert_deflection(gap, gears.compliance[j], gears.lost_motion[j], gears.mesh_torque[j])
            work.stiff[j] = dt / deflection_slope(
                gear, gears.compliance[j], gears.lost_motion[j], gears.mesh_torque[j]
            )
            work.residual[j] = gear - links
            missing = max(missing, abs(work.residual[j]) / gears.tolerance[j])
        else:
            gear = links
            work.residual[j] = 0.0
        work.links[j] = links
        work.need[j] = motor - gear - gears.armature[j] * motion.acceleration[j]
    return missing


@njit(**INNER)
def _release(gears, state, work, motion, single):
    """Release motors at rest that need more than friction can give; say whether any was."""
    worst, beyond = -1, 0.0
    any_released = False
    for j in range(len(state.mode)):
        if state.mode[j] != 0:
            continue
        excess = max(work.need[j] - work.high[j], work.low[j] - work.need[j])
        if excess <= gears.tolerance[j]:
            continue
        any_released = True
        if not single:
            _let_go(state, work, motion, j)
        elif excess > beyond:
            worst, beyond = j, excess
    if single and worst >= 0:
        _let_go(state, work, motion, worst)
    return any_released


@njit(**INNER)
def _let_go(state, work, motion, j):
    state.mode[j] = 1 if work.need[j] > work.high[j] else -1
    motion.sign[j] = state.mode[j]
    state.slope[j] = np.nan


@njit(**INNER)
def _correct(gears, terms, state, work, motion, w, dt):
    """One Newton step of speeds; motors whose direction would turn come to rest.

    Returns how many did, or -1 where the system is singular.
    """
    n = len(state.mode)
    mass, mode, y, a, b = w.mass_matrix, state.mode, motion.speed, work.matrix, work.held
    for j in range(n):
        for c in range(n):
            a[j, c] = mass[j, c]
        inertia = gears.armature[j] / dt
        damping = max(state.slope[j], -0.5 * (inertia + (0.0 if gears.flexible[j] else mass[j, j] / dt)))
        motor = inertia + damping + work.free[j]
        if gears.flexible[j]:
            stiff = work.stiff[j]
            if mode[j] != 0:
                missing = work.need[j] - work.high[j]
                a[j, j] += dt * stiff * motor / (motor + stiff)
                b[j] = dt * (work.residual[j] + stiff * missing / (motor + stiff))
            else:
                a[j, j] += dt * stiff
                b[j] = dt * work.residual[j]
        elif mode[j] != 0:
            a[j, j] += dt * motor
            b[j] = dt * (work.need[j] - work.high[j])
            if terms.coupled[j]:
                for c in range(n):
                    if c != j:
                        a[j, c] += dt * work.jacobian[j, c]
        else:
            b[j] = 0.0
    for j in range(n):
        if mode[j] == 0 and not gears.flexible[j]:
            for c in range(n):
                a[j, c] = 0.0
                a[c, j] = 0.0
            a[j, j] = 1.0
    if not _solve(a, b):
        return -1
    for j in range(n):
        work.change[j] = b[j]
        if gears.flexible[j]:
            work.change[j] = 0.0
            if mode[j] != 0:
                inertia = gears.armature[j] / dt
                motor = inertia + max(state.slope[j], -0.5 * inertia) + work.free[j]
                missing = work.need[j] - work.high[j] + work.stiff[j] * b[j]
                work.change[j] = missing / (motor + work.stiff[j])
    share = _shorten(gears, state, work, motion, dt)
    turned = 0
    for j in range(n):
        work.x[j] += share * b[j]
        if mode[j] == 0:
            continue
        speed = y[j] + share * work.change[j]
        if mode[j] * speed < 0.0:
            speed = 0.0
            mode[j] = 0
            turned += 1
        _set_speed(motion, state, j, speed, dt)
        motion.sign[j] = mode[j]
        if not gears.flexible[j]:
            work.x[j] = speed
    return turned


@njit(**INNER)
def _shorten(gears, state, work, motion, dt):
    """Share of the Newton step that no gear's torque answers by far more than its slope says.

    A gear hardens where its lost motion is taken up: a full step from within it overshoots by far.
    """
    share = 1.0
    for j in range(len(state.mode)):
        if not gears.flexible[j] or gears.lost_motion[j] == 0.0:
            continue
        before = work.residual[j] + work.links[j]
        for _ in range(40):
            speed = motion.speed[j] - work.x[j] + share * (work.change[j] - work.held[j])
            after = invert_deflection(
                state.gap[j] + dt * speed, gears.compliance[j], gears.lost_motion[j], gears.mesh_torque[j]
            )
            said = share * work.stiff[j] * (work.change[j] - work.held[j])
            if abs(after - before - said) <= 3.0 * abs(said) + gears.tolerance[j]:
                break
            share *= 0.5
    return share


@njit(**INNER)
def _begin(state, work, motion, gears, w, dt):
    """First iterate: the acceleration of the step before goes on."""
    n = len(state.mode)
    for j in range(n):
        load = w.bias[j]
        for c in range(n):
            load += w.mass_matrix[j, c] * state.a[c]
        motion.load[j] = load
        motion.position[j] = state.q[j] + state.gap[j]
        speed = 0.0
        if state.mode[j] != 0:
            speed = state.y[j] + dt * (2.0 * state.a_motor[j] - state.a_before[j])
            if speed * state.mode[j] < 0.0:
                speed = state.y[j]
        _set_speed(motion, state, j, speed, dt)
        motion.sign[j] = state.mode[j]
        work.x[j] = state.v[j] + dt * state.a[j] if gears.flexible[j] else speed
        work.old_mode[j] = 0


@njit(**INNER)
def _solve_step(rows, terms, law, gears, state, work, motion, w, k, t, dt, temperature, wear, may_trust):
    """Iterate until the torques balance; False where they do not.

    As the steps are alike, the last rate of convergence tells whether one correction is enough, without
    asking for the effects again: Hairer and Wanner, Solving Ordinary Differential Equations II, sec. IV.8.
    """
    _begin(state, work, motion, gears, w, dt)
    before = 0.0
    for iteration in range(MAX_ITERATIONS):
        evaluate_terms(
            rows, terms, state.mode, state.y, state.slope, work.jacobian, motion, work.low, work.high,
            t, dt, temperature, wear,
        )  # fmt: skip
        _learn_slopes(terms, state, work, motion)
        missing = _balance(law, gears, state, work, motion, w, k, dt)
        for j in range(len(state.mode)):
            if state.mode[j] != 0:
                missing = max(missing, abs(work.need[j] - work.high[j]) / gears.tolerance[j])
        if before > 0.0:
            state.pace[0], state.pace[1] = missing / before, 0.0
        if missing <= 1.0:
            # What a motor at rest needs is known only now.
            if not _release(gears, state, work, motion, iteration > PATIENCE):
                return True
            before = 0.0
            continue
        turned = _correct(gears, terms, state, work, motion, w, dt)
        if turned < 0:
            return False
        before = 0.0 if turned > 0 else missing
        sure = SAFETY * state.pace[0] * missing <= 1.0 and state.pace[1] < TRUST
        if may_trust and iteration == 0 and turned == 0 and sure:
            _balance(law, gears, state, work, motion, w, k, dt)
            if not _release(gears, state, work, motion, False):
                state.pace[1] += 1.0
                return True
            before = 0.0
    return False


def _stamp_sources() -> int:
    """Digest of the sources that the compiled step is made of.

    Numba looks for changes in a cached function's own file only. The digest, as a variable of the function,
    is part of what its cache is looked up by; functions of this file that use others' are not cached.
    """
    files = [Path(__file__).with_name(f"{name}.py") for name in SOURCES]
    return int(hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12], 16)


def _compile_advance(stamp: int) -> Callable:
    @njit(cache=True, error_model="numpy")
    def advance_block(
        rows, terms, law, gears, plant, bodies, ghost, state, work, motion, w, v, log,
        temperature, wear, t0, dt, first, last,
    ):  # fmt: skip
        """Take steps `first` to `last` (exclusive) from `state`, which is left at their end.

        Parameters
        ----------
        rows, terms : typed.List, Terms
        law : Law
        gears : Gears
        plant, bodies : Chain
            The robot as it is, and as PyBullet holds it; they differ where `ghost` is set.
        state : State
        work, motion, w, v : Work, Motion, Scratch, Scratch
        log : Log
            Rows `first` to `last` are written.
        temperature, wear : ndarray (1 or N, n)
            [deg C], [-].
        t0, dt : float
            Start and step [s].

        Returns
        -------
        int
            -1, or the step that has no solution.
        """
        if stamp < 0:
            return first
        n = len(state.q)
        # Memory and coupling are taken from the last evaluation.
        may_trust = not (terms.remembers.any() or terms.coupled.any())
        for k in range(first, last):
            mass_and_bias(plant, state.q, state.v, w)
            warm = temperature[min(k, len(temperature) - 1)]
            worn = wear[min(k, len(wear) - 1)]
            t = t0 + k * dt
            if not _solve_step(
                rows, terms, law, gears, state, work, motion, w, k, t, dt, warm, worn, may_trust
            ):
                return k
            for j in range(n):
                log.position[k, j] = motion.position[j]
                log.speed[k, j] = motion.speed[j]
                log.torque[k, j] = work.motor[j]
                log.applied[k, j] = work.links[j]
            for i in range(len(terms.joint)):
                if terms.remembers[i]:
                    # One by one: the assignment of a whole row takes 3 s more to compile.
                    for c in range(terms.state.shape[1]):
                        terms.state[i, c] = terms.next_state[i, c]
            if ghost:
                mass_and_bias(bodies, state.q, state.v, v)
                for j in range(n):
                    torque = v.bias[j]
                    for c in range(n):
                        torque += v.mass_matrix[j, c] * (work.x[c] - state.v[c]) / dt
                    log.applied[k, j] = torque
            for j in range(n):
                state.a[j] = (work.x[j] - state.v[j]) / dt
                state.a_before[j] = state.a_motor[j]
                state.a_motor[j] = motion.acceleration[j]
                if gears.flexible[j]:
                    state.gap[j] += dt * (motion.speed[j] - work.x[j])
                state.v[j] = work.x[j]
                state.y[j] = motion.speed[j]
                state.q[j] += dt * work.x[j]
        return -1

    return advance_block


advance_block = _compile_advance(_stamp_sources())
