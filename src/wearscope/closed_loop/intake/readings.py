"""Other readings of a data set's columns, weighed against the stated one by the fit of all joints.

A reading is a guess at what the columns really hold: torque without gravity, another sign, another unit,
another joint's torque, a delayed channel. The one that clearly leaves least of what the stated one leaves is
the data set's.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from wearscope.closed_loop.intake.acceptance import exchange_code
from wearscope.closed_loop.intake.asked import Asked, Reading, say_columns
from wearscope.closed_loop.intake.gravity import read_gravity, read_mount
from wearscope.closed_loop.intake.joint_fit import Rows, is_clearly_less
from wearscope.closed_loop.intake.lags import read_lag
from wearscope.closed_loop.intake.products import DOUBTFUL, Fit, Products
from wearscope.closed_loop.intake.scales import read_scales
from wearscope.closed_loop.intake.sizes import LEAST_MM, read_sizes
from wearscope.closed_loop.intake.zeros import read_zeros

_MOTION = ("q", "v", "a", "sign")
#: Columns of two joints that may be exchanged, and what they are called.
_EXCHANGED: tuple[tuple[tuple[str, ...], tuple[str, ...]], ...] = (
    (("tau",), ("tau",)),
    (_MOTION, ("q",)),
    ((*_MOTION, "tau"), ("q", "tau")),
)
#: A reading's joints must keep less than a share of what it removes, where no test of its own shows it.
#: Totals that differ by less are alike. Where a joint keeps, or its links cost, more than the last, its own
#: columns may be exchanged, and two faults at once are asked for.
_CLEAR, _ALIKE, _POOR = 0.3, 0.02, 0.1
#: Rows of a first look; least span of a position in degrees that is a motion.
_FIRST_LOOK, _LEAST_DEGREES = 450, 1.0
_SIGN_HINT = "give motor torque, positive where it does positive work in positive motion"


class Readings:
    """What the columns may be in the place of what is stated, each asked for once and as far as needed.

    There are none where the stated reading leaves next to nothing.
    """

    def __init__(self, asked: Asked) -> None:
        self.asked, self._made = asked, list[Reading]()
        stated = asked.rows.products.fit()
        self._rest = _list_readings(asked, stated) if stated.is_doubtful else iter(())

    def list_without(self, ignored: frozenset[str]) -> Iterator[Reading]:
        """Those without some codes."""
        k = 0
        while True:
            if k == len(self._made):
                self._made.extend(islice(self._rest, 1))
            if k == len(self._made):
                return
            if not set(self._made[k].codes) & ignored:
                yield self._made[k]
            k += 1


def find_reading(every: Readings, ignored: frozenset[str] = frozenset()) -> Reading | None:
    """The reading that explains the torques clearly better than the stated one, if there is one.

    Parameters
    ----------
    every : Readings
    ignored : frozenset of str
        Codes of readings that are not asked for.
    """
    asked = every.asked
    stated = asked.rows.products.fit()
    best = _choose(every.list_without(ignored), stated, asked.rows.products.any_size)
    # What a test of its own has shown, or what leaves much, may be one of two faults.
    asks = best is None or best.shown or best.fit.total > _POOR
    if asks and (some := list(every.list_without(ignored))):
        other = [one for one in some if not one.codes[0].startswith("gain ")]
        better = [one for one in other if one.fit.total < stated.total - DOUBTFUL]
        heard = tuple(asked.rows.products.heard)
        better += [*read_mount(asked, heard, any_size=True), *read_zeros(asked, any_size=True)]
        better += read_scales(asked, any_size=True)
        pairs = [pair for one in better for pair in read_sizes(asked, one)]
        pair = _choose([one for one in pairs if not set(one.codes) & ignored], stated, stated.total)
        if best is None or best.shown or (pair and is_clearly_less(pair.fit.total, best.fit.total, _POOR)):
            best = pair or best
    # What an undeclared payload explains as well speaks for no other columns.
    if best is None or best.shown or is_clearly_less(best.fit.total, asked.rows.carried[0], DOUBTFUL):
        return best
    return None


def _choose(readings: Iterable[Reading], stated: Fit, rival: float) -> Reading | None:
    """The first of those that clearly leave less than the stated reading and a body of any size."""
    best: Reading | None = None
    for reading in readings:
        removed = stated.total - reading.fit.total
        if removed > DOUBTFUL and not reading.any_size:
            least = min(reading.fit.total, reading.products.any_size)
            removed = removed if is_clearly_less(least, rival, DOUBTFUL) else min(removed, rival - least)
        own, before = (fit.left[list(reading.joints)] for fit in (reading.fit, stated))
        # A torque that is noise is left by every reading, and speaks for none where most joints do.
        speaks = np.abs(before - own) > _CLEAR * own
        kept = float(np.nansum(own[speaks] if np.mean(speaks) > 0.5 else own))
        # What is removed of its torques is at most all that they vary: their misfit may be any size.
        held = kept > _CLEAR * min(removed, len(reading.joints)) and not reading.shown
        if removed < DOUBTFUL or held:
            continue
        if best is None or is_clearly_less(reading.fit.total, best.fit.total, _ALIKE):
            best = reading
            if not is_clearly_less(0.0, best.fit.total, _ALIKE):
                break
    return best


def _list_readings(asked: Asked, stated: Fit) -> Iterator[Reading]:
    """Readings from the likeliest to the unlikeliest: of those alike the first is taken."""
    rows, heard = asked.rows, tuple(asked.rows.products.heard)
    yield from read_gravity(asked, heard)
    yield from read_sizes(asked)
    turned = _turn_torques(rows)
    if turned is not None:
        yield _tell_turned(asked, turned, np.zeros(rows.n, dtype=bool), rows.products.resize(_signs(turned)))
    yield from read_lag(asked, heard)
    told = "the torques fit the motion run backwards; sort the rows by time."
    yield Reading(told, ("backwards t",), heard, rows.products.run_backwards())
    yield from _read_units(asked, heard)
    yield from _read_turned_positions(asked)
    yield from read_scales(asked)
    yield from read_zeros(asked)
    yield from _read_exchanges(asked, stated)


def _signs(turned: np.ndarray) -> np.ndarray:
    return np.where(turned, -1.0, 1.0)


def _turn_torques(rows: Rows, start: np.ndarray | None = None) -> np.ndarray | None:
    """Joints (n,) whose torques must be turned to leave least; None where none must."""
    products = rows.products
    best = np.zeros(rows.n, dtype=bool) if start is None else start
    least = products.resize(_signs(best)).total
    every = np.ones(rows.n, dtype=bool)
    candidates = [every] if rows.n > 1 else []
    while True:
        single = []
        for j in products.heard:
            other = best.copy()
            other[j] ^= True
            single.append(other)
        tried = [(products.resize(_signs(one)).total, k, one) for k, one in enumerate([*single, *candidates])]
        candidates = []
        total, _, one = min(tried, key=lambda t: t[:2]) if tried else (np.inf, 0, best)
        if total > least - _ALIKE:
            break
        least, best = total, one
    return best if best.any() else None


def _tell_turned(asked: Asked, torques: np.ndarray, positions: np.ndarray, read: Products) -> Reading:
    """One sentence about all columns that are turned round."""
    every = not positions.any() and torques[asked.rows.products.heard].all()
    axis = "the URDF's axis"
    groups: list[tuple[np.ndarray, tuple[str, ...], str]]
    groups = [(torques & ~positions, ("tau",), "what the motion needs"), (positions & ~torques, ("q",), axis)]
    both = np.flatnonzero(torques & positions)
    groups += [(np.arange(len(torques)) == j, ("q", "tau"), axis) for j in both]
    parts, codes, columns = [], ["sign tau"] if every else [], []
    for some, kinds, of_what in groups:
        names = [f"{kind}_{asked.joints[j]}" for j in np.flatnonzero(some) for kind in kinds]
        if not names:
            continue
        noun, verb = ("columns ", "have") if len(names) > 1 else ("column ", "has")
        parts.append(f"{'' if every else noun}{say_columns(names)} {verb} the opposite sign of {of_what}")
        if not every:
            codes += [f"sign {' '.join(names)}"] if len(kinds) > 1 else [f"sign {name}" for name in names]
        columns += names
    hint = f"; {_SIGN_HINT}" if (torques & ~positions).any() else ""
    told = f'{", and ".join(parts)}{hint}; write "turned: [{", ".join(columns)}]" in dataset.yaml.'
    return Reading(told, tuple(codes), tuple(np.flatnonzero(torques | positions).tolist()), read)


def _read_units(asked: Asked, heard: tuple[int, ...]) -> Iterator[Reading]:
    rows = asked.rows
    slides = np.array(asked.slides)
    span = np.ptp(rows.q, axis=0)
    for kind, unit, target, factor, least in (
        (~slides, "degrees", "rad", np.pi / 180.0, _LEAST_DEGREES),
        (slides, "mm", "m", 1e-3, LEAST_MM),
    ):
        moved = kind & (span > least)
        picked = [moved, *(np.arange(rows.n) == j for j in np.flatnonzero(moved) if moved.sum() > 1)]
        for k, some in enumerate(picked if moved.any() else []):
            read = rows.times(np.where(some, factor, 1.0), "q", "v", "a").products
            j = int(np.flatnonzero(some)[0])
            told, code = f"positions look like {unit}; convert q to {target}.", f"{unit} q"
            if k:
                name = f"q_{asked.joints[j]}"
                told, code = f"column '{name}' looks like {unit}; convert it to {target}.", f"{unit} {name}"
            # Positions that hardly move are those of a body that a balancer carries.
            if not k or rows.is_worth(read.total):
                yield Reading(told, (code,), (j,) if k else heard, read)


def _read_turned_positions(asked: Asked) -> Iterator[Reading]:
    """Positions, of any set of joints, that are turned round, their torques turned or not."""
    rows = asked.rows.thin(_FIRST_LOOK)
    turned = np.zeros(rows.n, dtype=bool)
    torques = np.zeros(rows.n, dtype=bool)
    least = rows.products.total
    while turned.sum() < rows.n:
        tried: list[tuple[float, int, np.ndarray, np.ndarray]] = []
        for j in rows.products.heard:
            other = turned.copy()
            other[j] ^= True
            read = rows.times(_signs(other), *_MOTION)
            for also in (False, True):
                tau = torques.copy()
                tau[j] ^= also
                tried.append((read.products.resize(_signs(tau)).total, len(tried), other, tau))
        if not tried:
            return
        total, _, other, tau = min(tried, key=lambda t: t[:2])
        if total > least - _ALIKE:
            break
        least, turned, torques = total, other, tau
    if turned.any():
        whole = asked.rows.times(_signs(turned), *_MOTION)
        yield _tell_turned(asked, torques, turned, whole.products.resize(_signs(torques)))


def _read_exchanges(asked: Asked, stated: Fit) -> Iterator[Reading]:
    """Columns of two joints exchanged, and of the kinds of one."""
    doubtful = [j for j in range(asked.rows.n) if stated.left[j] > DOUBTFUL or asked.rows.n == 1]
    # A torque that its joint's motion explains is no position.
    for j in [j for j in doubtful if stated.left[j] > _POOR or asked.rows.n == 1]:
        names = [f"q_{asked.joints[j]}", f"tau_{asked.joints[j]}"]
        told = f"columns {say_columns(names)} look swapped; exchange them."
        yield Reading(told, (f"exchanged {' '.join(names)}",), (j,), asked.swapped(j).products)
    rows = asked.rows.thin(_FIRST_LOOK)
    for i in range(rows.n):
        for j in range(i + 1, rows.n):
            if i not in doubtful and j not in doubtful:
                continue
            order = np.arange(rows.n)
            order[[i, j]] = [j, i]
            for columns, kinds in _EXCHANGED:
                moved = (*columns, "counts") if "tau" in columns else columns
                read = replace(rows, **{name: getattr(rows, name)[:, order] for name in moved})
                pairs = [f"'{k}_{asked.joints[i]}' with '{k}_{asked.joints[j]}'" for k in kinds]
                told = f"columns look swapped: exchange {' and '.join(pairs)}."
                code = exchange_code(asked.joints, kinds, i, j)
                yield Reading(told, (code,), (i, j), read.products)
