"""A data set made ready for regression: signals of one bandwidth, the known torque, rows that count.

`prepare` is a chain of steps: clean every recording, find the joints and runs that move, choose the filter
before differentiation, bridge missing torques, choose the common filter and the friction's reversal, and make
the signals. Recordings are read one at a time; fast ones are thinned to the rate that the filters need.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from wearscope.closed_loop.intake.cleaning import LONGEST_SPIKE, MOST_FROZEN
from wearscope.closed_loop.intake.dataset import Dataset
from wearscope.closed_loop.intake.direction import Reversals
from wearscope.closed_loop.intake.filtering import (
    EDGE_PERIODS,
    Band,
    Motion,
    choose_factor,
    choose_motion_cutoff,
    choose_torque_cutoff,
    decimate,
    differentiate_run,
    rows,
)
from wearscope.closed_loop.intake.prepared import (
    LEAST_ROWS,
    Prepared,
    PreparedRun,
    known_inertia,
    leave_out_short,
    take_direction,
)
from wearscope.closed_loop.intake.reversals import choose_reversal_widths
from wearscope.closed_loop.intake.rough_model import RoughRun, bridge_rest, predict_rough
from wearscope.closed_loop.intake.saturation import (
    bridge_torque,
    find_clipped,
    goes_beyond,
    keep_lasting,
    spread_out,
)
from wearscope.closed_loop.intake.sources import MovingJoints, Source, clean_runs, leave_out_rest
from wearscope.effects.base import Signals
from wearscope.errors import InputError
from wearscope.robots.urdf import TINY_MASS, movable_joints, normalise_tree, parse_urdf, write_urdf

#: Share of a joint's training torque that may be clipped or frozen.
_MOST_FAULTY = 0.2
#: Speed below which a joint of unknown encoder step rests, as a share of the largest speed of any joint.
_STILL = 1e-6


def prepare(dataset: Dataset, urdf_source: str | Path | None = None) -> Prepared:
    """Make a data set ready for regression.

    Parameters
    ----------
    dataset : Dataset
    urdf_source : path-like, optional
        Instead of the data set's own URDF.

    Raises
    ------
    InputError
        Where no training run moves, a channel is broken beyond correction, or no moving link has a mass.
    """
    urdf, told = normalise_robot(urdf_source or dataset.urdf, dataset)
    notes = [*dataset.notes, *told]
    sources = clean_runs(dataset, urdf, notes)
    sources, motion = leave_out_rest(dataset, sources, notes)
    rate, inertia = dataset.fields.sample_rate, known_inertia(dataset)
    edge = choose_motion_cutoff([s.run for s in sources if s.run.use == "train"], rate)
    factor = choose_factor(rate, edge, 0.0)
    rough = [make_rough(s, rate, edge, factor, inertia, motion) for s in sources]
    sources, rough = bridge_gaps(dataset, sources, rough, factor, notes)
    band = _choose_band(rough, motion.moving, rate, edge, factor)
    reversals = Reversals.over(_choose_widths(rough, motion.moving, band, factor))
    del rough
    factor = choose_factor(rate, band.motion, band.torque)
    band = replace(band, rate=rate / factor)
    runs = []
    while sources:
        runs.append(finish_run(sources.pop(0), rate, band, factor, inertia, reversals, motion))
    for run in runs:
        run.keep[:, [reading == "none" for reading in dataset.fields.readings().values()]] = False
    runs = leave_out_short(dataset, runs, band, notes)
    notes += _describe(dataset, band, rate, factor)
    return Prepared(dataset, urdf, runs, band, motion.moving, notes, reversals, motion.top_speed)


def normalise_robot(source: str | Path, dataset: Dataset) -> tuple[str, list[str]]:
    """Normalised URDF of a robot and what was corrected in it; refused where no moving link has a mass."""
    locked = dataset.fields.robot.locked
    tree, told = normalise_tree(source, dataset.joints, strict=False, locked=locked)
    silent = [name for name in movable_joints(parse_urdf(source)) if name not in (*dataset.joints, *locked)]
    if silent:
        told.append(
            f"{', '.join(silent[:6])}{' and others' if len(silent) > 6 else ''}: locked at 0, as "
            "robot.locked states no angle."
        )
    if all(tree.links[joint.child].mass <= TINY_MASS for joint in tree.joints):
        raise InputError(f"{source}: no link that the joints move has a mass; give the URDF its <inertial>s.")
    return write_urdf(tree), told


def make_rough(
    source: Source, rate: float, cutoff: float, factor: int, inertia: np.ndarray, motion: MovingJoints
) -> RoughRun:
    """Signals of a run that the rough model needs, at a `factor`-th of its rate."""
    made = differentiate_run(source.run, rate, cutoff, motion.top_speed)
    q, v, a = (decimate(x, factor) for x in (made.q, made.v, made.a))
    known = source.body.inverse_dynamics(q, v, a) + inertia * a
    slow = ~motion.moving | (np.abs(v) < np.maximum(made.sure_speed, _STILL * motion.top_speed.max()))
    sign = np.sign(v)
    return RoughRun(
        source.run.use,
        source.run.t[::factor],
        known,
        a,
        sign,
        v,
        decimate(source.run.tau, factor),
        _thin_marks(source.faulty, factor),
        slow,
    )


def _thin_marks(marked: np.ndarray, factor: int) -> np.ndarray:
    """Marks (M, n) of every `factor`-th sample: set where its anti-alias filter reaches a marked sample."""
    return marked if factor == 1 else spread_out(marked, factor)[::factor]


def bridge_gaps(
    dataset: Dataset, sources: list[Source], rough: list[RoughRun], factor: int, notes: list[str]
) -> tuple[list[Source], list[RoughRun]]:
    """Find clipped torques and bridge all that are no measurements, along the rough model's prediction.

    Raises
    ------
    InputError
        Where too much of a joint's training torque is no measurement.
    """
    stated = dataset.fields.robot.torque_limit
    limits = [np.inf] * len(dataset.joints) if stated is None else list(stated)
    for j, limit in enumerate(limits):
        if goes_beyond(np.concatenate([source.run.tau[:, j] for source in sources]), limit):
            name, limits[j] = f"tau_{dataset.joints[j]}", np.inf
            notes.append(
                f"{name} goes beyond robot.torque_limit ({limit:g}), which is not used; correct it, or the "
                "torque's unit."
            )
    bridged, seen = [], []
    for source, run, guess in zip(sources, rough, predict_rough(rough, inner=True), strict=True):
        predicted, v = (
            np.column_stack([np.interp(source.run.t, run.t, column) for column in x.T])
            for x in (guess, run.v)
        )
        clipped = find_clipped(source.run.tau, predicted, v, limits) & ~run.slow.all(axis=0)
        for j in map(int, np.flatnonzero(clipped.any(axis=0) & ~source.faulty.all(axis=0))):
            notes.append(
                f"{source.run.label}: tau_{dataset.joints[j]} is at a limit in {int(clipped[:, j].sum())} "
                "rows; they do not count."
            )
        faulty = source.faulty | clipped
        # Where a drive is off for nearly a whole run, its few other samples do not count either.
        faulty[:, faulty.mean(axis=0) > MOST_FROZEN] = True
        tau = bridge_torque(source.run.tau, predicted, faulty)
        bridged.append(replace(source, run=replace(source.run, tau=tau), faulty=faulty))
        seen.append(replace(run, tau=decimate(tau, factor), faulty=_thin_marks(faulty, factor)))
    _check_share(dataset, bridged, seen, factor, notes)
    return bridged, seen


def _check_share(
    dataset: Dataset, sources: list[Source], runs: list[RoughRun], factor: int, notes: list[str]
) -> None:
    """Refuse a joint whose training torque is clipped or frozen too often: the other rows are biased."""
    count, faulty = np.zeros((2, len(dataset.joints)))
    never, moves = np.zeros((2, len(dataset.joints)), dtype=bool)
    for source, run in zip(sources, runs, strict=True):
        if run.use == "train":
            off = np.zeros_like(source.faulty) if source.run.off is None else source.run.off
            asked = ~(run.slow | _thin_marks(off, factor))
            lost = (run.faulty & asked).sum(axis=0)
            silent = run.faulty.all(axis=0)
            count += ~silent * asked.sum(axis=0)
            faulty += ~silent * lost
            never |= silent
            moves |= ~run.slow.all(axis=0)
    share = np.where(never & (count == 0), 1.0, faulty / np.maximum(count, 1.0))
    readings = dataset.fields.readings()
    for joint, part in zip(dataset.joints, share * moves, strict=True):
        if part > _MOST_FAULTY and readings[joint] != "none":
            limited = "" if dataset.fields.robot.torque_limit is None else "correct robot.torque_limit, "
            told = (
                f"'tau_{joint}' is clipped or frozen in {100 * part:.0f} % of the train runs; {limited}"
                "record them with a higher torque limit, slower, or leave the joint out."
            )
            notes.append(dataset.accepted.refuse(str(dataset.folder), told, f"clipped tau_{joint}"))


def _choose_band(rough: list[RoughRun], moving: np.ndarray, rate: float, edge: float, factor: int) -> Band:
    """Cut-offs of both filters."""
    train = [run for run in rough if run.use == "train"]
    predicted = predict_rough(train, inner=False)
    pairs = [(run.tau[:, moving], out[:, moving]) for run, out in zip(train, predicted, strict=True)]
    torque = choose_torque_cutoff(pairs, rate / factor, edge)
    # The motion filter must change nothing below the common cut-off, since the torque does not pass it.
    return Band(rate, min(max(edge, 3.0 * torque), 0.4 * rate), torque)


def _choose_widths(rough: list[RoughRun], moving: np.ndarray, band: Band, factor: int) -> np.ndarray:
    """Widths (n,) of the friction's reversal, from the training runs."""
    thinned = replace(band, rate=band.rate / factor)
    train = [
        replace(run, sign=np.where(_find_rest(run.slow, thinned), 0.0, run.sign))
        for run in rough
        if run.use == "train"
    ]
    return choose_reversal_widths(train, moving, thinned, averaged=factor > 1)


