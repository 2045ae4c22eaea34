"""Whether what a model leaves at a joint depends on the motion, now or past, whatever noise it may be.

A slow residual resembles some slow signal by chance, and filtered until it is white a slow effect is gone
with the drift that it might be. So the residual is compared with itself where it cannot depend on the motion:
each run's moved in time (of a single recording there are too few moments to move it to), and with random
phases, which keep its spectrum (surrogate data; Theiler et al. 1992). Splines of all signals of the motion
and of its past are fitted to each and predict held-out runs; what gains beyond all surrogates is dependence.
Temperature and time are no motion: a drift follows both.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import lfilter

from wearscope.closed_loop.inference.gram import Fit
from wearscope.closed_loop.inference.held_out import HeldOut
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.series import bridge_uncounted
from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.closed_loop.intake.signals import join_signals, pick_rows, thin_signals
from wearscope.closed_loop.model.regression import penalise
from wearscope.effects.base import Signals
from wearscope.effects.unknown import COARSE, LEVELS, PRODUCT, SLOW, coarsen
from wearscope.effects.vocabulary import empirical_effect

#: Largest and smallest number of rows of a joint that are tested.
_MOST_ROWS, _LEAST_ROWS = 3000, 60
#: Surrogates drawn at once; the first batch settles most tests.
_AT_ONCE = 99
#: Smallest and largest shift of a run, over its length.
_MOVED = (0.15, 0.85)


@dataclass(frozen=True)
class Dependence:
    """The part of a residual that depends on the motion.

    Attributes
    ----------
    share : float
        Of the held-out loss at the joint.
    depends_on : list of str
        Signals.
    past : bool
        Whether on what they have been.
    """

    share: float
    depends_on: list[str]
    past: bool


@dataclass(frozen=True)
class _Spline:
    depends_on: list[str]
    past: bool
    columns: np.ndarray
    penalty: np.ndarray


def find_dependence(
    problem: Problem, fit: Fit, joints: Sequence[int], policy: Policy
) -> dict[int, Dependence]:
    """Parts of the joints' residuals that depend on the motion beyond chance.

    Parameters
    ----------
    problem : Problem
    fit : Fit
    joints : sequence of int
    policy : Policy

    Returns
    -------
    dict of int to Dependence
        Of the joints at which at least `structure_share` of the held-out loss does, with a p-value over all
        splines of at most `unknown_level`.
    """
    seen = {joint: _test_joint(problem, fit, joint, policy) for joint in joints}
    return {joint: one for joint, one in seen.items() if one is not None}


def _test_joint(problem: Problem, fit: Fit, joint: int, policy: Policy) -> Dependence | None:
    layout = problem.layout
    every = max(1, -(-len(layout.keep) // _MOST_ROWS))
    keep = layout.keep[::every, joint]
    if keep.sum() < _LEAST_ROWS:
        return None
    residual = fit.leave(joint)
    known = fit.know_elsewhere(joint) * fit.sigma[joint] ** 2
    sums = HeldOut(layout, every, keep, fit.columns(joint)[::every], known)
    splines = list(_list_splines(problem, joint, every))
    own = sums.target(residual[::every, None])
    shares = np.array([sums.explain(s.columns, s.penalty, own)[:, 0] for s in splines])
    able = shares[:, 0] >= policy.structure_share
    if not able.any():
        return None
    runs = zip(layout.unpack(residual[:, None]), layout.unpack(layout.keep[:, joint]), strict=True)
    parts = [bridge_uncounted(x, kept)[:, 0] for x, kept in runs]
    for make in (move, mix_phases) if layout.folds.by_run else (mix_phases,):
        rng = np.random.default_rng(np.random.SeedSequence([policy.seed, joint]))
        gains = np.zeros((*shares.shape, 0))
        while gains.shape[-1] < policy.flips:
            count = min(_AT_ONCE, policy.flips - gains.shape[-1])
            made = np.concatenate([make(x, count, rng) for x in parts])[::every]
            target = sums.target(made)
            more = np.array([sums.explain(s.columns, s.penalty, target) for s in splines])
            gains = np.concatenate([gains, _log_gain(more)], axis=-1)
            score, chance = score_gains(_log_gain(shares), gains)
            above = (chance >= score.max(axis=1)[:, None]).sum(axis=-1)
            beyond = able & ((1.0 + above) / (policy.flips + 1.0) <= policy.unknown_level)
            if not beyond.any():
                return None
        able = beyond
    best = int(np.argmax(np.where(able, shares[:, 0], -np.inf)))
    return Dependence(float(min(shares[best, 0], 1.0)), splines[best].depends_on, splines[best].past)


def score_gains(own: np.ndarray, gains: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gains (C, 2) in standard deviations of surrogates' (C, 2, S), and the largest of each of these (S,).

    Splines with few and with many heights gain differently by chance, and so do held-out and fitted rows.
    """
    mean, error = gains.mean(axis=-1), gains.std(axis=-1) + 1e-12
    chance = ((gains - mean[..., None]) / error[..., None]).max(axis=(0, 1))
    return (own - mean) / error, chance


def _log_gain(share: np.ndarray) -> np.ndarray:
    """Logarithm of a loss over its remainder, which is hardly bounded above."""
    return np.asarray(-np.log(np.maximum(1.0 - share, 1e-6)))


