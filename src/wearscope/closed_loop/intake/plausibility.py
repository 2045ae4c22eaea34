"""Whether signals can be what the data set says they are: units, torque side, signs, channel order, delay.

The readings of the columns are weighed for all runs together, then for those that the stated reading does not
explain. A data set is refused with the best reading as the remedy, unless `accept` overrules it; a reading
that changes no number is a note.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy import interpolate

from wearscope.closed_loop.intake.asked import Asked, Reading, say_columns
from wearscope.closed_loop.intake.filtering import differentiate, low_pass, rows
from wearscope.closed_loop.intake.gravity import find_missing_weight
from wearscope.closed_loop.intake.joint_fit import LEAST_ROWS, WORTH, Rows, is_clearly_less
from wearscope.closed_loop.intake.lags import find_lag
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.products import DOUBTFUL, NONE
from wearscope.closed_loop.intake.readings import Readings, find_reading
from wearscope.closed_loop.intake.scales import find_scale
from wearscope.closed_loop.intake.signal_checks import check_signals, check_speeds
from wearscope.closed_loop.intake.sizes import (
    find_constants,
    find_impossible_sizes,
    free_misfit,
    needs_body,
    say_payload,
    say_sizes,
    unfold,
)
from wearscope.closed_loop.intake.zeros import starts_at_zero
from wearscope.effects.time_delay import EFFECT as TIME_DELAY

#: Share of a torque's variance above which a joint, or a run, is doubted.
_DOUBTFUL = 0.1
#: A data set is refused without a remedy where this share of the variance stays at half of its joints.
_HOPELESS = 0.8
#: Share of a torque's variance, half of it as RMS, beyond which no name can be judged.
_UNJUDGED = 0.25
#: Most rows of all runs, and of one run, that the readings are weighed on.
_MOST_ROWS, _MOST_OF_RUN = 4000, 1200
#: Torque that varies less than this share of what it usually does is of an idle drive, unless the motion
#: explains all but a share of it.
_QUIET, _IDLE = 0.2, 0.3
#: Share of what a torque as recorded leaves that it leaves with signs, where it has lost them.
_FOLDED = 0.5
#: Share of its reach below which a joint rests in a run.
_RESTS = 1e-2
#: Share of a torque's variance below which there is no friction in it; factor below which there is no body.
_NO_FRICTION, _NO_BODY = 1e-4, 0.1


def check_plausibility(prepared: Prepared) -> None:
    """Refuse data that another reading of the columns explains and the stated one does not.

    What is accepted, readings that change no number and unused entries of `accept` are noted.

    Raises
    ------
    InputError
        Naming the runs, the columns and what they look like.
    """
    asked, first = ask_runs(prepared), len(prepared.notes)
    left = np.array([asked.pick(asked.run == run).products.fit().left for run in range(len(prepared.runs))])
    check_speeds(prepared)
    for run, own in zip(prepared.runs, left, strict=True):
        check_signals(prepared, run, own <= _DOUBTFUL)
    _check_signs(prepared, asked)
    _check_readings(prepared, asked, left)
    _check_sizes(prepared, asked)
    _note_constants(prepared, asked)
    _note_lag(prepared, asked)
    _check_unrelated(prepared, asked, left)
    _note_body(prepared, asked)
    prepared.notes += prepared.dataset.accepted.list_unused()
    prepared.checked = prepared.notes[first:]


def ask_runs(prepared: Prepared) -> Rows:
    """Rows of all runs as stated, those of idle drives left out."""
    reach = np.max([np.ptp(run.signals.q, axis=0) for run in prepared.runs], axis=0)
    usual = np.median([_torque_spread(run) for run in prepared.runs], axis=0)
    names = ("q", "v", "a", "sign", "tau", "counts", "run")
    parts: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for k, run in enumerate(prepared.runs):
        s, at = run.signals, _pick(run, len(prepared.runs))
        for name, x in (("q", s.q), ("v", s.v), ("a", s.a), ("sign", s.sign)):
            parts[name].append(run.reduce(x)[at])
        parts["tau"].append(run.measured[at])
        travels = np.ptp(s.q, axis=0) > _RESTS * reach
        parts["counts"].append(run.keep[at] & prepared.moving & travels)
        parts["run"].append(np.full(len(run.t[at]), k))
    whole: dict[str, Any] = {name: np.concatenate(part) for name, part in parts.items()}
    every = Rows(
        **whole,
        bodies=tuple(run.signals.rigid_body for run in prepared.runs),
        inertia=known_inertia(prepared.dataset),
        top=prepared.top_speed,
        inertials=prepared.dataset.fields.robot.inertials,
    )
    for k, run in enumerate(prepared.runs):
        own = every.run == k
        quiet = _torque_spread(run) <= _QUIET * usual
        if quiet.any():
            left = every.pick(own).products.fit_sizes()[1]
            for j in np.flatnonzero(quiet & prepared.moving & ~(left < _IDLE)).tolist():
                every.counts[own, j] = False
                if np.ptp(run.signals.q[:, j]) > 0.0:
                    prepared.notes.append(
                        f"{run.label}: tau_{prepared.dataset.joints[j]} hardly varies, as of a joint that is "
                        "not driven; no reading of the columns is weighed on it."
                    )
    return _leave_rotors(every)


def _leave_rotors(whole: Rows) -> Rows:
    """Rows without the declared rotors of joints whose torque clearly is that behind the gear."""
    without = replace(whole, inertia=np.zeros(whole.n))
    stated, fit = whole.products.fit(), without.products.fit()
    behind = (fit.left < np.minimum(stated.left - DOUBTFUL, _DOUBTFUL)) & (fit.friction < NONE)
    return replace(whole, inertia=np.where(behind, 0.0, whole.inertia)) if behind.any() else whole


def _pick(run: PreparedRun, runs: int) -> slice:
    most = min(_MOST_OF_RUN, max(_MOST_ROWS // runs, 3 * LEAST_ROWS))
    return slice(None, None, max(1, len(run.t) // most))


def _check_signs(prepared: Prepared, whole: Rows) -> None:
    """Torques without their signs; positions that count from where each run starts."""
    left, joints = whole.products.fit().left, prepared.dataset.joints
    if np.nan_to_num(left).max(initial=0.0) < WORTH:
        return
    records, heard = [record.load() for record in prepared.dataset.runs], whole.products.heard
    lowest = np.min([record.tau.min(axis=0) for record in records], axis=0)
    if np.nanmax(left) > _DOUBTFUL and np.all(lowest[heard] >= 0.0):
        # A load may keep a torque on one side of zero.
        gains = {f"tau_{joints[j]}": unfold(whole, j) for j in heard}
        most = np.where(left[list(heard)] > _HOPELESS, 1.0, _FOLDED)
        if folded := [name for (name, gain), one in zip(gains.items(), most, strict=True) if gain < one]:
            verb, one = ("are", "torques") if len(folded) > 1 else ("is", "a torque")
            told = f"{say_columns(folded)} {verb} never negative, as {one} without sign; record the torque"
            prepared.refuse(str(prepared.dataset.folder), f"{told} with its sign.", "unsigned tau")
        elif doubted := [name for name, gain in gains.items() if gain < 1.0]:
            prepared.notes.append(f"{', '.join(doubted)}: never negative, by the load or without a sign.")
    if all(starts_at_zero(record.q) for record in records):
        prepared.notes.append(
            "all positions are 0 at the start of every run, and the stated bodies leave much of the torque: "
            "where the controller counts from there, give absolute positions."
        )


def _check_sizes(prepared: Prepared, whole: Rows) -> None:
    """Torques of joints at which body and drive's inertia move alike, so that one passes for the other."""
    every = range(len(prepared.runs))
    sizes = np.array([find_impossible_sizes(whole.pick(whole.run == k)) for k in every])
    runs = np.flatnonzero(np.isfinite(sizes).any(axis=1))
    if len(runs):
        some = len(runs) < len(prepared.runs)
        where = prepared.dataset.folder / (prepared.runs[runs[0]].file if some else "")
        at = np.flatnonzero(np.isfinite(sizes[runs[0]]))
        told, codes = say_sizes(_ask(prepared, whole), at, sizes[runs[0]])
        prepared.refuse(str(where), told, *codes)


