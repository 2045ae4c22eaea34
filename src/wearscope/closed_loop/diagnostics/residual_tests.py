"""Three tests of what a model leaves at a joint: it follows the motion, differs by run, or changes in time.

Autocorrelated noise does none of these. Whether a known signal of the motion explains the residual is tested
in the search (`wearscope.closed_loop.inference.motion_dependence`). The tests here need no signal: the
residual returns when a motion is repeated, has a mean of one sign in every run, or is larger on the test
runs' other motions. What differs between runs cannot be predicted from other runs, but from the other half of
the same run.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from wearscope.closed_loop.diagnostics.in_time import find_line, fit_shift
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.series import bridge_uncounted
from wearscope.closed_loop.intake.prepared import PreparedRun

#: p-value of a mean, or of a difference between runs, over all joints; standard deviations from which the
#: agreement of two runs is not due to chance.
LEVEL, _SURE = 0.005, 4.0
#: Least share of a single recording's residual that a level must hold to be reported.
_MOST = 0.7
#: Ratio of test to training error (RMS) from which a model does not carry over to other motions.
_ALIKE = 1.5
#: Least deviance of shifts of level: in 600 simulated series, noise and drifts reach 25.
_SHIFTED = 30.0
#: Signals with which a difference between runs may vary.
_SIGNALS = ("load_{joint}", "qdd_{joint}", "sign_qd_{joint}", "qd_{joint}")


@dataclass(frozen=True)
class Residual:
    """Residual of a joint's torque in one run.

    Attributes
    ----------
    run : PreparedRun
    torque : ndarray (M,)
        Residual torque after the common filter.
    keep : ndarray (M,) of bool
        Rows that count.
    """

    run: PreparedRun
    torque: np.ndarray
    keep: np.ndarray

    @property
    def counted(self) -> np.ndarray:
        """Residual torque of the rows that count."""
        return self.torque[self.keep]


@dataclass(frozen=True)
class Seen:
    """Structure that was seen in a joint's residual.

    Attributes
    ----------
    share : float
        Share of the residual's variance.
    depends_on : list of str
        Signals that it depends on, as far as that is known.
    reason : str
        How it was seen.
    """

    share: float
    depends_on: list[str]
    reason: str


def measure_rms(parts: Sequence[Residual]) -> float:
    """Root mean square of residuals over the rows that count."""
    square = sum(float((one.counted**2).sum()) for one in parts)
    return float(np.sqrt(square / max(sum(int(one.keep.sum()) for one in parts), 1)))


def see_motion(
    train: Sequence[Residual], test: Sequence[Residual], repeats: Sequence[tuple[int, int]]
) -> list[Seen]:
    """Structure that depends on the motion through no known signal: it repeats, or has one mean in every run.

    Parameters
    ----------
    train, test : sequence of Residual
    repeats : sequence of (int, int)
        Pairs of training runs, by index, that follow the same trajectory.
    """
    seen = []
    for a, b in repeats:
        short = min(len(train[a].torque), len(train[b].torque))
        both = train[a].keep[:short] & train[b].keep[:short]
        x, y = (train[k].torque[:short][both] for k in (a, b))
        if len(x) < 100:
            continue
        size = max(float(np.sqrt(np.mean(x**2) * np.mean(y**2))), 1e-300)
        # Runs that are shifted against each other show how well autocorrelated noise agrees by chance.
        shifts = np.linspace(0.2, 0.8, 60) * len(x)
        share, *chance = (float(np.mean(x * np.roll(y, int(k)))) / size for k in (0.0, *shifts))
        if share > max(_SURE * float(np.sqrt(np.mean(np.square(chance)))), np.abs(chance).max()):
            seen.append(Seen(share, [], "it returns whenever a motion is repeated"))
    return [*seen, *_see_mean(train, test)]


def _see_mean(train: Sequence[Residual], test: Sequence[Residual]) -> list[Seen]:
    """A mean of the same sign and about the same size in every run, test runs included."""
    counted = [one.counted for one in (*train, *test) if one.keep.any()]
    means = np.array([x.mean() for x in counted])
    if len({one.run.file for one in train}) == 1 and train[0].keep.any():
        y = np.concatenate([one.counted for one in train])
        share = float(y.mean() ** 2 / max(np.mean(y**2), 1e-300))
        told = f"a level of {y.mean():.3g}, an offset or a drift, which a single run does not tell apart"
        if share >= _MOST:
            return [Seen(share, [], told)]
    if len(means) < 3 or np.ptp(np.sign(means)) > 0.0:
        return []
    mean, error = float(means.mean()), float(means.std(ddof=1)) / np.sqrt(len(means))
    if stats.t.sf(abs(mean) / max(error, 1e-300), len(means) - 1) > 2.0 * LEVEL:
        return []
    share = min(mean**2 / max(float(np.mean(np.concatenate(counted) ** 2)), 1e-300), 1.0)
    return [Seen(share, [], f"its mean is about {mean:.2g} in every run, as of an offset or a weight")]


def see_runs(train: Sequence[Residual], joint: int, name: str, joints: int) -> list[Seen]:
    """Differences from run to run, which held-out runs do not show: friction, inertia, a load, an offset.

    Parameters
    ----------
    train : sequence of Residual
    joint : int
    name : str
        Name of the joint.
    joints : int
        Number of joints that are tested, by which the p-value is corrected.
    """
    shares, p_values = compare_runs([(_take_signals(one, joint), one.counted) for one in train])
    sure = p_values * joints <= LEVEL
    if not sure.any():
        return []
    best = int(np.argmax(np.where(sure, shares, -np.inf)))
    if best == 0:
        return [Seen(float(shares[0]), [], "its mean differs from run to run")]
    signal = _SIGNALS[best - 1].format(joint=name)
    return [Seen(float(shares[best]), [signal], f"what goes with {signal} differs from run to run")]


def compare_runs(runs: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Test whether slopes of the residual differ more between runs than between the halves of a run.

    The slopes of a drift do not.

    Parameters
    ----------
    runs : sequence of (ndarray (M_r, P), ndarray (M_r,))
        Columns, the first a constant, and the residual, in the rows that count.

    Returns
    -------
    ndarray (P,)
        Share of the residual's square that the differences of each column's slope hold.
    ndarray (P,)
        p-value of the F test of each column.
    """
    halves = [
        _fit_alone(x[half], y[half])
        for x, y in runs
        if len(y) > 3
        for half in (slice(len(y) // 2), slice(len(y) // 2, None))
    ]
    count, square = len(halves) // 2, sum(float(y @ y) for _, y in runs)
    if count < 2 or not square > 0.0:
        columns = runs[0][0].shape[1] if runs else 0
        return np.zeros(columns), np.ones(columns)
    slope, power = (np.array([half[k] for half in halves]).reshape(count, 2, -1) for k in (0, 1))
    weight, own = power.sum(axis=1), slope.mean(axis=1)
    middle = (weight * own).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-300)
    between = (weight * (own - middle) ** 2).sum(axis=0)
    within = (weight * (slope[:, 0] - slope[:, 1]) ** 2).sum(axis=0)
    ratio = between / (count - 1) / np.maximum(within / count, 1e-300)
    return between / square, stats.f.sf(ratio, count - 1, count)


def _fit_alone(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope (P,) and power (P,) of each column alone; all but the first about their mean."""
    x = np.concatenate([x[:, :1], x[:, 1:] - x[:, 1:].mean(axis=0)], axis=1)
    power = (x**2).sum(axis=0)
    return x.T @ y / np.where(power > 0.0, power, np.inf), power


def _take_signals(one: Residual, joint: int) -> np.ndarray:
    """A constant and the signals with which a difference may vary, in the rows that count."""
    s = one.run.signals
    signals = np.column_stack([x[:, joint] for x in (one.run.known, s.a, s.sign, s.v)])
    columns = one.run.reduce(signals)[one.keep]
    return np.column_stack([np.ones(len(columns)), columns])


def see_time(train: Sequence[Residual], cut_off: float, joints: int, policy: Policy) -> list[Seen]:
    """A shift of level at one moment of each run, or a spectral line, tested on all runs together.

    Parameters
    ----------
    train : sequence of Residual
    cut_off : float
        Cut-off of the common filter [Hz]; filtered torques have no line above it.
    joints : int
        Number of joints that are tested, by which the p-value is corrected.
    policy : Policy
    """
    seen = []
    whole = max(sum(float((one.counted**2).sum()) for one in train), 1e-300)
    found = [
        (shift, shift.share * float((one.counted**2).sum()) / whole, one.run.file)
        for one in train
        if (shift := fit_shift(one.run.t[one.keep], one.counted)) is not None
    ]
    if sum(shift.deviance for shift, _, _ in found) >= _SHIFTED:
        share = sum(part for shift, part, _ in found if shift.deviance > 0.0)
        most, _, file = max(found, key=lambda one: one[0].deviance)
        told = f"its level shifts at a moment, surest by {abs(most.size):.3g} at {most.time:.3g} s of {file}"
        seen.append(Seen(share, ["t"], told))
    # Rows that do not count, at reversals and rests, may hide a spectral line; straight lines bridge them.
    bridged = [bridge_uncounted(one.torque[:, None], one.keep)[:, 0] for one in train]
    line = find_line(bridged, 1.0 / float(np.median(np.diff(train[0].run.t))))
    if line is not None and line.frequency < cut_off and line.p_value * joints <= policy.unknown_level:
        seen.append(Seen(line.share, ["t"], f"a line at {line.frequency:.3g} Hz in time"))
    return seen


def see_test_error(train: Sequence[Residual], error: float, noisier: float = 1.0) -> list[Seen]:
    """A test error that exceeds the training runs' errors by more than their scatter, as with a drift.

    The scatter of few runs hardly limits the error of a further run. So the limit is at most the largest
    training error times `_ALIKE` squared. Noisier test runs may have a larger error.

    Parameters
    ----------
    train : sequence of Residual
    error : float
        RMS residual of the test runs.
    noisier : float
        Noise of the test runs over that of the training runs; see `compare_noise`.
    """
    test, own = error / noisier, measure_rms(train)
    if not np.isfinite(test) or not own > 0.0 or test < _ALIKE * own:
        return []
    logs = np.log(np.maximum([measure_rms([one]) for one in train if one.keep.any()], 1e-300))
    if len(logs) > 1:
        width = logs.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(logs))
        usual = logs.mean() + stats.t.isf(LEVEL, len(logs) - 1) * width
        if np.log(test) < min(usual, logs.max() + 2.0 * np.log(_ALIKE)):
            return []
    # Excess variance of the test residual over the training residual's, to which all other shares refer too.
    share = min((test / own) ** 2 - 1.0, 1.0)
    return [Seen(share, [], f"the test runs' error is {error / own:.1f} times the training runs'")]


def compare_noise(train: Sequence[np.ndarray], test: Sequence[np.ndarray]) -> float:
    """Noise of the test runs over the training runs', at least 1, from residuals (N_r,) without the filter.

    It is measured by the median change from sample to sample, to which missing terms hardly contribute.
    """
    sizes = [float(np.median(np.abs(np.concatenate([np.diff(x) for x in one])))) for one in (train, test)]
    return max(1.0, sizes[1] / sizes[0]) if sizes[0] > 0.0 else 1.0
