"""Whether signals can be what the data set says they are: units, torque side, signs, channel order, delay.

A reading is a hypothesis of what the columns hold. Readings are compared on all runs together, then on the
run that agrees least with the others, since one machine must explain both. A data set is refused with the
best reading as the remedy, unless `accept` overrules it. What the search can name as an effect, and what
changes no number, is only noted.
"""

import re
from dataclasses import replace
from functools import partial

import numpy as np

from wearscope.closed_loop.intake.filtering import differentiate
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.signal_checks import check_signals, check_speeds
from wearscope.closed_loop.intake.traits import notes
from wearscope.closed_loop.intake.traits.hypotheses import find_delay, say_columns, tell
from wearscope.closed_loop.intake.traits.reading import Reading
from wearscope.closed_loop.intake.traits.rows import Rows, subtract_fit
from wearscope.closed_loop.intake.traits.score import Weighing
from wearscope.closed_loop.intake.traits.search import (
    HOPELESS,
    MUCH,
    REFUSE,
    Weighed,
    look_at,
    look_at_few,
    weigh,
)
from wearscope.effects.time_delay import EFFECT as TIME_DELAY

#: Largest unexplained share of a torque's variance (half of its RMS) with which effects can be judged.
_UNJUDGED = 0.25
#: A torque has lost its signs where restored signs reduce its unexplained part to this share.
_FOLDED = 0.5
#: Pattern of a remedy that holds for all runs; its group is not empty where a further remedy follows.
_FOR_ALL = re.compile(r'; write "[^"]*"(?: below robot)? in dataset\.yaml(, or)?')
#: Iterations of the search for a torque's signs; largest step of a position from row to row, over its reach.
_TURNS, _STEP = 20, 0.1


def check_plausibility(prepared: Prepared) -> None:
    """Refuse data that another reading of the columns explains and the stated one does not.

    Accepted refusals, noted readings and unused entries of `accept` are added to the data set's notes.

    Raises
    ------
    InputError
        Naming the runs, the columns and what they look like.
    """
    first, rows = len(prepared.notes), Rows.of(prepared)
    left = np.array([_find_unexplained(rows.pick(rows.run == k)) for k in range(len(prepared.runs))])
    check_speeds(prepared, partial(_ask_clock, prepared))
    if rows.tested:
        _check_signs(prepared, rows)
        found = _check_readings(prepared, rows)
    # Limits of the signals are checked last, since a refusal by a reading tells the user more.
    for run, own in zip(prepared.runs, left, strict=True):
        check_signals(prepared, run, own <= MUCH)
    if rows.tested:
        _check_unrelated(prepared, rows, left, found)
        notes.add_notes(prepared, rows, found)
    prepared.notes += prepared.dataset.accepted.list_unused()
    prepared.checked = prepared.notes[first:]


def _ask_clock(prepared: Prepared, factor: float) -> float:
    """Evidence [nats] that the clock is wrong by `factor`, with speeds from differentiated positions."""
    rows = Rows.of(replace(prepared, runs=[_take_slopes(run) for run in prepared.runs], notes=[]))
    return look_at(rows, Reading.stated(rows.n).has("clock", 0.0, clock=factor)) if rows.tested else 0.0


def _take_slopes(run: PreparedRun) -> PreparedRun:
    """Copy of a run whose speeds are differentiated positions, not recorded ones."""
    v = differentiate(run.signals.q, run.band.rate)
    sign = np.where(run.resting, 0.0, np.sign(v))
    signals = replace(run.signals, v=v, a=differentiate(v, run.band.rate), sign=sign, _slopes={})
    return replace(run, signals=signals)


def _find_unexplained(rows: Rows) -> np.ndarray:
    """Share (n,) of each torque's variance that rigid body and friction leave; NaN where none is tested."""
    left = np.full(rows.n, np.nan)
    if rows.tested:
        left[rows.tested] = Weighing(rows, coarse=True).fit(Reading.stated(rows.n)).leave_plain()
    return left


