"""The vocabulary as a whole: all effects, and those with a role, such as candidates for a model."""

from collections.abc import Collection, Iterable, Sequence
from functools import cache

from wearscope import plugins
from wearscope.effects.effect import Effect
from wearscope.errors import InputError


@cache
def _builtin() -> tuple[Effect, ...]:
    return tuple(plugins.load(name, "effects", "EFFECT") for name in plugins.list_names("effects", "EFFECT"))


def list_effects() -> list[Effect]:
    """Effects of the vocabulary, by name."""
    return list(_builtin())


def plain_friction() -> list[Effect]:
    """Friction of a plain joint."""
    return [effect for effect in _builtin() if effect.is_plain_friction]


def session_effects() -> list[Effect]:
    """Effects that the comparison of sessions tries at every joint, the most believable first."""
    asked = {effect.changes: effect for effect in _builtin() if effect.changes is not None}
    return [asked[place] for place in sorted(asked)]


def worn_effect() -> Effect:
    """What wear adds to a joint's friction, as a change between sessions."""
    (effect,) = (effect for effect in session_effects() if effect.needs_wear)
    return effect


def thermal_friction() -> Effect:
    """How friction depends on a temperature that is recorded."""
    (effect,) = (effect for effect in _builtin() if effect.thermal)
    return effect


def empirical_effect() -> Effect:
    """The generic term for structure outside the vocabulary."""
    (effect,) = (effect for effect in _builtin() if effect.empirical)
    return effect


def given_effects(declared: Iterable[Effect], stated: Collection[str]) -> list[Effect]:
    """Declared effects whose value a field of the data set gives, so that nothing is fitted.

    Parameters
    ----------
    declared : iterable of Effect
    stated : collection of str
        Fields that are filled in, e.g. of a data set's `robot`.
    """
    return [effect for effect in declared if effect.given_by and effect.given_by in stated]


def candidate_effects(
    declared: Sequence[Effect], extra: Sequence[Effect], given: Collection[str], n: int
) -> list[Effect]:
    """Effects that a model may lack.

    Parameters
    ----------
    declared : sequence of Effect
        What the model has.
    extra : sequence of Effect
        A user's own effects.
    given : collection of str
        Names of effects whose value is given instead of fitted, so that it can be wrong: those of
        `given_effects`, and the rigid body (which every model has, declared or not) where its inertials are
        trusted.
    n : int
        Number of joints.

    Returns
    -------
    list of Effect
        Of the vocabulary, then of `extra`, sized for the robot; none that is declared or that a declared one
        contains, and no error of a value that is fitted.

    Raises
    ------
    InputError
        Where two own effects have the same name.
    """
    names = {effect.name for effect in declared}
    gone = names.union(*(effect.contains for effect in declared))
    found: dict[str, Effect] = {}
    for effect in [*_builtin(), *extra]:
        same = found.setdefault(effect.name, effect)
        if same is not effect:
            raise InputError(
                f"two own effects are called '{effect.name}' ({same.reference} and {effect.reference}); "
                "rename one."
            )
    return [
        effect.for_robot(n)
        for effect in found.values()
        if effect.candidate and effect.name not in gone and (not effect.corrects or effect.corrects in given)
    ]
