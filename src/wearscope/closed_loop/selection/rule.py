"""The rule that accepts, ties and names: pure functions of frozen evidence. Its numbers are `Policy`'s."""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy import stats

from wearscope.closed_loop.selection.evidence import Evidence, Refusal
from wearscope.closed_loop.selection.policy import Policy

#: Sine of the angle to the model below which a term is absorbed.
_ABSORBED = 1e-3
#: Fewest blocks, effectively, that the evidence from a single run may lie in.
_FEWEST_BLOCKS = 4.0
#: Largest RMS of one column of a term over that of their sum, and of their sum over that of the joint's
#: torque: beyond, columns cancel each other, or other terms.
_CANCELS = 12.0
#: `Policy.beyond_chance` where two runs or parts inform.
_BEYOND_DOUBT = 0.9
#: Share of the held-out loss from which a standard term is kept where only this share of the runs agree.
_LARGE, _MOSTLY = 0.1, 2.0 / 3.0
#: Standard errors by which a gear's plain friction, which every joint has, must gain there.
_EXPECTED = 1.0
#: How much more than a name the generic term must add to the torque.
_GENERIC_TORQUE = 2.5
#: Share of its joint's held-out loss above which a generic term gains by other joints, whose model runs away
#: where a run is held out.
_ALL = 1.05
#: How much more of that a name must remove where a single run was recorded, whose parts have its motion in
#: common.
_ALONE = 2.5
#: Share of the material torque that a term must add to what the model's other terms could give.
_OWN = 1.0 / 3.0
#: Share of a joint's largest speed above which it is away from its reversals, and of its rows that must be;
#: factor within which a delay must be the same there: else it is the form of a reversal, or of a loop.
_FAST, _ALIKE = 0.2, 1.6
#: Loss of the rows that are fitted that one of several terms leaves, over what the best of them leaves, from
#: which it is not as good, whatever held-out runs say.
_FAR_MORE = 4.0
#: Share of what a term gains at all its joints that another one must gain at the same ones to stand in its
#: place.
_THERE = 0.5
#: Share of the loss that the better one leaves from which a difference of held-out losses is material.
_MATERIAL = 0.02


def judge(
    e: Evidence, policy: Policy, bounds: Sequence[tuple[float, float]], least: float, by_run: bool,
    generic: bool = False,
) -> Refusal:  # fmt: skip
    """Whether a term may be taken, or why not.

    Parameters
    ----------
    e : Evidence
        With its family-wise p-value; one that a single recording shows is judged as of a single run.
    policy : Policy
    bounds : sequence of (float, float)
        Believable bounds of its coefficients, then of its shape parameters.
    least : float
        Smallest believable size of its first coefficient.
    by_run : bool
        Whether whole runs are held out.
    generic : bool
        Whether it is the generic term, which asks for more.
    """
    standard = e.term.effect.standard
    by_run = by_run and not e.alone
    share = policy.unknown_share if generic else policy.standard_share if standard else policy.material_share
    level = policy.unknown_level if generic else policy.family_level
    if e.refusal is not Refusal.NONE:
        return e.refusal
    # Asked so that what is NaN is refused.
    if not e.sine >= _ABSORBED:
        return Refusal.ABSORBED
    alone = 1.0 if by_run else _ALONE
    whole = policy.unknown_share if generic else 0.0 if standard else policy.material_whole * alone
    torque = policy.material_torque * (_GENERIC_TORQUE if generic else 1.0)
    own = e.torque >= torque and e.torque * e.sine >= _OWN * torque
    if not (e.share >= share and own and e.whole >= whole):
        return Refusal.IMMATERIAL
    if e.informing < 2 or (not by_run and e.blocks < _FEWEST_BLOCKS):
        return Refusal.LOCAL
    # Its columns each other, or what it gives the torque of other terms.
    if not generic and e.chosen.candidate.penalty is None and not max(e.cancellation, e.torque) <= _CANCELS:
        return Refusal.CANCELS
    believed = all(low <= b <= high for b, (low, high) in zip((*e.beta, *e.term.shape), bounds, strict=True))
    if not believed or e.overturns:
        return Refusal.BOUNDS
    if not abs(float(e.beta[0])) >= least:
        return Refusal.SMALL
    if not e.p_value <= level and not is_beyond_chance(e, policy, by_run):
        return Refusal.CHANCE
    # Parts of one run resemble each other more than runs do: all must agree.
    if not e.agreement >= (policy.agreeing if by_run else 1.0) or (generic and e.share > _ALL):
        return Refusal.DISAGREES
    return Refusal.ALONE if generic and not by_run else Refusal.NONE


