"""What a term changes of a model's own parameters: friction made negative, or parameters near their prior."""

import numpy as np

from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.chosen import Chosen
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.sums import Sums


def overturns_friction(
    assembly: Assembly, chosen: Chosen, sums: Sums, beta: np.ndarray, inner: np.ndarray, fitted: float,
    policy: Policy,
) -> bool:  # fmt: skip
    """Whether plain friction that a model has at a term's joints would be negative beside the term.

    Outside its standard errors, and by `large_share` of what it is without: a term that takes the place of
    friction that a joint must have, in a form that fits another one. What is negative already is not its
    doing.

    Parameters
    ----------
    assembly : Assembly
        The model.
    chosen : Chosen
        The term.
    sums : Sums
        Of its columns, one shape.
    beta : ndarray (m,)
    inner : ndarray (m, m)
        Information on it beside the model.
    fitted : float
        Share of the loss that it removes.
    policy : Policy
    """
    inverse, theta = assembly.whole
    onto = project_columns(assembly, sums)
    for term, span in zip(assembly.chosen, assembly.spans, strict=True):
        other = term.candidate
        if not other.effect.is_plain_friction or other.joint not in chosen.candidate.joints:
            continue
        k = span.start
        beside = theta[k] - onto[k] @ beta
        variance = inverse[k, k] + onto[k] @ np.linalg.solve(inner, onto[k])
        error = np.sqrt(max(variance * (1.0 - fitted), 0.0))
        if theta[k] > 0.0 and beside < -max(policy.unexpected * error, policy.large_share * theta[k]):
            return True
    return False


def project_columns(assembly: Assembly, sums: Sums) -> np.ndarray:
    """By how much a model's parameters fall for each unit of a term's coefficients, (P, m)."""
    inverse, _ = assembly.whole
    return inverse[:, sums.columns] @ sums.cross[:, 0].sum(axis=0).T


def relieve_prior(assembly: Assembly, sums: Sums, beta: np.ndarray) -> float:
    """What a model's parameters come nearer to where they are expected, beside a term.

    Parameters
    ----------
    assembly : Assembly
        The model.
    sums : Sums
        Of the term's columns, one shape.
    beta : ndarray (m,)
        Its coefficients.

    Returns
    -------
    float
        Difference of the squared distances, in standard deviations a priori.
    """
    _, theta = assembly.whole
    beside = theta - project_columns(assembly, sums) @ beta
    return float(theta @ assembly.prior @ theta - beside @ assembly.prior @ beside)
