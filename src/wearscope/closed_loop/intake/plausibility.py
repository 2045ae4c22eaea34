"""Whether signals can be what the data set says they are: units, torque side, signs, channel order, delay.

Every run is asked on its own, against the declared rigid body, so that it holds for any robot. A run whose
torque the stated reading of its columns explains is believed. Where it explains little and another reading
explains far more, the data set is refused with that reading as the remedy.
"""

import numpy as np

from wearscope.closed_loop.intake.filtering import differentiate, low_pass
from wearscope.closed_loop.intake.preprocessing import Prepared, PreparedRun, known_inertia
from wearscope.closed_loop.intake.channel_hypotheses import (
    Sample,
    find_lag,
    fit_joint,
    list_readings,
    misfits,
    scale_factors,
    take_sample,
    total_misfit,
)
from wearscope.errors import InputError
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

    Raises
    ------
    InputError
        Naming the run, the columns and what they look like.
    """
    usual = np.median([_torque_spread(run) for run in prepared.runs], axis=0)
    for run in prepared.runs:
        _check_limits(prepared, run)
        _check_speeds(prepared, run)
        sample = take_sample(
            run, known_inertia(prepared.dataset), prepared.dataset.fields.robot.inertials, usual
        )
        _check_readings(prepared, run, sample)
        _check_frozen(prepared, run)
        _check_lag(prepared, run, sample)


def _torque_spread(run: PreparedRun) -> np.ndarray:
    return np.array(
        [y[at].std() if at.any() else 0.0 for y, at in zip(run.measured.T, run.keep.T, strict=True)]
    )


def _where(prepared: Prepared, run: PreparedRun) -> str:
    return str(prepared.dataset.folder / run.file)


def _check_limits(prepared: Prepared, run: PreparedRun) -> None:
    """Positions far outside the URDF's limits, which no zero offset explains."""
    for joint in parse_urdf(prepared.urdf).joints:
        j = prepared.dataset.joints.index(joint.name)
        widest = max(abs(joint.lower), abs(joint.upper))
        slides = prepared.dataset.position_unit[j] == "m"
        reach = float(np.abs(run.signals.q[:, j]).max())
        if widest < 0.1 * OPEN_LIMIT and reach > 2.0 * widest + (0.2 if slides else 2 * np.pi):
            unit, other = ("m", "mm") if slides else ("rad", "degrees")
            raise InputError(
                f"{_where(prepared, run)}: column 'q_{joint.name}' reaches {reach:.3g}, where the URDF's "
                f"limits are {joint.lower:.3g} to {joint.upper:.3g} {unit}; if it is in {other}, "
                f"convert it to {unit}."
            )


def _check_speeds(prepared: Prepared, run: PreparedRun) -> None:
    """Given speeds that are not the positions' derivative."""
    recorded = next(r for r in prepared.dataset.runs if r.file == run.file)
    if recorded.qd is None:
        return
    slope = differentiate(low_pass(recorded.q, run.band.torque, run.band.rate), run.band.rate)
    for j in np.flatnonzero(prepared.moving & np.isfinite(recorded.qd).all(axis=0)):
        given = low_pass(recorded.qd[:, [j]], run.band.torque, run.band.rate)[:, 0]
        both = float(given @ slope[:, j])
        gain = both / max(float(slope[:, j] @ slope[:, j]), 1e-300)
        alike = both / max(float(np.linalg.norm(given) * np.linalg.norm(slope[:, j])), 1e-300)
        if np.ptp(recorded.q[:, j]) > 1e-3 and not (0.8 < gain < 1.25 and alike > 0.8):
            joint = prepared.dataset.joints[j]
            raise InputError(
                f"{_where(prepared, run)}: column 'qd_{joint}' is {gain:.3g} times the slope of 'q_{joint}' "
                f"(correlation {alike:.2f}); give the joint's speed in rad/s or m/s, or leave the column out."
            )


def _check_readings(prepared: Prepared, run: PreparedRun, sample: Sample) -> None:
    """Degrees, swapped columns, opposite signs, motor-side torque and the like."""
    dataset = prepared.dataset
    stated = np.where(sample.heard, misfits(sample), np.nan)
    doubtful = np.nan_to_num(stated) > _DOUBTFUL
    if not doubtful.any():
        _check_inertia(prepared, run, sample)
        return
    slides = [unit == "m" for unit in dataset.position_unit]
    scale, told = _judge_scale(prepared, sample, doubtful)
    # A mere scale is told where no reading of its own does as well; of readings alike, the first.
    best = scale + _ALIKE
    many = doubtful.sum() >= 0.5 * np.isfinite(stated).sum()
    for reading in list_readings(run, dataset.joints, slides, doubtful):
        concerned = list(reading.joints) or np.flatnonzero(doubtful).tolist()
        if (not reading.joints and not many) or np.nanmedian(stated[concerned]) < reading.least:
            continue
        left = misfits(reading.change(sample))
        worst = float(np.nanmax(stated[concerned]))
        total = total_misfit(left, sample.heard)
        mended = all(left[j] < min(_BETTER * worst, _GOOD) for j in concerned)
        mended = mended and total < 0.5 * total_misfit(stated, sample.heard)
        if mended and total < best:
            best, told = total - _ALIKE, reading.told
    if told:
        raise InputError(f"{_where(prepared, run)}: {told}")
    heard = np.isfinite(stated)
    lenient = np.array([_free_misfit(sample, j) if heard[j] else np.nan for j in range(prepared.n)])
    if heard.any() and np.nanmedian(lenient) > _HOPELESS and np.nanmedian(stated) > _HOPELESS:
        explained = 100 * max(0.0, 1 - float(np.nanmin(lenient)))
        raise InputError(
            f"{_where(prepared, run)}: the motion explains next to nothing of the torque "
            f"(at most {explained:.0f} % of a joint's); check that the columns belong "
            "together, their units, and the URDF."
        )


