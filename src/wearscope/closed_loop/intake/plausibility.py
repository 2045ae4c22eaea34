"""Whether signals can be what the data set says they are: units, torque side, signs, channel order, delay.

Every run is asked on its own, against the declared rigid body, so that it holds for any robot. A run whose
torque the stated reading of its columns explains is believed. Where it explains little and another reading
explains far more, in that run and in most of the others that the stated one explains as little, the data set
is refused with that reading as the remedy, unless `accept` in `dataset.yaml` says that the data are right as
they are. What the model lacks may look like another reading along one motion, and not along several.
"""

from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.intake.channel_hypotheses import (
    Reading,
    Sample,
    columns_for,
    explains_more,
    fit_joint,
    list_readings,
    misfits,
    misfits_with_load,
    scale_factors,
    take_sample,
    total_misfit,
)
from wearscope.closed_loop.intake.channel_lag import find_lag
from wearscope.closed_loop.intake.filtering import differentiate, low_pass
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.recording import estimate_quantum
from wearscope.closed_loop.intake.rough_model import fit_rough
from wearscope.effects.time_delay import EFFECT as TIME_DELAY
from wearscope.robots.urdf_file import OPEN_LIMIT, parse_urdf

#: A joint is doubted above this misfit; another reading must leave less than a share of it and than a bound.
_DOUBTFUL, _BETTER, _GOOD = 0.15, 0.25, 0.25
#: Total misfits that differ by less are alike.
_ALIKE = 0.02
#: A run is refused without a remedy where this share of the variance stays at half of its joints.
_HOPELESS = 0.8
#: A lag of all channels beyond this [s] is the recorder's; it must halve the misfit.
_LAG, _LONGEST = 0.025, 0.5
#: Torque over need beyond which a scale is no model error; further inertia over the rigid body's.
_SMALL, _LARGE, _ROTOR = 0.25, 4.0, 300.0


def check_plausibility(prepared: Prepared) -> None:
    """Refuse data that another reading of the columns explains and the stated one does not.

    Notes on what is accepted, and on entries of `accept` that overrule nothing, are added to the notes.

    Raises
    ------
    InputError
        Naming the run, the columns and what they look like.
    """
    asked = ask_runs(prepared)
    for one in asked:
        others = [other for other in asked if other is not one]
        _check_limits(prepared, one.run, one.stated)
        if one.run.piece < 2:
            _check_speeds(prepared, one.run)
        _check_readings(prepared, one, others)
        _check_frozen(prepared, one.run)
        _check_lag(prepared, one, others)
    prepared.notes += prepared.dataset.accepted.list_unused()


@dataclass(frozen=True)
class AskedRun:
    """A run, rows of it, and the misfits (n,) of the stated reading; NaN where a joint says nothing."""

    run: PreparedRun
    sample: Sample
    stated: np.ndarray

    @property
    def doubtful(self) -> np.ndarray:
        """Joints (n,) of bool that the stated reading does not explain."""
        return np.asarray(np.nan_to_num(self.stated) > _DOUBTFUL)


def ask_runs(prepared: Prepared) -> list[AskedRun]:
    """Every run with the misfits of its stated reading."""
    usual = np.median([_torque_spread(run) for run in prepared.runs], axis=0)
    inertia, inertials = known_inertia(prepared.dataset), prepared.dataset.fields.robot.inertials
    samples = [take_sample(run, inertia, inertials, usual) for run in prepared.runs]
    return [
        AskedRun(run, sample, np.where(sample.heard, misfits(sample), np.nan))
        for run, sample in zip(prepared.runs, samples, strict=True)
    ]


def _refuse(prepared: Prepared, run: PreparedRun, told: str, *codes: str) -> None:
    """Refuse by inference; noted instead where the data set accepts it."""
    where = str(prepared.dataset.folder / run.file)
    note = prepared.dataset.accepted.refuse(where, told, *codes)
    if note not in prepared.notes:
        prepared.notes.append(note)


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
        explained = stated[j] <= _DOUBTFUL
        if (
            not explained
            and widest < 0.1 * OPEN_LIMIT
            and reach > 2.0 * widest + (0.2 if slides else 2 * np.pi)
        ):
            unit, other = ("m", "mm") if slides else ("rad", "degrees")
            told = (
                f"column 'q_{joint.name}' reaches {reach:.3g}, where the URDF's limits are {joint.lower:.3g} "
                f"to {joint.upper:.3g} {unit}; if it is in {other}, convert it to {unit}."
            )
            _refuse(prepared, run, told, f"limits q_{joint.name}")


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
            _refuse(prepared, run, told, f"speed qd_{joint}")


