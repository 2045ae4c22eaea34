"""Evidence on a candidate given a model: what held-out runs gain, chance, agreement, determinacy. Frozen."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from wearscope.closed_loop.model.blocks import Folds
from wearscope.closed_loop.model.candidates import Candidate
from wearscope.closed_loop.model.terms import ModelTerm
from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen, find_reach
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.significance import (
    adjust,
    find_critical,
    flip_scores,
    make_flips,
    score_chance,
)
from wearscope.closed_loop.selection.sums import Sums
from wearscope.effects.base import Effect


class Refusal(Enum):
    """Why a candidate cannot be taken."""

    NONE = ""
    ABSORBED = "the model absorbs it on these runs"
    LOCAL = "all its evidence lies in a few blocks of the runs"
    CANCELS = "its parameters are not determined by these runs (terms cancel)"
    BOUNDS = "a parameter is outside its believable bounds"
    SMALL = "smaller than can be believed"
    CHANCE = "not significant once all candidates are counted"
    IMMATERIAL = "too little gained on held-out runs"
    DISAGREES = "held-out runs do not agree on it"
    DRIFTS = "not significant, as the residual drifts"
    NO_DELAY = "no delay: it differs away from reversals or at low frequencies"
    ALONE = "a single run, or two, cannot show that it carries over to other motions"
    FULL = "the joint has the most terms that are asked for"


@dataclass(frozen=True, eq=False)
class Evidence:
    """One candidate (a subset of its coefficients, its best shape) conditional on a model.

    Attributes
    ----------
    chosen : Chosen
        What would be added to the model.
    joint : int
        Joint at which it removes most.
    change : ndarray (B,)
        Held-out loss by block less the model's, in residual variances; NaN where no fold holds a block out.
    gain, share : float
        Reduction of the held-out loss, and the same over the model's at `joint`.
    fitted : float
        Share of the model's loss at `joint` that it removes on the rows that it is fitted on.
    whole : float
        Largest reduction of a joint's held-out loss over the loss that the standard model leaves there;
        infinite where that is not asked, since the term is no form of the large ones there.
    gains : dict of int to float
        Reduction of the held-out loss by joint where the term is felt.
    left : float
        Held-out loss that is left at the joints that the model couples to those where the term is felt.
    torque : float
        RMS of the term's torque over that of the torque at `joint`.
    varies : float
        RMS of the torque at `joint` about its mean in each run, over its RMS.
    statistic, chance : float, ndarray (F,)
        Normal score of the loss removed over the loss left, and the same under random signs.
    p_value : float
        Family-wise, over all candidates scored together.
    agreement : float
        Share of the informing runs (parts) that gain when held out.
    opposed : bool
        Whether one of them loses more than its blocks' noise.
    informing, recordings : int
        How many parts inform; how many recordings do, whether or not parts of them must agree.
    sine : float
        Of the angle between candidate and model.
    blocks : float
        Effective number of blocks that inform.
    cancellation : float
        Largest of its columns' RMS over the RMS of their sum.
    beta : ndarray (m,)
    tried : float
    by_fifths : bool
        Whether fifths of several recordings are held out: one alone shows it, or none can be predicted from
        the others.
    relief : float
        What the model's parameters with a prior, such as inertial ones, come nearer to it: difference of
        their squared distances [standard deviations a priori, squared].
    refusal : Refusal
        Of what can be said of it without comparing it with others.
    """

    chosen: Chosen
    joint: int
    change: np.ndarray
    gain: float
    share: float
    fitted: float
    gains: dict[int, float]
    left: float
    torque: float
    statistic: float
    chance: np.ndarray
    agreement: float
    opposed: bool
    informing: int
    recordings: int
    sine: float
    blocks: float
    cancellation: float
    beta: np.ndarray
    tried: float
    by_fifths: bool = False
    relief: float = 0.0
    varies: float = 1.0
    whole: float = np.inf
    p_value: float = np.nan
    refusal: Refusal = Refusal.NONE

    @property
    def term(self) -> ModelTerm:
        """Model term that it represents."""
        return self.chosen.candidate.term(0, self.chosen.subset)

    @property
    def complexity(self) -> int:
        """Coefficients, and shape parameters that were searched."""
        return self.chosen.candidate.effect.complexity(self.chosen.subset)


def weigh(
    assembly: Assembly, candidate: Candidate, subset: tuple[int, ...], policy: Policy,
    sums: Sums | None = None, by_fifths: bool = False,
) -> Evidence:  # fmt: skip
    """Evidence on one subset of a candidate's coefficients, p-value and refusal left open.

    Parameters
    ----------
    assembly : Assembly
        The model.
    candidate : Candidate
    subset : tuple of int
    policy : Policy
    sums : Sums, optional
        Of all the candidate's columns, where they are there.
    by_fifths : bool
        Whether fifths of several recordings are held out.
    """
    assembly = assembly.by_fifths if by_fifths else assembly
    layout = assembly.layout
    sums = (sums or assembly.sum_products(candidate)).select(subset)
    added = assembly.add(sums)
    best = int(np.argmax(added.gain))
    beta, inner = added.beta[best], added.inner[best]
    chosen = Chosen(candidate.at(best), subset)
    own = sums.gram[:, best].sum(axis=0)
    information = assembly.inform(sums.at(best), beta)
    if not by_fifths and shows_alone(candidate, information, layout.folds, policy):
        return weigh(assembly, candidate, subset, policy, by_fifths=True)
    by_joint = assembly.hold_out(sums)
    change = by_joint.sum(axis=1)
    fit_change = assembly.fit_change(sums.at(best), beta)
    felt = _losses_where_felt(assembly, candidate, by_joint, fit_change, policy)
    joint = max(felt, key=lambda j: felt[j].gain / max(felt[j].loss, 1e-300))
    reach = list(find_reach(assembly.chosen, candidate))
    left = float(assembly.joint_losses[np.isfinite(change)][:, reach].sum())
    sample = float(assembly.sample_losses[joint if len(felt) == 1 else list(felt)].sum())
    flips = make_flips(policy.flips, len(layout.blocks), policy.seed)
    observed, flipped = flip_scores(assembly.block_scores(sums), added.inner, flips)
    chance = _odds(flipped, sample)
    parts = layout.folds.parts
    by_part = np.bincount(parts, information)
    gain_by_part, error_by_part = sum_by_part(-change, parts, policy)
    informs = by_part > policy.informing * max(by_part.sum(), 1e-300)
    whole = float(np.sqrt(max(beta @ own @ beta, 1e-300)))
    rows = chosen.rows[candidate.joints.index(joint)] @ beta
    keep = layout.keep[:, joint]
    size, change_of_it = layout.torque_size[:, joint]
    return Evidence(
        chosen=chosen,
        joint=joint,
        change=change,
        gain=float(-np.nansum(change)),
        share=felt[joint].gain / max(felt[joint].loss, 1e-300),
        fitted=felt[joint].fitted,
        gains={j: own.gain for j, own in felt.items()},
        left=left + float(np.nansum(change)),
        torque=float(np.sqrt(np.mean(rows[keep] ** 2))) / size,
        varies=change_of_it / size,
        statistic=float(score_chance(_odds(np.asarray(observed), sample), chance)),
        chance=score_chance(chance, chance),
        agreement=float(np.mean(gain_by_part[informs] > 0.0)) if informs.any() else 0.0,
        opposed=bool((gain_by_part < -error_by_part)[informs].any()),
        informing=int(informs.sum()),
        recordings=count_informing(information, layout.folds.recording, policy),
        sine=float(np.sqrt(max(beta @ inner @ beta, 0.0))) / whole,
        blocks=float(information.sum() ** 2 / max((information**2).sum(), 1e-300)),
        cancellation=float((np.sqrt(np.maximum(np.diag(own), 0.0)) * np.abs(beta)).max() / whole),
        beta=beta,
        tried=candidate.tried,
        by_fifths=by_fifths,
        relief=assembly.relieve_prior(sums.at(best), beta),
    )


def on_same_folds(
    assembly: Assembly, weighed: Sequence[Evidence], policy: Policy
) -> tuple[Assembly, list[Evidence]]:
    """Evidence with the same held out of all terms, and the model so folded, for terms that are compared.

    Where fifths are held out of some, then of all: what a whole recording loses, predicted by others, is no
    measure for what a part of it does.

    Parameters
    ----------
    assembly : Assembly
        The model, conditional on which they were weighed.
    weighed : sequence of Evidence
    policy : Policy
    """
    if len({e.by_fifths for e in weighed}) < 2:
        return assembly, list(weighed)
    folded = assembly.by_fifths
    return folded, [
        e
        if e.by_fifths
        else replace(
            weigh(folded, e.chosen.candidate, e.chosen.subset, policy),
            p_value=e.p_value, tried=e.tried, whole=e.whole, refusal=e.refusal,
        )
        for e in weighed
    ]  # fmt: skip


def sum_by_part(values: np.ndarray, parts: np.ndarray, policy: Policy) -> tuple[np.ndarray, np.ndarray]:
    """Sums of blocks' values (B,) by part, and how far noise of so few blocks takes them from nothing.

    Parameters
    ----------
    values : ndarray (B,)
        NaN where a block does not count.
    parts : ndarray (B,) of int
    policy : Policy
        Whose `told_apart` standard errors are meant, as far out in Student's t.
    """
    held = np.isfinite(values)
    which, own = parts[held], values[held]
    size = parts.max() + 1
    count = np.bincount(which, minlength=size)
    total = np.bincount(which, own, size)
    free = np.maximum(count - 1.0, 1.0)
    spread = np.maximum(np.bincount(which, own**2, size) - total**2 / np.maximum(count, 1), 0.0) / free
    return total, find_critical(policy.told_apart, count) * np.sqrt(count * spread)


def shows_alone(candidate: Candidate, information: np.ndarray, folds: Folds, policy: Policy) -> bool:
    """Whether only one of several recordings informs (B,) on a candidate.

    Fitted on the others it would be anything, so that nothing can be learnt from holding that one out. Not of
    what goes with temperature or time, of which another recording has another level.
    """
    if any(name == "t" or name.startswith("temp") for name in candidate.effect.depends_on):
        return False
    several = len(np.unique(folds.recording)) > 1
    return several and count_informing(information, folds.recording, policy) == 1


def count_informing(information: np.ndarray, part: np.ndarray, policy: Policy) -> int:
    """Parts that hold a share of the information (B,) on a term, `part` (B,) being that of each block."""
    by_part = np.bincount(part, information)
    return int((by_part > policy.informing * by_part.sum()).sum())


def _odds(gain: np.ndarray, loss: float) -> np.ndarray:
    """Loss removed over loss left."""
    return np.asarray(gain) / np.maximum(loss - np.asarray(gain), 1e-9 * max(loss, 1e-300))


@dataclass(frozen=True)
class _Felt:
    """At one joint: reduction of the held-out loss, that loss, share removed of the loss of fitted rows."""

    gain: float
    loss: float
    fitted: float


def _losses_where_felt(
    assembly: Assembly, candidate: Candidate, change: np.ndarray, fit_change: np.ndarray, policy: Policy
) -> dict[int, _Felt]:
    """Losses of the model at each joint where a candidate is felt.

    What is felt at one joint gains at all that the model couples to it. Where it removes much of the fitted
    loss, the share at the joint itself is told.

    Parameters
    ----------
    assembly : Assembly
        The model.
    candidate : Candidate
    change : ndarray (B, n)
        Of the held-out loss by the candidate.
    fit_change : ndarray (n,)
        The same on the rows that are fitted.
    policy : Policy
    """
    gains, losses = -np.nansum(change, axis=0), np.nansum(assembly.joint_losses, axis=0)
    shares = -fit_change / np.maximum(assembly.sample_losses, 1e-300)
    if len(candidate.joints) == 1:
        (j,) = candidate.joints
        fitted = -float(fit_change.sum()) / max(float(assembly.sample_losses[j]), 1e-300)
        fitted = float(shares[j]) if fitted >= policy.beyond_chance else fitted
        return {j: _Felt(float(gains.sum()), float(losses[j]), fitted)}
    return {j: _Felt(float(gains[j]), float(losses[j]), float(shares[j])) for j in candidate.joints}


def adjust_p_values(weighed: list[Evidence]) -> list[Evidence]:
    """The same evidence with p-values over all of it."""
    p_values = adjust([e.statistic for e in weighed], [e.chance for e in weighed], [e.tried for e in weighed])
    return [replace(e, p_value=float(p)) for e, p in zip(weighed, p_values, strict=True)]


@dataclass(frozen=True, eq=False)
class Found:
    """A term that was named, with the evidence on it conditional on all others."""

    chosen: Chosen
    evidence: Evidence

    @property
    def effect(self) -> Effect:
        """Its effect."""
        return self.chosen.candidate.effect

    @property
    def joint(self) -> int:
        """Its joint."""
        return self.chosen.candidate.joint


def count_parameters(found: Iterable[Found]) -> int:
    """Parameters of terms together."""
    return sum(f.evidence.complexity for f in found)
