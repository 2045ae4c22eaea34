"""All names that an effect's file imports, and the loading of effects by name or file."""

from pathlib import Path

from wearscope import plugins
from wearscope.effects.effect import (
    ALONE,
    GRAVITY_SIGN,
    OTHERS,
    PAYLOAD,
    POSTURES,
    QUICK,
    RANGE,
    REVERSALS,
    SESSIONS,
    SLOW_MOTION,
    SPEEDS,
    TEMPERATURE,
    TIME,
    WEAR,
    Effect,
)
from wearscope.effects.kinds import (
    ArmatureEffect,
    BalancerEffect,
    BodyEffect,
    FrictionLaw,
    InertialEffect,
    MeasurementEffect,
    PayloadEffect,
    RigidBodyEffect,
    TransmissionEffect,
    WaveEffect,
)
from wearscope.effects.own_effect import load_installed_effect, load_own_effect
from wearscope.effects.parameter import Parameter
from wearscope.effects.rows import ROW, Plant, Term, compile_row, decay, saturate
from wearscope.effects.signals import Signals
from wearscope.errors import InputError

__all__ = [
    "ALONE",
    "GRAVITY_SIGN",
    "OTHERS",
    "PAYLOAD",
    "POSTURES",
    "QUICK",
    "RANGE",
    "REVERSALS",
    "ROW",
    "SESSIONS",
    "SLOW_MOTION",
    "SPEEDS",
    "TEMPERATURE",
    "TIME",
    "WEAR",
    "ArmatureEffect",
    "BalancerEffect",
    "BodyEffect",
    "Effect",
    "FrictionLaw",
    "InertialEffect",
    "MeasurementEffect",
    "Parameter",
    "PayloadEffect",
    "Plant",
    "RigidBodyEffect",
    "Signals",
    "Term",
    "TransmissionEffect",
    "WaveEffect",
    "compile_row",
    "decay",
    "load_effect",
    "saturate",
]


def load_effect(reference: str, allow_code: bool = True, folder: str | Path | None = None) -> Effect:
    """Load an effect of the platform or an installed package by its name, or a user's own by its file.

    Parameters
    ----------
    reference : str
        A name, or the path of a ``.py`` file that defines ``EFFECT``.
    allow_code : bool
        Whether a file may run. A data set may come from someone else, so the code that it names runs only
        where the user allows it.
    folder : path-like, optional
        Folder to which a relative path refers: that of the file which names the effect.

    Returns
    -------
    Effect
        The same object for the same reference.

    Raises
    ------
    InputError
        Where there is no such effect, its file may not run, or it breaks a rule (see
        `wearscope.effects.own_effect.check_own_effect`).
    """
    if not reference.endswith(".py"):
        if not plugins.is_built_in(reference, "effects"):
            return load_installed_effect(reference)
        effect: Effect = plugins.load(reference, "effects", "EFFECT")
        return effect
    if not allow_code:
        raise InputError(
            f"{reference}: is Python code that a data set names, which may come from someone else; read the "
            "file, then allow it to run with '--config allow_code=true'."
        )
    return load_own_effect(Path(reference) if folder is None else Path(folder) / reference)
