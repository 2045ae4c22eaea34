"""An effect's compiled row: its signature, its compilation, and rows stacked along signals."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numba import njit, typed, types

_VECTOR = types.Array(types.float64, 1, "C")

#: Signature of an effect's row, called for joint `j` of `n`:
#: ``row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out)``.
#: All vectors but the last four are (n,), in joint order; `sign` is the direction of motion, -1 to 1, given
#: apart from `v` so that the simulator can ask for the torque on either side of rest; `load` is the torque of
#: the rigid body; `next_state` and `out` are written.
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
    """``exp(-ratio^power)``, by how much the Stribeck curve has fallen; most laws have a power of 1."""
    return np.exp(-(ratio if power == 1.0 else ratio**power))


_MATRIX = types.Array(types.float64, 2, "C")


#: A row as a first-class function: what takes one is compiled once for all effects and kept, where a
#: dispatcher argument would compile anew in every process.
ROW_FUNCTION = types.FunctionType(ROW)
ROWS = types.ListType(ROW_FUNCTION)


# Compiled once and kept, where the list's own methods would be compiled in every process.
@njit(ROWS(), cache=True)
def _start_rows():
    return typed.List.empty_list(ROW_FUNCTION)


@njit(types.void(ROWS, ROW_FUNCTION), cache=True)
def _add_row(rows, row):
    rows.append(row)


@lru_cache(maxsize=256)
def hold_rows(rows: tuple[Callable, ...]) -> typed.List:
    """Compiled rows as a list, which costs compiled code a third of what a row alone does at each call.

    The same rows get the same list, which is only read.
    """
    held = _start_rows()
    for row in rows:
        _add_row(held, row)
    return held


def stack_rows(row: Callable, *arguments) -> np.ndarray:
    """Regressors (N, S*p) of several shapes side by side; the arguments are those of `_stack`."""
    return _stack(hold_rows((row,)), *arguments)


# All shapes in one pass, since a sample's views cost more than a row.
@njit(
    _MATRIX(
        ROWS, types.int64, _VECTOR, types.float64, *([_MATRIX] * 7), _MATRIX, types.int64, types.int64
    ),
    cache=True,
    nogil=True,
)  # fmt: skip
def _stack(rows, j, t, dt, sign, q, v, a, load, temperature, wear, shapes, n_states, p):
    """Regressors (N, S*p) of several shapes (S, k) side by side; the rest as `ROW` has it, by sample."""
    row = rows[0]
    out = np.empty((len(t), len(shapes) * p))
    state = np.zeros((len(shapes), max(n_states, 1)))
    next_state = np.zeros((len(shapes), max(n_states, 1)))
    for i in range(len(t)):
        signi, qi, vi, ai, loadi = sign[i], q[i], v[i], a[i], load[i]
        temperaturei, weari = temperature[i], wear[i]
        for s in range(len(shapes)):
            row(
                j, t[i], dt, signi, qi, vi, ai, loadi, temperaturei, weari,
                shapes[s], state[s], next_state[s], out[i, s * p : (s + 1) * p],
            )  # fmt: skip
        # One by one: the assignment of a whole array takes seconds more to compile.
        for s in range(len(shapes)):
            for c in range(n_states):
                state[s, c] = next_state[s, c]
    return out
