"""Other readings of a run's columns, and how well the declared rigid body explains the torque under each.

A reading is a guess at what the columns really hold: degrees, another joint's torque, the opposite sign.
Under each, the torque of every joint is fitted with the declared rigid body at (nearly) its stated size,
further rotor inertia, Coulomb and viscous friction that take power and never give it, and an offset. What no
size of these explains is the reading's misfit.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from wearscope.closed_loop.intake.acceptance import exchange_code
from wearscope.closed_loop.intake.filtering import differentiate, low_pass, rows
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.intake.rough_model import fit_bounded, rough_columns
from wearscope.robots.dynamics import RigidBody

#: By which factor the rigid body may be off: as the data set states it is trusted, or approximate.
GAINS = {"trusted": (0.7, 1.4), "approximate": (0.4, 2.5)}
#: Least misfit as stated of a joint whose position is in another unit; what another reading may leave, as a
#: share of what the stated one leaves with a rigid body of any size.
_OTHER_UNIT, _FAR_BETTER = 0.8, 0.25
_ANY_GAIN = (-np.inf, np.inf)
_MOST_ROWS, LEAST_ROWS = 1200, 30
#: Torque that varies less than this share of what it usually does says nothing.
_QUIET = 0.2
#: Least span of a position in degrees, or in mm, that is a motion.
_LEAST_DEGREES, _LEAST_MM = 1.0, 5.0


@dataclass(frozen=True)
class Sample:
    """Thinned rows of a run as some reading has them; arrays are (M, n).

    Attributes
    ----------
    q, v, a, sign, tau : ndarray
        At the common bandwidth.
    counts : ndarray of bool
    body : RigidBody
    inertia : ndarray (n,)
        Rotor inertia that the data set declares and states.
    gains : (float, float)
        Bounds on the factor of the rigid body.
    heard : ndarray (n,) of bool
        Joints whose torque, or the need for one, varies enough here for a misfit to mean anything.
    rate : float
        Rows a second.
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    sign: np.ndarray
    tau: np.ndarray
    counts: np.ndarray
    body: RigidBody
    inertia: np.ndarray
    gains: tuple[float, float]
    heard: np.ndarray
    rate: float

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.q.shape[1]

    def known(self) -> np.ndarray:
        """Rigid-body and declared rotor torque (M, n)."""
        return self.body.inverse_dynamics(self.q, self.v, self.a) + self.inertia * self.a


@dataclass(frozen=True)
class Reading:
    """One reading.

    Attributes
    ----------
    change : callable
        From the sample as stated to the sample as read.
    joints : tuple of int
        Joints whose misfit it must remove; empty where it concerns all.
    told : str
        What is wrong and the remedy, to stand after the run's file name.
    code : str
        Under which a data set overrules it.
    other_unit : bool
        Whether it takes the positions for another unit. Such a reading shrinks the rigid body to next to
        nothing, which also suits a joint whose body the URDF merely overstates; so it is asked for more.
    """

    change: Callable[[Sample], Sample]
    joints: tuple[int, ...]
    told: str
    code: str
    other_unit: bool = False


