"""Compiled rows of effects: their signature, their stacking along signals, and the plant they change.

The row of an effect computes the regressors of one sample. Identification and the simulator use the same row.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numba import njit, typed, types


@dataclass
class Term:
    """A torque term in a simulated plant: the row of an effect at a joint, with parameter values."""

    row: Callable
    joint: int
    shape: np.ndarray
    coefficients: np.ndarray
    n_states: int
    effect: str = ""


@dataclass
class Plant:
    """All that effects change in a simulated robot of `n` joints.

    Attributes
    ----------
    terms : list of Term
        Torques at the motors, which the simulated step balances with the others.
    armature : ndarray (n,)
        Inertia on the motor side of the gear, reflected to the joint [kg m^2 or kg].
    inertials : ndarray (n, 10)
        Additional inertial parameters of each joint's link, in its frame: mass [kg], first moments [kg m],
        inertia about the frame's origin [kg m^2] (xx, xy, yy, xz, yz, zz).
    compliance : ndarray (n,)
        Deflection of the gear for each unit of torque [rad/(N m) or m/N]; 0 is rigid.
    lost_motion : ndarray (n,)
        Total lost motion of the gear at torque reversal [rad or m].
    mesh_torque : ndarray (n,)
        Torque at which the lost motion is taken up [N m or N]: the deflection is
        ``lost_motion / 2 * tanh(torque / mesh_torque)``.
    torque_gain, torque_delay : ndarray (n,)
        Gain error [-] and lag [s] of the recorded torque.
    """

    n: int
    terms: list[Term] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.armature = np.zeros(self.n)
        self.inertials = np.zeros((self.n, 10))
        self.compliance = np.zeros(self.n)
        self.lost_motion = np.zeros(self.n)
        self.mesh_torque = np.ones(self.n)
        self.torque_gain = np.zeros(self.n)
        self.torque_delay = np.zeros(self.n)


_VECTOR = types.Array(types.float64, 1, "C")

#: Signature of an effect's row, called for joint `j` of `n`:
#: ``row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out)``.
#: The vectors `sign` to `wear` are (n,), in joint order. `sign` is the direction of motion, -1 to 1. It is
#: separate from `v`, so that the simulator can compute the torque on both sides of rest. `load` is the torque
#: of the rigid body. The row writes `next_state` and `out`.
ROW = types.void(
    types.int64,
    types.float64,
    types.float64,
    *([_VECTOR] * 7),
    _VECTOR,
    _VECTOR,
    _VECTOR,
    _VECTOR,
)

#: Compiles an effect's row.
compile_row: Callable = njit(ROW, cache=True)


@njit(types.float64(types.float64, types.float64), cache=True)
def decay(ratio, power):
    """Return ``exp(-ratio^power)``, the decay of Stribeck friction; the usual power of 1 is faster."""
    return np.exp(-(ratio if power == 1.0 else ratio**power))


@njit(types.float64(types.float64, types.float64), cache=True)
def saturate(change, rate):
    """Return ``(1 - exp(-rate change)) / rate``, or the change itself at a rate of 0."""
    return -np.expm1(-rate * change) / rate if rate > 0.0 else change


_MATRIX = types.Array(types.float64, 2, "C")


#: Numba's type of a row as a first-class function. Code that takes rows of this type is compiled once for all
#: effects and cached on disk; with dispatchers as arguments it would be compiled in every process.
ROW_FUNCTION = types.FunctionType(ROW)
ROWS = types.ListType(ROW_FUNCTION)


# These two functions are cached on disk; the methods of a typed list would be compiled in every process.
@njit(ROWS(), cache=True)
def _start_rows():
    """Return an empty typed list of rows."""
    return typed.List.empty_list(ROW_FUNCTION)


@njit(types.void(ROWS, ROW_FUNCTION), cache=True)
def _add_row(rows, row):
    """Append a row to a typed list."""
    rows.append(row)


@lru_cache(maxsize=256)
def hold_rows(rows: tuple[Callable, ...]) -> typed.List:
    """Return compiled rows as a typed list; equal rows give the same list, which must only be read.

    A call of a row from the list takes compiled code a third of the time that a row as an argument takes.
    """
    held = _start_rows()
    for row in rows:
        _add_row(held, row)
    return held


def stack_rows(row: Callable, *arguments) -> np.ndarray:
    """Return the regressors (N, S*p) for several shapes side by side; the arguments are those of `_stack`."""
    return _stack(hold_rows((row,)), *arguments)


# All shapes are evaluated in one pass over the samples. Rows are copied, as views cost more for a few values.
@njit(
    _MATRIX(
        ROWS, types.int64, _VECTOR, types.float64, *([_MATRIX] * 7), _MATRIX, types.int64, types.int64
    ),
    cache=True,
    nogil=True,
)  # fmt: skip
def _stack(rows, j, t, dt, sign, q, v, a, load, temperature, wear, shapes, n_states, p):
    """Compute the regressors (N, S*p) for shapes (S, k); the signals are those of `ROW`, with N rows."""
    row, n, size = rows[0], sign.shape[1], shapes.shape[1]
    out = np.empty((len(t), len(shapes) * p))
    states = np.zeros((len(shapes), max(n_states, 1)))
    signi, qi, vi, ai = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    loadi, temperaturei, weari = np.empty(n), np.empty(n), np.empty(n)
    shape, state, own = np.empty(size), np.zeros(max(n_states, 1)), np.empty(p)
    next_state = np.zeros(max(n_states, 1))
    for i in range(len(t)):
        # One by one: the assignment of a whole array takes seconds more to compile.
        for k in range(n):
            signi[k], qi[k], vi[k], ai[k] = sign[i, k], q[i, k], v[i, k], a[i, k]
            loadi[k], temperaturei[k], weari[k] = load[i, k], temperature[i, k], wear[i, k]
        for s in range(len(shapes)):
            for k in range(size):
                shape[k] = shapes[s, k]
            for c in range(n_states):
                state[c] = states[s, c]
            row(j, t[i], dt, signi, qi, vi, ai, loadi, temperaturei, weari, shape, state, next_state, own)
            for c in range(n_states):
                states[s, c] = next_state[c]
            for c in range(p):
                out[i, s * p + c] = own[c]
    return out
