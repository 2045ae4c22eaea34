"""Scores of candidates beside the current model: cross-validated gain, significance, determinacy."""

from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from wearscope.closed_loop.model.blocks import Folds
from wearscope.closed_loop.model.candidates import Family
from wearscope.closed_loop.model.regression import (
    Entry,
    Regression,
    Regressors,
    block_scores,
    cross_validate_family,
    partial_fit,
)

#: Share of the best candidate's gain that another one must miss before the runs can tell them apart.
MATERIAL = 0.02
#: Why a candidate is not taken that a drift of the residual may imitate.
DRIFTS = "not significant: what it leaves drifts"
#: Share of a regressor that must stay after the current model is projected out.
ISOLABLE = 1e-3
#: Least number of blocks, effectively, that the information on a candidate must come from where there is one
#: run; of several, a held-out one must have it too.
_LEAST_BLOCKS = 4.0
#: Student's t at which runs agree, however few.
_ENOUGH = 7.5
#: Share of the information from which a run tells of a candidate; how many must, and by how many standard
#: errors each, to show it on their own.
_TELLING, _LEAST_TELLING, _ALONE = 0.05, 3, 4.0
#: Correlation of blocks of the residual above which one remembers the other.
_REMEMBERED = 0.2
#: Largest sum of the terms of one effect over the effect itself: beyond, terms cancel each other.
_CANCELLATION = 12.0


@dataclass
class Scored:
    """One candidate (effect, joint, subset of its coefficients, best shape) beside the current model.

    Attributes
    ----------
    entry : Entry
    odds : float
        Loss it removes over the loss that is left, on the blocks it is fitted on, or another statistic of
        its significance.
    cv_gain : float
        Reduction of the held-out loss.
    cv_share : float
        The same over the current loss of the joints it acts on.
    cv_loss : ndarray (B,)
        Held-out loss by block.
    p_block : float
        Family-wise p-value of the best score over all candidates, by block sign flips.
    p_run : float
        p-value of the score's consistency over runs (over parts of them where there are fewer than three).
    isolability : float
        Sine of the angle between the candidate and the current model.
    beta : ndarray (m,)
    reason : str
        Why it cannot be taken; empty where it can.
    extends : bool
        Whether it adds coefficients to an effect that is in the model.
    flips : ndarray (F,)
        Odds when the residual's blocks change sign at random.
    joint_loss : float
        Held-out loss of its joint beside which it was scored.
    """

    entry: Entry
    odds: float
    cv_gain: float
    cv_share: float
    cv_loss: np.ndarray
    p_run: float
    isolability: float
    beta: np.ndarray
    flips: np.ndarray
    joint_loss: float
    p_block: float = np.nan
    reason: str = ""
    extends: bool = False

    @property
    def size(self) -> int:
        """Number of coefficients."""
        return len(self.entry.subset)


@dataclass
class Found:
    """An effect that was named, with what the runs cannot tell apart from it."""

    entry: Entry
    equivalent: list[str]
    scored: Scored


