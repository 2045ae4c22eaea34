"""Estimates of changes in one session, given all that is not known of the healthy machine.

The torque that a session leaves of the reference's prediction is y = Z d + C b + e: the change d sought,
the error b of the reference's parameters with its covariance, and autocorrelated noise e. The estimate of d
is that of generalised least squares with b as a random effect (Henderson 1975); its covariance has a part
from b and a part from e, the second by the sandwich with blocks of rows as clusters (Liang and Zeger 1986).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wearscope.tracking.changes import Change

#: Share of a column's information below which it cannot be told from the reference's own uncertainty.
_ABSORBED = 1e-9
#: Blocks that the reference's noise is worth in a session's own.
_BLOCKS = 20.0


@dataclass(frozen=True, eq=False)
class Belief:
    """What the reference's runs say of the structure's columns.

    Attributes
    ----------
    mean : ndarray (P,)
    covariance : ndarray (P, P)
    """

    mean: np.ndarray
    covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class Estimate:
    """A change in one session.

    Attributes
    ----------
    change : Change
    value : ndarray (m,)
    noise : ndarray (m, m)
        Covariance from the session's own noise and the error of the reference's parameters.
    shares : ndarray (m, m)
        Mean square torque of the change, as a share of the scale, as a quadratic form of its value.
    prior : ndarray (m, m)
        Precision of the value known beforehand; zero but of a body's parameters.
    gain : float
        Reduction of the weighted sum of squares.
    torque : float
        RMS torque of the change at the joint where it is largest, as a share of the scale.
    """

    change: Change
    value: np.ndarray
    noise: np.ndarray
    shares: np.ndarray
    prior: np.ndarray
    gain: float
    torque: float


@dataclass(frozen=True, eq=False)
class Sample:
    """Weighted rows of one session with the columns of all changes, nuisances projected out.

    Attributes
    ----------
    changes : tuple of Change
    parts : dict of str to ndarray of int
        Columns of each change, by its key.
    moments, inner, scores : ndarray
        Gram matrix of the changes' columns as a share of their torque's scale (K, K), and without the
        nuisances (K, K); the product of the second with the target (K,).
    random : ndarray (K, K)
        Part of the scores' covariance that the reference's uncertainty makes.
    clean : ndarray (R, K)
        Columns without the nuisances.
    left : ndarray (R,)
        Target without the nuisances.
    starts : ndarray (B,)
        First row of each block.
    penalty : ndarray (K, K)
    plain : ndarray (K,)
        Diagonal of the columns' own Gram matrix.
    """

    changes: tuple[Change, ...]
    parts: dict[str, np.ndarray]
    moments: np.ndarray
    inner: np.ndarray
    scores: np.ndarray
    random: np.ndarray
    clean: np.ndarray
    left: np.ndarray
    starts: np.ndarray
    penalty: np.ndarray
    plain: np.ndarray


@dataclass(frozen=True, eq=False)
class SessionRows:
    """Weighted rows of one session, (R,) or (R, k), all joints and runs one below the other.

    Attributes
    ----------
    target : ndarray (R,)
    base : ndarray (R, P)
    unrecorded : ndarray (R, u)
    columns : ndarray (R, K)
        Of all changes.
    shares : ndarray (R, K)
        The same as a share of their joint's torque scale.
    starts : ndarray (B,)
    """

    target: np.ndarray
    base: np.ndarray
    unrecorded: np.ndarray
    columns: np.ndarray
    shares: np.ndarray
    starts: np.ndarray


def make_sample(
    rows: SessionRows, changes: Sequence[Change], belief: Belief, payload_prior: np.ndarray,
    temperature_known: np.ndarray | None = None,
) -> Sample:  # fmt: skip
    """Project the reference's uncertainty out of a session's rows.

    Parameters
    ----------
    rows : SessionRows
    changes : sequence of Change
    belief : Belief
    payload_prior : ndarray (10,)
        Prior precision of a payload's parameters.
    temperature_known : ndarray (P,) of bool, optional
        Columns whose weights are taken as known, and no temperature as unrecorded: to ask what would be said
        if the dependence on temperature were known exactly.
    """
    u = rows.unrecorded.shape[1]
    if temperature_known is None:
        nuisance = np.concatenate([rows.base, rows.unrecorded], axis=1)
        covariance = np.zeros((nuisance.shape[1],) * 2)
        covariance[: len(belief.mean), : len(belief.mean)] = belief.covariance
        covariance[len(belief.mean) :, len(belief.mean) :] = np.eye(u)
    else:
        nuisance = rows.base
        covariance = condition(belief.covariance, temperature_known)
    target = rows.target - rows.base @ belief.mean
    z = rows.columns
    gram = nuisance.T @ nuisance
    # (G + V^-1)^-1 without the inverse of a covariance that may be singular.
    shrink = np.linalg.inv(np.eye(len(gram)) + covariance @ gram)
    inverse = shrink @ covariance
    cross = nuisance.T @ z
    onto = inverse @ cross
    parts, penalty, at = {}, np.zeros(z.shape[1]), 0
    for change in changes:
        parts[change.key] = np.arange(at, at + change.count)
        if change.spread:
            penalty[at : at + change.count] = payload_prior
        at += change.count
    plain = (z**2).sum(axis=0)
    inner = z.T @ z - cross.T @ onto
    return Sample(
        tuple(changes),
        parts,
        rows.shares.T @ rows.shares,
        inner + np.diag(penalty),
        z.T @ target - onto.T @ (nuisance.T @ target),
        cross.T @ shrink @ covariance @ shrink.T @ cross,
        z - nuisance @ onto,
        target - nuisance @ (inverse @ (nuisance.T @ target)),
        rows.starts,
        np.diag(penalty),
        plain,
    )


def condition(covariance: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Covariance (P, P) of normal variables given those that are `known` (P,) of bool; theirs is zero."""
    left = covariance.copy()
    cross = covariance[np.ix_(~known, known)]
    given = np.linalg.pinv(covariance[np.ix_(known, known)], rcond=1e-10, hermitian=True)
    left[np.ix_(~known, ~known)] -= cross @ given @ cross.T
    left[known] = 0.0
    left[:, known] = 0.0
    return left