def _check_readings(prepared: Prepared, one: AskedRun, others: list[AskedRun]) -> None:
    """Degrees, swapped columns, opposite signs, motor-side torque and the like."""
    run, sample, stated, doubtful = one.run, one.sample, one.stated, one.doubtful
    if not doubtful.any():
        _check_inertia(prepared, run, sample)
        return
    while doubtful.any():
        found = _find_reading(prepared, run, sample, stated, doubtful)
        if found is None:
            break
        told, codes, joints = found
        if _is_borne_out(prepared, others, codes, joints):
            _refuse(prepared, run, told, *codes)
        # What is accepted, or not borne out, is right as it is: no other reading is sought for these joints.
        doubtful = doubtful & ~np.isin(np.arange(prepared.n), joints)
        stated = np.where(np.isin(np.arange(prepared.n), joints), np.nan, stated)
    heard = np.isfinite(stated)
    lenient = np.array([_free_misfit(sample, j) if heard[j] else np.nan for j in range(prepared.n)])
    if heard.any() and np.nanmedian(lenient) > _HOPELESS and np.nanmedian(stated) > _HOPELESS:
        explained = 100 * max(0.0, 1 - float(np.nanmedian(lenient)))
        told = (
            "the motion explains next to nothing of the torque "
            f"({explained:.0f} % of the middle joint's); check that the columns belong together, their "
            "units, and the URDF."
        )
        _refuse(prepared, run, told, "unrelated tau")


#: What is wrong, its codes, and the joints that it concerns.
_Found = tuple[str, list[str], list[int]]


def _find_reading(
    prepared: Prepared, run: PreparedRun, sample: Sample, stated: np.ndarray, doubtful: np.ndarray
) -> _Found | None:
    """The reading that explains the doubtful joints far better than the stated one, if there is one."""
    dataset = prepared.dataset
    slides = [unit == "m" for unit in dataset.position_unit]
    scale, found = _judge_scale(prepared, sample, doubtful)
    # A mere scale is told where no reading of its own does as well; of readings alike, the first.
    best = scale + _ALIKE
    many = doubtful.sum() >= 0.5 * np.isfinite(stated).sum()
    for reading in list_readings(run, dataset.joints, slides, doubtful):
        concerned = list(reading.joints) or np.flatnonzero(doubtful).tolist()
        if (not reading.joints and not many) or not np.isfinite(stated[concerned]).any():
            continue
        total = _judge_reading(reading, sample, stated, concerned)
        if total < best:
            best, found = total - _ALIKE, (reading.told, [reading.code], concerned)
    return found


def _is_borne_out(prepared: Prepared, others: list[AskedRun], codes: list[str], joints: list[int]) -> bool:
    """Whether a reading explains more than the stated one in most other runs where these joints are doubtful.

    Also where it cannot be asked of any.
    """
    dataset = prepared.dataset
    slides = [unit == "m" for unit in dataset.position_unit]
    better = []
    for other in others:
        if not other.doubtful[joints].any():
            continue
        for reading in list_readings(other.run, dataset.joints, slides, other.doubtful):
            if [reading.code] == codes:
                own = other.doubtful.nonzero()[0] if not reading.joints else joints
                left = misfits(reading.change(other.sample))
                better.append(np.nansum(left[own]) < np.nansum(other.stated[own]))
    return not better or bool(np.mean(better) >= 0.5)


def _judge_reading(reading: Reading, sample: Sample, stated: np.ndarray, concerned: list[int]) -> float:
    """Total misfit of a reading; infinite where it does not explain what it concerns far better."""
    read = reading.change(sample)
    left = misfits(read)
    worst = float(np.nanmax(stated[concerned]))
    total = total_misfit(left, sample.heard)
    if not all(left[j] < min(_BETTER * worst, _GOOD) for j in concerned):
        return np.inf
    if total >= 0.5 * total_misfit(stated, sample.heard):
        return np.inf
    return total if explains_more(sample, reading, read, stated) else np.inf


def _judge_scale(prepared: Prepared, sample: Sample, doubtful: np.ndarray) -> tuple[float, _Found | None]:
    """Motor-side torque, newton-millimetres, masses in grams: the misfits left, and what to say."""
    dataset = prepared.dataset
    factors, left = scale_factors(sample, doubtful)
    with np.errstate(invalid="ignore"):
        off = (np.abs(factors) < _SMALL) | (np.abs(factors) > _LARGE)
    if not off.any():
        return np.inf, None
    total = total_misfit(left, sample.heard)
    if np.nanmin(np.abs(factors[off])) > _LARGE and _is_load(sample, off, total):
        return np.inf, None
    ratio = dataset.fields.robot.gear_ratio
    factor = float(np.median(factors[off]))
    hint = (
        "give torque on the joint side of the gear in N m (or N), and check the URDF's and payload's masses"
    )
    if ratio is not None and 0.3 < abs(factor * float(np.median(np.abs(np.array(ratio)[off])))) < 3.0:
        hint = "it looks like motor-side torque: multiply it with the gear ratio"
    elif 0.7 < abs(factor) * 180.0 / np.pi < 1.4:
        hint += ", and that q is in rad"
    names = [dataset.joints[j] for j in np.flatnonzero(off)]
    columns = ", ".join(f"'tau_{name}'" for name in names)
    verb = "is" if off.sum() == 1 else "are"
    told = f"{columns} {verb} {factor:.3g} times what the rigid body needs; {hint}."
    codes = [f"gain tau_{name}" for name in names]
    return total, (told, codes, np.flatnonzero(off).tolist())