def _note_constants(prepared: Prepared, whole: Rows) -> None:
    """Torques by a constant that is off, or of masses that are: one fit does not tell them apart."""
    size, (total, mass) = find_constants(whole.products), whole.carried
    sized, stated = whole.products.resize(size).total, whole.products.total
    if total < sized and is_clearly_less(total, stated, DOUBTFUL) and whole.rivals_springs(total):
        prepared.notes.append(say_payload(mass))
        if is_clearly_less(total, sized, DOUBTFUL):
            return
    if np.all(size == 1.0) or not whole.rivals_springs(sized):
        size = find_constants(whole.sprung)  # a missing spring looks like a body of another size
    named = zip(prepared.dataset.joints, size.tolist(), strict=True)
    prepared.torque_factors = {joint: one for joint, one in named if one != 1.0}
    if not prepared.torque_factors:
        return
    where, sizes = list(prepared.torque_factors), [f"{one:.3g}" for one in prepared.torque_factors.values()]
    if len(where) == len(whole.products.heard) and len(set(sizes)) == 1:
        where, sizes = ["all joints"], sizes[:1]
    prepared.notes.append(
        f"torques at {', '.join(where)} are {', '.join(sizes)} times what the stated bodies need: the "
        "payload, masses, torque constants or positions (gear ratio, counts per turn) are off, or a balancer "
        "is not declared. Where constants are off, friction is as far off."
    )


