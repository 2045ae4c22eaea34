"""What is left at each joint: noise, or structure that no name and no generic term holds."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from scipy import stats

from wearscope.closed_loop.diagnostics.in_time import Seen, see_jumps, see_level, see_lines, see_shifts
from wearscope.closed_loop.diagnostics.run_differences import (
    SIGNALS,
    compare_offsets,
    gain_by_halves,
    list_train_repeats,
    see_repeats,
)
from wearscope.closed_loop.inference.answer import Left
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.series import find_memory, join_blocks
from wearscope.closed_loop.intake.prepared import Prepared, PreparedRun
from wearscope.closed_loop.model.prediction import predict_full
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.terms import ModelTerm

#: p-value of a difference between runs, over the joints; standard errors of a sum over blocks that is there.
_LEVEL, _SURE = 0.005, 3.0
#: p-value at which runs have a mean in common.
_MEANS = 0.02
#: Factor of two errors (RMS) from which a model does not carry over to other motions.
_ALIKE = 1.5
State = Literal["explained", "corrected", "unexplained", "not_judged"]


@dataclass(frozen=True)
class JointState:
    """What is left at a joint.

    Attributes
    ----------
    joint : int
    state : str
    unexplained_rms : float or None
        RMS of the structure [torque unit of the joint]: in the training runs, or in the test runs where it is
        seen in these alone.
    depends_on : list of str
        Signals that it depends on, as far as that is known.
    reason : str
        How it was seen.
    """

    joint: int
    state: State
    unexplained_rms: float | None = None
    depends_on: list[str] = field(default_factory=list)
    reason: str = ""


def judge_joints(
    prepared: Prepared,
    after: Regression,
    named: Sequence[ModelTerm],
    left: Mapping[int, Left],
    policy: Policy,
    withdrawn: Sequence[tuple[ModelTerm, float, str]] = (),
) -> list[JointState]:
    """State of every joint, from what the corrected model leaves of the training runs.

    Autocorrelated noise is noise; what repeats with the motion, depends on a signal or on time, or makes the
    test runs' error larger than the training runs', is not.

    Parameters
    ----------
    prepared : Prepared
    after : Regression
        The corrected model.
    named : sequence of ModelTerm
        Of the corrected model.
    left : mapping of int to Left
        By joint, what the search found and could not take.
    policy : Policy
    withdrawn : sequence of (ModelTerm, float, str)
        What was named and is not in the corrected model, with its share of the held-out loss, and why.
    """
    theta = after.solve()
    train = prepared.runs_for("train")
    full = [run.tau - predict_full(after, theta, run) for run in train]
    residuals = [run.measured - run.reduce(run.tau - x) for run, x in zip(train, full, strict=True)]
    test = prepared.runs_for("test")
    full_test = [run.tau - predict_full(after, theta, run) for run in test]
    tested = [run.measured - run.reduce(run.tau - x) for run, x in zip(test, full_test, strict=True)]
    repeats = list_train_repeats(prepared)
    states, moving, band = [], int(prepared.moving.sum()), prepared.band
    for j in range(prepared.n):
        corrected = any(term.joint == j for term in named)
        if not prepared.moving[j]:
            states.append(JointState(j, "not_judged"))
            continue
        own = [r[:, j] for r in residuals]
        keep = [run.keep[:, j] for run in train]
        rms = _rms(own, keep)
        inside = [
            *_from_withdrawn(prepared, withdrawn, j),
            *([Seen(left[j].share, left[j].depends_on, left[j].reason)] if j in left else []),
            *see_repeats(repeats, own, keep, policy),
            *_from_runs(train, own, keep, prepared, j, policy),
            *see_level(train, own, keep, policy),
            *_from_means(
                [*own, *(r[:, j] for r in tested)], [*keep, *(run.keep[:, j] for run in test)], policy
            ),
            *see_jumps(train, own, keep, policy),
            *see_shifts(train, own, keep, policy),
            *see_lines([x[:, j] for x in full], train, own, keep, band.rate, band.torque, moving, policy),
        ]
        own_test, keep_test = [r[:, j] for r in tested], [run.keep[:, j] for run in test]
        error = _rms(own_test, keep_test)
        noisier = _compare_noise([x[:, j] for x in full], [x[:, j] for x in full_test])
        inside = [one for one in inside if one.share >= policy.structure_share]
        seen = [*inside, *_from_test(own, keep, error, policy, noisier)]
        if not seen or not rms > 0.0:
            states.append(JointState(j, "corrected" if corrected else "explained"))
            continue
        most = np.sqrt(min(max(s.share for s in seen), 1.0)) * rms
        if not inside:
            most = np.sqrt(max(error**2 - (noisier * rms) ** 2, 0.0))
        # Seen in the training runs, it says more than that the test runs' error is large.
        reason = max(inside or seen, key=lambda s: s.share).reason
        known = next((s.depends_on for s in sorted(seen, key=lambda s: -s.share) if s.depends_on), [])
        states.append(JointState(j, "unexplained", float(most), known, reason))
    return states


def _rms(parts: list[np.ndarray], keep: list[np.ndarray]) -> float:
    square = sum(float((x[k] ** 2).sum()) for x, k in zip(parts, keep, strict=True))
    return float(np.sqrt(square / max(sum(int(k.sum()) for k in keep), 1)))


def _from_withdrawn(
    prepared: Prepared, withdrawn: Sequence[tuple[ModelTerm, float, str]], joint: int
) -> list[Seen]:
    """What training runs have by a name that the test runs do not bear out."""
    seen = []
    for term, share, why in (one for one in withdrawn if one[0].joint == joint):
        depends = list(dict.fromkeys(term.effect.name_signals(term.shape, prepared.dataset.joints, joint)))
        told = f"{term.effect.name} fits the training runs, but is left out: {why}"
        seen.append(Seen(share, depends, told))
    return seen


def _sum_independent(gain: np.ndarray, y: np.ndarray, run: np.ndarray, length: int) -> np.ndarray:
    """Sums of a gain over groups of rows beyond which a residual is not autocorrelated, two at least.

    Parameters
    ----------
    gain, y : ndarray (M,)
    run : ndarray (M,)
        Run of each row, in order.
    length : int
        Rows of the shortest group.
    """
    block = np.concatenate([np.arange(size) // length for size in np.bincount(run)])
    first = np.concatenate([[True], (np.diff(block) != 0) | (np.diff(run) != 0)])
    number = np.cumsum(first) - 1
    own = run[first]
    group = join_blocks(own, find_memory(np.bincount(number, y), own))
    sums = np.bincount(np.unique(group, return_inverse=True)[1][number], gain)
    return sums if len(sums) > 1 else np.array([part.sum() for part in np.array_split(gain, 2)])


def _from_runs(
    train: list[PreparedRun], own: list[np.ndarray], keep: list[np.ndarray], prepared: Prepared,
    joint: int, policy: Policy,
) -> list[Seen]:  # fmt: skip
    """What differs from run to run, which held-out runs do not see: friction, inertia, a load, an offset."""
    if len(train) < 2:
        return []
    seen = []
    kept = [x[k] for x, k in zip(own, keep, strict=True)]
    share, p_value = compare_offsets(kept)
    if share >= policy.structure_share and p_value * prepared.moving.sum() <= _LEVEL:
        seen.append(Seen(share, [], "its mean differs from run to run"))
    gains = gain_by_halves(train, own, keep, joint)
    best = int(np.argmax(gains.sum(axis=0)))
    run = np.repeat(np.arange(len(train)), [len(x) for x in kept])
    y = np.concatenate(kept)
    sums = _sum_independent(gains[:, best], y, run, max(4, int(4 * prepared.band.torque)))
    share = float(sums.sum() / max((y**2).sum(), 1e-300))
    error = np.sqrt(len(sums) * sums.var(ddof=1))
    if share >= policy.structure_share and sums.sum() >= _SURE * error:
        name = SIGNALS[best].format(joint=prepared.dataset.joints[joint])
        seen.append(Seen(share, [name], f"what goes with {name} differs from run to run"))
    return seen


def _from_means(own: list[np.ndarray], keep: list[np.ndarray], policy: Policy) -> list[Seen]:
    """A mean of one sign and about one size in every run, those of the test too: that is no noise."""
    counted = [x[k] for x, k in zip(own, keep, strict=True) if k.any()]
    if len(counted) < 3:
        return []
    means = np.array([x.mean() for x in counted])
    mean, spread = float(means.mean()), float(means.std(ddof=1))
    share = mean**2 / max(float(np.mean(np.concatenate(counted) ** 2)), 1e-300)
    error = spread / np.sqrt(len(means))
    p_value = 2.0 * float(stats.t.sf(abs(mean) / max(error, 1e-300), len(means) - 1))
    if share < policy.structure_share or np.ptp(np.sign(means)) > 0.0 or p_value > _MEANS:
        return []
    return [
        Seen(min(share, 1.0), [], f"its mean is about {mean:.2g} in every run, as of an offset or a weight")
    ]


def _compare_noise(train: list[np.ndarray], test: list[np.ndarray]) -> float:
    """How many times as noisy the test runs are, at least 1, from residuals (N_r,) before the common filter.

    By the median change from sample to sample, in which what a model lacks has next to no part.
    """
    sizes = [float(np.median(np.abs(np.concatenate([np.diff(x) for x in one])))) for one in (train, test)]
    return max(1.0, sizes[1] / sizes[0]) if sizes[0] > 0.0 else 1.0


def _from_test(
    own: list[np.ndarray], keep: list[np.ndarray], error: float, policy: Policy, noisier: float = 1.0
) -> list[Seen]:
    """A test error beyond the training runs' own, and beyond what those differ by (a drift's do).

    What few runs differ by says next to nothing of how far another one may lie: it is not asked beyond the
    largest of theirs by the square of what makes two errors unlike. Of runs that are noisier, more is noise.
    """
    test = error / noisier
    train = _rms(own, keep)
    if not np.isfinite(test) or not train > 0.0 or test < _ALIKE * train:
        return []
    sizes = [_rms([x], [k]) for x, k in zip(own, keep, strict=True) if k.any()]
    logs = np.log(np.maximum(sizes, 1e-300))
    if len(logs) > 1:
        width = logs.std(ddof=1) * np.sqrt(1.0 + 1.0 / len(logs))
        usual = logs.mean() + stats.t.isf(_LEVEL, len(logs) - 1) * width
        if np.log(test) < min(usual, logs.max() + 2.0 * np.log(_ALIKE)):
            return []
    # The test error's excess, in units of the training error, as the other shares are.
    share = (test / train) ** 2 - 1.0
    return [
        Seen(min(share, 1.0), [], f"the test runs' error is {error / train:.1f} times the training runs'")
    ]