def _every(run: PreparedRun) -> int:
    return max(1, len(run.t) // _MOST_ROWS)


def take_sample(run: PreparedRun, inertia: np.ndarray, inertials: str, usual: np.ndarray) -> Sample:
    """Thinned rows of a prepared run.

    Parameters
    ----------
    run : PreparedRun
    inertia : ndarray (n,)
        Declared rotor inertia.
    inertials : str
        ``trusted`` or ``approximate``.
    usual : ndarray (n,)
        Standard deviation of the torque in the runs of the data set.
    """
    s = run.signals
    every = _every(run)
    thin = slice(None, None, every)
    q, v, a, sign, known = (run.reduce(x)[thin] for x in (s.q, s.v, s.a, s.sign, run.known))
    tau, counts = run.measured[thin], run.keep[thin]
    spread = np.array(
        [max(tau[at, j].std(), known[at, j].std()) if at.any() else 0.0 for j, at in enumerate(counts.T)]
    )
    heard = (spread > _QUIET * usual) & (counts.sum(axis=0) >= LEAST_ROWS)
    rate = run.band.rate / run.band.stride / every
    return Sample(q, v, a, sign, tau, counts, s.rigid_body, inertia, GAINS[inertials], heard, rate)


def columns_for(sample: Sample, known: np.ndarray, j: int) -> np.ndarray:
    """Regressors (K, 5) of joint j over the rows that count: known, a, sign, v, 1."""
    at = sample.counts[:, j]
    return rough_columns(known[at, j], sample.a[at, j], sample.sign[at, j], sample.v[at, j])


def fit_joint(
    sample: Sample, known: np.ndarray, j: int, gains: tuple[float, float] | None = None
) -> tuple[float, np.ndarray]:
    """Misfit of joint j, as a share of its torque's variance, and the coefficients (5,).

    Parameters
    ----------
    sample : Sample
    known : ndarray (M, n)
    j : int
    gains : (float, float), optional
        Instead of the sample's own bounds; a free factor leaves no further inertia, which could stand for it.

    Returns
    -------
    float
        NaN where too few rows count.
    ndarray (5,)
        Factor of the rigid body, inertia, Coulomb, viscous friction, offset.
    """
    y = sample.tau[sample.counts[:, j], j]
    if len(y) < LEAST_ROWS or y.std() <= 0.0:
        return np.nan, np.zeros(5)
    x = columns_for(sample, known, j)
    low, high = gains or sample.gains
    further = np.inf if gains is None else 1e-12
    free = np.inf
    left, found = fit_bounded(
        x, y, np.array([low, 0.0, 0.0, 0.0, -free]), np.array([high, further, free, free, free])
    )
    return left / float(np.sum((y - y.mean()) ** 2)), found


def misfits(sample: Sample) -> np.ndarray:
    """Misfit (n,) of every joint."""
    known = sample.known()
    return np.array([fit_joint(sample, known, j)[0] for j in range(sample.n)])


def total_misfit(left: np.ndarray, heard: np.ndarray) -> float:
    """Sum over the joints that say something; each counts 2 at most, and where it is not known."""
    return float(np.sum(np.minimum(np.nan_to_num(left[heard], nan=2.0), 2.0)))


def explains_more(sample: Sample, reading: Reading, read: Sample, stated: np.ndarray) -> bool:
    """Whether a reading explains its joints far better than the stated one with a rigid body of any size.

    A body that the URDF merely overstates, on a joint full of friction, suits many readings: those that take
    it away or average it out. A reading of another unit shrinks it to next to nothing, and must explain far
    more than friction and rotors alone do, too.
    """
    joints = list(reading.joints) or np.flatnonzero(np.isfinite(stated)).tolist()
    if reading.other_unit and np.nanmedian(stated[joints]) < _OTHER_UNIT:
        return False
    known, other = sample.known(), read.known()
    free = without = left = 0.0
    for j in joints:
        any_size = fit_joint(sample, known, j, (0.0, np.inf))[0]
        no_body = fit_joint(sample, np.zeros_like(known), j)[0]
        free += min(any_size, no_body, stated[j])
        without += fit_joint(read, np.zeros_like(other), j)[0]
        left += fit_joint(read, other, j)[0]
    return bool(left < _FAR_BETTER * free and (not reading.other_unit or left < _FAR_BETTER * without))


def scale_factors(sample: Sample, doubtful: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque over need (n,) of joints that the rigid body then explains, else NaN; misfits (n,)."""
    known = sample.known()
    factors, left = np.full(sample.n, np.nan), misfits(sample)
    for j in np.flatnonzero(doubtful).tolist():
        after, theta = fit_joint(sample, known, j, _ANY_GAIN)
        flat = known.copy()
        flat[:, j] = 0.0
        without = fit_joint(sample, flat, j, _ANY_GAIN)[0]
        if after < 0.25 * left[j] and after < 0.3 and after < 0.5 * without:
            factors[j], left[j] = theta[0], after
    return factors, left


def misfits_with_load(sample: Sample) -> np.ndarray:
    """Misfit (n,) of every joint beside one load at the last link that nobody declared, of any inertia.

    On a light wrist it is many times the rigid body, as a torque in another unit would be; but the same load
    is felt at the joints before.
    """
    known, load = sample.known(), sample.body.payload_regressor(sample.q, sample.v, sample.a)
    heard = [j for j in range(sample.n) if sample.heard[j] and sample.counts[:, j].sum() >= LEAST_ROWS]
    size, shared = load.shape[-1], []
    for j in heard:
        at = sample.counts[:, j]
        own = columns_for(sample, known, j)[:, 1:]
        both = np.column_stack([load[at, j], sample.tau[at, j] - known[at, j]])
        # What the drive's own columns take is no part of the load's.
        both -= own @ np.linalg.lstsq(own, both, rcond=None)[0]
        shared.append(both / max(float(sample.tau[at, j].std()), 1e-300))
    left = misfits(sample)
    if not shared:
        return left
    rows_of_all = np.vstack(shared)
    theta = np.linalg.lstsq(rows_of_all[:, :size], rows_of_all[:, size], rcond=None)[0]
    # No robot carries more than it weighs.
    if not 0.0 < theta[0] < sample.body.inertial_parameters.reshape(-1, size)[:, 0].sum():
        return left
    carried = replace(sample, tau=sample.tau - load @ theta)
    beside = misfits(carried)
    for j in heard:
        at = sample.counts[:, j]
        left[j] = beside[j] * float(carried.tau[at, j].var() / max(sample.tau[at, j].var(), 1e-300))
    return left


def _exchange(sample: Sample, names: tuple[str, ...], i: int, j: int) -> Sample:
    order = np.arange(sample.n)
    order[[i, j]] = [j, i]
    return replace(sample, **{name: getattr(sample, name)[:, order] for name in names})


def _times(sample: Sample, factor: np.ndarray, *names: str) -> Sample:
    return replace(sample, **{name: getattr(sample, name) * factor for name in names})


def _only(n: int, j: int, value: float) -> np.ndarray:
    factor = np.ones(n)
    factor[j] = value
    return factor


_MOTION = ("q", "v", "a", "sign")


def _with_gravity(sample: Sample, gravity: np.ndarray) -> Sample:
    return replace(sample, body=sample.body.with_gravity(gravity.tolist()))


def _exchange_kinds(sample: Sample, run: PreparedRun, j: int) -> Sample:
    """Position and torque of joint j exchanged."""
    thin = slice(None, None, _every(run))
    q = low_pass(run.tau[:, j], run.band.torque, run.band.rate)
    v = differentiate(q, run.band.rate)
    a = differentiate(v, run.band.rate)
    kept = rows(run.band, len(q))
    moved = {name: getattr(sample, name).copy() for name in (*_MOTION, "tau")}
    for name, x in (("q", q), ("v", v), ("a", a), ("sign", np.sign(v))):
        moved[name][:, j] = x[kept][thin]
    moved["tau"][:, j] = sample.q[:, j]
    return replace(sample, **moved)


def list_readings(
    run: PreparedRun, joints: list[str], slides: list[bool], doubtful: np.ndarray
) -> Iterator[Reading]:
    """Readings worth trying where the joints `doubtful` (n,) of bool are not explained."""
    n = len(joints)
    turning = ~np.array(slides)
    span = np.ptp(run.signals.q, axis=0)
    if turning.any() and span[turning].max() > _LEAST_DEGREES:
        factor = np.where(turning, np.pi / 180.0, 1.0)
        yield Reading(
            lambda s: _times(s, factor, "q", "v", "a"),
            (),
            "positions look like degrees; convert q to rad.",
            "degrees q",
            True,
        )
    if not turning.all() and span[~turning].max() > _LEAST_MM:
        shrink = np.where(turning, 1.0, 1e-3)
        yield Reading(
            lambda s: _times(s, shrink, "q", "v", "a"),
            (),
            "positions look like mm; convert q to m.",
            "mm q",
            True,
        )
    yield Reading(
        lambda s: _times(s, -np.ones(n), "tau"),
        (),
        "the torques have the opposite sign of what the motion needs; give motor torque, positive where it "
        "does positive work in positive motion.",
        "sign tau",
    )
    yield Reading(
        lambda s: _times(s, -np.ones(n), "v", "sign"),
        (),
        "the torques fit the motion run backwards; sort the rows by time.",
        "backwards t",
    )
    gravity = np.array(run.signals.rigid_body.gravity)
    if gravity.any():
        yield Reading(
            lambda s: _with_gravity(s, -gravity),
            (),
            "gravity acts opposite to robot.gravity; give gravity in the base frame.",
            "sign gravity",
        )
    if gravity.any() and not 9.7 < np.linalg.norm(gravity) < 9.9:
        yield Reading(
            lambda s: _with_gravity(s, 9.81 * gravity / np.linalg.norm(gravity)),
            (),
            f"gravity is not {np.linalg.norm(gravity):.3g} m/s^2 strong as robot.gravity says; give m/s^2.",
            "size gravity",
        )
    for j in np.flatnonzero(doubtful).tolist():
        yield from _list_for_joint(run, joints, slides, j)
    for i in np.flatnonzero(doubtful).tolist():
        for j in range(n):
            if i != j and (not doubtful[j] or i < j):
                yield from _list_exchanges(joints, i, j)


def _list_for_joint(run: PreparedRun, joints: list[str], slides: list[bool], j: int) -> Iterator[Reading]:
    n, joint = len(joints), joints[j]
    factor, unit = (
        (1e-3, "mm; convert it to m") if slides[j] else (np.pi / 180.0, "degrees; convert it to rad")
    )
    if np.ptp(run.signals.q[:, j]) > (_LEAST_MM if slides[j] else _LEAST_DEGREES):
        yield Reading(
            lambda s: _times(s, _only(n, j, factor), "q", "v", "a"),
            (j,),
            f"column 'q_{joint}' looks like {unit}.",
            f"{'mm' if slides[j] else 'degrees'} q_{joint}",
            True,
        )
    yield Reading(
        lambda s: _times(s, _only(n, j, -1.0), "tau"),
        (j,),
        f"column 'tau_{joint}' has the opposite sign of what the motion needs; give motor torque, positive "
        "where it does positive work in positive motion.",
        f"sign tau_{joint}",
    )
    yield Reading(
        lambda s: _times(s, _only(n, j, -1.0), *_MOTION),
        (j,),
        f"column 'q_{joint}' has the opposite sign of the URDF's axis; turn it round.",
        f"sign q_{joint}",
    )
    yield Reading(
        lambda s: _times(s, _only(n, j, -1.0), *_MOTION, "tau"),
        (j,),
        f"columns 'q_{joint}' and 'tau_{joint}' have the opposite sign of the URDF's axis; turn both round.",
        f"sign q_{joint} tau_{joint}",
    )
    yield Reading(
        lambda s: _exchange_kinds(s, run, j),
        (j,),
        f"columns 'q_{joint}' and 'tau_{joint}' look swapped; exchange them.",
        f"exchanged q_{joint} tau_{joint}",
    )


def _list_exchanges(joints: list[str], i: int, j: int) -> Iterator[Reading]:
    for names, kinds in (
        (("tau",), ("tau",)),
        (_MOTION, ("q",)),
        ((*_MOTION, "tau"), ("q", "tau")),
    ):
        what = " and ".join(f"'{kind}_{joints[i]}' with '{kind}_{joints[j]}'" for kind in kinds)
        yield Reading(
            lambda s, names=names: _exchange(s, names, i, j),  # type: ignore[misc]
            (i, j),
            f"columns look swapped: exchange {what}.",
            exchange_code(joints, kinds, i, j),
        )