def _note_lag(prepared: Prepared, whole: Rows) -> None:
    """Torques that follow the motion at every joint, as a recorder's or a filter's do."""
    declared = prepared.dataset.fields.declared_effects
    if (lag := find_lag(_ask(prepared, whole))) is not None and TIME_DELAY.name not in declared:
        prepared.notes.append(
            f"torques follow the motion by about {1000 * lag:.0f} ms at every joint, as behind a filter. "
            "A delay that is named at a joint comes from the recorder. Record the torque without a filter."
        )


def _check_readings(prepared: Prepared, whole: Rows, left: np.ndarray) -> None:
    """Readings of all runs together, then of those runs that the stated one does not explain."""
    doubtful = np.flatnonzero(np.nan_to_num(left).max(axis=1) > _DOUBTFUL)
    worst = doubtful[np.argsort(-np.nansum(left[doubtful], axis=1))][:1]
    groups = [np.arange(len(prepared.runs))]
    for group in (doubtful, worst):
        if len(group) and len(group) < len(groups[-1]):
            groups.append(group)
    taken: set[str] = {"late tau"} if TIME_DELAY.name in prepared.dataset.fields.declared_effects else set()
    for group in groups:
        asked = _ask(prepared, whole.pick(np.isin(whole.run, group)))
        every = Readings(asked)
        while (found := find_reading(every, frozenset(taken))) is not None:
            taken.update(found.codes)
            if not _is_borne_out(prepared, whole, found, np.setdiff1d(doubtful, group)):
                continue
            where = prepared.dataset.folder
            if len(group) < len(prepared.runs):
                where = where / prepared.runs[group[0]].file
            prepared.refuse(str(where), found.told, *found.codes)


def _is_borne_out(prepared: Prepared, whole: Rows, found: Reading, others: np.ndarray) -> bool:
    """Whether a reading of some runs suits most others that the stated one does not explain either."""
    better = []
    for run in others.tolist():
        asked = _ask(prepared, whole.pick(whole.run == run))
        own = find_reading(Readings(asked))
        better.append(own is not None and own.codes == found.codes)
    return not better or bool(np.mean(better) >= 0.5)


def _ask(prepared: Prepared, own: Rows) -> Asked:
    """What other readings of some rows need."""
    dataset, runs = prepared.dataset, np.unique(own.run).tolist()
    count = len(prepared.runs)

    torques = [interpolate.CubicSpline(prepared.runs[k].t, prepared.runs[k].measured) for k in runs]

    def torque_at(delay: float, order: int) -> np.ndarray:
        parts = []
        for k, spline in zip(runs, torques, strict=True):
            run = prepared.runs[k]
            t = run.t[_pick(run, count)] + delay
            parts.append(spline(np.clip(t, run.t[0], run.t[-1]), order))
        return np.concatenate(parts)

    times = [prepared.runs[k].t for k in runs]
    room = np.concatenate(
        [
            np.minimum(t - t[0], t[-1] - t)[_pick(prepared.runs[k], count)]
            for k, t in zip(runs, times, strict=True)
        ]
    )

    def swapped(j: int) -> Rows:
        columns = {name: getattr(own, name).copy() for name in ("q", "v", "a", "sign", "tau")}
        for k in runs:
            run = prepared.runs[k]
            q = low_pass(run.tau[:, j], run.band.torque, run.band.rate)
            v = differentiate(q, run.band.rate)
            kept = rows(run.band, len(q))
            a = differentiate(v, run.band.rate)
            for name, x in (("q", q), ("v", v), ("a", a), ("sign", np.sign(v))):
                columns[name][own.run == k, j] = x[kept][_pick(run, count)]
        columns["tau"][:, j] = own.q[:, j]
        return replace(own, **columns)

    slides = [unit == "m" for unit in dataset.position_unit]
    return Asked(own, slides, dataset.joints, torque_at, room, swapped, dataset.fields.robot.gear_ratio)


