"""The rule that accepts, ties and names: pure functions of frozen evidence. Its numbers are `Policy`'s."""

from collections.abc import Iterable, Sequence

import numpy as np
from scipy import stats

from wearscope.closed_loop.selection.evidence import Evidence, Refusal
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.significance import find_critical
from wearscope.effects import unknown
from wearscope.effects.base import ArmatureEffect, PayloadEffect


def judge(
    e: Evidence, policy: Policy, bounds: Sequence[tuple[float, float]], least: float, by_run: bool,
    generic: bool = False, any_form: bool = False,
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
    any_form : bool
        Whether with its shape it may follow any function of its signals.
    """
    expected = e.term.effect.is_in_every_drive
    by_run = by_run and not e.by_fifths
    named = policy.material_whole if expected else policy.material_share
    share = policy.structure_share if generic else named
    share = max(share, policy.beyond_chance) if any_form else share
    whole = policy.large_share if generic else policy.material_whole if by_run else policy.material_alone
    level = policy.unknown_level if generic else policy.family_level
    if e.refusal is not Refusal.NONE:
        return e.refusal
    if relieves(e, policy):
        if not is_within(e, bounds):
            return Refusal.BOUNDS
        return Refusal.NONE if abs(float(e.beta[0])) >= least else Refusal.SMALL
    # Asked so that what is NaN is refused.
    if not (is_own(e, policy) or is_plain(e, policy)):
        return Refusal.ABSORBED
    if not (e.share >= share and (expected or e.whole >= whole)):
        return Refusal.IMMATERIAL
    if is_local(e, policy, by_run):
        return Refusal.LOCAL
    smooth = generic or e.chosen.candidate.penalty is not None
    if not smooth and cancels(e, policy):
        return Refusal.CANCELS
    if not is_within(e, bounds):
        return Refusal.BOUNDS
    if not abs(float(e.beta[0])) >= least:
        return Refusal.SMALL
    if not e.p_value <= level and not is_beyond_chance(e, policy, by_run):
        return Refusal.CHANCE
    # More than all of its joint's loss is gained at others, whose model diverges where a run is held out.
    if not agrees(e, policy, by_run) or (generic and e.share > 1.0):
        return Refusal.DISAGREES
    alone = may_coincide(e) or not by_run if generic else not by_run and is_driven_alone(e, policy)
    return Refusal.ALONE if alone else Refusal.NONE


def is_slow(e: Evidence) -> bool:
    """Whether a generic term depends on time or temperature, as any drift of a run seems to."""
    return any(code in unknown.SLOW for code, _ in unknown.list_signals(e.term.shape))


def may_coincide(e: Evidence) -> bool:
    """Whether structure in two runs at most goes with time, with temperature or with another joint.

    Of two oscillations that start when they like, one predicts a fifth of the other's variance, as much as
    is asked for, in 30 of 100 pairs, those within 53 degrees, and nothing of the next run's. So it is with
    what a joint does and the many signals of the other joints.
    """
    signals = unknown.list_signals(e.term.shape)
    own = not is_slow(e) and all(source == e.term.joint for _, source in signals)
    return not own and e.recordings < 3


def is_driven_alone(e: Evidence, policy: Policy) -> bool:
    """Whether a name for what another joint drives explains less of a single run than is beyond doubt.

    Joints that start and stop together move alike along one run, and as they like along the next.
    """
    return e.term.effect.name_driver is not None and not is_beyond_chance(e, policy, by_run=False)


def cancels(e: Evidence, policy: Policy) -> bool:
    """Whether a term's columns cancel each other, or what it gives the torque other terms of the model.

    What is more than all of the joint's torque, and nearly all of which others take back, is none.
    """
    taken_back = e.torque > 1.0 and e.sine * policy.cancels < 1.0
    # Asked so that what is NaN cancels.
    return taken_back or not max(e.cancellation, e.torque) <= policy.cancels


def is_within(e: Evidence, bounds: Sequence[tuple[float, float]]) -> bool:
    """Whether a term's coefficients and shape parameters are within what such machines have."""
    return all(low <= b <= high for b, (low, high) in zip((*e.beta, *e.term.shape), bounds, strict=True))


def relieves(e: Evidence, policy: Policy) -> bool:
    """Whether a body that refitted inertials of links can hold would make these unbelievable.

    No motion tells a drive's inertia from that of a robot's first link, nor a payload from the last link, so
    that the data alone gain nothing by it. What the links' inertials had to be without it, against what the
    robot's description says of them, does.
    """
    if not isinstance(e.term.effect, ArmatureEffect | PayloadEffect) or e.fitted >= policy.material_whole:
        return False
    believable = stats.chi2.isf(2.0 * stats.norm.sf(policy.unexpected), len(e.beta))
    return bool(e.relief > believable)


def agrees(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether most runs are predicted better, of parts of one run, which resemble each other more, all.

    Except for noise: a part that loses no more than its blocks' noise does not speak against a term. Nor does
    one run of three or four, or of plain friction, which every joint has, fewer than half; but it does where
    a torque that drifts resembles the term.
    """
    effect = e.term.effect
    one = (1.0 - e.agreement) * e.informing < 1.5 and not (effect.empirical or effect.drifts_alike)
    if by_run and (one or effect.is_plain_friction) and e.agreement > 0.5 and not e.opposed:
        return True
    return e.agreement >= policy.agreeing and (by_run or not e.opposed)


def is_own(e: Evidence, policy: Policy) -> bool:
    """Whether what a term gives the torque, and no other term of the model could, is material."""
    return e.torque * e.sine >= policy.material_torque * e.varies


def is_beyond_chance(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether every one of the informing runs is predicted far better when held out, of few nearly all.

    The same on the rows that are fitted: where only the held-out ones gain, the model diverges there. What
    goes with time or temperature, or changes with nothing, resembles a torque that drifts, of which a few
    runs are few parts.
    """
    several = by_run and not e.by_fifths and e.informing >= 3 and not e.term.effect.drifts_alike
    least = policy.beyond_chance if several else policy.beyond_doubt
    enough = e.informing >= 2 or wears_off(e, policy)
    return min(e.share, e.fitted) >= least and e.agreement == 1.0 and enough


def is_local(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether all evidence lies in one run (part), or a single run's in few blocks: one event, perhaps.

    What wears off in the first part its reversals repeat there.
    """
    return not wears_off(e, policy) and (e.informing < 2 or not (by_run or is_repeated(e, policy)))


def wears_off(e: Evidence, policy: Policy) -> bool:
    """Whether a term goes with time, as a warm-up that is soon over, and removes nearly all of the loss."""
    return "t" in e.term.effect.depends_on and min(e.share, e.fitted) >= policy.beyond_doubt


def is_repeated(e: Evidence, policy: Policy) -> bool:
    """Whether what a single run shows is no one event: in blocks enough, or sure in three parts."""
    sure = e.informing >= 3 and is_beyond_chance(e, policy, by_run=False)
    return sure or e.blocks >= policy.fewest_blocks


def explains_unbelievably(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether a name is refused for its parameters alone and explains what makes a joint `unexplained`."""
    much = min(e.share, e.fitted) >= policy.structure_share and e.p_value <= policy.unknown_level
    return e.refusal is Refusal.BOUNDS and much and agrees(e, policy, by_run)


def is_suspected(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether a name explains what would make a joint `unexplained`, and only its significance is too low."""
    much = min(e.share, e.fitted) >= policy.structure_share and e.p_value <= policy.zero_level
    return e.refusal is Refusal.CHANCE and much and agrees(e, policy, by_run)


def is_needed(e: Evidence, policy: Policy, by_run: bool) -> bool:
    """Whether a standard term of a joint is kept: held-out runs gain by it, materially and outside noise.

    What not every drive has must matter against the standard model's loss too, as a name must, or be what is
    left. Where most of the loss is gained in all of them there is no noise to ask about: what differs then is
    how far each part diverges without the term. Plain friction that explains much need only gain in most.
    """
    gain, error = summed(-e.change)
    errors = policy.told_apart if e.term.effect.is_plain_friction else policy.unexpected
    beyond = min(e.share, e.fitted) >= policy.beyond_chance and e.agreement == 1.0
    sure = agrees(e, policy, by_run) and (gain > errors * error or beyond)
    likely = is_plain(e, policy) and e.agreement > 0.5
    material = e.term.effect.is_in_every_drive or e.whole >= policy.material_whole
    matters = material or is_beyond_chance(e, policy, by_run)
    own = is_own(e, policy) or (is_plain(e, policy) and sure)
    gains = own and e.share >= policy.material_whole and matters and (sure or likely)
    return gains or relieves(e, policy)


def is_plain(e: Evidence, policy: Policy) -> bool:
    """Whether a term is plain friction, which every joint has, and explains much, held out and fitted."""
    return e.term.effect.is_plain_friction and min(e.share, e.fitted) >= policy.large_share


def find_fast(speed: np.ndarray, kept: np.ndarray, policy: Policy) -> np.ndarray | None:
    """Rows (M,) of bool in which a joint is away from its reversals; None where too few of those kept are.

    Parameters
    ----------
    speed : ndarray (M,)
    kept : ndarray (M,) of bool
    policy : Policy
    """
    fast: np.ndarray = np.abs(speed) > policy.away * np.abs(speed).max()
    return fast if np.mean(fast[kept]) >= policy.away else None


def is_alike(delay: float, other: float, policy: Policy) -> bool:
    """Whether a delay is the same in a part of the torque, within a factor.

    Reversals may hide more of one that is there than it may lose away from them: its square.
    """
    return 1.0 / policy.alike <= other / delay <= policy.alike**2


def summed(values: np.ndarray) -> tuple[float, float]:
    """Sum over blocks and its standard error; blocks that no fold holds out do not count."""
    held = values[np.isfinite(values)]
    return float(held.sum()), float(np.sqrt(len(held) * max(float(held.var(ddof=1)), 1e-300)))


def separates(better: Evidence, worse: Evidence, policy: Policy) -> bool:
    """Whether held-out losses tell two terms apart: materially, and outside their noise."""
    difference, error = summed(worse.change - better.change)
    critical = float(find_critical(policy.told_apart, min(better.blocks, worse.blocks)))
    return difference > max(critical * error, policy.material_apart * better.left)


def separates_names(better: Evidence, worse: Evidence, policy: Policy) -> bool:
    """Whether two terms are told apart, and a simpler one by more than a machine may differ from its form.

    No machine follows the form of a large term exactly: a spring that hardens by some per cent is a spring.
    """
    lost = summed(worse.change - better.change)[0]
    holds = worse.complexity < better.complexity and lost <= policy.material_whole * better.gain
    return separates(better, worse, policy) and not holds


def touches(a: Evidence, b: Evidence) -> bool:
    """Whether two terms are felt at a common joint."""
    return bool(set(a.chosen.candidate.joints) & set(b.chosen.candidate.joints))


def gains_there(e: Evidence, own: Evidence) -> bool:
    """Whether a term may stand in the place of another: it gains most of what that one does, joint by joint.

    A term that is felt at several joints would else compete with what is wrong at each of them.
    """
    common = sum(min(e.gains.get(j, 0.0), gain) for j, gain in own.gains.items() if gain > 0.0)
    return common > 0.5 * sum(gain for gain in own.gains.values() if gain > 0.0)


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


def fit_alike(tied: Sequence[Evidence], policy: Policy) -> list[Evidence]:
    """Those of some terms whose error on the rows that are fitted is like that of the best of them.

    Where few runs go far, held-out ones may lie beyond the others and tell nothing apart.
    """
    least = min((1.0 - e.fitted for e in tied), default=0.0)
    return [e for e in tied if 1.0 - e.fitted <= policy.alike**2 * max(least, 1e-12)]


def choose(able: Sequence[Evidence], policy: Policy) -> Evidence | None:
    """The simplest of those terms that neither held-out runs nor the fit tell from the best one."""
    if not able:
        return None
    best = max(able, key=lambda e: e.gain)
    tied = [e for e in able if e is best or (touches(e, best) and not separates(best, e, policy))]
    return simplest(fit_alike(tied, policy))