def _check_readings(prepared: Prepared, whole: Rows) -> Weighed:
    """Refuse data that another reading explains, in all runs or in the worst one; return all runs' result."""
    declared = prepared.dataset.fields.declared_effects
    taken: dict[str, Reading] = {}
    if TIME_DELAY.name in declared:
        taken["late tau"] = find_delay(look_at_few(whole), Reading.stated(whole.n))
    found = weigh(whole, frozenset(taken))
    single = _doubt_one(whole, found)
    while True:
        every = [(found, whole), *((weigh(rows, frozenset(taken)), rows) for rows in single)]
        told = [(one.best.over(one.stated), k) for k, (one, rows) in enumerate(every) if _tell(one, rows)]
        if not told:
            return found
        best, rows = every[max(told)[1]]
        text, codes = _tell(best, rows) or ("", ())
        reading = best.best.reading
        # A reading that the data set accepts explains these rows at least as well.
        if any(look_at(rows, one) >= look_at(rows, reading) for one in taken.values()):
            return Weighed(found.stated, found.stated, [])
        taken.update(dict.fromkeys(codes, reading))
        file = ""
        if rows is not whole:
            file = prepared.runs[int(rows.run[rows.doubted][0])].file
            # A line in dataset.yaml would hold for every run, so that such a remedy is left out.
            text = _FOR_ALL.sub(lambda found: ";" if found[1] else "", text.rstrip("."))
            text += "; correct this run's file, or leave the run out; a hand on the robot may look the same."
        prepared.refuse(str(prepared.dataset.folder / file), text, *codes)
        found = weigh(whole, frozenset(taken))


def _doubt_one(whole: Rows, found: Weighed) -> list[Rows]:
    """List of the rows with the least explained run marked as doubted; empty where all runs are explained.

    A wrong run makes others look wrong, so the doubted run is the one without which the others agree best.
    """
    left = found.stated.leave_by_run()
    doubtful = np.flatnonzero(left > MUCH).tolist() if len(left) > 1 else []
    rest = {k: np.nan_to_num(_find_unexplained(whole.pick(whole.run != k))).sum() for k in doubtful}
    return [replace(whole, doubted=whole.run == run) for run in sorted(rest, key=lambda k: rest[k])[:1]]


def _tell(found: Weighed, rows: Rows) -> tuple[str, tuple[str, ...]] | None:
    """Sentence on what is refused, and its codes; None where nothing is refused."""
    refused, noted = tell(found.best.reading, rows)
    poor = not found.is_answer
    if not rows.doubted.all():
        which = np.unique(rows.run).tolist().index(rows.run[rows.doubted][0])
        poor |= bool(found.best.leave_by_run()[which] > MUCH)
    if not refused or poor or found.best.over(found.stated) < REFUSE:
        return None
    parts = [told.rstrip(".") for told, _ in (*refused, *noted)]
    if max(map(found.best.measure_friction, range(len(found.best.left)))) < notes.NO_FRICTION:
        parts = [one.replace("no gravity", "neither gravity nor friction") for one in parts]
    codes = [code for _, some in refused for code in some]
    rivals = found.list_rivals(rows)
    text = "; or, which these motions do not tell from it, ".join(["; in addition, ".join(parts), *rivals])
    codes += [code for some in rivals.values() for code in some]
    return f"{text}.", tuple(dict.fromkeys(codes))


def _check_signs(prepared: Prepared, whole: Rows) -> None:
    """Refuse torques that were recorded without their sign; note positions that start at 0 in every run."""
    left, joints = _find_unexplained(whole), prepared.dataset.joints
    records = [record.load() for record in prepared.dataset.runs]
    lowest = np.min([record.tau.min(axis=0) for record in records], axis=0)
    if bare := [j for j in whole.tested if lowest[j] >= 0.0]:
        # A load may keep a torque on one side of zero.
        known = Weighing(whole, coarse=True).fit(Reading.stated(whole.n)).columns.known
        gains = {j: _unfold(whole, known, j) for j in bare}
        most = {j: 1.0 if left[j] > HOPELESS else _FOLDED for j in bare}
        if folded := [f"tau_{joints[j]}" for j in bare if gains[j] < most[j]]:
            verb, one = ("are", "torques") if len(folded) > 1 else ("is", "a torque")
            told = f"{say_columns(folded)} {verb} never negative, as {one} without sign; record the torque"
            prepared.refuse(str(prepared.dataset.folder), f"{told} with its sign.", "unsigned tau")
        elif doubted := [f"tau_{joints[j]}" for j in bare if gains[j] < 1.0 and left[j] > MUCH]:
            prepared.notes.append(f"{', '.join(doubted)}: never negative, by the load or without a sign.")
    if np.nanmax(left) > MUCH / 2.0 and all(starts_at_zero(record.q) for record in records):
        prepared.notes.append(
            "all positions are 0 at the start of every run, and the stated bodies leave much of the torque: "
            "where the controller counts from there, give absolute positions."
        )


