"""Loads and checks a user's own effect: a ``.py`` file or installed package that defines ``EFFECT``."""

import importlib.util
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from wearscope import plugins
from wearscope.effects.effect import Effect
from wearscope.effects.parameter import Parameter
from wearscope.effects.rows import ROW
from wearscope.errors import InputError

#: Value that marks array elements to which a tried row wrote nothing; number of guard elements behind those
#: that the row may write.
_UNWRITTEN, _GUARD = -7.345e302, 16


def load_own_effect(path: Path) -> Effect:
    """Load the effect that a file defines; the same file gives the same object.

    Raises
    ------
    InputError
        Where there is no such file, it cannot be imported, or its ``EFFECT`` breaks a rule.
    """
    module = plugins.load_file(path, "EFFECT")
    effect: Any = getattr(module, "EFFECT", None)
    if effect is None:
        raise InputError(f"{path}: defines no EFFECT; add a module-level EFFECT.")
    if isinstance(effect, Effect) and effect.reference:
        return effect
    check_own_effect(effect, str(path))
    checked: Effect = replace(effect, reference=str(path.resolve()))
    module.__dict__["EFFECT"] = checked
    return checked


@cache
def load_installed_effect(name: str) -> Effect:
    """Load the effect of an installed package by the name of its entry point.

    Raises
    ------
    InputError
        Where there is no such package, it cannot be imported, its effect has another name, or breaks a rule.
    """
    effect = plugins.load(name, "effects", "EFFECT")
    check_own_effect(effect, f"effect '{name}'")
    if effect.name != name:
        raise InputError(
            f"effect '{name}': its package calls it '{effect.name}'; give the entry point that name."
        )
    return replace(effect, reference=name)


def check_own_effect(effect: Any, where: str) -> None:
    """Refuse an effect that identification or the simulator could not use.

    Parameters
    ----------
    effect : object
        Value of ``EFFECT`` in a file.
    where : str
        Path of the file, for messages.

    Raises
    ------
    InputError
        Where the effect breaks a rule; the message names the first one.
    """
    if not isinstance(effect, Effect):
        raise InputError(
            f"{where}: EFFECT is a {type(effect).__name__}; make it a wearscope.effects.base.Effect."
        )
    if not isinstance(effect.name, str) or not effect.name.isidentifier():
        raise InputError(
            f"{where}: EFFECT.name is {effect.name!r}; use letters, digits and '_', as in 'hose_drag'."
        )
    if importlib.util.find_spec(f"wearscope.effects.{effect.name}") is not None:
        raise InputError(f"{where}: EFFECT.name '{effect.name}' is taken by the vocabulary; choose another.")
    _check_parameters(effect, where)
    _check_names(effect, where)
    _check_row(effect, where)


def _check_parameters(effect: Effect, where: str) -> None:
    """Refuse parameters with wrong types, names, units, bounds or defaults."""
    for field in ("coefficients", "shape"):
        values = getattr(effect, field)
        if not isinstance(values, tuple) or not all(isinstance(p, Parameter) for p in values):
            raise InputError(f"{where}: EFFECT.{field} is no tuple of Parameter; write (Parameter(...),).")
    if not effect.coefficients:
        raise InputError(
            f"{where}: EFFECT.coefficients is empty; give the parameters the torque is linear in."
        )
    names = [p.name for p in effect.parameters]
    for p in effect.parameters:
        if not isinstance(p.name, str) or not p.name.isidentifier():
            raise InputError(
                f"{where}: a parameter is called {p.name!r}; use letters, digits and '_' in its name."
            )
        if names.count(p.name) > 1:
            raise InputError(f"{where}: two parameters are called '{p.name}'; rename one.")
        try:
            p.unit_at("rad", "N m")
        except (KeyError, IndexError, ValueError, AttributeError):
            raise InputError(
                f"{where}: unit {p.unit!r} of parameter '{p.name}' holds other braces than {{torque}} and "
                "{position}; correct it."
            ) from None
        for unit in ("rad", "m"):
            low, high = p.bounds(unit)
            if not low < high:
                raise InputError(
                    f"{where}: bounds of parameter '{p.name}' leave nothing between {low} and {high}; give a "
                    "lower one below the upper one."
                )
        if not p.lower <= p.default <= p.upper and p in effect.shape:
            raise InputError(
                f"{where}: default {p.default} of parameter '{p.name}' lies outside [{p.lower}, {p.upper}]; "
                "give one inside."
            )


