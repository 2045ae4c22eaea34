"""How large an effect may be and get no name: hidden by noise, or taken up by the model's own parameters."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy import stats

from wearscope.closed_loop.selection.assembly import Assembly
from wearscope.closed_loop.selection.evidence import Evidence, Found
from wearscope.closed_loop.selection.offers import list_subsets
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.closed_loop.selection.significance import find_ratio
from wearscope.closed_loop.selection.sums import Sums
from wearscope.effects.base import MeasurementEffect

#: Share of a joint's torque (RMS) from which a limit is told in words.
LARGE = 0.05
#: Square of a column that is zero, as of a joint that rests: above rounding of zero, below all that is there.
_NOTHING = 1e-200


def find_limits(search: Search, found: Sequence[Found]) -> list[dict[str, float]]:
    """By joint, the size below which an effect gets no name there.

    A name must be a share of the torque, remove a share of the loss, and be significant or remove most of the
    loss. An effect adds its power in residual variances to the loss, times the squared sine of its angle to
    the model's columns. Friction and refitted masses take up the rest.

    Parameters
    ----------
    search : Search
    found : sequence of Found
        All that was named.

    Returns
    -------
    list of dict of str to float
        By effect its RMS torque over that of the joint: of its shapes and variants the median, of directions
        within one the mean. Infinite where no size gets a name, as its evidence is one event.
    """
    problem, policy = search.problem, search.policy
    assembly = search.assemble(found)
    size, varies = problem.layout.torque_size
    least = policy.material_torque * varies / assembly.sigma
    limits: list[dict[str, float]] = [{} for _ in size]
    offered = search.candidates(assembly, found, range(len(size)), every=True)
    asked = [(c, list_subsets(c.effect, by_run=False)) for c in offered]
    beyond = float(stats.norm.isf(policy.family_level / max(sum(len(subsets) for _, subsets in asked), 1)))
    for candidate, subsets in asked:
        effect, j = candidate.effect, candidate.joint
        if effect.spread or effect.is_in_every_drive or isinstance(effect, MeasurementEffect):
            continue
        whole = search.standard_losses[0, j] / assembly.sigma[j] ** 2
        material = max(policy.material_share * assembly.sample_losses[j], policy.material_whole * whole)
        every = assembly.sum_products(candidate)
        own = [
            _find_sizes(assembly, every.select(subset), j, material, least[j], beyond, policy)
            for subset in subsets
        ]
        limits[j][effect.name] = float(assembly.sigma[j] / size[j] * np.median(np.concatenate(own)))
    return limits


def _find_sizes(
    assembly: Assembly, sums: Sums, joint: int, material: float, least: float, beyond: float, policy: Policy
) -> np.ndarray:
    """RMS torque in residual scales from which each shape (S,) of a candidate gets a name.

    Of its reduction of the loss, a block's random sign leaves the block's own share of it. Where few blocks
    inform, no size is significant; what removes most of the loss is then named all the same.

    Parameters
    ----------
    assembly : Assembly
    sums : Sums
    joint : int
    material : float
        Least reduction of the loss.
    least : float
        Least RMS torque that no other term could give, in residual scales.
    beyond : float
        Standard errors from which one candidate is significant.
    policy : Policy
    """
    layout, loss, m = assembly.layout, float(assembly.sample_losses[joint]), len(sums.penalty)
    gram = sums.gram.sum(axis=0)
    gram += (1e-9 * np.einsum("smm->sm", gram) + _NOTHING)[..., None] * np.eye(m)
    inner = assembly.add(sums).inner
    squares = np.trace(np.linalg.solve(gram, inner), axis1=1, axis2=2) / m
    scores = assembly.block_scores(sums)
    noise = np.einsum("bsm,smn,bsn->s", scores, np.linalg.inv(inner), scores)
    power = sum(assembly.weight[j] * layout.sum_blocks((x**2).sum(axis=-1)) for j, x in sums.rows.items())
    one = (power**2).sum(axis=0) / np.maximum(power.sum(axis=0) ** 2, 1e-300)
    ratio = find_ratio(beyond, m)
    with np.errstate(divide="ignore"):
        significant = np.where(ratio * one < 1.0, ratio * noise / np.maximum(1.0 - ratio * one, 0.0), np.inf)

    def count(parts: np.ndarray) -> np.ndarray:
        own = np.array([power[parts == part].sum(axis=0) for part in np.unique(parts)])
        return np.asarray((own > policy.informing * own.sum(axis=0)).sum(axis=0))

    folds = layout.folds
    alone = np.full(len(one), not folds.by_run) | (count(folds.recording) == 1)
    informing = np.where(alone, count(layout.by_fifths.folds.parts), count(folds.parts))
    few = alone & (one * policy.fewest_blocks > 1.0)
    most = np.where(alone | (informing < 3), policy.beyond_doubt, policy.beyond_chance)
    needed = np.minimum(np.where(few, np.inf, significant), most / (1.0 - most) * loss)
    needed[(informing < 2) | (few & (informing < 3))] = np.inf
    sine = np.sqrt(np.maximum(squares, 1e-12))
    rows = max(int(layout.keep[:, joint].sum()), 1)
    return np.asarray(np.maximum(np.sqrt(np.maximum(needed, material) / rows), least) / sine)


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


def tell_suspected(suspected: Mapping[int, Sequence[Evidence]]) -> dict[int, str]:
    """By joint, a sentence on names that explain much and are too uncertain to be given."""
    return {
        j: f"{' or '.join(dict.fromkeys(e.term.effect.name for e in able))} would remove "
        f"{100 * able[0].share:.0f} % of the squared error that is left; that is too uncertain for a name "
        f"(p = {able[0].p_value:.2g}), and longer or more training runs can decide it"
        for j, able in sorted(suspected.items())
    }
