"""The set of names of a term: what held-out runs cannot tell apart from it, with a stated coverage."""

from collections.abc import Sequence

import numpy as np

from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.evidence import Evidence, Found, Refusal, on_same_folds
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.problem import Problem
from wearscope.closed_loop.selection.revision import match_gain
from wearscope.closed_loop.selection.search import Search

#: Bootstrap draws, length of their blocks [blocks of rows], most alternatives compared.
_DRAWS, _LENGTH, _MOST = 500, 2, 12
#: Difference of losses, of the largest, below which two alternatives are the same.
_SAME = 1e-9
#: What may be listed with a name although it may not give it.
_OPEN = (Refusal.NONE, Refusal.CHANCE, Refusal.DISAGREES, Refusal.DRIFTS)


def _keep_columns(losses: np.ndarray, policy: Policy) -> list[int]:
    """Columns of losses (N, k) that are in the set: their largest studentised difference is one of chance."""
    n, k = losses.shape
    rng, here = np.random.default_rng(policy.seed), np.arange(n)
    means = np.empty((_DRAWS, k))
    for draw in range(_DRAWS):  # blocks of geometric length: Politis and Romano 1994, JASA 89
        first = rng.integers(n, size=(n,))
        begin = np.maximum.accumulate(np.where(rng.random(n) > 1.0 / _LENGTH, 0, here))
        means[draw] = losses[(first[begin] + here - begin) % n].mean(axis=0)
    center = losses.mean(axis=0)
    apart = center[:, None] - center
    drawn = means[:, :, None] - means[:, None] - apart
    scale = np.sqrt((drawn**2).mean(axis=0) + np.eye(k))
    apart, drawn = apart / scale, drawn / scale
    kept = list(range(k))
    while len(kept) > 1:
        among = apart[np.ix_(kept, kept)]
        if (among.max() < drawn[:, kept][:, :, kept].max(axis=(1, 2))).mean() > policy.set_level:
            break
        del kept[among.argmax() // len(kept)]
    return kept


def find_confidence_set(evidence: Sequence[Evidence], policy: Policy) -> list[Evidence]:
    """Those terms that are in the model confidence set of their held-out losses by block.

    Hansen, Lunde and Nason 2011, Econometrica 79(2), by the stationary bootstrap.
    """
    if len(evidence) < 2:
        return list(evidence)
    losses = np.column_stack([e.change for e in evidence])
    losses = losses[np.isfinite(losses).all(axis=1)]
    # Alternatives that predict the same are one to the bootstrap, which divides by what differs.
    scale = max(float(np.abs(losses).max()), 1e-300)
    like = [
        next(i for i in range(k + 1) if np.abs(losses[:, k] - losses[:, i]).max() <= _SAME * scale)
        for k in range(len(evidence))
    ]
    apart = sorted(set(like))
    inside = set(apart)
    if len(apart) > 1:
        inside = {apart[k] for k in _keep_columns(losses[:, apart], policy)}
    # With few blocks the bootstrap is too sure, and of large terms it refuses a simpler one for its form.
    best = max(evidence, key=lambda e: e.gain)
    return [
        e
        for e, i in zip(evidence, like, strict=True)
        if i in inside or not rule.separates_names(best, e, policy)
    ]


def name_terms(search: Search, found: list[Found]) -> tuple[list[Found], list[list[str]]]:
    """Give each term the simplest name of its set; return the other names of it.

    A standard term keeps its name: a plain joint is expected to have it.
    """
    equivalent: list[list[str]] = [[] for _ in found]
    for i in range(len(found)):
        f = found[i]
        if f.effect.empirical:
            continue
        others = [k for k in found if k is not f]
        given = search.assemble(others)
        joints = f.chosen.candidate.joints if f.effect.spread else (f.joint,)
        offered = search.list_rivals(given, others, joints, every=True)
        offered = [c for c in offered if not (f.effect.standard and c.effect.spread)]
        own = search.refine(given, search.weigh_again(given, f))
        weighed = search.weigh_all(given, offered, match_gain(given, own))
        weighed = [e for e in weighed if e.refusal in _OPEN and search.is_delay(given, e, settled=True)]
        given, (own, *weighed) = on_same_folds(given, [own, *weighed], search.policy)
        weighed.sort(key=lambda e: -e.gain)
        able = [e for e in weighed if e.refusal is Refusal.NONE and rule.gains_there(e, own)]
        best = max([own.gain, *(e.gain for e in able)])
        near = [e for e in weighed if e.gain > search.policy.beyond_doubt * best and not _is_same(e, own)]
        near = [search.refine(given, e) for e in near if rule.gains_there(e, own)][:_MOST]
        inside = find_confidence_set([own, *near], search.policy)
        able = rule.fit_alike([e for e in inside if e is own or e.refusal is Refusal.NONE], search.policy)
        opposing = [e for e in able if opposes_gravity(search.problem, e)]
        # What names of single joints took the place of may be in the set, and gives no name.
        naming = [e for e in able if not f.effect.standard and e.term.effect.name not in search.left_out]
        name = rule.simplest(naming, opposing) if naming else own
        most = max((e.complexity for e in able), default=own.complexity)
        if f.effect.standard:
            most = own.complexity
        named = dict.fromkeys(e.term.effect.name for e in inside if e.complexity <= most)
        equivalent[i] = [x for x in named if x != name.term.effect.name]
        found = [Found(name.chosen, name) if k is f else k for k in found]
    return found, equivalent


def _is_same(a: Evidence, b: Evidence) -> bool:
    return (
        a.term.effect is b.term.effect and a.term.joint == b.term.joint and a.chosen.subset == b.chosen.subset
    )


def opposes_gravity(problem: Problem, e: Evidence) -> bool:
    """Whether a term that is built to take gravity's load off a joint does so."""
    if not e.term.effect.opposes_gravity:
        return False
    joint, opposed, scale = e.term.joint, 0.0, 0.0
    at = e.chosen.candidate.joints.index(joint)
    torques = problem.layout.unpack(e.chosen.rows[at] @ e.beta)
    for run, torque in zip(problem.train, torques, strict=True):
        q = run.signals.q[rows(run.band, len(run.signals.t))]
        gravity = run.signals.rigid_body.inverse_dynamics(q, np.zeros_like(q), np.zeros_like(q))[:, joint]
        opposed += float(torque @ gravity)
        scale += float(np.linalg.norm(torque) * np.linalg.norm(run.signals.load[:, joint]))
    # Where gravity gives nothing but round-off there is nothing to balance.
    return opposed < -1e-6 * scale