def _find_rest(slow: np.ndarray, band: Band) -> np.ndarray:
    """Samples (N, n) of a rest that lasts longer than the common filter's reach."""
    return keep_lasting(slow, int(0.5 * band.rate / band.torque))


def finish_run(
    source: Source,
    rate: float,
    band: Band,
    factor: int,
    inertia: np.ndarray,
    reversals: Reversals,
    motion: MovingJoints,
) -> PreparedRun:
    """Signals of one run and the rows of it that count."""
    made = differentiate_run(source.run, rate, band.motion, motion.top_speed)
    source, made = cut_ends(source, made, int(EDGE_PERIODS * rate / band.motion))
    run = source.run
    signals, known, rest = _make_signals(source, made, rate, band, factor, inertia, reversals)
    tau = decimate(run.tau, factor)
    bad = _mark_uncounted(np.abs(signals.v) < made.rest_speed, source, factor, band)
    at = rows(band, len(bad))
    return PreparedRun(
        run.file,
        run.use,
        signals,
        tau,
        known,
        band,
        keep=~bad[at],
        t=signals.t[at],
        start=run.start,
        piece=run.piece,
        session=run.session,
        resting=rest[::factor],
        factor=factor,
        bridges=bridge_rest(tau - known, known, signals.a, signals.v, _thin_marks(rest, factor), band),
    )


