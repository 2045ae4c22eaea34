"""An effect's compiled row: its signature, its compilation, and rows stacked along signals."""

from collections.abc import Callable

import numpy as np
from numba import njit, types

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

_MATRIX = types.Array(types.float64, 2, "C")


# The row as a first-class function: compiled once for all effects and kept, where a dispatcher argument would
# compile anew in every process. All shapes in one pass, since a sample's views cost more than a row.
@njit(
    _MATRIX(
        types.FunctionType(ROW), types.int64, _VECTOR, types.float64, *([_MATRIX] * 7), _MATRIX, types.int64,
        types.int64,
    ),
    cache=True,
)  # fmt: skip
def stack_rows(row, j, t, dt, sign, q, v, a, load, temperature, wear, shapes, n_states, p):
    """Regressors (N, S*p) of several shapes (S, k) side by side; the rest as `ROW` has it, by sample."""
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