def estimate_change(sample: Sample, change: Change, given: Sequence[Change] = ()) -> Estimate | None:
    """Estimate of a change given others; None where the session does not excite it.

    Parameters
    ----------
    sample : Sample
    change : Change
    given : sequence of Change
        Fitted too.
    """
    groups = [sample.parts[c.key] for c in (change, *given)]
    at = np.concatenate(groups)
    inner, plain = sample.inner[np.ix_(at, at)], sample.plain[at]
    diagonal = np.diag(inner)
    free = np.diag(sample.penalty)[at] == 0.0
    if not np.any(plain > 0.0) or np.any(free & (diagonal <= _ABSORBED * plain)):
        return None
    scale = np.sqrt(diagonal)
    inverse = np.linalg.pinv(inner / np.outer(scale, scale), rcond=1e-10, hermitian=True)
    inverse /= np.outer(scale, scale)
    value = inverse @ sample.scores[at]
    left = sample.left - sample.clean[:, at] @ value
    scores = np.add.reduceat(sample.clean[:, at] * left[:, None], sample.starts, axis=0)
    informing = max(int(np.count_nonzero(np.abs(scores).sum(axis=1))), 2)
    meat = scores.T @ scores * informing / max(informing - len(at), 1)
    # Few blocks say little of a variance: the reference's noise, to whose scale the rows are, counts as some.
    usual = sample.clean[:, at].T @ sample.clean[:, at]
    meat = (informing * meat + _BLOCKS * usual) / (informing + _BLOCKS)
    noise = inverse @ (meat + sample.random[np.ix_(at, at)] + sample.penalty[np.ix_(at, at)]) @ inverse
    m = change.count
    own = groups[0]
    part = inverse[:m, :m]
    gain = float(value[:m] @ np.linalg.pinv(part, hermitian=True) @ value[:m])
    shares = sample.moments[np.ix_(own, own)]
    torque = float(np.sqrt(max(value[:m] @ shares @ value[:m], 0.0)))
    prior = sample.penalty[np.ix_(own, own)]
    return Estimate(change, value[:m], noise[:m, :m], shares, prior, gain, torque)
