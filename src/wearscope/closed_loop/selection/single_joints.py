"""What the whole robot has once, such as wrong masses, against names with fewer parameters in its place.

Many inertial parameters together follow what several drives do at once, and gain most where they are asked
first; nothing is then left by which the drives would be named. So what was named of the whole robot is left
out once, and other names are sought in its place: what of the whole robot it contains (of all links a
payload) and names of single joints, then these alone.
"""

import numpy as np

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.evidence import Found, count_parameters
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.stepwise import extend, settle


def prefer_single_joints(search: Search, found: list[Found]) -> list[Found]:
    """The terms found, or ones with fewer parameters, less of them of the whole robot, that predict as well.

    Parameters
    ----------
    search : Search
        Which goes on with those that are preferred, and does not ask in addition for what was left out.
    found : list of Found
    """
    if int(search.problem.prepared.moving.sum()) < 2:
        return found
    whole = frozenset(e.name for e in search.problem.effects if e.per_robot)
    containing = frozenset(e.name for e in search.problem.effects if e.per_robot and whole & {*e.contains})
    # Such a body changes no prediction: the links' inertials need it.
    if any(f.effect.per_robot and rule.relieves(f.evidence, search.policy) for f in found):
        return found
    for left_out in (containing, whole):
        if any(f.effect.name in left_out for f in found):
            found = _prefer_without(search, found, left_out)
    if search.left_out and not any(f.effect.per_robot for f in found):
        search.left_out = whole
    return found


def _prefer_without(search: Search, found: list[Found], left_out: frozenset[str]) -> list[Found]:
    tried = search.branch()
    tried.left_out = left_out
    most = count_parameters(found)
    fewer = extend(tried, [f for f in found if f.effect.name not in left_out], most)
    if count_parameters(fewer) < most:
        fewer = settle(tried, fewer)
    if count_parameters(fewer) >= most or not predicts_as_well(search, found, tried, fewer):
        return found
    search.progress(f"without {', '.join(sorted(left_out))}, fewer parameters predict as well")
    search.adopt(tried)
    return fewer


def predicts_as_well(search: Search, found: list[Found], tried: Search, fewer: list[Found]) -> bool:
    """Whether every joint is predicted alike, except for what would not matter of a name or is within noise.

    Held out: of the rows that are fitted many parameters always explain a little more than few.

    Parameters
    ----------
    search : Search
        In whose weights both are asked.
    found : list of Found
        The one model's terms.
    tried : Search
        Of the other model.
    fewer : list of Found
        Its terms.
    """
    policy, moving = search.policy, search.problem.prepared.moving
    tried.sigma = search.sigma
    now, then = search.assemble(found).joint_losses, tried.assemble(fewer).joint_losses
    for j in np.flatnonzero(moving):
        scale = float(search.sigma[j]) ** 2
        lost, error = rule.summed(scale * (then[:, j] - now[:, j]))
        matters = policy.material_whole * search.standard_losses[0, j]
        if lost > max(matters, policy.told_apart * error):
            return False
        if np.nansum(then[:, j]) > policy.alike**2 * np.nansum(now[:, j]):
            return False
    return True
