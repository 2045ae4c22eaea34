"""A term of a model: one shape of a candidate, and some of its coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wearscope.closed_loop.model.candidates import Candidate


@dataclass(frozen=True, eq=False)
class Chosen:
    """One shape of a candidate, with a subset of its coefficients, in a model.

    Attributes
    ----------
    candidate : Candidate
        With one shape.
    subset : tuple of int
    """

    candidate: Candidate
    subset: tuple[int, ...]

    @property
    def rows(self) -> list[np.ndarray]:
        """Columns (M, m) by joint of the candidate's."""
        whole = self.subset == tuple(range(self.candidate.count))
        return [x if whole else x[:, list(self.subset)] for x in self.candidate.rows]


def find_reach(terms: Sequence[Chosen], candidate: Candidate) -> set[int]:
    """Joints that a model couples to those where a candidate is felt, these included."""
    reach = set(candidate.joints)
    grown = True
    while grown:
        more = {j for t in terms if reach & set(t.candidate.joints) for j in t.candidate.joints}
        grown = not more <= reach
        reach |= more
    return reach
