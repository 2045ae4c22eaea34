"""The compiled step: it solves friction, rotors, gears and controller for the speeds half a step later.

PyBullet's step is ``v += dt M^-1 (torque - c)``, ``q += dt v``. With positions q at the instants t_k = k dt,
its speeds lie half a step between them (Stoermer-Verlet, leapfrog). So step k takes the speeds from
t_k - dt/2 to t_k + dt/2, and balances the torques at the mean of these speeds, which is the speed at t_k. A
step within which a motor comes to rest or reverses is split into parts at that moment, as friction jumps
there. PyBullet gets the mean torque on the links over the step; the bias torque that PyBullet computes from
its own state is taken into account.

Hairer, Lubich, Wanner 2003, Acta Numerica 12, for the leapfrog; Acary and Brogliato 2008, Numerical Methods
for Nonsmooth Dynamical Systems, sec. 7, for steps that end at events; `wearscope.simulation.balance`.
"""

import hashlib
from collections.abc import Callable
from pathlib import Path

from numba import njit

from wearscope.simulation.arrays import INNER, borrow, borrow_rows
from wearscope.simulation.balance import NO_BALANCE, REST, WHOLE, balance_part
from wearscope.simulation.dynamics import mass_and_bias
from wearscope.simulation.terms import remember, share_out

#: Modules of this room whose code is compiled into the step.
SOURCES = ("arrays", "balance", "chain", "dynamics", "step", "terms")
#: After this many parts, the rest of a step is taken at once, with the torques balanced at its end.
MAX_PARTS = 24
#: Share of a step that counts as an instant: a motor that reverses within it is set to rest.
INSTANT = 1e-5
#: Accelerations for the next first iterate come only from parts longer than this share of a step.
LASTING = 0.1


@njit(**INNER)
def _finish_part(law, gears, state, work, motion, k, length, h, start, lasting):
    """Set the speeds at the end of a part, and log speed and torque at t_k where the part contains it.

    `start` is the part's start, counted from t_k [s].
    """
    n = len(state.mode)
    for j in range(n):
        link = state.v[j] + (work.x[j] - state.v[j]) * (length / h)
        motor = state.y[j] + (motion.speed[j] - state.y[j]) * (length / h)
        if state.mode[j] == 0:
            motor = 0.0
        elif motor * state.mode[j] <= REST * abs(motor - state.y[j]):
            motor = 0.0
            state.mode[j] = 0
        if not gears.flexible[j]:
            link = motor
        if start <= 0.0 and start + length >= 0.0:
            work.speed[j], work.torque[j] = motor, work.motor[j]
            if h < length:
                work.speed[j] = state.y[j] - (motor - state.y[j]) * (start / length)
                torque = (
                    law.feedforward[k, j]
                    + law.stiffness[j] * (law.position[k, j] - state.q[j] - state.gap[j])
                    + law.damping[j] * (law.speed[k, j] - work.speed[j])
                )
                work.torque[j] = min(max(torque, -law.limit[j]), law.limit[j])
        if lasting:
            state.a_before[j] = state.a_motor[j]
            state.a_motor[j] = (motor - state.y[j]) / length
            state.a[j] = (link - state.v[j]) / length
        state.v[j], state.y[j] = link, motor


@njit(**INNER)
def _take_step(
    rows, terms, law, gears, state, work, motion, w, log, k, t, dt, start, warm, worn, may_trust
):  # fmt: skip
    """Take the speeds from t_k + `start` to t_k + dt/2; return False where the torques do not balance."""
    left = 0.5 * dt - start
    parts = 0
    while left > INSTANT * dt:
        length, ends = left, parts > MAX_PARTS
        while True:
            h = length if ends else 0.5 * length
            at = start + h
            if abs(at) < 1e-12 * dt:
                at = 0.0
            share = balance_part(
                rows, terms, law, gears, state, work, motion, w, k, at, h, t + at, dt, warm, worn,
                may_trust and length == dt, ends,
            )  # fmt: skip
            if share == WHOLE:
                break
            if share == NO_BALANCE:
                if ends:
                    return False
                ends = True
                continue
            if share * length <= INSTANT * dt:
                j = work.turning[0]
                state.mode[j] = 0
                state.y[j] = 0.0
                if not gears.flexible[j]:
                    state.v[j] = 0.0
            else:
                length *= share
            parts += 1
            ends = parts > MAX_PARTS
            if ends:
                length = left
        if len(log.terms) > 0:
            share_out(
                rows, terms, state.mode, motion, work.need, log.terms[k], length / dt, t + at, h, warm, worn
            )
            for j in range(len(state.q)):
                log.motor[k, j] += length / dt * work.motor[j]
                log.rotor[k, j] += length / dt * gears.armature[j] * motion.acceleration[j]
        remember(rows, terms, motion, t + at, length, warm, worn)
        _finish_part(law, gears, state, work, motion, k, length, h, start, length > LASTING * dt)
        start += length
        left -= length
        parts += 1
    return True