def starts_at_zero(q: np.ndarray) -> bool:
    """Whether all positions (N, n) start at 0 and leave it without a step.

    Zeros that a recorder wrote in place of missing values end with a step.
    """
    moved = q[np.any(q != 0.0, axis=1)][:1]
    return bool(np.all(q[0] == 0.0) and np.all(np.abs(moved) <= _STEP * np.ptp(q, axis=0)))


def _unfold(rows: Rows, known: np.ndarray, j: int) -> float:
    """Unexplained variance of the torque with restored signs, over that of the torque as recorded."""
    at = rows.counts[:, j]
    y, direction, body = rows.tau[at, j], rows.sign[at, j], known[at, j]
    columns, left = [np.ones(len(y)), body, rows.a[at, j], direction, rows.v[at, j]], []
    for start in (body, direction):
        sign = np.where(start < 0.0, -1.0, 1.0)
        for _ in range(_TURNS):
            sign = np.where(sign * y < subtract_fit(sign * y, columns), -1.0, 1.0)
        left.append(float(subtract_fit(sign * y, columns).var()))
    none = 0.01 * float(y.var())
    return (min(left) + none) / (float(subtract_fit(y, columns).var()) + none)


def _check_unrelated(prepared: Prepared, whole: Rows, left: np.ndarray, found: Weighed) -> None:
    """Refuse torques that the motion hardly explains in a run, or that no machine explains well."""
    known = found.stated.fit.columns.known
    for k, run in enumerate(prepared.runs):
        own, tested = whole.run == k, np.isfinite(left[k])
        if not tested.any() or np.median(left[k, tested]) <= HOPELESS:
            continue
        free = np.median([_misfit(whole.pick(own), known[own], j) for j in np.flatnonzero(tested).tolist()])
        if free > HOPELESS:
            told = (
                f"the motion explains next to nothing of the torque ({100 * max(0.0, 1 - free):.0f} % of the "
                "middle joint's); check that the columns belong together, their units, and the URDF."
            )
            prepared.refuse(str(prepared.dataset.folder / run.file), told, "unrelated tau")
    bad = found.stated.held > _UNJUDGED
    names = [f"tau_{prepared.dataset.joints[j]}" for j in np.array(whole.tested, dtype=int)[bad]]
    sizes = 100 * np.sqrt(found.stated.held[bad])
    # A single joint may have an effect of its own; where most joints are unexplained, a common cause is
    # missing.
    if 1 < len(names) >= 0.5 * len(whole.tested):
        told = (
            f"body, friction and springs leave {sizes.min():.0f} to {sizes.max():.0f} % (RMS) of "
            f"{', '.join(names)}, as where the base moves or something is touched; measure on a fixed base "
            "and free of contact, or check that the columns belong together, their units, and the URDF."
        )
        prepared.refuse(str(prepared.dataset.folder), told, "unrelated tau")
    for name, size in zip(names, sizes, strict=True):
        told = f"{name}: body, friction and springs leave {size:.0f} % of this torque (RMS), and no reading"
        prepared.notes.append(f"{told} of its column explains it.")


def _misfit(own: Rows, known: np.ndarray, j: int) -> float:
    """Share of a torque's variance that the motion leaves when all coefficients are free.

    The regressors are body, acceleration, direction, speed and a polynomial of the position.
    """
    at = own.counts[:, j]
    y, q = own.tau[at, j], own.q[at, j]
    centre, half = 0.5 * (q.max() + q.min()), max(0.5 * float(np.ptp(q)), 1e-12)
    smooth = [((q - centre) / half) ** k for k in range(5)]
    motion = [known[at, j], own.a[at, j], own.sign[at, j], own.v[at, j]]
    return float(subtract_fit(y, [*motion, *smooth]).var() / y.var())
