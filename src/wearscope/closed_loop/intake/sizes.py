"""Torques of another size than the rigid body needs: currents, another unit, another side of the gear."""

from collections.abc import Iterator

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.asked import Asked, Reading, say_columns
from wearscope.closed_loop.intake.joint_fit import Rows
from wearscope.closed_loop.intake.products import NONE, Products
from wearscope.closed_loop.intake.rough_model import fit_rough
from wearscope.effects.torque_constant_error import EFFECT as TORQUE_CONSTANT

#: Torque over need beyond which a factor is no error of the model.
_SMALL, _LARGE = 0.25, 4.0
#: Torque over what the body needs beyond which no undeclared drive's inertia explains it, where that inertia
#: and the body move alike: the body's own share of its torque there.
_LARGEST, _OWN = 300.0, 0.05
#: Least share of a torque that a body must explain for its factor to mean anything.
_BODY = 0.5
#: Factors that are tried, in octaves; shares of a torque's variance from which another is sought, and that it
#: must remove.
_OCTAVES, _LEFT, _ALIKE = np.arange(-12.0, 13.0, 2.0).tolist(), 0.05, 0.02
#: Octaves by which a torque constant may look off, least and most; shares of what is left, that another one
#: must remove to be sought, and that all must leave at most; share of a variance that they must remove.
_NEAR, _FAR, _SOME, _CLEAR, _LEAST = 0.3, 2.5, 0.05, 0.3, 1e-3
#: Turns of the search for a torque's signs.
_TURNS = 20
#: Least span of a position in mm that is a motion.
LEAST_MM = 5.0


def read_sizes(asked: Asked, other: Reading | None = None) -> Iterator[Reading]:
    """Motor-side torque, currents, newton-millimetres, masses in grams, also on top of another reading."""
    products = asked.rows.products if other is None else other.products
    _, loose, without = products.fit_sizes()
    size = find_sizes(products)
    read = products.resize(size)
    at = np.flatnonzero(size != 1.0)
    # A torque in which no body is seen is of any size: most must show theirs.
    if len(at) and np.mean(loose[at] < _BODY * without[at]) > 0.5 and asked.rows.rivals_springs(read.total):
        told, codes = say_sizes(asked, at, size)
        if other is None:
            yield Reading(told, codes, tuple(at.tolist()), read, True)
        else:
            told = f"{other.told.rstrip('.')}; in addition, {told}"
            yield Reading(told, (*other.codes, *codes), tuple(read.heard), read, True)


def find_constants(products: Products) -> np.ndarray:
    """Torque over need (n,) by a constant that no drive's is off by; 1 where the fit asks for no other.

    All joints by one factor are asked for before single ones: links that may differ hide a common factor from
    each joint alone.
    """
    heard, stated = products.heard, products.total
    most = min(_CLEAR * stated, stated - _LEAST)
    size = np.ones(products.scale.shape[-1])
    if most <= 0.0:
        return size

    def miss(octave: float, some: list[int]) -> float:
        return products.resize(_at(size, some, 2.0**octave)).total

    least = stated
    for some in [heard, *([j] for j in 2 * heard)]:
        if min(miss(-_NEAR, some), miss(_NEAR, some)) < least - _SOME * stated or np.any(size[some] != 1.0):
            fine = optimize.minimize_scalar(
                miss, bounds=(-_FAR, _FAR), args=(some,), method="bounded", options={"xatol": 0.01}
            )
            # Where all by one factor leave little, no joint is asked for alone.
            if fine.fun < (most if some is heard else least) and abs(fine.x) < _FAR - _NEAR:
                size, least = _at(size, some, 2.0**fine.x), float(fine.fun)
        if some is heard and least < stated:
            break
    low, high = TORQUE_CONSTANT.coefficients[0].bounds("rad", 1.0)
    size = np.where((size - 1.0 < low) | (size - 1.0 > high), size, 1.0)
    for j in np.flatnonzero(size != 1.0).tolist() if len(np.unique(size)) > 1 else []:
        if miss(0.0, [j]) < most:
            size = _at(size, [j], 1.0)
    return size if products.resize(size).total < most else np.ones(len(size))


def _at(size: np.ndarray, some: list[int], one: float) -> np.ndarray:
    other = size.copy()
    other[some] = one
    return other


def _is_off(size: np.ndarray) -> np.ndarray:
    return np.asarray((np.abs(size) < _SMALL) | (np.abs(size) > _LARGE))


def find_sizes(products: Products) -> np.ndarray:
    """Torque over need (n,) at which the fit of all joints leaves least, the most telling joint first.

    1 where it is no more than an error of the model.
    """
    factor, loose, without = products.fit_sizes()
    with np.errstate(invalid="ignore"):
        off = _is_off(factor) & (factor != 0.0) & (loose < _BODY * without)
    size, free = np.where(off, np.nan_to_num(factor, nan=1.0), 1.0), list(products.heard)

    def miss(octave: float, j: int) -> float:
        return products.resize(_at(size, [j], size[j] * 2.0**octave)).total

    least = products.resize(size).total
    while free and least > _LEFT:
        total, octave, j = min((miss(octave, j), octave, j) for j in free for octave in _OCTAVES)
        if total > least - _ALIKE:
            break
        bounds = (octave - 2.0, octave + 2.0)
        fine = optimize.minimize_scalar(
            miss, bounds=bounds, args=(j,), method="bounded", options={"xatol": 0.02}
        )
        size[j] *= 2.0**fine.x
        least = float(fine.fun)
        free.remove(j)
    return np.where(_is_off(size), size, 1.0)


