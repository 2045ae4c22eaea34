"""How large an effect may be and get no name: hidden by noise, or taken up by the model's own parameters."""

from collections.abc import Sequence

import numpy as np

from wearscope.closed_loop.selection.evidence import Found
from wearscope.closed_loop.selection.offers import list_subsets
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.base import MeasurementEffect

#: Share of a joint's torque (RMS) from which a limit is told in words.
LARGE = 0.05
#: Square of a column that is zero, as of a joint that rests: above rounding of zero, below all that is there.
_NOTHING = 1e-200


def find_limits(search: Search, found: Sequence[Found]) -> list[dict[str, float]]:
    """By joint, the size below which an effect gets no name there.

    A name must remove a share of the loss. An effect adds its power in residual variances to the loss, times
    the squared sine of its angle to the model's columns. Friction and refitted masses take up the rest.

    Parameters
    ----------
    search : Search
    found : sequence of Found
        All that was named.

    Returns
    -------
    list of dict of str to float
        By effect its RMS torque over that of the joint: of its shapes and variants the median, of directions
        within one the mean.
    """
    problem, policy = search.problem, search.policy
    layout = problem.layout
    assembly = search.assemble(found)
    scale = assembly.sigma / layout.torque_size[0]
    limits: list[dict[str, float]] = [{} for _ in scale]
    for candidate in search.candidates(assembly, found, range(len(scale)), every=True):
        effect, j = candidate.effect, candidate.joint
        if effect.spread or effect.is_in_every_drive or isinstance(effect, MeasurementEffect):
            continue
        whole = search.standard_losses[0, j] / assembly.sigma[j] ** 2
        least = max(policy.material_share * assembly.sample_losses[j], policy.material_whole * whole)
        every = assembly.sum_products(candidate)
        squares = []
        for subset in list_subsets(effect, by_run=False):
            own = every.select(subset)
            gram = own.gram.sum(axis=0)
            gram += (1e-9 * np.einsum("smm->sm", gram) + _NOTHING)[..., None] * np.eye(len(subset))
            left = np.linalg.solve(gram, assembly.add(own).inner)
            squares += (np.trace(left, axis1=1, axis2=2) / len(subset)).tolist()
        power = max(float(np.median(squares)), 1e-12) * max(int(layout.keep[:, j].sum()), 1)
        limits[j][effect.name] = float(scale[j] * np.sqrt(least / power))
    return limits


def say_limit(share: float) -> str:
    """A share in words."""
    return f"{100 * share:.0f} %" if share < 1.0 else "all"


def tell_limits(limits: Sequence[dict[str, float]], joints: Sequence[str]) -> list[str]:
    """A sentence on joints at which a large effect gets no name; none where there is no such joint."""
    where = [
        joint for joint, own in zip(joints, limits, strict=True) if max(own.values(), default=0.0) > LARGE
    ]
    if not where:
        return []
    return [
        f"{', '.join(where)}: on these runs friction, refitted masses and noise can hide effects of more "
        f"than {say_limit(LARGE)} of the torque (RMS). detection_limit_percent in verdict.json lists them."
    ]
