"""Traits of a recording: each is a way in which its columns may differ from what they are said to be.

A reading is a set of traits. To add a trait, write here which readings it proposes, and the sentence about a
reading that has it. The score alone decides between readings.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations, product

import numpy as np
from scipy import optimize

from wearscope.closed_loop.intake.acceptance import exchange_code
from wearscope.closed_loop.intake.traits.reading import Reading
from wearscope.closed_loop.intake.traits.rows import LONGEST, Rows
from wearscope.closed_loop.intake.traits.score import ROWS, Weighing

#: Odds [nats] that a noted reading must overcome: 20 to 1.
NOTE = 3.0
#: Cost of a free number [nats]; a known number is preferred where it is at most this much worse [nats].
FREE, _ALIKE = 0.5 * float(np.log(ROWS)), 1.0
#: Ratios of a torque to what the body needs; errors of the model explain only what lies between them.
SMALL, LARGE = 0.25, 4.0
#: Shortest delay [s] that is refused: the loop names shorter ones.
LATE = 0.025
DEGREE = float(np.pi / 180.0)
_MM, _QUARTER = 1e-3, float(np.pi / 2.0)
#: Start values of the search for a factor (in octaves) and for a delay [s]; factors of half turns and turns.
_OCTAVES, _TIMES = np.arange(-3.0, 4.0), LONGEST / 2.0 ** np.arange(1.0, 6.0)
_TURNS = (float(np.pi), 2.0 * float(np.pi))
#: Span [rad] below which angles may be rad that were read as degrees: two turns.
_NARROW = 4.0 * float(np.pi) * DEGREE
#: Odds [nats] for Earth's gravity where the stated one is of another size.
_UNEARTHLY = 10.0
#: Cosine to the stated direction from which gravity counts as unchanged; part along an axis that counts as 0;
#: first step of the search for a direction.
_SAME, _LEVEL, _STEP = 0.99, 0.03, 0.1
_SIGN_HINT = "give motor torque, positive where it does positive work in positive motion"

Told = tuple[str, tuple[str, ...]]


@dataclass(frozen=True)
class Trait:
    """A way in which columns may differ from what is stated.

    Attributes
    ----------
    propose : callable
        ``propose(few, reading)`` returns readings with the trait in addition, their numbers refined.
    tell : callable
        ``tell(reading, rows)`` returns a sentence and the codes; None where the reading lacks the trait.
    notes : callable or None
        ``notes(reading, rows)`` says whether the trait is only noted, since the search can name it as an
        effect. The readings that `propose` returns then include the odds against it.
    """

    propose: Callable[[Weighing, Reading], Iterator[Reading]]
    tell: Callable[[Reading, Rows], Told | None]
    notes: Callable[[Reading, Rows], bool] | None = None


def say_columns(names: list[str]) -> str:
    """Columns as a list in words."""
    quoted = [f"'{name}'" for name in names]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} and {quoted[-1]}"


def _name(rows: Rows, joints: np.ndarray | list[int], kind: str) -> list[str]:
    return [f"{kind}_{rows.joints[j]}" for j in joints]


def refine(
    few: Weighing, make: Callable[[float], Reading], start: float, reach: tuple[float, float], hope: float
) -> Reading:
    """Reading with its number refined within `reach`, if its first score at `start` is no worse than `hope`.

    Both scores are compared without the odds against the readings.
    """
    best = make(start)
    if few.look(best) - best.nats <= hope:
        found = optimize.minimize_scalar(
            lambda x: few.look(make(float(x))), bounds=reach, method="bounded", options={"maxiter": 10}
        )
        best = min((best, make(float(found.x))), key=few.look)
    return best


def _round(few: Weighing, best: Reading, known: Reading) -> Reading:
    """The reading with a known number, where it explains about as well as the one with a fitted number."""
    return known if few.look(known) < few.look(best) + _ALIKE else best


def _propose_gravity(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings without gravity, with a controller's gravity taken out, or with gravity of another vector."""
    body = few.rows.prepared.runs[0].signals.rigid_body
    stated, size = np.array(body.gravity), float(np.linalg.norm(body.gravity))
    if not size or r.without or r.gravity is not None:
        return
    yield r.has("without_gravity", 0.0, gravity=(0.0, 0.0, 0.0))
    yield r.has("without_gravity", 0.0, without="all")
    if body.payload is not None:
        yield r.has("without_gravity", 0.0, without="robot")
    if not 9.7 < size < 9.9:
        # No place on Earth has the stated gravity, so that keeping it is the unlikely choice.
        yield r.has("gravity", -_UNEARTHLY, gravity=tuple((9.81 / size * stated).tolist()))

    def point(way: np.ndarray, nats: float = 2.0 * FREE) -> Reading:
        along = size * np.asarray(way) / max(float(np.linalg.norm(way)), 1e-9)
        return r.has("gravity", nats, gravity=tuple(along.tolist()))

    grid = [np.array(way) / np.linalg.norm(way) for way in product((-1.0, 0.0, 1.0), repeat=3) if any(way)]
    ways = [way for way in grid if way @ stated < _SAME * size]
    start = min(ways, key=lambda way: few.look(point(way)))
    yield point(start, 0.0 if np.abs(start).max() == 1.0 else FREE)
    # A base that stands on a slope is tilted by less than half of a right angle.
    start = min((start, stated / size), key=lambda way: few.look(point(way, 0.0)))
    steps = start + _STEP * np.eye(4, 3)
    found = optimize.minimize(
        lambda way: few.look(point(way)),
        start,
        method="Nelder-Mead",
        options={"maxfev": 40, "initial_simplex": steps},
    ).x
    found = np.where(np.abs(found) < _LEVEL * np.linalg.norm(found), 0.0, found)
    if found @ stated < _SAME * size * np.linalg.norm(found):
        yield point(found)