def _list_splines(problem: Problem, joint: int, every: int) -> Iterator[_Spline]:
    """Coarse splines of the motion's signals, of pairs and of its past, on one row in `every`."""
    runs, joints = problem.train, problem.prepared.dataset.joints
    effect = empirical_effect()
    signals = pick_rows(
        join_signals(replace(thin_signals(run), sign=run.reduce(run.signals.sign)) for run in runs),
        slice(None, None, every),
    )
    for shape in effect.shapes(problem.joined, joint):
        if {int(shape[0]), int(shape[5])} & set(SLOW):
            continue
        named = shape.copy()
        named[-1] = finest = PRODUCT if shape[5] >= 0 else COARSE
        x = effect.columns(signals, joint, named)[:, :finest]
        names = effect.name_signals(named, joints, joint)
        yield _Spline(names, False, x, penalise(x))
        if finest == COARSE:
            coarse = x @ coarsen(finest, LEVELS[0])
            yield _Spline(names, False, coarse, penalise(coarse))
    for codes, x in list_past(runs, joint):
        thinned = x[::every]
        yield _Spline([f"{code}_{joints[joint]}" for code in codes], True, thinned, penalise(thinned))


def move(x: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """A run's residual (M,) moved in time, backwards and with the other sign as often as not, (M, count)."""
    n = len(x)
    place = np.arange(n)[:, None] + (rng.uniform(*_MOVED, count) * n).astype(int)
    place = np.where(rng.random(count) < 0.5, place, -place)
    return np.asarray(x[place % n] * rng.choice([-1.0, 1.0], count))


def mix_phases(x: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """A run's residual (M,) with random phases, and random signs of its level and slope, (M, count)."""
    n = len(x)
    along = np.linspace(-1.0, 1.0, n)
    slope, level = np.polyfit(along, x, 1)
    spectrum = np.fft.rfft(x - level - slope * along)[:, None]
    mixed = np.fft.irfft(spectrum * np.exp(2j * np.pi * rng.random((len(spectrum), count))), n, axis=0)
    turned = rng.choice([-1.0, 1.0], (2, count))
    return np.asarray(mixed + slope * along[:, None] * turned[0] + level * turned[1])


#: Time constants of the past [s]; the longest one, over the shortest run: a longer one would resemble time.
_MEMORIES, _LONGEST = (0.3, 1.0, 3.0, 10.0), 0.2
#: Signals that are filtered to their past, with the codes of the signals they are made of.
_FADING: tuple[tuple[tuple[str, ...], Callable[[Signals, int], np.ndarray]], ...] = (
    (("qd",), lambda s, j: s.v[:, j]),
    (("qd",), lambda s, j: np.abs(s.v[:, j])),
    (("sign_qd",), lambda s, j: s.sign[:, j]),
    (("load", "qd"), lambda s, j: np.abs(s.load[:, j] * s.v[:, j])),
)


def list_past(
    runs: list[PreparedRun], joint: int, levels: Sequence[int] = LEVELS[:1]
) -> Iterator[tuple[tuple[str, ...], np.ndarray]]:
    """Splines of a joint's past at its rows, alone and times the direction of motion, by hat functions.

    Speed, its size, the direction of motion and the mechanical power, filtered to the past as if the joint
    had rested before each run; and the position at which the joint last turned round.

    Yields
    ------
    tuple of str
        Codes of the signals.
    ndarray (M, m)
    """
    sign = np.concatenate([run.reduce(run.signals.sign[:, [joint]]) for run in runs])
    shortest = min(len(run.signals.t) / run.band.rate for run in runs)
    times = [time for time in _MEMORIES if time <= _LONGEST * shortest]
    every = [(codes, _remember(runs, joint, take, time)) for codes, take in _FADING for time in times]
    for codes, x in [*every, (("q",), _last_turn(runs, joint))]:
        low, high = np.quantile(x, [0.002, 0.998])
        if high - low > 1e-9 * (1.0 + abs(high)):
            for knots in levels:
                columns = _spline(x, low, high, knots)
                yield codes, columns
                yield tuple(dict.fromkeys((*codes, "sign_qd"))), columns * sign


def _remember(
    runs: list[PreparedRun], joint: int, take: Callable[[Signals, int], np.ndarray], time: float
) -> np.ndarray:
    """A signal filtered to its past over some time, at the rows (M,)."""
    parts = []
    for run in runs:
        keep = np.exp(-1.0 / (run.band.rate * time))
        past = lfilter([1.0 - keep], [1.0, -keep], take(run.signals, joint))
        parts.append(past[rows(run.band, len(past))])
    return np.concatenate(parts)


def _last_turn(runs: list[PreparedRun], joint: int) -> np.ndarray:
    """Position at which a joint last turned round, at the rows (M,); before, where its run starts."""
    parts = []
    for run in runs:
        forwards = run.signals.v[:, joint] > 0.0
        turned = np.concatenate([[False], forwards[1:] != forwards[:-1]])
        last = np.maximum.accumulate(np.where(turned, np.arange(len(turned)), 0))
        parts.append(run.signals.q[last, joint][rows(run.band, len(last))])
    return np.concatenate(parts)


def _spline(x: np.ndarray, low: float, high: float, knots: int) -> np.ndarray:
    """Hat functions (M, knots) between two values, constant beyond."""
    place = np.clip((x - low) / (high - low), 0.0, 1.0) * (knots - 1)
    return np.maximum(0.0, 1.0 - np.abs(place[:, None] - np.arange(knots)))