def is_beyond_chance(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether every one of the informing runs is predicted far better when held out, of two nearly all.

    The same on the rows that are fitted: where only the held-out ones gain, the model runs away there.
    """
    least = policy.beyond_chance if by_run and not e.alone else policy.beyond_chance_few
    least = least if e.informing >= 3 else _BEYOND_DOUBT
    return min(e.share, e.fitted) >= least and e.agreement == 1.0 and e.informing >= 2


def is_needed(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether a standard term of a joint is kept: held-out runs gain by it, materially and outside noise.

    Where most of the loss is gained in all of them there is no noise to ask about: what differs then is how
    far each part runs away without the term.
    """
    plain = e.term.effect.is_plain_friction
    gain, error = summed(-e.change)
    agrees = e.agreement >= (policy.agreeing if by_run else 1.0)
    beyond = min(e.share, e.fitted) >= policy.beyond_chance and e.agreement == 1.0
    sure = gain > (policy.told_apart if plain else policy.unexpected) * error or beyond
    large = is_large(e) and e.agreement >= _MOSTLY
    likely = large and gain > (_EXPECTED if plain else policy.unexpected) * error
    return (
        e.sine >= _ABSORBED
        and e.share >= policy.standard_share
        and e.torque >= policy.material_torque
        and ((agrees and sure) or likely)
    )


def is_large(e: Evidence) -> bool:
    """Whether a standard term explains much, of the rows that are fitted and of those that are not."""
    return min(e.share, e.fitted) >= _LARGE


def is_plain(e: Evidence) -> bool:
    """Whether a term is plain friction, which every joint has, and explains much."""
    return e.term.effect.is_plain_friction and is_large(e)


def find_fast(speed: np.ndarray, kept: np.ndarray) -> np.ndarray | None:
    """Rows (M,) of bool in which a joint is away from its reversals; None where too few of those kept are.

    Parameters
    ----------
    speed : ndarray (M,)
    kept : ndarray (M,) of bool
    """
    fast: np.ndarray = np.abs(speed) > _FAST * np.abs(speed).max()
    return fast if np.mean(fast[kept]) >= _FAST else None


def is_alike(e: Evidence, other: Evidence) -> bool:
    """Whether a delay is the same away from reversals, within a factor.

    Reversals may hide more of one that is there than it may lose away from them: its square.
    """
    ratio = float(other.beta[0]) / float(e.beta[0])
    return 1.0 / _ALIKE <= ratio <= _ALIKE**2


def summed(values: np.ndarray) -> tuple[float, float]:
    """Sum over blocks and its standard error; blocks that no fold holds out do not count."""
    held = values[np.isfinite(values)]
    return float(held.sum()), float(np.sqrt(len(held) * max(float(held.var(ddof=1)), 1e-300)))


def separates(better: Evidence, worse: Evidence, policy: Policy) -> bool:
    """Whether held-out losses tell two terms apart: materially, and outside their noise."""
    difference, error = summed(worse.change - better.change)
    critical = find_critical(policy.told_apart, min(better.blocks, worse.blocks))
    return difference > max(critical * error, _MATERIAL * better.left)


def find_critical(errors: float, blocks: float) -> float:
    """Standard errors from which a sum is told from noise, where so many blocks inform on it effectively.

    As far out in Student's t with as many degrees of freedom, less one, as `errors` are in normal noise.
    """
    return float(stats.t.ppf(stats.norm.cdf(errors), max(blocks - 1.0, 1.0)))


def touches(a: Evidence, b: Evidence) -> bool:
    """Whether two terms are felt at a common joint."""
    return bool(set(a.chosen.candidate.joints) & set(b.chosen.candidate.joints))


def gains_there(e: Evidence, own: Evidence) -> bool:
    """Whether a term may stand in the place of another: it gains where that one does.

    A term that is felt at several joints would else compete with what is wrong at each of them.
    """
    common = sum(min(e.gains.get(j, 0.0), gain) for j, gain in own.gains.items() if gain > 0.0)
    return common > _THERE * sum(gain for gain in own.gains.values() if gain > 0.0)


def simplest(tied: Iterable[Evidence], opposing: Sequence[Evidence] = ()) -> Evidence:
    """Least complex of tied terms; among equals what is built to oppose gravity where it does, then gain.

    Parameters
    ----------
    tied : iterable of Evidence
    opposing : sequence of Evidence
        Those that take gravity's load off their joint.
    """

    def fits_purpose(e: Evidence) -> int:
        if not e.term.effect.opposes_gravity:
            return 1
        return 0 if any(e is o for o in opposing) else 2

    return min(tied, key=lambda e: (e.complexity, fits_purpose(e), -e.gain))


def fit_alike(tied: Sequence[Evidence]) -> list[Evidence]:
    """Those of some terms that leave of the rows that are fitted not far more than the best of them.

    Where few runs go far, held-out ones may lie beyond the others and tell nothing apart.
    """
    least = min((1.0 - e.fitted for e in tied), default=0.0)
    return [e for e in tied if 1.0 - e.fitted <= _FAR_MORE * max(least, 1e-12)]


def choose(able: Sequence[Evidence], policy: Policy) -> Evidence | None:
    """The simplest of those terms that neither held-out runs nor the fit tell from the best one."""
    if not able:
        return None
    best = max(able, key=lambda e: e.gain)
    tied = [e for e in able if e is best or (touches(e, best) and not separates(best, e, policy))]
    return simplest(fit_alike(tied))