def cut_ends(source: Source, made: Motion, count: int) -> tuple[Source, Motion]:
    """A recording and its motion without `count` samples at either end.

    Where a recording starts or stops in motion, the motion filter does not know what comes before or after:
    the acceleration there is wrong by its own size, and the common filter would carry that far into the run.
    """
    count = min(count, max(len(made.t) // 2 - LEAST_ROWS, 0))
    if not count:
        return source, made
    part = slice(count, len(made.t) - count)
    run = source.run.cut(part.start, part.stop)
    motion = replace(
        made,
        t=made.t[part],
        q=made.q[part],
        v=made.v[part],
        a=made.a[part],
        temperature=made.temperature[part],
    )
    return replace(source, run=run, faulty=source.faulty[part], lost=source.lost[part]), motion


def _make_signals(
    source: Source,
    made: Motion,
    rate: float,
    band: Band,
    factor: int,
    inertia: np.ndarray,
    reversals: Reversals,
) -> tuple[Signals, np.ndarray, np.ndarray]:
    """Signals of one run at `band.rate`, the known torque (N, n) along them, and which samples rest.

    The direction of motion is taken at the recording's rate.
    """
    rest = _find_rest(np.abs(made.v) < made.sure_speed, replace(band, rate=rate))
    sign, reversal = take_direction(made.v, rest, reversals)
    q, v, a = (decimate(x, factor) for x in (made.q, made.v, made.a))
    load = source.body.inverse_dynamics(q, v, a)
    known = load + inertia * a
    signals = Signals(
        t=made.t[::factor],
        q=q,
        v=v,
        a=a,
        sign=decimate(sign, factor),
        reversal=decimate(reversal, factor),
        load=load,
        temperature=decimate(made.temperature, factor),
        wear=np.zeros_like(load),
        rigid_body=source.body,
        torque=known,
        bandwidth=band.torque,
        factor=factor,
        carries=source.carries,
        channels={name: decimate(x, factor) for name, x in source.run.channels.items()},
    )
    return signals, known, rest


def _mark_uncounted(slow: np.ndarray, source: Source, factor: int, band: Band) -> np.ndarray:
    """Samples (N, n) at rest, next to a rest, or without a measured torque or motion."""
    # The filter carries friction at rest, which is not determined, into the rows next to a rest.
    width = int(0.5 * band.rate / band.torque)
    bad = slow | spread_out(keep_lasting(slow, width), width)
    if source.faulty.any():
        # A bridged spike leaves no error nearby. A bridged gap does: the rough prediction's error spreads
        # over a whole period of the common filter.
        gaps = keep_lasting(source.faulty, LONGEST_SPIKE)
        bad |= _thin_marks(source.faulty, factor) | spread_out(_thin_marks(gaps, factor), 2 * width)
    if source.lost.any():
        bad |= _thin_marks(source.lost[:, None], factor)
    return bad


def _describe(dataset: Dataset, band: Band, rate: float, factor: int) -> list[str]:
    """Notes on filters and inertials."""
    notes = [
        f"motion filtered at {band.motion:.3g} Hz, torque and regressors at {band.torque:.3g} Hz, zero phase."
    ]
    if factor > 1:
        notes.append(f"recorded at {rate:g} Hz, of which {band.rate:g} Hz are kept after the filters.")
    robot = dataset.fields.robot
    if robot.inertials == "approximate" and "rigid_body" not in dataset.fields.declared_effects:
        notes.append("rigid_body is not declared, but inertials are approximate: they are refitted.")
    return notes
