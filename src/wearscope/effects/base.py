"""The door of the room: what an effect's file needs, and how an effect is loaded."""

from wearscope import plugins
from wearscope.effects.effect import Effect
from wearscope.effects.kinds import (
    ArmatureEffect,
    MeasurementEffect,
    PayloadEffect,
    RigidBodyEffect,
    TransmissionEffect,
)
from wearscope.effects.parameter import Parameter
from wearscope.effects.plant import Plant, Term
from wearscope.effects.rows import ROW, compile_row
from wearscope.effects.signals import Signals

__all__ = [
    "ROW",
    "ArmatureEffect",
    "Effect",
    "MeasurementEffect",
    "Parameter",
    "PayloadEffect",
    "Plant",
    "RigidBodyEffect",
    "Signals",
    "Term",
    "TransmissionEffect",
    "compile_row",
    "load_effect",
]


def load_effect(name: str) -> Effect:
    """Effect of the vocabulary by name.

    Raises
    ------
    InputError
        Where the name is not in the vocabulary.
    """
    effect: Effect = plugins.load(name, "effects", "EFFECT")
    return effect