def _is_load(sample: Sample, off: np.ndarray, total: float) -> bool:
    """Whether a load that nobody declared leaves no more than a scale of the joints `off` does in all."""
    left = misfits_with_load(sample)
    return bool((left[off] < _GOOD).all()) and total_misfit(left, sample.heard) < total + _ALIKE


def _check_inertia(prepared: Prepared, run: PreparedRun, sample: Sample) -> None:
    """Torque in too small a unit on a robot without gravity, where rotors could stand for any factor."""
    known = sample.known()
    shares, names = [], []
    for j in np.flatnonzero(prepared.moving):
        misfit, theta = fit_joint(sample, known, int(j))
        if np.isfinite(misfit) and sample.heard[j]:
            shares.append(theta[1] * sample.a[:, j].std() / max(known[:, j].std(), 1e-300))
            names.append(prepared.dataset.joints[j])
    if shares and min(shares) > _ROTOR:
        told = (
            f"the torques are {min(shares):.3g} times what the rigid body needs; give torque on the joint "
            "side of the gear in N m (or N)."
        )
        _refuse(prepared, run, told, *(f"gain tau_{name}" for name in names))


def _free_misfit(sample: Sample, j: int) -> float:
    """Share of the variance that stays with free signs and sizes and a smooth function of position."""
    at = sample.counts[:, j]
    y = sample.tau[at, j]
    q = sample.q[at, j]
    centre, half = 0.5 * (q.max() + q.min()), max(0.5 * float(np.ptp(q)), 1e-12)
    u = (q - centre) / half
    x = np.column_stack([columns_for(sample, sample.known(), j), *(u**k for k in range(1, 5))])
    left = y - x @ fit_rough([x], [y])
    return float(np.sum(left**2) / np.sum((y - y.mean()) ** 2))


def _check_frozen(prepared: Prepared, run: PreparedRun) -> None:
    """A position that never changes while its torque swings as in motion: a dead encoder, no locked joint.

    A held joint's brake and motor share the load that the others' motion makes. Noise is known by its band.
    """
    recorded = next(r for r in prepared.dataset.runs if r.file == run.file)
    for j in np.flatnonzero(recorded.reach == 0.0).tolist():
        load = run.reduce(run.known[:, [j]])[:, 0]
        swing, torque = _span(run.measured[:, j] - load), _span(run.measured[:, j])
        usual = max(_span(other.measured[:, j]) for other in prepared.runs)
        steady = run.measured[:, j].var() > 0.5 * run.tau[:, j].var()
        if steady and min(swing, torque) > 0.5 * usual and swing + torque > 1.6 * _span(load):
            joint = prepared.dataset.joints[j]
            told = (
                f"column 'q_{joint}' never changes while 'tau_{joint}' swings by {torque:.3g}; the encoder's "
                "channel is dead, record the run again or leave it out."
            )
            _refuse(prepared, run, told, f"frozen q_{joint}")


def _span(x: np.ndarray) -> float:
    return float(np.ptp(np.percentile(x, [2, 98])))


def _check_lag(prepared: Prepared, one: AskedRun, others: list[AskedRun]) -> None:
    """A delay between the torque and the position channels of the whole recorder.

    Of one joint it is believed where it is the same in most of the runs in which that one is as doubtful; not
    where it is near what all runs have in their middle, which is little.
    """
    if TIME_DELAY.name in prepared.dataset.fields.declared_effects:
        return
    lag, ratio = find_lag(one.sample, _LONGEST)
    heard = np.isfinite(lag)
    if not heard.any():
        return
    middle = float(np.median(lag[heard]))
    agree = np.abs(lag[heard] - middle) < 0.01
    if abs(middle) >= _LAG and agree.mean() >= 0.75 and float(np.median(ratio[heard])) < 0.5:
        every = [lag, *(find_lag(other.sample, _LONGEST)[0] for other in others)]
        common = float(np.nanmedian(every))
        if max(abs(common), abs(middle - common)) < _LAG:
            return
        if heard.sum() == 1:
            lags = [
                find_lag(other.sample, _LONGEST)[0][heard] for other in others if other.doubtful[heard].any()
            ]
            if lags and np.mean(np.abs(np.array(lags) - middle) < 0.01) < 0.5:
                return
        late = "late" if middle > 0 else "early"
        told = (
            f"the torque channels come {1000 * abs(middle):.0f} ms {late} against the positions; align the "
            "channels, or declare time_delay."
        )
        _refuse(prepared, one.run, told, "late tau")