@dataclass
class Scorer:
    """Scores candidate families beside a regression.

    Attributes
    ----------
    model : Regression
    folds : Folds
    flips : ndarray (F, B)
        Random signs, the same for every candidate.
    """

    model: Regression
    folds: Folds
    flips: np.ndarray
    joint_loss: np.ndarray = field(init=False)
    sample_loss: np.ndarray = field(init=False)
    base: np.ndarray = field(init=False)

    def __post_init__(self) -> None:
        self.base = self.model.cross_validate(self.folds)
        self.joint_loss = self.model.cross_validate_joints(self.folds)
        self.sample_loss = self.model.block_power(self.model.solve()).sum(axis=0)

    def score(self, family: Family, subsets: list[np.ndarray] | None = None) -> list[Scored]:
        """Score variants of a family: those given, or all (of a single run only the plain ones)."""
        if subsets is None:
            effect = family.effect
            subsets = effect.subsets() if self.folds.by_run else effect.plain_subsets()
        regressors = self.model.correlate(family.columns, family.joint, family.count)
        return [self.score_regressors(family, regressors.select(s), s) for s in subsets]

    def score_regressors(
        self,
        family: Family,
        regressors: Regressors,
        subset: np.ndarray,
        tested: tuple[float, np.ndarray] | None = None,
    ) -> Scored:
        """Score one variant of a family, of which the regressors are given.

        Parameters
        ----------
        family : Family
        regressors : Regressors
            Of the columns `subset`.
        subset : ndarray
        tested : tuple, optional
            Another statistic to test its significance with than `Scored.odds`, and the same under `flips`.
        """
        model = self.model
        fit = partial_fit(model, regressors)
        inner = fit.inner
        best = int(np.argmax(fit.gain))
        beta = fit.beta[best]
        losses = cross_validate_family(model, regressors, self.folds)
        own = regressors.gram[:, best].sum(axis=0)
        isolability = float(np.sqrt(max(beta @ inner[best] @ beta, 0.0) / max(beta @ own @ beta, 1e-300)))
        scale = self._loss_at(family, best, subset, beta, self.joint_loss)
        if tested is None:
            sample = self._loss_at(family, best, subset, beta, self.sample_loss)
            gains, flipped = flip_blocks(block_scores(model, regressors), inner, self.flips)
            tested = float(_odds(np.asarray(gains), sample)), _odds(flipped, sample)
        odds, flips = tested
        gain = float(np.nansum(self.base - losses))
        left = block_scores(model, regressors.at(best), beta[None])[:, 0] @ beta
        information = np.einsum("i,bij,j->b", beta, regressors.gram[:, best], beta)
        scored = Scored(
            entry=family.entry(best, subset),
            odds=odds,
            cv_gain=gain,
            cv_share=gain / max(float(scale), 1e-300),
            cv_loss=losses,
            p_run=self._test_runs(left, information, float(beta @ inner[best] @ beta)),
            isolability=isolability,
            beta=beta,
            flips=flips,
            joint_loss=float(self.joint_loss[family.joint]),
        )
        blocks = float(information.sum() ** 2 / max((information**2).sum(), 1e-300))
        scored.reason = self._object(scored, own, blocks)
        return scored

    def _loss_at(
        self, family: Family, shape: int, subset: np.ndarray, beta: np.ndarray, loss: np.ndarray
    ) -> float:
        """Loss of the joints a candidate acts on, each by how strongly it does."""
        if not family.effect.spread:
            return float(loss[family.joint])
        power = np.zeros(self.model.prepared.n)
        for x, w in zip(family.columns, self.model.weights, strict=True):
            own = x.reshape(*x.shape[:2], -1, family.count)[:, :, shape][..., subset] @ beta
            power += ((own * w) ** 2).sum(axis=0)
        return float((power / max(power.max(), 1e-300)) @ loss)

    def _test_runs(self, left: np.ndarray, information: np.ndarray, gain: float) -> float:
        """Whether runs agree: t-test of the gain with the scores' scatter over them as its error.

        Three or four runs cannot give small p-values, however well they agree; nor do they where each wants
        another size. They agree, too, where every one that tells of the candidate shows it on its own.

        Parameters
        ----------
        left, information : ndarray (B,)
            Scores of what is left once the candidate is fitted, and its loss, by block.
        gain : float
            Loss that it removes.
        """
        part = self.folds.parts
        u = np.bincount(part, left)
        count = len(u)
        error = np.sqrt((u**2).sum() * count / (count - 1))
        t = gain / max(error, 1e-300)
        if self.folds.agree_by_run:
            information = information * (gain / max(information.sum(), 1e-300))
            own = np.bincount(part, information)
            size = 1.0 + u / np.maximum(own, 1e-300)
            noise = np.sqrt(np.bincount(part, (left - information * (size - 1.0)[part]) ** 2))
            tells = own > _TELLING * own.sum()
            alone = size * own / np.maximum(noise, 1e-300)
            if t > _ENOUGH or (tells.sum() >= _LEAST_TELLING and alone[tells].min() > _ALONE):
                return 0.0
        return float(stats.t.sf(t, count - 1))

    def _object(self, scored: Scored, own: np.ndarray, blocks: float) -> str:
        if scored.isolability < ISOLABLE:
            return "the declared model absorbs it on these runs"
        if not self.folds.by_run and blocks < _LEAST_BLOCKS:
            return f"all its evidence lies in {blocks:.1f} blocks of the runs"
        beta = scored.beta
        parts = np.sqrt(np.maximum(np.diag(own), 0)) * np.abs(beta)
        whole = np.sqrt(max(beta @ own @ beta, 1e-300))
        if scored.entry.effect.name != "unknown" and parts.max() > _CANCELLATION * whole:
            return "its parameters are not determined by these runs (terms cancel)"
        for k, value in zip(scored.entry.subset, beta, strict=True):
            parameter = scored.entry.effect.coefficients[k]
            if not parameter.lower <= value <= parameter.upper:
                return f"{parameter.name} = {value:.3g} is outside its physical bounds"
        return ""