def _check_unrelated(prepared: Prepared, whole: Rows, left: np.ndarray) -> None:
    """Torques of which the motion explains next to nothing, in a run."""
    for k, run in enumerate(prepared.runs):
        own = whole.pick(whole.run == k)
        heard = own.products.heard
        if not heard or np.median(left[k, heard]) <= _HOPELESS:
            continue
        free = np.median([free_misfit(own, j) for j in heard])
        if free > _HOPELESS:
            told = (
                f"the motion explains next to nothing of the torque ({100 * max(0.0, 1 - free):.0f} % of the "
                "middle joint's); check that the columns belong together, their units, and the URDF."
            )
            prepared.refuse(str(prepared.dataset.folder / run.file), told, "unrelated tau")
    # Links may weigh less than stated, and then an overstated body leaves more than there is.
    held = whole.sprung
    own = np.nan_to_num(np.fmin.reduce([held.fit().left, *held.fit_sizes()[1:]]))
    bad = np.flatnonzero(own > _UNJUDGED)
    names, sizes = [f"tau_{prepared.dataset.joints[j]}" for j in bad], 100 * np.sqrt(own[bad])
    # One joint may have what no other has; most joints together lack something that moves them all.
    if 1 < len(bad) >= 0.5 * len(whole.products.heard):
        told = (
            f"body, friction and springs leave {sizes.min():.0f} to {sizes.max():.0f} % (RMS) of "
            f"{', '.join(names)}, as where the base moves or something is touched; measure on a fixed base "
            "and free of contact, or check that the columns belong together, their units, and the URDF."
        )
        prepared.refuse(str(prepared.dataset.folder), told, "unrelated tau")
    for name, size in zip(names, sizes, strict=True):
        told = f"{name}: body, friction and springs leave {size:.0f} % of this torque (RMS), and no reading"
        prepared.notes.append(f"{told} of its column is better.")


def _note_body(prepared: Prepared, whole: Rows) -> None:
    """Readings that change no number: torques without friction, and bodies of which nothing is seen."""
    fit, joints = whole.products.fit(), prepared.dataset.joints
    factor, loose, without = whole.products.fit_sizes()
    link = [joints[j] for j in whole.products.heard if fit.friction[j] < _NO_FRICTION and fit.left[j] < 0.05]
    prepared.link_side = frozenset(link)
    if link:
        prepared.notes.append(
            f"{', '.join(link)}: there is no friction to be seen in this torque, as behind the gear (link "
            'side); "torque: link" in dataset.yaml says so and changes no number.'
        )
    scale = find_scale(whole, np.array([unit != "m" for unit in prepared.dataset.position_unit], dtype=float))
    if scale != 1.0:
        prepared.notes.append(
            f"positions {scale:.3g} times as large fit better next to springs and torques of any size: gear "
            "ratio, counts per turn or unit of the positions may be wrong."
        )
    weight, lacks, has = find_missing_weight(whole)
    for j in whole.products.heard:
        if lacks[j] and fit.left[j] < _UNJUDGED:
            unit = prepared.dataset.torque_unit[j]
            prepared.notes.append(
                f"{joints[j]}: of the weight that the stated bodies have there, {weight[j]:.3g} {unit} on "
                f"average, this torque has {has[j]:.3g} {unit}: "
                'gravity was taken out ("torque: without_gravity"), a balancer or '
                "brake carries it, the sensor was set to zero under load, or positions are of another "
                "scale or zero. Where it hardly varies, the data do not tell which; record the drive's whole "
                "torque."
            )
            continue
        small = (0.0 < factor[j] < _NO_BODY or without[j] < 1.1 * loose[j]) and without[j] < _DOUBTFUL
        if small and needs_body(whole, j):
            prepared.notes.append(
                f"{joints[j]}: next to nothing of the rigid body is seen in this torque; likely causes: "
                'gravity was taken out ("torque: without_gravity"), a balancer carries the body, positions '
                "are wrong (scale, zero), or masses are far too large."
            )


def _torque_spread(run: PreparedRun) -> np.ndarray:
    return np.array(
        [y[at].std() if at.any() else 0.0 for y, at in zip(run.measured.T, run.keep.T, strict=True)]
    )