def _check_names(effect: Effect, where: str) -> None:
    """Refuse variants, extensions and signals that name what does not exist."""
    coefficients = {p.name for p in effect.coefficients}
    for field in ("variants", "extensions"):
        for subset in getattr(effect, field):
            if isinstance(subset, str) or not subset or not set(subset) <= coefficients:
                raise InputError(
                    f"{where}: EFFECT.{field} holds {subset!r}; each is a tuple of coefficients, which are "
                    f"{', '.join(sorted(coefficients))}."
                )
    for field in ("depends_on", "parents", "contains"):
        names = getattr(effect, field)
        if not isinstance(names, tuple) or not all(isinstance(name, str) for name in names):
            raise InputError(f"{where}: EFFECT.{field} is no tuple of text; write ('...',).")
    if effect.per_robot and not effect.spread:
        raise InputError(
            f"{where}: EFFECT.per_robot needs 'spread': what the whole robot has once is felt in the torque "
            "of every joint; set both or none."
        )
    if not effect.depends_on:
        raise InputError(f"{where}: EFFECT.depends_on is empty; name the signals that the torque depends on.")
    try:
        effect.name_signals(effect.pack({})[1].tolist(), ("a", "b"), 0)
    except (KeyError, IndexError, ValueError):
        raise InputError(
            f"{where}: EFFECT.depends_on {effect.depends_on} has other braces than {{joint}}; correct it."
        ) from None


def _check_row(effect: Effect, where: str) -> None:
    """Refuse an effect without regressors, and a row that is not compiled or writes out of range."""
    own_columns = type(effect).columns is not Effect.columns or type(effect).stack is not Effect.stack
    if effect.row is None:
        if effect.regressors is None and not own_columns:
            raise InputError(
                f"{where}: EFFECT has neither 'row' nor 'regressors'; give a row compiled with @compile_row."
            )
        return
    if tuple(ROW.args) not in getattr(effect.row, "overloads", ()):
        raise InputError(
            f"{where}: EFFECT.row is not compiled; put @compile_row from wearscope.effects.base above it."
        )
    _try_row(effect, where)


def _try_row(effect: Effect, where: str) -> None:
    """Evaluate a row once, and refuse one that leaves values unwritten or writes beyond its arrays."""
    assert effect.row is not None
    count, memory = len(effect.coefficients), effect.n_states
    out, after = (np.full(size + _GUARD, _UNWRITTEN) for size in (count, memory))
    v, sign = np.array([0.3, -0.4]), np.array([1.0, -1.0])
    q, a, load = np.array([0.2, 0.5]), np.array([1.0, 2.0]), np.array([5.0, -6.0])
    still = np.full(2, 30.0), np.zeros(2)
    shape, state = effect.pack({})[1], np.zeros(max(memory, 1))
    # The row gets slices, so that an assignment to a whole array does not reach the guard elements.
    effect.row(0, 0.5, 1e-3, sign, q, v, a, load, *still, shape, state, after[:memory], out[:count])
    if np.any(out[:count] == _UNWRITTEN) or np.any(after[:memory] == _UNWRITTEN):
        raise InputError(
            f"{where}: row leaves a regressor or a state unwritten; write every one of the {count} values of "
            f"'out' and the {memory} of 'next_state'."
        )
    if np.any(out[count:] != _UNWRITTEN) or np.any(after[memory:] != _UNWRITTEN):
        raise InputError(
            f"{where}: row writes beyond the {count} values of 'out' or the {memory} of 'next_state'; state "
            "as many coefficients and n_states as it writes."
        )
