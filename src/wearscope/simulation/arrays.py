"""Named tuples of the arrays that the compiled simulation step reads and writes."""

from collections import namedtuple
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic


# Numba counts references to arrays by atomic additions, also for the array rows that an effect gets as
# arguments. This counting took half of the time of a step, so the compiled step borrows its arrays.
@intrinsic
def borrow(typingctx, arrays):
    """Return a (named) tuple of arrays that numba does not reference-count; the Python caller holds them."""

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
    """Return a typed list that numba does not reference-count; the Python caller holds it."""

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
    """Controller of each motor: feed-forward plus feedback of position and speed, without integrator.

    The torque at t_k is ``feedforward[k] + stiffness (position[k] - q) + damping (speed[k] - y)``, cut at
    ``limit``; q and y are position and speed of the motor.

    Attributes
    ----------
    feedforward, position, speed : ndarray (N, n)
    stiffness, damping, limit : ndarray (n,)
    """


class Gears(namedtuple("Gears", "armature flexible compliance lost_motion mesh_torque tolerance")):
    """Drive train of each joint, each (n,), see `wearscope.effects.base.Plant`.

    `tolerance` is the largest imbalance of torque [N m or N] that the solver accepts.
    """


class State(namedtuple("State", "q v gap y a a_motor a_before mode slope pace")):
    """State at the start of a step, each (n,) unless stated.

    Attributes
    ----------
    q, gap : ndarray
        Link position, and motor minus link position, at the instant of the step.
    v, y : ndarray
        Speeds of links and of motors half a step before it.
    a, a_motor, a_before : ndarray
        Mean acceleration of the links and of the motors over the previous part of a step, and of the motors
        over the part before that.
    mode : ndarray of int
        Direction of the motor's motion, 0 at rest.
    slope : ndarray
        Derivative of the effects' torque with respect to the motor's speed; NaN where it must be measured.
    pace : ndarray (2,)
        Last measured rate of convergence, and the number of steps that have relied on it since.
    """


class Work(
    namedtuple(
        "Work",
        "x rate start middle speed torque turning ahead fed wanted gap give held change residual "
        "old_torque old_speed old_mode motor free stiff need low high matrix jacobian inertia",
    )
):
    """Scratch memory of a step: vectors (n,); matrices (n, n) for the last three."""


class Log(namedtuple("Log", "position speed torque applied motor rotor bias terms")):
    """Results of the steps.

    Attributes
    ----------
    position, speed, torque : ndarray (N, n)
        Of the motors, at t_k.
    applied : ndarray (N, n)
        Joint torque for PyBullet.
    motor, rotor, bias : ndarray (N, n), or (0, n) where not asked for
        Means over the step: torque of the motors, torque that accelerates their rotors, and by how much
        `applied` exceeds the torque that the links get.
    terms : ndarray (N, m), or (0, m)
        Mean torque of each term of an effect over the step.
    """


class Motion(namedtuple("Motion", "sign position speed acceleration load")):
    """Signals that the effects' terms depend on, each (n,).

    `sign`, `position`, `speed` and `acceleration` are the motor's; `load` is the torque that the links need.
    """


def make_state(n: int) -> State:
    """State with all joints at rest at position 0."""
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
    """Empty log of `count` steps; `by_effect` adds rows for the torque of each effect."""
    detailed = count if by_effect else 0
    position, speed, torque, applied = (np.full((count, n), np.nan) for _ in range(4))
    motor, rotor, bias = (np.zeros((detailed, n)) for _ in range(3))
    return Log(position, speed, torque, applied, motor, rotor, bias, np.zeros((detailed, terms)))


def make_motion(n: int) -> Motion:
    """Signals of `n` joints, all 0."""
    return Motion(*(np.zeros(n) for _ in range(5)))
