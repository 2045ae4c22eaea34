"""What the whole robot has once, such as wrong masses, against names of single joints in its place.

Many inertial parameters together follow what several drives do at once, and gain most where they are asked
first; nothing is then left by which the drives would be named. So what was named of the whole robot is left
out once, and names of single joints are sought in its place.
"""

from copy import copy
from typing import TYPE_CHECKING

import numpy as np

from wearscope.closed_loop.selection.found import Found

if TYPE_CHECKING:
    from wearscope.closed_loop.selection.search import Search


def prefer_single_joints(search: "Search", found: list[Found]) -> list[Found]:
    """The terms found, or ones of single joints alone with fewer parameters that predict every joint as well.

    Parameters
    ----------
    search : Search
        Which goes on with those that are preferred, and asks for nothing of the whole robot beside them.
    found : list of Found
    """
    several = int(search.problem.prepared.moving.sum()) > 1
    if not several or not any(f.effect.per_robot for f in found):
        return found
    tried = copy(search)
    tried.rows, tried.full, tried.no_delay = list(search.rows), set(search.full), set(search.no_delay)
    tried.asks_whole_robot = False
    most = count_parameters(found)
    single = tried.extend([f for f in found if not f.effect.per_robot], most)
    if count_parameters(single) < most:
        single = tried.settle(single)
    if count_parameters(single) >= most or not _predicts_as_well(search, found, tried, single):
        return found
    search.progress("names of single joints, fewer parameters, predict as well as one of the whole robot")
    search.adopt(tried)
    return single


def count_parameters(found: list[Found]) -> int:
    """Parameters of terms together."""
    return sum(f.evidence.complexity for f in found)


def _predicts_as_well(search: "Search", found: list[Found], tried: "Search", single: list[Found]) -> bool:
    """Whether every joint is predicted alike, but for what would not matter of a name.

    Held out: of the rows that are fitted many parameters always explain a little more than few.
    """
    policy, moving = search.policy, search.problem.prepared.moving
    tried.sigma = search.sigma
    now, then = (
        np.nansum(one.joint_losses, axis=0)[moving] * search.sigma[moving] ** 2
        for one in (search.assemble(found), tried.assemble(single))
    )
    matters = policy.material_whole * search.standard_losses[0, moving]
    return bool(np.all((then - now <= matters) & (then <= policy.alike**2 * now)))