def say_sizes(asked: Asked, at: np.ndarray, size: np.ndarray) -> tuple[str, tuple[str, ...]]:
    """What is said of joints `at` with torques `size` (n,) times what the body needs, and its codes."""
    middle = float(np.median(size[at]))
    hint = (
        "give torque on the joint side of the gear in N m (or N), and check the URDF's and payload's masses"
    )
    ratio = asked.gear_ratio
    if ratio is not None and 0.3 < abs(middle * float(np.median(np.abs(np.array(ratio)[at])))) < 3.0:
        hint = "it looks like motor-side torque: multiply it with the gear ratio"
    elif all(asked.slides[j] for j in at):
        far = all(np.ptp(asked.rows.q[:, j]) > LEAST_MM for j in at)
        hint += (
            ", and that q is in m" if far else "; a spindle's force is its torque times 2 pi over its lead"
        )
    elif 0.7 < abs(middle) * 180.0 / np.pi < 1.4:
        hint += ", and that q is in rad"
    elif abs(middle) > _LARGE:
        hint += ", and that q is in rad and not in turns"
    names, turned = asked.names(at), asked.names(at[size[at] < 0.0])
    if turned:
        hint += (
            f'; what is negative is turned round too: write "turned: [{", ".join(turned)}]" in dataset.yaml'
        )
    sizes = ", ".join(f"{one:.3g}" for one in size[at])
    told = (
        f"{say_columns(names)} {'is' if len(at) == 1 else 'are'} {sizes} times what the rigid body needs, as "
        f"currents or torques in another unit or before a gear are; {hint}."
    )
    return told, tuple(f"gain {name}" for name in names)


def say_payload(mass: float) -> str:
    """What is said of a payload that explains torques, by its mass less the stated one's [kg] or NaN."""
    told = "a payload that is not stated"
    if np.isfinite(mass):
        told = f"a payload about {abs(mass):.2g} kg {'heavier' if mass > 0.0 else 'lighter'} than stated"
    return (
        f"{told} explains the torques better. If the machine carries it, state it as each run's 'payload'; "
        "otherwise the last link's mass is off by as much."
    )


def find_impossible_sizes(rows: Rows) -> np.ndarray:
    """Torque over need (n,) of joints at which body and rotor move alike; NaN where it is possible."""
    size = np.full(rows.n, np.nan)
    # A light wrist's drive may have a thousand times its body's inertia, yet needs less than the arm's.
    heard = rows.products.heard
    most = max((float(rows.known[rows.counts[:, j], j].std()) for j in heard), default=0.0)
    for j in heard:
        at = rows.counts[:, j]
        known, plain = rows.known[at, j], [np.ones(at.sum()), rows.sign[at, j], rows.v[at, j]]
        if leave(known, [*plain, rows.a[at, j]]).std() > _OWN * known.std():
            continue
        tau, body = leave(rows.tau[at, j], plain), leave(known, plain)
        if (body @ tau) ** 2 > 0.5 * (body @ body) * (tau @ tau):
            one = body @ tau / (body @ body)
            # Behind the gear there is the body alone.
            behind = leave(rows.known[at, j] - rows.inertia[j] * rows.a[at, j], plain)
            if _SMALL < behind @ tau / max(float(behind @ behind), 1e-300) < _LARGE:
                continue
            if abs(one) < _SMALL or (abs(one) > _LARGEST and tau.std() > most):
                size[j] = one
    return size


def unfold(rows: Rows, j: int) -> float:
    """What body and drive of any size leave of a torque that is given signs, over what they leave of it."""
    at = rows.counts[:, j]
    y, direction, body = rows.tau[at, j], rows.sign[at, j], rows.known[at, j]
    columns, left = [np.ones(len(y)), body, rows.a[at, j], direction, rows.v[at, j]], []
    for start in (body, direction):
        sign = np.where(start < 0.0, -1.0, 1.0)
        for _ in range(_TURNS):
            sign = np.where(sign * y < leave(sign * y, columns), -1.0, 1.0)
        left.append(float(leave(sign * y, columns).var()))
    none = NONE * float(y.var())
    return (min(left) + none) / (float(leave(y, columns).var()) + none)


def needs_body(whole: Rows, j: int) -> bool:
    """Whether a joint's body has much torque that the drive's own inertia and friction cannot have."""
    at = whole.counts[:, j]
    own = [np.ones(at.sum()), whole.a[at, j], whole.sign[at, j], whole.v[at, j]]
    return bool(leave(whole.known[at, j], own).std() > 0.5 * whole.tau[at, j].std())


def free_misfit(own: Rows, j: int) -> float:
    """Share of the variance that stays with free signs and sizes and a smooth function of position."""
    at = own.counts[:, j]
    y, q = own.tau[at, j], own.q[at, j]
    centre, half = 0.5 * (q.max() + q.min()), max(0.5 * float(np.ptp(q)), 1e-12)
    smooth = [((q - centre) / half) ** k for k in range(5)]
    x = np.column_stack([own.known[at, j], own.a[at, j], own.sign[at, j], own.v[at, j], *smooth])
    left = y - x @ fit_rough([x], [y])
    return float(np.sum(left**2) / np.sum((y - y.mean()) ** 2))


def leave(y: np.ndarray, columns: list[np.ndarray]) -> np.ndarray:
    """What columns do not explain of a signal."""
    x = np.column_stack(columns)
    return np.asarray(y - x @ np.linalg.lstsq(x, y, rcond=None)[0])
