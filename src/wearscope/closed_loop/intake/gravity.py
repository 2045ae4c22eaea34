"""Readings of gravity: none in the torque, along another direction of the base, of another size."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading
from wearscope.closed_loop.intake.joint_fit import WORTH, Rows, is_clearly_less
from wearscope.closed_loop.intake.products import DOUBTFUL

#: Rows on which a direction is sought; part of gravity along an axis below which there is none.
_FEW, _LEVEL = 300, 0.03
#: Cosine of the angle to the stated direction from which there is no other.
_AS_STATED = 0.9


def read_gravity(asked: Asked, heard: tuple[int, ...]) -> Iterator[Reading]:
    """Readings from the likeliest on."""
    rows = asked.rows
    gravity = np.array(rows.bodies[0].gravity)
    size = float(np.linalg.norm(gravity))
    if not size:
        return
    none = replace(rows, gravity=0.0).products
    friction = np.nanmean(none.fit().friction[list(heard)]) if heard else 0.0
    what = "no gravity" if friction > 1e-3 else "neither gravity nor friction"
    # Links that weigh next to nothing fit as well where friction and the drives' inertia make the torque.
    # What is stated is wrong either way, where no balancer explains what it leaves.
    left = none.fit().total
    wrong = is_clearly_less(left, rows.fitted.total, WORTH) and rows.is_worth(left)
    light = wrong and not is_clearly_less(left, rows.products.any_size, DOUBTFUL)
    told = (
        f"the torque has {what} in it{', or masses are far too large' if light else ''}; write "
        '"torque: without_gravity" in dataset.yaml, or record the motors\' whole torque.'
    )
    yield Reading(told, ("without_gravity tau",), heard, none, any_size=wrong)
    yield from read_mount(asked, heard)
    if not 9.7 < size < 9.9:
        told = f"gravity is not {size:.3g} m/s^2 strong as robot.gravity says; give m/s^2."
        yield Reading(told, ("size gravity",), heard, replace(rows, gravity=9.81 / size).products, True)


def read_mount(asked: Asked, heard: tuple[int, ...], any_size: bool = False) -> Iterator[Reading]:
    """Gravity along another direction of the base, of torques as they are or of any size."""
    acts = any(asked.rows.bodies[0].gravity)
    direction = _find_gravity(asked.rows, any_size) if acts else None
    if direction is not None:
        gravity = float(np.linalg.norm(asked.rows.bodies[0].gravity)) * direction
        along = ", ".join(f"{one + 0.0:.3g}" for one in gravity)
        told = (
            f"gravity acts along [{along}] in the base frame, as of a robot that is mounted so; write "
            f'"gravity: [{along}]" below robot in dataset.yaml.'
        )
        yield Reading(told, ("sign gravity",), heard, _with_gravity(asked.rows, gravity).products)


def _with_gravity(rows: Rows, gravity: np.ndarray) -> Rows:
    return replace(rows, bodies=tuple(body.with_gravity(gravity.tolist()) for body in rows.bodies))


def _find_gravity(rows: Rows, any_size: bool) -> np.ndarray | None:
    """Direction (3,) of gravity that leaves least; None where it is as stated."""
    few = rows.thin(_FEW)
    stated = np.array(rows.bodies[0].gravity)
    size = np.linalg.norm(stated)
    # Torques are linear in gravity: three directions and none give all.
    none = replace(few, gravity=0.0).slack
    along = [_with_gravity(few, size * one).slack - none for one in np.eye(3)]

    def miss(direction: np.ndarray) -> float:
        one = direction / max(np.linalg.norm(direction), 1e-9)
        slack = none + one[0] * along[0] + one[1] * along[1] + one[2] * along[2]
        return few.with_slack(slack).products.miss(any_size)

    every = np.array([one for one in np.ndindex(3, 3, 3) if one != (1, 1, 1)], dtype=float) - 1.0
    start = min(every, key=miss)
    start = start / np.linalg.norm(start)
    if start @ stated > _AS_STATED * size:
        return None
    found = optimize.minimize(miss, start, method="Nelder-Mead", options={"maxfev": 60, "xatol": 1e-3}).x
    found = found / np.linalg.norm(found)
    if found @ stated > _AS_STATED * size:
        return None
    found = np.where(np.abs(found) < _LEVEL, 0.0, found)
    found = found / np.linalg.norm(found)
    # A balancer gives at most what gravity does, and is a tilt; a spring may give more, and fits better.
    tilts = float(np.linalg.norm(found - stated / size)) < 1.0
    left = miss(found)
    told = few.is_worth(left, any_size) if tilts else few.rivals_springs(left)
    return np.asarray(found) if told else None
