"""The vocabulary, which is all effects of the platform, and selections from it."""

from collections.abc import Collection, Iterable, Sequence
from functools import cache

from wearscope import plugins
from wearscope.effects.base import ArmatureEffect, Effect, load_effect
from wearscope.errors import InputError

#: Effects whose change the comparison of sessions tries at every joint, the most believable first.
CHANGES = (
    "coulomb", "viscous", "load_dependent_friction", "wear", "payload_error", "torque_constant_error",
    "torque_offset", "joint_spring", "gravity_counterbalance", "rotor_inertia_error",
)  # fmt: skip
#: Usual names, where an effect's own name is not clear enough.
TITLES = {
    "concave_viscous": "concave viscous friction",
    "coulomb": "Coulomb friction",
    "coulomb_asymmetry": "Coulomb asymmetry",
    "quadratic_viscous": "quadratic viscous friction",
    "stribeck": "Stribeck friction",
    "viscous": "viscous friction",
}


def say_effect(name: str) -> str:
    """Return the name of an effect in words: ``Stribeck friction``; of an own effect, its name as text."""
    return TITLES.get(name, name.replace("_", " "))


@cache
def _builtin() -> tuple[Effect, ...]:
    """Load all effects of the platform once."""
    return tuple(plugins.load(name, "effects", "EFFECT") for name in plugins.list_names("effects", "EFFECT"))


def list_effects() -> list[Effect]:
    """Return all effects of the platform, sorted by name."""
    return list(_builtin())


def plain_friction() -> list[Effect]:
    """Return the friction effects that a usual joint has."""
    return [effect for effect in _builtin() if effect.is_plain_friction]


def session_effects() -> list[Effect]:
    """Return the effects that the comparison of sessions tries at every joint, the most believable first."""
    return [load_effect(name) for name in CHANGES]


def worn_effect() -> Effect:
    """Return the effect that is the change of a joint's friction by wear."""
    return load_effect("wear")


def thermal_friction() -> Effect:
    """Return the effect that is the dependence of friction on a recorded temperature."""
    return load_effect("temperature_dependent_friction")


def empirical_effect() -> Effect:
    """Return the generic effect for structure that no other effect explains."""
    return load_effect("unknown")


def given_effects(declared: Iterable[Effect], stated: Collection[str]) -> list[Effect]:
    """Return the declared effects whose value a field of the data set gives, so that it is not fitted.

    Parameters
    ----------
    declared : iterable of Effect
    stated : collection of str
        Names of the fields that have a value, e.g. of a data set's `robot`.
    """
    return [effect for effect in declared if isinstance(effect, ArmatureEffect) and effect.name in stated]


def candidate_effects(
    declared: Sequence[Effect], extra: Sequence[Effect], given: Collection[str], n: int
) -> list[Effect]:
    """Return the effects that a model may lack.

    Parameters
    ----------
    declared : sequence of Effect
        Effects that the model has.
    extra : sequence of Effect
        The user's own effects.
    given : collection of str
        Names of effects whose value is given instead of fitted, so that it can be wrong: those of
        `given_effects`, and the rigid body where its inertial parameters are trusted. Every model has a rigid
        body, declared or not.
    n : int
        Number of joints.

    Returns
    -------
    list of Effect
        Effects of the vocabulary, then of `extra`, for a robot of `n` joints. Declared effects, effects that
        these contain, and errors of values that are fitted are left out; on a robot with one joint, also
        effects of another joint.

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
        if n > 1 or not effect.selects_signals
    ]
