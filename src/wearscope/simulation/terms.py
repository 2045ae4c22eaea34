"""Torque terms of a plant's effects, packed into arrays for the compiled step."""

from collections import namedtuple
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numba import njit, typed

from wearscope.effects.base import Plant, Term
from wearscope.effects.rows import hold_rows
from wearscope.simulation.arrays import INNER

#: Difference of speed [rad/s or m/s] over which the slope of a torque is measured.
PROBE = 1e-7


class Terms(
    namedtuple("Terms", "joint width coefficients shape state next_state remembers coupled loaded out")
):
    """Torque terms in the order of their joints.

    Attributes
    ----------
    joint : ndarray of int (m,)
    width : ndarray of int (m,)
        Number of coefficients of each term.
    coefficients, shape : ndarray (m, widest)
    state, next_state : ndarray (m, most states)
        Internal states of the terms, and their values after the step.
    remembers : ndarray of bool (m,)
        Whether a term has internal states.
    coupled : ndarray of bool (n,)
        Whether a term of the joint depends on the motion of another joint.
    loaded : ndarray of bool (n,)
        Whether a term of the joint depends on the load of its links. The load, and so the torque, changes
        with the accelerations of all joints.
    out : ndarray (widest,)
        Scratch memory for the regressor row of one term.
    """


@lru_cache(maxsize=256)
def _find_dependence(
    row: Callable, joint: int, n: int, width: int, shape: tuple[float, ...], n_states: int
) -> tuple[bool, bool]:
    """Return whether a term depends on the motion of other joints, and whether it depends on the load."""
    state, fixed = np.zeros(max(n_states, 1)), np.full(n, 0.7)

    def ask(others: float, load: float) -> np.ndarray:
        moved, out = np.full(n, others), np.zeros(width)
        moved[joint] = 0.7
        row(
            joint, 0.0, 1e-3, moved, fixed, moved, moved, np.full(n, load), fixed, fixed,
            np.array(shape), state, state.copy(), out,
        )  # fmt: skip
        return out

    here = ask(0.0, 0.7)
    coupled, loaded = (not np.array_equal(here, ask(*k), equal_nan=True) for k in ((1.0, 0.7), (0.0, 0.8)))
    return coupled, loaded


def order_terms(plant: Plant) -> list[Term]:
    """Return the terms of a plant sorted by joint."""
    return sorted(plant.terms, key=lambda term: term.joint)


def pack_terms(plant: Plant) -> tuple[typed.List, Terms]:
    """Pack the terms of a plant.

    Parameters
    ----------
    plant : Plant

    Returns
    -------
    rows : typed.List (m,)
        Compiled function of each term, which computes its regressor row.
    Terms
    """
    ordered = order_terms(plant)
    rows = hold_rows(tuple(term.row for term in ordered))
    m = len(ordered)
    widest = max([1, *(len(t.coefficients) for t in ordered)])
    deepest = max([1, *(len(t.shape) for t in ordered)])
    memory = max([1, *(t.n_states for t in ordered)])
    coefficients, shape = np.zeros((max(m, 1), widest)), np.zeros((max(m, 1), deepest))
    depends = np.zeros((plant.n, 2), dtype=bool)
    for i, term in enumerate(ordered):
        coefficients[i, : len(term.coefficients)] = term.coefficients
        shape[i, : len(term.shape)] = term.shape
        depends[term.joint] |= _find_dependence(
            term.row, term.joint, plant.n, len(term.coefficients), tuple(term.shape), term.n_states
        )
    return rows, Terms(
        joint=np.array([term.joint for term in ordered], dtype=np.int64),
        width=np.array([len(t.coefficients) for t in ordered], dtype=np.int64),
        coefficients=coefficients,
        shape=shape,
        state=np.zeros((max(m, 1), memory)),
        next_state=np.zeros((max(m, 1), memory)),
        remembers=np.array([t.n_states > 0 for t in ordered], dtype=bool),
        coupled=depends[:, 0].copy(),
        loaded=depends[:, 1].copy(),
        out=np.zeros(widest),
    )


@njit(cache=True, **INNER)
def _evaluate(row, terms, i, after, j, t, dt, motion, temperature, wear):
    """Return the torque of term `i` at joint `j`; write its internal states after the step to `after`."""
    sign, q, y, a, load = motion
    row(
        j, t, dt, sign, q, y, a, load, temperature, wear,
        terms.shape[i], terms.state[i], after[i], terms.out,
    )  # fmt: skip
    torque = 0.0
    for c in range(terms.width[i]):
        torque += terms.coefficients[i, c] * terms.out[c]
    return torque


@njit(cache=True, error_model="numpy")
def _probe_slopes(
    row, terms, i, here, mode, speed_before, jacobian, inertia, j, t, dt, motion, temperature, wear
):  # fmt: skip
    """Add to `jacobian` the slopes of a term's torque against the speeds that it may depend on.

    `inertia` (n, n) is the derivative of a joint's load by the accelerations; it is that of the links behind
    rigid gears, and 0 elsewhere.
    """
    load, moves_load = motion.load[j], terms.loaded[j] and inertia[j, j] > 0.0
    for other in range(len(mode)):
        if mode[other] == 0 or (other != j and not (terms.coupled[j] or moves_load)):
            continue
        speed, probe = motion.speed[other], PROBE * mode[other]
        motion.speed[other] = speed + probe
        motion.acceleration[other] = (speed + probe - speed_before[other]) / dt
        motion.load[j] = load + inertia[j, other] * probe / dt
        probed = _evaluate(row, terms, i, terms.next_state, j, t, dt, motion, temperature, wear)
        motion.speed[other], motion.load[j] = speed, load
        motion.acceleration[other] = (speed - speed_before[other]) / dt
        jacobian[j, other] += (probed - here) / probe