def _stamp_sources() -> int:
    """Return a digest of the source files that are compiled into the step.

    Numba notices changes only in the file of the cached function itself. The digest is a closure variable of
    the compiled function and so part of its cache key: a change of any of the files compiles the step anew.
    """
    files = [Path(__file__).with_name(f"{name}.py") for name in SOURCES]
    return int(hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()[:12], 16)


def _compile_advance(stamp: int) -> Callable:
    """Return the compiled function that advances a block of steps; `stamp` is part of its cache key."""

    @njit(cache=True, error_model="numpy")
    def advance_block(
        rows, terms, law, gears, plant, bodies, ghost, state, work, motion, w, v, log,
        temperature, wear, t0, dt, first, last,
    ):  # fmt: skip
        """Take steps `first` to `last` (exclusive) from `state`, which then holds the state after them.

        Step 0 takes the speeds from t0 to half a step later; before it, `state` holds the speeds at t0.

        Parameters
        ----------
        rows, terms : typed.List, Terms
        law : Law
        gears : Gears
        plant, bodies : Chain
            The true robot, and the robot that PyBullet holds; they differ where `ghost` is true.
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
            -1, or the index of the step that has no solution.
        """
        if stamp < 0:
            return first
        terms, law, gears, plant, bodies = (
            borrow(terms), borrow(law), borrow(gears), borrow(plant), borrow(bodies),
        )  # fmt: skip
        state, work, motion, w, v, log = (
            borrow(state), borrow(work), borrow(motion), borrow(w), borrow(v), borrow(log),
        )  # fmt: skip
        temperature, wear = borrow((temperature, wear))
        rows = borrow_rows(rows)
        n = len(state.q)
        # Terms with memory, coupling or load use values of the last evaluation. A correction must therefore
        # not be accepted without another evaluation.
        may_trust = not (terms.remembers.any() or terms.coupled.any() or terms.loaded.any())
        for k in range(first, last):
            start = 0.0 if k == 0 else -0.5 * dt
            for j in range(n):
                work.start[j] = state.v[j]
                work.middle[j] = state.v[j] - start * state.a[j]
            mass_and_bias(plant, state.q, work.middle, work.start, w)
            warm = temperature[min(k, len(temperature) - 1)]
            worn = wear[min(k, len(wear) - 1)]
            if not _take_step(
                rows, terms, law, gears, state, work, motion, w, log, k, t0 + k * dt, dt, start, warm, worn,
                may_trust,
            ):  # fmt: skip
                return k
            if ghost:
                mass_and_bias(bodies, state.q, work.start, work.start, v)
            body = v if ghost else w
            for j in range(n):
                work.rate[j] = (state.v[j] - work.start[j]) / dt
            for j in range(n):
                log.position[k, j] = state.q[j] + state.gap[j]
                log.speed[k, j] = work.speed[j]
                log.torque[k, j] = work.torque[j]
                torque = body.start_bias[j]
                for c in range(n):
                    torque += body.mass_matrix[j, c] * work.rate[c]
                log.applied[k, j] = torque
                if len(log.bias) > 0:
                    links = (0.5 - start / dt) * w.bias[j]
                    for c in range(n):
                        links += w.mass_matrix[j, c] * work.rate[c]
                    log.bias[k, j] = torque - links
            for j in range(n):
                if gears.flexible[j]:
                    state.gap[j] += dt * (state.y[j] - state.v[j])
                state.q[j] += dt * state.v[j]
        return -1

    return advance_block


advance_block = _compile_advance(_stamp_sources())
