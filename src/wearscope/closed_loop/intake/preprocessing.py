"""A data set made ready for regression: signals of one bandwidth, the known torque, rows that count."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from wearscope.closed_loop.intake.cleaning import LONGEST_SPIKE, clean_run
from wearscope.closed_loop.intake.filtering import (
    Band,
    Motion,
    choose_motion_cutoff,
    choose_torque_cutoff,
    differentiate_run,
    low_pass,
    resample,
)
from wearscope.closed_loop.intake.dataset import Dataset, Run
from wearscope.closed_loop.intake.saturation import bridge_torque, find_clipped, predict_roughly, spread_out
from wearscope.effects.base import Signals
from wearscope.errors import InputError
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.urdf import TINY_MASS, normalise_tree
from wearscope.robots.urdf_file import write_urdf

#: Seconds lost at either end of a run to the filters, in periods of the common cut-off.
_EDGE_PERIODS = 1.0
#: Widths of the friction's reversal that are tried, over the joint's largest speed: none is wide enough to be
#: an effect of its own.
_REVERSALS = (0.0, 3e-4, 6e-4, 1e-3, 2e-3, 4e-3)
#: Share of a joint's training torque that may be clipped or frozen.
_MOST_FAULTY = 0.2


@dataclass
class PreparedRun:
    """One run ready for regression.

    Attributes
    ----------
    file, use : str
    signals : Signals
        At the full rate.
    tau : ndarray (N, n)
        Measured torque; samples that are no measurements are bridged and do not count.
    known : ndarray (N, n)
        Torque of the rigid body and of declared rotor inertias as the data set states them.
    band : Band
    keep : ndarray (M, n) of bool
        Rows that count for each joint: the joint moves and the torque is not saturated.
    measured : ndarray (M, n)
        Torque after the common filter.
    t : ndarray (M,)
        Time of the rows [s].
    """

    file: str
    use: str
    signals: Signals
    tau: np.ndarray
    known: np.ndarray
    band: Band
    keep: np.ndarray
    measured: np.ndarray
    t: np.ndarray

    def reduce(self, x: np.ndarray) -> np.ndarray:
        """Common filter, then one row in `Band.stride`, edges cut: (N, ...) to (M, ...)."""
        flat = low_pass(x.reshape(len(x), -1), self.band.torque, self.band.rate)
        return flat[rows(self.band, len(x))].reshape(-1, *x.shape[1:])


@dataclass
class Prepared:
    """A data set ready for regression.

    Attributes
    ----------
    dataset : Dataset
    urdf : str
        Normalised URDF.
    runs : list of PreparedRun
    band : Band
    moving : ndarray (n,) of bool
        Joints that move in at least one training run.
    notes : list of str
    """

    dataset: Dataset
    urdf: str
    runs: list[PreparedRun]
    band: Band
    moving: np.ndarray
    notes: list[str]

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.dataset.joints)

    def runs_for(self, use: str) -> list[PreparedRun]:
        """Runs of one use."""
        return [run for run in self.runs if run.use == use]


def rows(band: Band, length: int) -> slice:
    """Rows kept of a run of `length` samples."""
    edge = int(_EDGE_PERIODS * band.rate / band.torque)
    return slice(edge, max(length - edge, edge), band.stride)


def rigid_body_of(urdf: str, dataset: Dataset, run: Run) -> RigidBody:
    """Rigid body with the payload that a run declares."""
    payload = None
    if run.payload is not None:
        x, y, z = run.payload.com
        payload = Payload(run.payload.mass, (x, y, z))
    return RigidBody(urdf, dataset.joints, tuple(dataset.fields.robot.gravity), payload)


def known_inertia(dataset: Dataset) -> np.ndarray:
    """Rotor inertias (n,) that the data set declares and gives; zero where it does not."""
    stated = dataset.fields.robot.rotor_inertia
    if stated is None or "rotor_inertia" not in dataset.fields.declared_effects:
        return np.zeros(len(dataset.joints))
    return np.array(stated, dtype=float)


def make_signals(motion: Motion, body: RigidBody, inertia: np.ndarray) -> tuple[Signals, np.ndarray]:
    """Signals along a motion and the known torque (N, n)."""
    load = body.inverse_dynamics(motion.q, motion.v, motion.a)
    known = load + inertia * motion.a
    signals = Signals(
        t=motion.t,
        q=motion.q,
        v=motion.v,
        a=motion.a,
        sign=np.sign(motion.v),
        load=load,
        temperature=motion.temperature,
        wear=np.zeros_like(load),
        rigid_body=body,
        torque=known,
    )
    return signals, known


def _lasting(marked: np.ndarray, width: int) -> np.ndarray:
    """Marked samples that are part of a stretch longer than `width` samples."""
    lasting = np.zeros_like(marked)
    for j in range(marked.shape[1]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], marked[:, j].astype(int), [0]])))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            if stop - start > width:
                lasting[start:stop, j] = True
    return lasting


def _predict_roughly(
    made: list[tuple[Signals, np.ndarray]], measured: list[np.ndarray], moving: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Measured torque and a prediction with friction and inertia fitted joint by joint, run by run."""
    predicted = [np.empty_like(tau) for tau in measured]
    for j in np.flatnonzero(moving):
        columns = [
            np.column_stack([known[:, j], s.a[:, j], s.sign[:, j], s.v[:, j], np.ones(len(s.t))])
            for s, known in made
        ]
        theta = np.linalg.lstsq(
            np.vstack(columns), np.concatenate([tau[:, j] for tau in measured]), rcond=None
        )
        for out, x in zip(predicted, columns, strict=True):
            out[:, j] = x @ theta[0]
    return [(tau[:, moving], out[:, moving]) for tau, out in zip(measured, predicted, strict=True)]


