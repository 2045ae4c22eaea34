"""The vocabulary as a whole: which effects there are, which a model may lack, and what tells them apart."""

from collections.abc import Collection, Iterable, Sequence
from functools import cache

from wearscope import plugins
from wearscope.effects.effect import Effect


@cache
def _builtin() -> tuple[Effect, ...]:
    return tuple(plugins.load(name, "effects", "EFFECT") for name in plugins.list_names("effects", "EFFECT"))


def list_effects() -> list[Effect]:
    """Effects of the vocabulary, by name."""
    return list(_builtin())


def standard_effects() -> list[Effect]:
    """Effects of a plain joint."""
    return [effect for effect in _builtin() if effect.standard]


def empirical_effect() -> Effect:
    """The generic term for structure outside the vocabulary."""
    (effect,) = (effect for effect in _builtin() if effect.empirical)
    return effect


def candidate_effects(
    declared: Sequence[Effect], extra: Sequence[Effect] = (), given: Collection[str] = (), n: int = 1
) -> list[Effect]:
    """Effects that a model may lack.

    Parameters
    ----------
    declared : sequence of Effect
        What the model has.
    extra : sequence of Effect
        A user's own effects.
    given : collection of str
        Names of the declared effects whose values are given and stand, so that they can be wrong: a rotor
        inertia that the data set states, a rigid body whose inertials are trusted.
    n : int
        Number of joints.

    Returns
    -------
    list of Effect
        Of the vocabulary, then of `extra`, sized for the robot; none that is declared, that a declared one
        contains, or whose value a declared one is fitted to.
    """
    names = {effect.name for effect in declared}
    gone = names.union(*(effect.contains for effect in declared))
    known = names.intersection(given)
    found = {
        effect.name: effect
        for effect in [*_builtin(), *extra]
        if effect.candidate and effect.name not in gone and (not effect.corrects or effect.corrects in known)
    }
    return [effect.for_robot(n) for effect in found.values()]


def given_effects(declared: Iterable[Effect], stated: Collection[str]) -> list[Effect]:
    """Declared effects whose value a field gives, so that there is nothing to fit.

    Parameters
    ----------
    declared : iterable of Effect
    stated : collection of str
        Fields that are filled in, e.g. of the `robot` section of a data set.
    """
    return [effect for effect in declared if effect.given_by and effect.given_by in stated]


def separating_motions(a: Effect, b: Effect, n: int) -> list[str]:
    """Motions that separate two effects on a robot of `n` joints, in words, most telling first."""
    for one, other in ((a, b), (b, a)):
        if other.name in one.separated_by:
            return [one.separated_by[other.name]]
    return list(dict.fromkeys(effect.motion_for(n) for effect in sorted((a, b), key=lambda e: e.name)))