@njit(cache=True, **INNER)
def evaluate_terms(
    rows, terms, mode, speed_before, slope, jacobian, inertia, motion, low, high, t, dt, temperature, wear
):
    """Compute the torque of the effects at each motor, and its slopes against speed where they are needed.

    Parameters
    ----------
    rows, terms
        From `pack_terms`; ``terms.next_state`` receives the internal states after the step.
    mode : ndarray of int (n,)
        Direction of motion; at 0 (rest) the torque is computed just below and just above zero speed.
    speed_before : ndarray (n,)
        Motor speed at the step's start, to which accelerations refer.
    slope : ndarray (n,)
        Slope of each joint's torque against its own speed. It is measured where it is NaN, and always at a
        coupled joint.
    jacobian : ndarray (n, n)
        Receives the slopes of coupled joints' torques against the speeds of the other joints.
    inertia : ndarray (n, n)
        Change of each joint's load with each joint's acceleration; 0 where the slopes are to neglect it.
    motion : Motion
    low, high : ndarray (n,)
        Receive the torque: equal for a moving joint, the two ends of its range for a joint at rest.
    t, dt : float
        Time, and the time since that of the internal states [s].
    temperature, wear : ndarray (n,)
    """
    n = len(mode)
    for j in range(n):
        low[j] = 0.0
        high[j] = 0.0
        if terms.coupled[j] or np.isnan(slope[j]):
            jacobian[j, :] = 0.0
    for i in range(len(terms.joint)):
        j, row = terms.joint[i], rows[i]
        here = 0.0
        # At rest a row is evaluated on both sides: first below rest, for `low`; then above rest, for `high`,
        # which in motion is the only value.
        for side in range(1 if mode[j] != 0 else 2):
            if mode[j] == 0:
                low[j] += here
                here = 0.0
                motion.sign[j] = 2.0 * side - 1.0
            # Called here and not through `_evaluate`: handing a row on doubles the time of its call.
            row(
                j, t, dt, motion.sign, motion.position, motion.speed, motion.acceleration, motion.load,
                temperature, wear, terms.shape[i], terms.state[i], terms.next_state[i], terms.out,
            )  # fmt: skip
            for c in range(terms.width[i]):
                here += terms.coefficients[i, c] * terms.out[c]
        high[j] += here
        if mode[j] == 0:
            motion.sign[j] = 0.0
            continue
        if terms.coupled[j] or np.isnan(slope[j]):
            _probe_slopes(
                row, terms, i, here, mode, speed_before, jacobian, inertia, j, t, dt, motion, temperature,
                wear,
            )  # fmt: skip
    for j in range(n):
        if mode[j] != 0:
            low[j] = high[j]
            if terms.coupled[j] or np.isnan(slope[j]):
                slope[j] = jacobian[j, j]
        elif low[j] > high[j]:
            low[j], high[j] = high[j], low[j]


@njit(error_model="numpy")
def share_out(rows, terms, mode, motion, need, shares, weight, t, dt, temperature, wear):
    """Add the torque of each term, times a weight, to `shares` (m,).

    At a motor at rest the terms' sum is the torque that holds it. Each term then lies at the same fraction of
    its range between the torques below and above rest.
    """
    below, above = np.zeros(len(mode)), np.zeros(len(mode))
    lowest = np.zeros(len(shares))
    for i in range(len(terms.joint)):
        j = terms.joint[i]
        motion.sign[j] = mode[j] if mode[j] != 0 else -1.0
        lowest[i] = _evaluate(rows[i], terms, i, terms.next_state, j, t, dt, motion, temperature, wear)
        below[j] += lowest[i]
        if mode[j] == 0:
            motion.sign[j] = 1.0
            above[j] += _evaluate(rows[i], terms, i, terms.next_state, j, t, dt, motion, temperature, wear)
    for i in range(len(terms.joint)):
        j = terms.joint[i]
        torque = lowest[i]
        if mode[j] == 0:
            motion.sign[j] = 1.0
            most = _evaluate(rows[i], terms, i, terms.next_state, j, t, dt, motion, temperature, wear)
            width = above[j] - below[j]
            torque += (most - torque) * ((need[j] - below[j]) / width if width != 0.0 else 0.0)
            motion.sign[j] = 0.0
        shares[i] += weight * torque


@njit(**INNER)
def remember(rows, terms, motion, t, dt, temperature, wear):
    """Advance the internal states of the terms by `dt` [s]."""
    for i in range(len(terms.joint)):
        if not terms.remembers[i]:
            continue
        _evaluate(rows[i], terms, i, terms.next_state, terms.joint[i], t, dt, motion, temperature, wear)
        # One by one: the assignment of a whole row takes 3 s more to compile.
        for c in range(terms.state.shape[1]):
            terms.state[i, c] = terms.next_state[i, c]