def _soften_reversals(
    made: list[tuple[Signals, np.ndarray]],
    motions: list[Motion],
    is_train: list[bool],
    moving: np.ndarray,
    band: Band,
) -> None:
    """Give the direction of motion the width at reversals that fits each joint's training torque best.

    A reversal that is modelled sharper or smoother than the machine's leaks through the filters and looks
    like friction at low speed.
    """
    train = [(s, known, m) for (s, known), m, use in zip(made, motions, is_train, strict=True) if use]
    for j in np.flatnonzero(moving):
        fastest = max(float(np.abs(m.v[:, j]).max()) for _, _, m in train)
        losses = []
        for share in _REVERSALS:
            x, y = [], []
            for s, known, m in train:
                sign = _direction(m.v[:, j], share * fastest, s.sign[:, j])
                columns = np.column_stack(
                    [m.tau[:, j], known[:, j], s.a[:, j], sign, s.v[:, j], np.ones(len(sign))]
                )
                reduced = low_pass(columns, band.torque, band.rate)[rows(band, len(columns))]
                x.append(reduced[:, 1:])
                y.append(reduced[:, 0])
            design, target = np.vstack(x), np.concatenate(y)
            losses.append(
                float(((target - design @ np.linalg.lstsq(design, target, rcond=None)[0]) ** 2).sum())
            )
        width = _REVERSALS[int(np.argmin(losses))] * fastest
        for s, _ in made:
            s.sign[:, j] = _direction(s.v[:, j], width, s.sign[:, j])


def _direction(v: np.ndarray, width: float, sign: np.ndarray) -> np.ndarray:
    """Direction of motion (N,) that changes over a speed of `width`; 0 stays 0."""
    return np.where(sign == 0.0, 0.0, np.tanh(v / width)) if width > 0 else sign


def _mark_rest(signals: Signals, motion: Motion, band: Band) -> None:
    """Set the direction of motion to 0 where a joint is at rest for longer than the filter's reach."""
    slow = np.abs(motion.v) < motion.sure_speed
    signals.sign[_lasting(slow, int(0.5 * band.rate / band.torque))] = 0.0


def _prepare_run(
    run: Run, motion: Motion, signals: Signals, known: np.ndarray, faulty: np.ndarray, band: Band
) -> PreparedRun:
    slow = np.abs(motion.v) < motion.rest_speed
    # The filter carries friction at rest, which is not determined, into the rows beside a rest.
    width = int(0.5 * band.rate / band.torque)
    rest = _lasting(slow, width)
    bad = slow | spread_out(rest, width)
    if faulty.any():
        # A spike is bridged without a trace; a gap by a rough prediction, whose error reaches a whole period.
        bad |= faulty | spread_out(_lasting(faulty, LONGEST_SPIKE), 2 * width)
    prepared = PreparedRun(
        run.file,
        run.use,
        signals,
        motion.tau,
        known,
        band,
        keep=~bad[rows(band, len(bad))],
        measured=np.empty(0),
        t=motion.t[rows(band, len(motion.t))],
    )
    prepared.measured = prepared.reduce(motion.tau)
    return prepared


def _check_share(dataset: Dataset, runs: list[Run], faulty: list[np.ndarray]) -> None:
    """Refuse a joint of whose training torque too much is clipped or frozen: the rest is a biased choice."""
    share = np.mean(
        np.concatenate([bad for run, bad in zip(runs, faulty, strict=True) if run.use == "train"]), axis=0
    )
    for joint, part in zip(dataset.joints, share, strict=True):
        if part > _MOST_FAULTY:
            raise InputError(
                f"{dataset.folder}: 'tau_{joint}' is clipped or frozen in {100 * part:.0f} % of the train "
                "runs; record them with a higher torque limit, slower, or leave the joint out."
            )


