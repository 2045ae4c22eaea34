"""What differs from run to run: a friction, an inertia or a load that a model holds to be the same in all.

No run can say of another one what differs between them, so that neither held-out runs nor trees that were
grown on other runs see it. One half of a run can say it of the other half.
"""

from collections.abc import Sequence

import numpy as np
from scipy import stats

from wearscope.closed_loop.diagnostics.in_time import Seen
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.intake.rough_model import rough_columns
from wearscope.closed_loop.model.prediction import find_repeats

#: Standard deviations of chance from which what two runs have in common is there.
_SURE = 4.0
#: Signals that what differs may go with, in the order of the gains.
SIGNALS = ("load_{joint}", "qdd_{joint}", "sign_qd_{joint}", "qd_{joint}")


def gain_by_halves(
    runs: Sequence[PreparedRun], residuals: Sequence[np.ndarray], keep: Sequence[np.ndarray], joint: int
) -> np.ndarray:
    """Square of a residual, about its mean, that each signal removes of the halves it was not fitted on.

    Parameters
    ----------
    runs : sequence of PreparedRun
    residuals : sequence of ndarray (M_r,)
        Of the joint.
    keep : sequence of ndarray (M_r,) of bool
        Rows that count.
    joint : int

    Returns
    -------
    ndarray (M, 4)
        By row that counts, over all runs, and by `SIGNALS`.
    """
    return np.concatenate(
        [
            _gain(_take_signals(run, joint)[rows], x[rows])
            for run, x, rows in zip(runs, residuals, keep, strict=True)
        ]
    )


def compare_offsets(residuals: Sequence[np.ndarray]) -> tuple[float, float]:
    """Whether the means of runs differ by more than the halves of a run do, as those of a drift do not.

    Parameters
    ----------
    residuals : sequence of ndarray (M_r,)
        Of a joint, two runs or more, at the rows that count.

    Returns
    -------
    float
        Share of the residual's square that the differences hold.
    float
        p-value of the F test.
    """
    residuals = [y for y in residuals if len(y) > 1]
    count = len(residuals)
    square = sum(float(y @ y) for y in residuals)
    if count < 2 or not square > 0.0:
        return 0.0, 1.0
    size = np.array([len(y) for y in residuals])
    mean = np.array([y.mean() for y in residuals])
    halves = np.array([y[: len(y) // 2].mean() - y[len(y) // 2 :].mean() for y in residuals])
    share = float(size @ (mean - np.average(mean, weights=size)) ** 2) / square
    ratio = float(mean.var(ddof=1)) / max(float(np.mean(halves**2)), 1e-300)
    return share, float(stats.f.sf(ratio, count - 1, count))


def _take_signals(run: PreparedRun, joint: int) -> np.ndarray:
    s = run.signals
    known, a, sign, v = (x[:, joint] for x in (run.known, s.a, s.sign, s.v))
    return run.reduce(rough_columns(known, a, sign, v)[:, : len(SIGNALS)])


def _gain(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Gain (M, P) of every column alone, about a run's means, of which a torque that drifts has its own."""
    gain = np.zeros(x.shape)
    if len(y) < 2:
        return gain
    x, y = x - x.mean(axis=0), y - y.mean()
    first = np.arange(len(y)) < len(y) // 2
    for fitted, held in ((first, ~first), (~first, first)):
        power = (x[fitted] ** 2).sum(axis=0)
        slope = x[fitted].T @ y[fitted] / np.where(power > 0.0, power, np.inf)
        gain[held] = y[held, None] ** 2 - (y[held, None] - x[held] * slope) ** 2
    return gain


def list_train_repeats(prepared: Prepared) -> list[tuple[int, int]]:
    """Pairs of training runs, among themselves, that follow the same trajectory."""
    train = [i for i, run in enumerate(prepared.runs) if run.use == "train"]
    place = {i: k for k, i in enumerate(train)}
    return [(place[a], place[b]) for a, b in find_repeats(prepared) if a in place and b in place]


def see_repeats(
    repeats: list[tuple[int, int]], own: list[np.ndarray], keep: list[np.ndarray], policy: Policy
) -> list[Seen]:
    """What repeats when the motion does, from pairs of runs."""
    seen = []
    for a, b in repeats:
        x, y = own[a], own[b]
        short = min(len(x), len(y))
        both = keep[a][:short] & keep[b][:short]
        if both.sum() < 100:
            continue
        x, y = x[:short][both], y[:short][both]
        size = max(float(np.sqrt(np.mean(x**2) * np.mean(y**2))), 1e-300)
        share = float(np.mean(x * y)) / size
        # What autocorrelated noise gives by chance: the same runs, shifted against each other.
        shifts = np.linspace(0.2, 0.8, 60) * len(x)
        chance = np.array([float(np.mean(x * np.roll(y, int(k)))) / size for k in shifts])
        highest = max(_SURE * float(np.sqrt(np.mean(chance**2))), float(np.abs(chance).max()))
        if share > max(policy.structure_share, highest):
            seen.append(Seen(share, [], "it repeats where a run repeats another's motion"))
    return seen
