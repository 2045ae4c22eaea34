"""Whether signals can be what the data set says they are: units, torque side, signs, channel order, delay.

The readings of the columns are weighed for all runs together, then for those runs that the stated reading
does not explain. A data set is refused with the reading that is clearly best as the remedy, unless `accept`
in `dataset.yaml` says that the data are right as they are; a reading that changes no number is a note.
"""

from dataclasses import replace

import numpy as np
from scipy import interpolate

from wearscope.closed_loop.intake.asked import Asked, Reading
from wearscope.closed_loop.intake.filtering import differentiate, low_pass, rows
from wearscope.closed_loop.intake.joint_fit import LEAST_ROWS, Rows
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.readings import find_reading, list_readings
from wearscope.closed_loop.intake.recording import estimate_quantum
from wearscope.closed_loop.intake.rough_model import fit_rough
from wearscope.closed_loop.intake.sizes import find_impossible_sizes, leave, say_sizes
from wearscope.effects.time_delay import EFFECT as TIME_DELAY
from wearscope.robots.urdf_file import OPEN_LIMIT, parse_urdf

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
#: Counts of a torque that a joint which holds still may swing by.
_COUNTS = 5.0
#: Share of its reach below which a joint rests in a run.
_RESTS = 1e-2
#: Share of a torque's variance below which there is no friction in it; factor below which there is no body.
_NO_FRICTION, _NO_BODY = 1e-4, 0.1


def check_plausibility(prepared: Prepared) -> None:
    """Refuse data that another reading of the columns explains and the stated one does not.

    Notes on what is accepted, on readings that change no number, and on entries of `accept` that overrule
    nothing, are added to the notes.

    Raises
    ------
    InputError
        Naming the runs, the columns and what they look like.
    """
    asked = ask_runs(prepared)
    left = np.array([asked.pick(asked.run == run).products.fit().left for run in range(len(prepared.runs))])
    for run, own in zip(prepared.runs, left, strict=True):
        _check_limits(prepared, run, own)
        if run.piece < 2:
            _check_speeds(prepared, run)
        _check_frozen(prepared, run)
    _check_readings(prepared, asked, left)
    _check_sizes(prepared, asked)
    _check_unrelated(prepared, asked, left)
    _note_body(prepared, asked)
    prepared.notes += prepared.dataset.accepted.list_unused()


def ask_runs(prepared: Prepared) -> Rows:
    """Rows of all runs as stated, those of idle drives left out."""
    reach = np.max([np.ptp(run.signals.q, axis=0) for run in prepared.runs], axis=0)
    usual = np.median([_torque_spread(run) for run in prepared.runs], axis=0)
    inertia, inertials = known_inertia(prepared.dataset), prepared.dataset.fields.robot.inertials
    parts: dict[str, list[np.ndarray]] = {
        name: [] for name in ("q", "v", "a", "sign", "tau", "counts", "run")
    }
    for k, run in enumerate(prepared.runs):
        s, at = run.signals, _pick(run, len(prepared.runs))
        for name, x in (("q", s.q), ("v", s.v), ("a", s.a), ("sign", s.sign)):
            parts[name].append(run.reduce(x)[at])
        parts["tau"].append(run.measured[at])
        travels = np.ptp(s.q, axis=0) > _RESTS * reach
        parts["counts"].append(run.keep[at] & prepared.moving & travels)
        parts["run"].append(np.full(len(run.t[at]), k))
    whole = {name: np.concatenate(part) for name, part in parts.items()}
    every = Rows(
        whole["q"],
        whole["v"],
        whole["a"],
        whole["sign"],
        whole["tau"],
        whole["counts"],
        whole["run"],
        tuple(run.signals.rigid_body for run in prepared.runs),
        inertia,
        prepared.top_speed,
        inertials,
    )
    for k, run in enumerate(prepared.runs):
        own = every.run == k
        quiet = _torque_spread(run) <= _QUIET * usual
        if quiet.any():
            left = every.pick(own).products.fit_sizes()[1]
            for j in np.flatnonzero(quiet & ~(left < _IDLE)).tolist():
                every.counts[own, j] = False
                if np.ptp(run.signals.q[:, j]) > 0.0:
                    prepared.notes.append(
                        f"{run.label}: tau_{prepared.dataset.joints[j]} hardly varies, as of a joint that is "
                        "not driven; no reading of the columns is weighed on it."
                    )
    return every


