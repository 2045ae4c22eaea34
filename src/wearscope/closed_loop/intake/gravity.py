"""Readings of gravity: none in the torque, along another direction of the base, of another size."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading
from wearscope.closed_loop.intake.joint_fit import WORTH, Mixture, Rows, is_clearly_less
from wearscope.closed_loop.intake.products import DOUBTFUL

#: Rows on which a direction is sought; part of gravity along an axis below which there is none.
_FEW, _LEVEL = 200, 0.03
#: Cosine of the angle to the stated direction from which there is no other.
_AS_STATED = 0.9
_NONE = (0.0, 0.0, 0.0)
#: Mean torque of gravity that counts, over a torque's spread; share of it within which an offset is it.
_WEIGHS, _LACKS = 0.5, 0.5


def read_gravity(asked: Asked, heard: tuple[int, ...]) -> Iterator[Reading]:
    """Readings from the likeliest on."""
    rows = asked.rows
    gravity = np.array(rows.bodies[0].gravity)
    size = float(np.linalg.norm(gravity))
    if not size:
        return
    none = replace(rows, gravity=_NONE)
    # A controller takes out the gravity of its own model: that of what it does not know stays.
    whole, links = _list_gravities(rows)
    kept = [rows.share(replace(none), "slack") for _ in range(2)]
    for one, stays in zip(kept, (0.0, whole - links), strict=True):
        one.__dict__["known"] = none.known + stays
    parts = [none.products, *(one.products for one in kept)]
    read = min(parts, key=lambda one: one.total)
    friction = np.nanmean(read.fit().friction[list(heard)]) if heard else 0.0
    what = "no gravity" if friction > 1e-3 else "neither gravity nor friction"
    # Links that weigh next to nothing fit as well where friction and the drives' inertia make the torque.
    # What is stated is wrong either way, where no balancer explains what it leaves.
    wrong = is_clearly_less(read.total, rows.products.total, WORTH) and rows.is_worth(read.total)
    seen = is_clearly_less(read.total, rows.products.any_size, DOUBTFUL)
    light = wrong and not seen
    weight, lacks, _ = find_missing_weight(rows)
    shown = seen and np.sum(lacks) > 1 and bool(np.all(lacks[weight != 0.0]))
    shown = shown and rows.rivals_springs(read.total)
    told = (
        f"the torque has {what} in it{', or masses are far too large' if light else ''}; write "
        '"torque: without_gravity" in dataset.yaml, or record the motors\' whole torque.'
    )
    if read is parts[2]:
        told = (
            "the torque has the payload's gravity in it and not the robot's own; record the motors' whole "
            "torque, or add what the controller took out."
        )
    yield Reading(told, ("without_gravity tau",), heard, read, any_size=wrong or shown, shown=shown)
    yield from read_mount(asked, heard)
    if not 9.7 < size < 9.9:
        told = f"gravity is not {size:.3g} m/s^2 strong as robot.gravity says; give m/s^2."
        yield Reading(
            told, ("size gravity",), heard, _with_gravity(rows, 9.81 / size * gravity).products, True
        )


def find_missing_weight(rows: Rows) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean torque of gravity (n,), 0 where it is small, where the torque lacks it, and what it has of it.

    A fit does not see it, as offsets have any size.
    """
    gravities = _list_gravities(rows)
    weight, lacks, has = np.zeros(rows.n), np.zeros(rows.n, dtype=bool), np.zeros(rows.n)
    for j in rows.products.heard:
        at = rows.counts[:, j]
        x = np.column_stack([np.ones(at.sum()), rows.sign[at, j], rows.v[at, j], rows.a[at, j]])
        offset = np.linalg.lstsq(x, rows.tau[at, j] - rows.known[at, j], rcond=None)[0][0]
        means = np.array([one[at, j].mean() for one in gravities])
        heavy = np.abs(means) > _WEIGHS * rows.products.scale[j]
        if heavy[0]:
            weight[j], has[j] = means[0], means[0] + offset
            lacks[j] = np.any(heavy & (np.abs(offset + means) < _LACKS * np.abs(means)))
    return weight, lacks, has


def _list_gravities(rows: Rows) -> list[np.ndarray]:
    """Torques of gravity (N, n), with the payload and without."""
    bare = replace(rows, bodies=tuple(body.with_payload(None) for body in rows.bodies))
    return [one.known - replace(one, gravity=_NONE).known for one in (rows, bare)]


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
    return replace(rows, gravity=tuple(gravity.tolist()))


def _find_gravity(rows: Rows, any_size: bool) -> np.ndarray | None:
    """Direction (3,) of gravity that leaves least; None where it is as stated."""
    few = rows.thin(_FEW)
    stated = np.array(rows.bodies[0].gravity)
    size = np.linalg.norm(stated)
    # Torques are linear in gravity: three directions and none give all.
    parts = Mixture([replace(few, gravity=_NONE), *(_with_gravity(few, size * one) for one in np.eye(3))])

    def miss(direction: np.ndarray) -> float:
        one = direction / max(np.linalg.norm(direction), 1e-9)
        return parts.miss(np.append(1.0 - one.sum(), one), any_size)

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
