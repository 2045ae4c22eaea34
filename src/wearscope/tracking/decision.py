"""The rule that says what changed in a session: pure functions of what is asked of the estimates."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from wearscope.tracking.changes import Change
from wearscope.tracking.inference import Estimate

#: Least RMS torque of a change, as a share of the joint's friction, and of its torque for any other change.
LEAST_FRICTION, LEAST_TORQUE = 0.02, 0.005
#: p-value from which a change adds nothing given another one, which then explains it too.
_NOTHING_LEFT = 0.01
#: A further change at a joint must explain so much of what the first one there does.
_FURTHER = 0.05


@dataclass(frozen=True)
class Judged:
    """An estimate of a change given others, with the p-value of none, for this change alone."""

    estimate: Estimate
    p_value: float


#: Estimate of a change given others; None where the session does not show it.
Ask = Callable[[Change, Sequence[Change]], Judged | None]


@dataclass(frozen=True)
class Named:
    """A change that a session shows.

    Attributes
    ----------
    change : Change
    judged : Judged
        Given all others that the session shows.
    equivalent : tuple of str
        Names that explain it as well.
    """

    change: Change
    judged: Judged
    equivalent: tuple[str, ...]


def counts(judged: Judged, level: float, tests: int) -> bool:
    """Whether a change is beyond chance, over all that are asked (Bonferroni), and matters."""
    estimate = judged.estimate
    least = LEAST_FRICTION if estimate.change.friction else LEAST_TORQUE
    return judged.p_value * tests <= level and estimate.torque >= least


def touches(a: Change, b: Change) -> bool:
    """Whether two changes may explain each other: at the same joint, or felt at several."""
    return a.joint == b.joint or a.spread or b.spread


def excludes(a: Change, b: Change) -> bool:
    """Whether only one of two changes is named: friction of one joint changes as one."""
    return a.key == b.key or (a.joint == b.joint and a.friction and b.friction)


def name_changes(changes: Sequence[Change], ask: Ask, level: float) -> list[Named]:
    """Changes that a session shows.

    At each step the change that explains most, of those that count, is compared with the others that touch
    it: those given which it adds nothing explain it too, and the one believed first (`Change.order`) is
    named.

    Parameters
    ----------
    changes : sequence of Change
    ask : callable
    level : float
        False-alarm rate of a session.
    """
    tests = len(changes)
    taken: list[Change] = []
    names: dict[str, tuple[str, ...]] = {}
    most: dict[int, float] = {}
    while True:
        able = []
        for change in changes:
            if any(excludes(change, other) for other in taken):
                continue
            judged = ask(change, taken)
            if judged is not None and counts(judged, level, tests):
                able.append(judged)
        able = [j for j in able if j.estimate.gain >= _FURTHER * most.get(j.estimate.change.joint, 0.0)]
        if not able:
            break
        best = max(able, key=lambda j: j.estimate.gain - 2.0 * j.estimate.change.complexity).estimate.change
        rivals = [j.estimate.change for j in able if touches(j.estimate.change, best)]
        alike = [c for c in rivals if c is best or _covers(c, best, taken, ask)]
        chosen = min(alike, key=lambda c: c.order)
        gain = next(j.estimate.gain for j in able if j.estimate.change is chosen)
        same = [c for c in rivals if c is not chosen and _covers(c, chosen, taken, ask)]
        names[chosen.key] = tuple(dict.fromkeys(n for c in same for n in effect_names(c)))
        taken.append(chosen)
        most[chosen.joint] = max(most.get(chosen.joint, 0.0), gain)
    return _prune(taken, names, ask, level, tests)


def _covers(other: Change, change: Change, taken: Sequence[Change], ask: Ask) -> bool:
    """Whether `change` adds nothing given `other`."""
    if set(effect_names(change)) <= set(effect_names(other)) and change.joint == other.joint:
        return True
    judged = ask(change, [*taken, other])
    return judged is None or judged.p_value > _NOTHING_LEFT


def effect_names(change: Change) -> list[str]:
    """Names of a change's effects."""
    return [term.effect.name for term in change.terms]


def _prune(
    taken: list[Change], names: dict[str, tuple[str, ...]], ask: Ask, level: float, tests: int
) -> list[Named]:
    """Each change given all others; those that no longer count are dropped, the least sure first."""
    taken = list(taken)
    while taken:
        found = {change.key: ask(change, [c for c in taken if c is not change]) for change in taken}
        weak = [
            (1.0 if judged is None else judged.p_value, key)
            for key, judged in found.items()
            if judged is None or not counts(judged, level, tests)
        ]
        if not weak:
            return [
                Named(change, judged, tuple(n for n in names[change.key] if n not in effect_names(change)))
                for change in taken
                if (judged := found[change.key]) is not None
            ]
        gone = max(weak)[1]
        taken = [change for change in taken if change.key != gone]
    return []