def _pick(run: PreparedRun, runs: int) -> slice:
    most = min(_MOST_OF_RUN, max(_MOST_ROWS // runs, 3 * LEAST_ROWS))
    return slice(None, None, max(1, len(run.t) // most))


def _refuse(prepared: Prepared, where: str, told: str, *codes: str) -> None:
    """Refuse by inference; noted instead where the data set accepts it."""
    note = prepared.dataset.accepted.refuse(where, told, *codes)
    if note not in prepared.notes:
        prepared.notes.append(note)


def _check_sizes(prepared: Prepared, whole: Rows) -> None:
    """Torques of joints at which body and drive's inertia move alike, so that one passes for the other."""
    every = range(len(prepared.runs))
    sizes = np.array([find_impossible_sizes(whole.pick(whole.run == k)) for k in every])
    runs = np.flatnonzero(np.isfinite(sizes).any(axis=1))
    if len(runs):
        where = prepared.dataset.folder
        if len(runs) < len(prepared.runs):
            where = where / prepared.runs[runs[0]].file
        at = np.flatnonzero(np.isfinite(sizes[runs[0]]))
        told, codes = say_sizes(_ask(prepared, whole), at, sizes[runs[0]])
        _refuse(prepared, str(where), told, *codes)


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
        every = list_readings(asked)
        while (found := find_reading(asked, every, frozenset(taken))) is not None:
            taken.update(found.codes)
            if not _is_borne_out(prepared, whole, found, np.setdiff1d(doubtful, group)):
                continue
            where = prepared.dataset.folder
            if len(group) < len(prepared.runs):
                where = where / prepared.runs[group[0]].file
            _refuse(prepared, str(where), found.told, *found.codes)


def _is_borne_out(prepared: Prepared, whole: Rows, found: Reading, others: np.ndarray) -> bool:
    """Whether a reading of some runs suits most others that the stated one does not explain either."""
    better = []
    for run in others.tolist():
        asked = _ask(prepared, whole.pick(whole.run == run))
        own = find_reading(asked, list_readings(asked))
        better.append(own is not None and own.codes == found.codes)
    return not better or bool(np.mean(better) >= 0.5)


def _ask(prepared: Prepared, own: Rows) -> Asked:
    """What other readings of some rows need."""
    dataset, runs = prepared.dataset, np.unique(own.run).tolist()
    count = len(prepared.runs)

    torques = [interpolate.CubicSpline(prepared.runs[k].t, prepared.runs[k].measured) for k in runs]

    def torque_at(delay: float) -> np.ndarray:
        parts = []
        for k, spline in zip(runs, torques, strict=True):
            run = prepared.runs[k]
            t = run.t[_pick(run, count)] + delay
            parts.append(spline(np.clip(t, run.t[0], run.t[-1])))
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
        free = np.median([_free_misfit(own, j) for j in heard])
        if free > _HOPELESS:
            told = (
                f"the motion explains next to nothing of the torque ({100 * max(0.0, 1 - free):.0f} % of the "
                "middle joint's); check that the columns belong together, their units, and the URDF."
            )
            _refuse(prepared, str(prepared.dataset.folder / run.file), told, "unrelated tau")
    # Links may weigh less than stated, and then an overstated body leaves more than there is.
    held = replace(whole, springs=True).products
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
        _refuse(prepared, str(prepared.dataset.folder), told, "unrelated tau")
    for name, size in zip(names, sizes, strict=True):
        told = f"{name}: body, friction and springs leave {size:.0f} % of this torque (RMS), and no reading"
        prepared.notes.append(f"{told} of its column is better.")


def _free_misfit(own: Rows, j: int) -> float:
    """Share of the variance that stays with free signs and sizes and a smooth function of position."""
    at = own.counts[:, j]
    y, q = own.tau[at, j], own.q[at, j]
    centre, half = 0.5 * (q.max() + q.min()), max(0.5 * float(np.ptp(q)), 1e-12)
    smooth = [((q - centre) / half) ** k for k in range(5)]
    x = np.column_stack([own.known[at, j], own.a[at, j], own.sign[at, j], own.v[at, j], *smooth])
    left = y - x @ fit_rough([x], [y])
    return float(np.sum(left**2) / np.sum((y - y.mean()) ** 2))


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
    for j in whole.products.heard:
        small = (0.0 < factor[j] < _NO_BODY or without[j] < 1.1 * loose[j]) and without[j] < _DOUBTFUL
        if small and _needs_body(whole, j):
            prepared.notes.append(
                f"{joints[j]}: next to nothing of the rigid body is seen in this torque; likely causes: "
                'gravity was taken out ("torque: without_gravity"), a balancer carries the body, or masses '
                "are far too large."
            )


def _needs_body(whole: Rows, j: int) -> bool:
    """Whether a joint's body has much torque that the drive's own inertia and friction cannot have."""
    at = whole.counts[:, j]
    own = [np.ones(at.sum()), whole.a[at, j], whole.sign[at, j], whole.v[at, j]]
    return bool(leave(whole.known[at, j], own).std() > 0.5 * whole.tau[at, j].std())


def _torque_spread(run: PreparedRun) -> np.ndarray:
    return np.array(
        [y[at].std() if at.any() else 0.0 for y, at in zip(run.measured.T, run.keep.T, strict=True)]
    )


def _check_limits(prepared: Prepared, run: PreparedRun, stated: np.ndarray) -> None:
    """Positions far outside the URDF's limits, which no zero offset explains, of joints not explained so."""
    for joint in parse_urdf(prepared.urdf).joints:
        j = prepared.dataset.joints.index(joint.name)
        widest = max(abs(joint.lower), abs(joint.upper))
        slides = prepared.dataset.position_unit[j] == "m"
        reach = float(np.abs(run.signals.q[:, j]).max())
        beyond = widest < 0.1 * OPEN_LIMIT and reach > 2.0 * widest + (0.2 if slides else 2 * np.pi)
        if beyond and not stated[j] <= _DOUBTFUL:
            unit, other = ("m", "mm") if slides else ("rad", "degrees")
            told = (
                f"column 'q_{joint.name}' reaches {reach:.3g}, where the URDF's limits are {joint.lower:.3g} "
                f"to {joint.upper:.3g} {unit}; if it is in {other} or before the gear, convert it to the "
                f"joint's {unit}."
            )
            _refuse(prepared, str(prepared.dataset.folder / run.file), told, f"limits q_{joint.name}")


def _check_speeds(prepared: Prepared, run: PreparedRun) -> None:
    """Given speeds that are not the positions' derivative."""
    recorded = next(r for r in prepared.dataset.runs if r.file == run.file).load()
    if recorded.qd is None:
        return
    rate = prepared.dataset.fields.sample_rate
    slope = differentiate(low_pass(recorded.q, run.band.torque, rate), rate)
    for j in np.flatnonzero(prepared.moving & np.isfinite(recorded.qd).all(axis=0)):
        given = low_pass(recorded.qd[:, [j]], run.band.torque, rate)[:, 0]
        both = float(given @ slope[:, j])
        gain = both / max(float(slope[:, j] @ slope[:, j]), 1e-300)
        alike = both / max(float(np.linalg.norm(given) * np.linalg.norm(slope[:, j])), 1e-300)
        moves = np.ptp(recorded.q[:, j]) > max(1e-3, 10.0 * float(estimate_quantum(recorded.q[:, [j]])[0]))
        if moves and not (0.8 < gain < 1.25 and alike > 0.8):
            joint = prepared.dataset.joints[j]
            told = (
                f"column 'qd_{joint}' is {gain:.3g} times the slope of 'q_{joint}' (correlation "
                f"{alike:.2f}); give the joint's speed in rad/s or m/s, or leave the column out."
            )
            _refuse(prepared, str(prepared.dataset.folder / run.file), told, f"speed qd_{joint}")


def _check_frozen(prepared: Prepared, run: PreparedRun) -> None:
    """A position that never changes while its torque swings as in motion: a dead encoder, no locked joint.

    A held joint's brake and motor share the load that the others' motion makes. Noise is known by its band.
    """
    recorded = next(r for r in prepared.dataset.runs if r.file == run.file)
    for j in np.flatnonzero(recorded.reach == 0.0).tolist():
        load = run.reduce(run.known[:, [j]])[:, 0]
        swing, torque = _span(run.measured[:, j] - load), _span(run.measured[:, j])
        usual = max(_span(other.measured[:, j]) for other in prepared.runs)
        if torque < _COUNTS * float(estimate_quantum(run.tau[:, [j]])[0]):
            continue
        steady = run.measured[:, j].var() > 0.5 * run.tau[:, j].var()
        if steady and min(swing, torque) > 0.5 * usual and swing + torque > 1.6 * _span(load):
            joint = prepared.dataset.joints[j]
            told = (
                f"column 'q_{joint}' never changes while 'tau_{joint}' swings by {torque:.3g}; the encoder's "
                "channel is dead, record the run again or leave it out."
            )
            _refuse(prepared, str(prepared.dataset.folder / run.file), told, f"frozen q_{joint}")


def _span(x: np.ndarray) -> float:
    return float(np.ptp(np.percentile(x, [2, 98])))