def _tell_gravity(r: Reading, rows: Rows) -> Told | None:
    if r.without == "robot":
        return (
            "the torque has the payload's gravity in it and not the robot's own; record the motors' whole "
            "torque, or add what the controller took out.",
            ("without_gravity tau",),
        )
    if r.without or r.gravity == (0.0, 0.0, 0.0):
        return (
            'the torque has no gravity in it; write "torque: without_gravity" in dataset.yaml, or record the '
            "motors' whole torque.",
            ("without_gravity tau",),
        )
    if r.gravity is None:
        return None
    stated = np.array(rows.prepared.runs[0].signals.rigid_body.gravity)
    size = float(np.linalg.norm(stated))
    if stated @ np.array(r.gravity) > 0.999 * size * np.linalg.norm(r.gravity):
        return f"gravity is not {size:.3g} m/s^2 strong as robot.gravity says; give m/s^2.", ("size gravity",)
    along = ", ".join(f"{one + 0.0:.3g}" for one in r.gravity)
    return (
        f"gravity acts along [{along}] in the base frame, as of a robot that is mounted so; write "
        f'"gravity: [{along}]" below robot in dataset.yaml.',
        ("sign gravity",),
    )


def _propose_sizes(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings with torques that are a multiple of the body's: one joint's, all alike, or each its own."""
    if any(one != 1.0 for one in r.size):
        return
    fit, n = few.fit(r), few.rows.n
    own = {int(j): fit.size_alone(k) for k, j in enumerate(fit.joint)}
    own = {j: float(np.clip(abs(one), 1e-4, 1e4) * np.sign(one or 1.0)) for j, one in own.items()}
    every, hope = list(own), few.look(r) - r.nats
    sizes = np.array(list(own.values()))
    middle = float(np.median(np.abs(sizes))) * float(np.sign(sizes.sum()) if len(every) == 1 else 1.0)

    def resize(octaves: float, some: list[int], sign: float = 1.0) -> Reading:
        # A common factor of all torques may as well be one of all masses. Its note names both, so that it has
        # no odds against it.
        one = sign * float(2.0**octaves)
        alike = len(some) == len(every) > 1
        nats = FREE + (0.0 if is_off(one) else (NOTE + float(np.log(len(every)))) * (not alike))
        return r.has("size", nats, size=r.put("size", some, one))

    for some, one in [(every, middle), *(([j], own[j]) for j in every if len(every) > 1)]:
        if one > 0.0 or abs(one) > LARGE or abs(one) < SMALL:
            centre, sign = float(np.log2(abs(one))), float(np.sign(one))
            make = partial(resize, some=some, sign=sign)
            low, high = (SMALL, LARGE) if not is_off(one) else (0.5 * abs(one), 2.0 * abs(one))
            within = float(np.log2(low * 1.01)), float(np.log2(high * 0.99))
            yield refine(few, make, centre, within, hope)
    turned = (sizes > -LARGE) & (sizes < -SMALL)
    if len(every) > 1 and any(map(is_off, sizes)) and not turned.any():
        yield r.has("size", FREE * len(every), size=tuple(own.get(j, 1.0) for j in range(n)))


def is_off(size: float) -> bool:
    """Whether errors of the model cannot explain a torque's ratio to what the body needs."""
    return not SMALL < size < LARGE


def _tell_sizes(r: Reading, rows: Rows) -> Told | None:
    size = np.array(r.size)
    at = np.flatnonzero(size != 1.0)
    off = [j for j in at if is_off(size[j])]
    at = np.array(off) if off else at
    if not len(at):
        return None
    names, values = _name(rows, at, "tau"), [f"{one:.3g}" for one in size[at]]
    alike = len(set(values)) == 1
    values = values[:1] if alike else values
    if not off:
        where = [rows.joints[j] for j in at]
        if alike and set(rows.tested) == set(at.tolist()):
            where = ["all joints"]
        told = (
            f"torques at {', '.join(where)} are {', '.join(values)} times what the stated bodies need: the "
            "payload, masses, torque constants or positions (gear ratio, counts per turn) are off, or a "
            "balancer is not declared. Where constants are off, friction is as far off."
        )
        return told, tuple(f"gain {name}" for name in names)
    middle, ratio = abs(float(np.median(size[at]))), rows.prepared.dataset.fields.robot.gear_ratio
    hint = (
        "give torque on the joint side of the gear in N m (or N), and check the URDF's and payload's masses"
    )
    if ratio is not None and 0.3 < middle * float(np.median(np.abs(np.array(ratio)[at]))) < 3.0:
        hint = "it looks like motor-side torque: multiply it with the gear ratio"
    elif rows.slides[at].all():
        hint += ", and that q is in m; a spindle's force is its torque times 2 pi over its lead"
    elif middle > LARGE or 0.7 < middle / DEGREE < 1.4:
        hint += ", and that q is in rad and not in turns or degrees"
    if turned := [name for name, one in zip(names, size[at], strict=True) if one < 0.0]:
        columns = ", ".join(turned)
        hint += f'; what is negative is turned round too: write "turned: [{columns}]" in dataset.yaml'
    verb = "is" if len(at) == 1 else "are"
    told = (
        f"{say_columns(names)} {verb} {', '.join(values)} times what the rigid body needs, as currents or "
        f"torques in another unit or before a gear are; {hint}."
    )
    return told, tuple(f"gain {name}" for name in names)


def _propose_signs(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings with a reversed sign: of a torque, a position, both columns of a joint, or all torques."""
    tested = few.rows.tested
    if len(tested) > 1:
        yield r.has("sign", 0.0, torque_sign=tuple(-one for one in r.torque_sign))
    for j in tested:
        torque = {"torque_sign": r.times("torque_sign", [j], -1.0)}
        position = {"factor": r.times("factor", [j], -1.0), "zero": r.times("zero", [j], -1.0)}
        yield r.has("sign", 0.0, **torque)
        if not few.rows.slides[j]:
            yield r.has("sign", 0.0, **position)
        yield r.has("sign", 0.0, **torque, **position)


def _tell_signs(r: Reading, rows: Rows) -> Told | None:
    torques, positions = np.array(r.torque_sign) < 0.0, np.array(r.factor) < 0.0
    if not torques.any() and not positions.any():
        return None
    every = not positions.any() and torques[rows.tested].all()
    axis = "the URDF's axis"
    groups: list[tuple[np.ndarray, tuple[str, ...], str]]
    groups = [(torques & ~positions, ("tau",), "what the motion needs")]
    groups += [(positions & ~torques, ("q",), axis)]
    both = np.flatnonzero(torques & positions)
    groups += [(np.arange(rows.n) == j, ("q", "tau"), axis) for j in both]
    parts, codes, columns = [], ["sign tau"] if every else [], []
    for some, kinds, of_what in groups:
        names = [
            name for j in np.flatnonzero(some).tolist() for kind in kinds for name in _name(rows, [j], kind)
        ]
        if not names:
            continue
        noun, verb = ("columns ", "have") if len(names) > 1 else ("column ", "has")
        parts.append(f"{'' if every else noun}{say_columns(names)} {verb} the opposite sign of {of_what}")
        if not every:
            codes += [f"sign {' '.join(names)}"] if len(kinds) > 1 else [f"sign {name}" for name in names]
        columns += names
    hint = f"; {_SIGN_HINT}" if (torques & ~positions).any() else ""
    told = f'{", and ".join(parts)}{hint}; write "turned: [{", ".join(columns)}]" in dataset.yaml.'
    return told, tuple(codes)


def find_delay(few: Weighing, r: Reading) -> Reading:
    """Reading with the torques of all runs late, or early, by one time."""
    every = np.ones(len(few.rows.prepared.runs))
    return few.align(lambda x: _move(few, r, x[0] * every), np.append(_TIMES, -_TIMES)[:, None], LONGEST)


def _move(few: Weighing, r: Reading, times: np.ndarray, growth: float = 0.0) -> Reading:
    """Reading with delays (runs,) [s] at the start of the runs; they grow by `growth` [s] in the longest."""
    longest = max(float(run.t[-1]) for run in few.rows.prepared.runs)
    free = len(set(times) - {0.0}) + (growth != 0.0)
    late = r.has("late", FREE * free, delay=tuple(times.tolist()), drift=growth / longest)
    late = late.has("late", NOTE * (not _is_late(late, few.rows)))
    # Clocks that differ, or that are started by hand, are rarer than one delay, which they contain.
    return late if len(set(times)) == 1 and not growth else late.has("clocks", NOTE)


def _propose_delays(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings whose torques passed a first-order filter, or are late or early.

    They are late by one time; by one that grows, as of two clocks; or by a time of each run, as of two
    recorders that are started by hand.
    """
    if r.delay or r.lag:
        return

    def smooth(time: float) -> Reading:
        return r.has("late", FREE + NOTE * (time < _least_delay(few.rows)), lag=time)

    start = min(_TIMES.tolist(), key=lambda time: few.look(smooth(time)))
    yield refine(few, smooth, start, (0.4 * start, min(2.0 * start, LONGEST)), few.look(r) - r.nats)
    whole, every = find_delay(few, r), np.ones(len(few.rows.prepared.runs))
    starts = np.array([[time, growth] for time in (0.0, whole.delay[0]) for growth in (*_TIMES, *-_TIMES)])
    yield from (
        whole,
        few.align(lambda x: _move(few, r, 0.0 * every, x[0]), starts[:, 1:], LONGEST),
        few.align(lambda x: _move(few, r, x[0] * every, x[1]), starts, LONGEST),
    )
    if few.rows.doubted.all() and len(every) > 1:
        yield few.align(lambda x: _move(few, r, x), np.array([whole.delay]), LONGEST)


def _is_late(r: Reading, rows: Rows) -> bool:
    """Whether torques are behind a filter, or late or early, by so much that they are refused."""
    return max(abs(r.lag), float(np.abs(rows.delay_of(r)).max())) >= _least_delay(rows)


def _least_delay(rows: Rows) -> float:
    """Shortest delay [s] that is refused; a row may hold what happened since the row before it."""
    return max(LATE, 0.5 / rows.prepared.runs[0].band.rate)


def _tell_delays(r: Reading, rows: Rows) -> Told | None:
    times, codes = 1000.0 * np.array(r.delay or [r.lag]), ("late tau",)
    if r.drift:
        most = 1000.0 * float(np.abs(rows.delay_of(r)).max())
        return (
            f"the torque channels come from a clock that differs by {100 * abs(r.drift):.2g} % and are up to "
            f"{most:.0f} ms off; move each torque of time t [s, from the first row on] to the time "
            f"t - ({r.delay[0]:.4f} {r.drift:+.6f} t).",
            ("clock tau",),
        )
    if len(set(times)) > 1:
        runs = zip(times, rows.prepared.runs, strict=True)
        told = ", ".join(f"{round(time)} ms in {run.label}" for time, run in runs)
        return (
            "the torque channels are late by another time in each run, as where two recorders are started by "
            f"hand: {told}; move the torques of each run by its time.",
            ("clock tau",),
        )
    if not times.any():
        return None
    if not _is_late(r, rows):
        return (
            f"torques follow the motion by about {times[0]:.0f} ms at every joint, as behind a filter. A "
            "delay that is named at a joint comes from the recorder. Record the torque without a filter.",
            codes,
        )
    if r.lag:
        return (
            f"the torques are smoothed over about {times[0]:.0f} ms, as behind a low-pass filter; record "
            "them without it, or declare time_delay, which undoes most of it where motions are slow.",
            codes,
        )
    if times[0] < 0.0:
        told = f"come {-times[0]:.0f} ms early against the positions; align the channels"
    else:
        told = (
            f"come {times[0]:.0f} ms late against the positions, or passed a filter that delays them by as "
            "much; align the channels, or record them without the filter"
        )
    return f"the torque channels {told}, or declare time_delay.", codes


def _propose_clocks(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings whose clock is wrong by a factor, or whose rows run backwards."""
    if r.clock != 1.0:
        return
    yield r.has("clock", 0.0, clock=-1.0)

    def make(octaves: float) -> Reading:
        return r.has("clock", FREE, clock=float(2.0**octaves))

    start = min(_OCTAVES[_OCTAVES != 0.0].tolist(), key=lambda one: few.look(make(one)))
    best = refine(few, make, start, (start - 0.7, start + 0.7), few.look(r) - r.nats)
    yield _round(few, best, make(start))


def say_clock(factor: float) -> Told:
    """Sentence on a wrong clock and its code, from the ratio of true to recorded time."""
    by = max(factor, 1.0 / factor)
    by = float(round(by)) if abs(by / round(by) - 1.0) < 0.01 else by
    factor, way = (by, "short") if factor > 1.0 else (1.0 / by, "long")
    return (
        f"the clock or the rate is wrong by a factor of {by:.4g}, times are too {way}; write "
        f'"time_scale: {factor:.6g}" in dataset.yaml',
        ("clock t",),
    )


def _tell_clocks(r: Reading, rows: Rows) -> Told | None:
    if r.clock < 0.0:
        return "the torques fit the motion run backwards; sort the rows by time.", ("backwards t",)
    return say_clock(r.clock) if r.clock != 1.0 else None


def _propose_factors(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings whose positions are in degrees or mm, in turns, before a gear, or of another resolution."""
    rows, hope = few.rows, few.look(r)
    span = np.ptp(rows.q, axis=0)
    plain = [j for j in range(rows.n) if abs(r.factor[j]) == 1.0]
    units = ((False, DEGREE, span > 1.0), (True, _MM, span > 0.5), (False, 1.0 / DEGREE, span < _NARROW))
    for slides, unit, fits in units:
        some = [j for j in plain if rows.slides[j] == slides and fits[j]]
        for group in [some, *([j] for j in some if len(some) > 1)]:
            if group:
                yield r.has("unit", 0.0, factor=r.times("factor", group, unit))
    turning = [j for j in plain if not rows.slides[j]]
    for group in [turning, *([j] for j in turning if len(turning) > 1 and j in rows.tested)]:
        if not group:
            continue

        def make(octaves: float, group: list[int] = group) -> Reading:
            return r.has("scale", FREE, factor=r.times("factor", group, float(2.0**octaves)))

        # A single encoder may be off by a factor of two in its counts; all of them may also be before a gear.
        near = _OCTAVES[_OCTAVES != 0.0] if len(group) == len(turning) else [-1.0, 1.0]
        start = float(min(near, key=lambda one: few.look(make(float(one)))))
        best = refine(few, make, start, (start - 0.6, start + 0.6), hope)
        found = float(np.log2(abs(best.factor[group[0]] / r.factor[group[0]])))
        known = min((*_OCTAVES, *np.log2(_TURNS)), key=lambda one: abs(one - found))
        yield _round(few, best, make(float(known))) if known else best


def _tell_units(r: Reading, rows: Rows) -> Told | None:
    told, codes = [], []
    for unit, name, target, slides in ((DEGREE, "degrees", "rad", False), (_MM, "mm", "m", True)):
        some = [j for j in range(rows.n) if abs(r.factor[j]) == unit]
        columns, many = _name(rows, some, "q"), len(some) > 1
        if some and all(j in some for j in rows.tested if rows.slides[j] == slides):
            told.append(f"positions look like {name}; convert q to {target}.")
            codes.append(f"{name} q")
        elif some:
            noun, verb, them = ("columns", "look", "them") if many else ("column", "looks", "it")
            told.append(f"{noun} {say_columns(columns)} {verb} like {name}; convert {them} to {target}.")
            codes += [f"{name} {column}" for column in columns]
    return (" ".join(told), tuple(codes)) if told else None


def _tell_scales(r: Reading, rows: Rows) -> Told | None:
    at = [j for j in range(rows.n) if abs(r.factor[j]) not in (1.0, DEGREE, _MM)]
    if not at:
        return None
    names, sizes = _name(rows, at, "q"), [f"{abs(r.factor[j]):.5g}" for j in at]
    pairs = ", ".join(f"{name}: {size}" for name, size in zip(names, sizes, strict=True))
    told = (
        f"{say_columns(names)} {'fit' if len(at) > 1 else 'fits'} the URDF where multiplied by "
        f"{', '.join(dict.fromkeys(sizes))}, as turns, angles before a gear, or rad read as degrees; "
        f'where the exact factor is known, give that; write "scaled: {{{pairs}}}" in dataset.yaml.'
    )
    return told, tuple(f"scale {name}" for name in names)


def _propose_zeros(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings with another zero of a revolute joint's position."""
    hope = few.look(r) - r.nats
    for j in [j for j in few.rows.tested if not (few.rows.slides[j] or r.zero[j])]:

        def make(zero: float, j: int = j) -> Reading:
            return r.has("zero", FREE, zero=r.put("zero", [j], zero))

        grid = 0.5 * _QUARTER * np.arange(-3.0, 5.0)
        start = min(grid.tolist(), key=lambda zero: few.look(make(zero)))
        best = refine(few, make, start, (start - 0.4, start + 0.4), hope)
        quarter = _QUARTER * round(best.zero[j] / _QUARTER)
        yield _round(few, best, make(quarter)) if quarter else best


def _tell_zeros(r: Reading, rows: Rows) -> Told | None:
    moved = [j for j in range(rows.n) if r.zero[j]]
    if not moved:
        return None
    names, many = _name(rows, moved, "q"), len(moved) > 1
    pairs = ", ".join(f"{name}: {r.zero[j]:.4g}" for name, j in zip(names, moved, strict=True))
    told = (
        f"{' and '.join(names)} {'count' if many else 'counts'} from another zero than the URDF's "
        f'{"joints" if many else "joint"}; write "shifted: {{{pairs}}}" in dataset.yaml.'
    )
    return told, tuple(f"zero {name}" for name in names)


def _propose_exchanges(few: Weighing, r: Reading) -> Iterator[Reading]:
    """Readings with columns of two joints exchanged, or the position and torque of one joint."""
    rows = few.rows
    for i, j in combinations(range(rows.n), 2):
        motion, torque = {"motion_of": r.swap("motion_of", i, j)}, {"torque_of": r.swap("torque_of", i, j)}
        if i in rows.tested and j in rows.tested:
            yield r.has("exchanged", 0.0, **torque)
            yield r.has("exchanged", 0.0, **motion, **torque)
        if i in rows.tested or j in rows.tested:
            yield r.has("exchanged", 0.0, **motion)
    for j in rows.tested:
        if not r.crossed:
            yield r.has("exchanged", 0.0, crossed=frozenset([j]))


def _list_exchanges(order: Sequence[int]) -> list[tuple[int, int]]:
    """Pairs to exchange, one after the other, until each place holds what `order` says."""
    here, pairs = list(range(len(order))), []
    for j, wanted in enumerate(order):
        k = here.index(wanted)
        if k != j:
            here[j], here[k] = here[k], here[j]
            pairs.append((j, k))
    return pairs


def _tell_exchanges(r: Reading, rows: Rows) -> Told | None:
    pairs = {"q": _list_exchanges(r.motion_of), "tau": _list_exchanges(r.torque_of)}
    told, codes = [], []
    for i, j in dict.fromkeys((*pairs["q"], *pairs["tau"])):
        kinds = [kind for kind in ("q", "tau") if (i, j) in pairs[kind]]
        told += [f"'{kind}_{rows.joints[i]}' with '{kind}_{rows.joints[j]}'" for kind in kinds]
        codes.append(exchange_code(rows.joints, kinds, i, j))
    sentences = [f"columns look swapped: exchange {' and '.join(told)}."] if told else []
    for j in sorted(r.crossed):
        names = [*_name(rows, [j], "q"), *_name(rows, [j], "tau")]
        sentences.append(f"columns {say_columns(names)} look swapped; exchange them.")
        codes.append(f"exchanged {' '.join(names)}")
    return (" ".join(sentences), tuple(codes)) if sentences else None


#: Every trait, in the order of the sentences about them.
TRAITS = (
    Trait(_propose_gravity, _tell_gravity),
    Trait(_propose_signs, _tell_signs),
    Trait(_propose_exchanges, _tell_exchanges),
    Trait(_propose_factors, _tell_units),
    Trait(lambda few, r: iter(()), _tell_scales),
    Trait(_propose_zeros, _tell_zeros),
    Trait(_propose_clocks, _tell_clocks),
    Trait(_propose_delays, _tell_delays, lambda r, rows: not _is_late(r, rows)),
    Trait(_propose_sizes, _tell_sizes, lambda r, rows: not any(map(is_off, r.size))),
)


def tell(reading: Reading, rows: Rows) -> tuple[list[Told], list[Told]]:
    """Sentences and codes of a reading's traits: those that are refused, and those that are noted."""
    refused, noted = list[Told](), list[Told]()
    for trait in TRAITS:
        if told := trait.tell(reading, rows):
            (noted if trait.notes and trait.notes(reading, rows) else refused).append(told)
    return refused, noted
