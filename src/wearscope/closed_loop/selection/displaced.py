"""What a term changes of a model's own parameters: how near they are to their prior."""

import numpy as np

from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.sums import Sums


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