def _odds(gain: np.ndarray, loss: float) -> np.ndarray:
    """Loss removed over loss left."""
    return np.asarray(gain) / np.maximum(loss - np.asarray(gain), 1e-9 * max(loss, 1e-300))


def flip_blocks(scores: np.ndarray, inner: np.ndarray, flips: np.ndarray) -> tuple[float, np.ndarray]:
    """Largest reduction of the loss over the shapes, and the same when blocks change sign at random.

    Parameters
    ----------
    scores : ndarray (B, s, m)
        From `block_scores`.
    inner : ndarray (s, m, m)
        Gram matrices with the model projected out.
    flips : ndarray (F, B)
    """
    inverse = np.linalg.inv(inner)
    total = scores.sum(axis=0)
    flipped = np.zeros(len(flips))
    for start in range(0, len(inverse), 64):
        part = slice(start, start + 64)
        turned = np.tensordot(flips, scores[:, part], axes=(1, 0))
        value = np.einsum("fsm,smn,fsn->fs", turned, inverse[part], turned, optimize=True)
        flipped = np.maximum(flipped, value.max(axis=1))
    return float(np.einsum("sm,smn,sn->s", total, inverse, total).max()), flipped


def find_memory(left: np.ndarray, run: np.ndarray) -> int:
    """Blocks that turn their signs together: twice as many as remember what is left of them, (B,).

    Where that is more than a sixth of the shortest run, all of its blocks do.
    """
    whole = int(np.bincount(run).max())
    power = max(float((left**2).mean()), 1e-300)
    for lag in range(1, int(np.bincount(run).min()) // 12 + 2):
        same = run[lag:] == run[:-lag]
        if float((left[lag:] * left[:-lag])[same].mean()) < _REMEMBERED * power:
            length = 2 * lag - 1
            return length if 6 * length <= np.bincount(run).min() or length == 1 else whole
    return whole


def join_blocks(run: np.ndarray, length: int) -> np.ndarray:
    """First block (B,) of the group of `length` blocks that each block belongs to, within its run."""
    first = np.searchsorted(run, run)
    return first + (np.arange(len(run)) - first) // length * length


def make_flips(count: int, blocks: int, seed: int) -> np.ndarray:
    """Random signs (count, blocks)."""
    return np.random.default_rng(np.random.SeedSequence([seed, blocks])).choice([-1.0, 1.0], (count, blocks))


def adjust_p_values(scored: list[Scored]) -> None:
    """Family-wise p-values: the least p-value over all candidates against its distribution under flips.

    Scores of candidates with different numbers of columns and shapes are made comparable by a gamma
    distribution with the mean and variance of their own flips (Westfall and Young 1993, minP).
    """
    if not scored:
        return
    observed = np.empty(len(scored))
    lowest = np.zeros(len(scored[0].flips))
    for i, s in enumerate(scored):
        mean, variance = s.flips.mean(), max(s.flips.var(), 1e-300)
        shape, scale = mean**2 / variance, variance / max(mean, 1e-300)
        observed[i] = stats.gamma.logsf(s.odds, shape, scale=scale)
        lowest = np.minimum(lowest, stats.gamma.logsf(s.flips, shape, scale=scale))
    ordered = np.sort(lowest)
    for s, value in zip(scored, observed, strict=True):
        # Few groups of blocks give the observed signs again, but for rounding.
        value *= 1.0 - 1e-6
        s.p_block = float((1 + np.searchsorted(ordered, value, side="right")) / (len(ordered) + 1))


def separates(better: np.ndarray, worse: np.ndarray, least: float) -> bool:
    """Whether held-out losses by block tell two candidates apart: by `least` at least, outside the noise."""
    difference = worse - better
    difference = difference[np.isfinite(difference)]
    error = np.sqrt(len(difference) * max(difference.var(ddof=1), 1e-300))
    return bool(difference.sum() > max(2.0 * error, least))