def _judge_scale(prepared: Prepared, sample: Sample, doubtful: np.ndarray) -> tuple[float, str]:
    """Motor-side torque, newton-millimetres, masses in grams: the misfits left, and what to say."""
    dataset = prepared.dataset
    factors, left = scale_factors(sample, doubtful)
    with np.errstate(invalid="ignore"):
        off = (np.abs(factors) < _SMALL) | (np.abs(factors) > _LARGE)
    if not off.any():
        return np.inf, ""
    ratio = dataset.fields.robot.gear_ratio
    factor = float(np.median(factors[off]))
    hint = (
        "give torque on the joint side of the gear in N m (or N), and check the URDF's and payload's masses"
    )
    if ratio is not None and 0.3 < abs(factor * float(np.median(np.abs(np.array(ratio)[off])))) < 3.0:
        hint = "it looks like motor-side torque: multiply it with the gear ratio"
    columns = ", ".join(f"'tau_{dataset.joints[j]}'" for j in np.flatnonzero(off))
    verb = "is" if off.sum() == 1 else "are"
    told = f"{columns} {verb} {factor:.3g} times what the rigid body needs; {hint}."
    return total_misfit(left, sample.heard), told


def _check_inertia(prepared: Prepared, run: PreparedRun, sample: Sample) -> None:
    """Torque in too small a unit on a robot without gravity, where rotors could stand for any factor."""
    known = sample.known()
    shares = []
    for j in np.flatnonzero(prepared.moving):
        misfit, theta = fit_joint(sample, known, int(j))
        if np.isfinite(misfit) and sample.heard[j]:
            shares.append(theta[1] * sample.a[:, j].std() / max(known[:, j].std(), 1e-300))
    if shares and min(shares) > _ROTOR:
        raise InputError(
            f"{_where(prepared, run)}: the torques are {min(shares):.3g} times what the rigid body needs; "
            "give torque on the joint side of the gear in N m (or N)."
        )


def _free_misfit(sample: Sample, j: int) -> float:
    """Share of the variance that stays with free signs and sizes and a smooth function of position."""
    at = sample.counts[:, j]
    y = sample.tau[at, j]
    known = sample.known()
    s = sample
    centre, half = 0.5 * (s.q[at, j].max() + s.q[at, j].min()), max(0.5 * float(np.ptp(s.q[at, j])), 1e-12)
    u = (s.q[at, j] - centre) / half
    x = np.column_stack([known[at, j], s.a[at, j], s.sign[at, j], s.v[at, j], *(u**k for k in range(5))])
    left = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    return float(np.sum(left**2) / np.sum((y - y.mean()) ** 2))


def _check_frozen(prepared: Prepared, run: PreparedRun) -> None:
    """A position that never changes while its torque swings as in motion: a dead encoder, no locked joint.

    A held joint's brake and motor share the load that the others' motion makes. Noise is known by its band.
    """
    recorded = next(r for r in prepared.dataset.runs if r.file == run.file)
    for j in np.flatnonzero(np.ptp(recorded.q, axis=0) == 0.0).tolist():
        load = run.reduce(run.known[:, [j]])[:, 0]
        swing, torque = _span(run.measured[:, j] - load), _span(run.measured[:, j])
        usual = max(_span(other.measured[:, j]) for other in prepared.runs)
        steady = run.measured[:, j].var() > 0.5 * run.tau[:, j].var()
        if steady and min(swing, torque) > 0.5 * usual and swing + torque > 1.6 * _span(load):
            joint = prepared.dataset.joints[j]
            raise InputError(
                f"{_where(prepared, run)}: column 'q_{joint}' never changes while 'tau_{joint}' swings by "
                f"{torque:.3g}; the encoder's channel is dead, record the run again or leave it out."
            )


def _span(x: np.ndarray) -> float:
    return float(np.ptp(np.percentile(x, [2, 98])))


def _check_lag(prepared: Prepared, run: PreparedRun, sample: Sample) -> None:
    """A delay between the torque and the position channels of the whole recorder."""
    if "time_delay" in prepared.dataset.fields.declared_effects:
        return
    lag, ratio = find_lag(sample, _LONGEST)
    heard = np.isfinite(lag)
    if not heard.any():
        return
    middle = float(np.median(lag[heard]))
    agree = np.abs(lag[heard] - middle) < 0.01
    if abs(middle) >= _LAG and agree.mean() >= 0.75 and float(np.median(ratio[heard])) < 0.5:
        late = "late" if middle > 0 else "early"
        raise InputError(
            f"{_where(prepared, run)}: the torque channels come {1000 * abs(middle):.0f} ms {late} against "
            "the positions; align the channels, or declare time_delay."
        )
