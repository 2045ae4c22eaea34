"""The arrays that the compiled step reads and writes, by what they belong to."""

from collections import namedtuple
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


# Numba counts references to arrays by atomic additions, also to the rows that an effect is called with. The
# counting took half of the time of a step.
@intrinsic
def borrow(typingctx, arrays):
    """Give a (named) tuple of arrays without reference counts: the calling Python keeps them alive."""

    def generate(context, builder, signature, arguments):
        (value,) = arguments
        for i, kind in enumerate(arrays.types):
            array = context.make_array(kind)(context, builder, builder.extract_value(value, i))
            array.meminfo = ir.Constant(array.meminfo.type, None)
            array.parent = ir.Constant(array.parent.type, None)
            value = builder.insert_value(value, array._getvalue(), i)
        return value

    return arrays(arrays), generate


@intrinsic
def borrow_rows(typingctx, rows):
    """Give a typed list without reference counts, as `borrow` gives arrays."""

    def generate(context, builder, signature, arguments):
        (value,) = arguments
        lent = cgutils.create_struct_proxy(rows)(context, builder, value=value)
        lent.meminfo = ir.Constant(lent.meminfo.type, None)
        return lent._getvalue()

    return rows(rows) if isinstance(rows, types.ListType) else None, generate


#: Options for functions that only compiled code calls. The options leave out wrappers for calls from Python,
#: which would double the time of compilation.
INNER: dict[str, Any] = {
    "error_model": "numpy",
    "forceinline": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


class Law(namedtuple("Law", "feedforward position speed stiffness damping limit")):
    """Controller: at t_k ``feedforward[k] + stiffness (position[k] - q) + damping (speed[k] - y)``.

    Attributes
    ----------
    feedforward, position, speed : ndarray (N, n)
    stiffness, damping, limit : ndarray (n,)
    """


class Gears(namedtuple("Gears", "armature flexible compliance lost_motion mesh_torque tolerance")):
    """Motor side of each joint, (n,), see `wearscope.effects.base.Plant`; `tolerance` of torques' balance."""


class State(namedtuple("State", "q v gap y a a_motor a_before mode slope pace")):
    """What a step starts from, each (n,).

    Attributes
    ----------
    q, gap : ndarray
        Link position, and motor minus link position, at the instant of the step.
    v, y : ndarray
        Speeds of links and of motors half a step before it.
    a, a_motor, a_before : ndarray
        Acceleration of the links and of the motors in the part before, and of the motors one earlier.
    mode : ndarray of int
        Direction of the motor's motion, 0 at rest.
    slope : ndarray
        Of the effects' torque against the motor's speed.
    pace : ndarray (2,)
        Last rate of convergence, and the number of steps since that trusted it.
    """


class Work(
    namedtuple(
        "Work",
        "x rate start middle speed torque turning ahead fed wanted gap give held change residual "
        "old_torque old_speed old_mode motor free stiff need low high matrix jacobian inertia",
    )
):
    """Vectors (n,), and matrices (n, n), that a step works in."""


class Log(namedtuple("Log", "position speed torque applied motor rotor bias terms")):
    """Results of the steps.

    Attributes
    ----------
    position, speed, torque : ndarray (N, n)
        Of the motors, at t_k.
    applied : ndarray (N, n)
        Joint torque for PyBullet.
    motor, rotor, bias : ndarray (N, n), or (0, n) where not asked for
        Means over the step: torque of the motors, what their rotors take, and by how much `applied` exceeds
        what the links get.
    terms : ndarray (N, m), or (0, m)
        Means over the step of the effects' torques, term by term.
    """


class Motion(namedtuple("Motion", "sign position speed acceleration load")):
    """Signals at one step that the terms depend on, each (n,): motor side, `load` of the links."""


def make_state(n: int) -> State:
    """State at rest at 0."""
    z = np.zeros
    return State(
        z(n),
        z(n),
        z(n),
        z(n),
        z(n),
        z(n),
        z(n),
        z(n, dtype=np.int64),
        np.full(n, np.nan),
        np.array([1.0, 0.0]),
    )


def make_work(n: int) -> Work:
    """Work arrays for `n` joints."""
    shapes = {"matrix": (n, n), "jacobian": (n, n), "inertia": (n, n)}
    kinds = {"turning": np.int64, "old_mode": np.int64}
    return Work(*(np.zeros(shapes.get(f, n), dtype=kinds.get(f, np.float64)) for f in Work._fields))


def make_log(count: int, n: int, terms: int, by_effect: bool) -> Log:
    """Log of `count` steps, with what each effect takes if asked for."""
    detailed = count if by_effect else 0
    position, speed, torque, applied = (np.full((count, n), np.nan) for _ in range(4))
    motor, rotor, bias = (np.zeros((detailed, n)) for _ in range(3))
    return Log(position, speed, torque, applied, motor, rotor, bias, np.zeros((detailed, terms)))


def make_motion(n: int) -> Motion:
    """Signals for `n` joints."""
    return Motion(*(np.zeros(n) for _ in range(5)))