def _normalise(source: str | Path, dataset: Dataset) -> tuple[str, list[str]]:
    """Normalised URDF and what was mended in it; refused where no moving link has a mass."""
    tree, told = normalise_tree(source, dataset.joints, strict=False)
    if all(tree.links[joint.child].mass <= TINY_MASS for joint in tree.joints):
        raise InputError(f"{source}: no link that the joints move has a mass; give the URDF its <inertial>s.")
    return write_urdf(tree), told


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
        Where no training run moves, a channel is broken beyond mending, or no moving link has a mass.
    """
    robot = dataset.fields.robot
    rate = dataset.fields.sample_rate
    notes = list(dataset.notes)
    urdf, told = _normalise(urdf_source or dataset.urdf, dataset)
    notes += told
    slides = [unit == "m" for unit in dataset.position_unit]
    uniform, spoilt = [], {}
    for recorded in dataset.runs:
        where = str(dataset.folder / recorded.file)
        cleaned = clean_run(resample(recorded, rate), dataset.joints, slides, where)
        uniform.append(cleaned.run)
        spoilt[recorded.file] = cleaned.faulty
        notes += cleaned.notes
    reach = {run.file: np.ptp(run.q, axis=0) for run in uniform}
    largest = np.max([reach[run.file] for run in uniform if run.use == "train"], axis=0)
    reaches = np.array([reach[run.file].max() for run in uniform])
    usual = float(np.quantile(reaches[reaches >= 1e-5], 0.75)) if reaches.max() >= 1e-5 else 1e-9
    still = [run.file for run, far in zip(uniform, reaches, strict=True) if far < 1e-3 * usual]
    moving = largest > max(1e-5, 1e-3 * largest.max())
    if not moving.any() or largest.max() < 1e-5:
        raise InputError(
            f"{dataset.folder}: no joint moves in any train run; give at least one train run with motion."
        )
    for file in still:
        notes.append(f"{file}: the robot stands still; the run is left out.")
    uniform = [run for run in uniform if run.file not in still]
    for use in ("train", "test"):
        if not any(run.use == use for run in uniform):
            raise InputError(
                f"{dataset.folder}: the robot stands still in every {use} run; give a {use} run with motion."
            )
    for j, joint in enumerate(dataset.joints):
        if not moving[j]:
            notes.append(f"joint {joint} does not move in the train runs; its friction stays undetermined.")
    train = [run for run in uniform if run.use == "train"]
    edge = choose_motion_cutoff(train, rate)
    bodies = [rigid_body_of(urdf, dataset, run) for run in uniform]
    inertia = known_inertia(dataset)

    def differentiate(cutoff: float) -> tuple[list[Motion], list[tuple[Signals, np.ndarray]]]:
        motions = [differentiate_run(run, rate, cutoff) for run in uniform]
        return motions, [make_signals(m, body, inertia) for m, body in zip(motions, bodies, strict=True)]

    motions, made = differentiate(edge)
    is_train = [run.use == "train" for run in uniform]
    faulty = [spoilt[run.file] for run in uniform]
    rough = predict_roughly(made, [run.tau for run in uniform], faulty, is_train)
    for k, run in enumerate(uniform):
        clipped = find_clipped(run.tau, rough[k], robot.torque_limit)
        for j in map(int, np.flatnonzero(clipped.any(axis=0))):
            notes.append(
                f"{run.file}: tau_{dataset.joints[j]} is at a limit in {int(clipped[:, j].sum())} rows; "
                "they do not count."
            )
        faulty[k] = faulty[k] | clipped
        uniform[k] = replace(run, tau=bridge_torque(run.tau, rough[k], faulty[k]))
        motions[k].tau = uniform[k].tau
    _check_share(dataset, uniform, faulty)
    pairs = _predict_roughly(
        [m for m, use in zip(made, is_train, strict=True) if use],
        [m.tau for m, use in zip(motions, is_train, strict=True) if use],
        moving,
    )
    torque_cutoff = choose_torque_cutoff(pairs, rate, edge)
    # The motion filter must not be felt below the common cut-off, where the torque does not have it.
    band = Band(rate, min(max(edge, 3.0 * torque_cutoff), 0.4 * rate), torque_cutoff)
    if band.motion != edge:
        motions, made = differentiate(band.motion)
    for signals, _ in made:
        signals.bandwidth = band.torque
    for (signals, _), motion in zip(made, motions, strict=True):
        _mark_rest(signals, motion, band)
    _soften_reversals(made, motions, is_train, moving, band)
    notes.append(
        f"motion filtered at {band.motion:.3g} Hz, torque and regressors at {band.torque:.3g} Hz, zero phase."
    )
    if robot.inertials == "approximate" and "rigid_body" not in dataset.fields.declared_effects:
        notes.append("inertials are approximate but rigid_body is not declared; they are not refitted.")
    runs = [
        _prepare_run(run, motion, signals, known, bad, band)
        for run, motion, (signals, known), bad in zip(uniform, motions, made, faulty, strict=True)
    ]
    short = [run.file for run in runs if len(run.t) < 40]
    if short:
        raise InputError(
            f"{dataset.folder / short[0]}: too short for a {band.torque:.3g} Hz filter; record longer."
        )
    return Prepared(dataset, urdf, runs, band, moving, notes)
