"""Signals of prepared runs, picked at the rows of the residual and joined end to end."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from wearscope.closed_loop.intake.filtering import rows
from wearscope.closed_loop.intake.prepared import PreparedRun
from wearscope.effects.base import Signals

#: Signals with one value per sample.
_SAMPLED = ("t", "q", "v", "a", "sign", "load", "temperature", "wear")
#: Fields that only a whole run has; they are emptied where rows are picked.
_OF_A_RUN: dict[str, Any] = {"torque": None, "transmitted": None, "lag": None, "reversal": None}


def thin_signals(run: PreparedRun) -> Signals:
    """Signals of a run at the rows of its residual, unfiltered."""
    return pick_rows(run.signals, rows(run.band, len(run.signals.t)))


def pick_rows(whole: Signals, at: np.ndarray | slice) -> Signals:
    """Signals at some of their samples, without the fields that only a whole run has."""
    sampled: dict[str, Any] = {name: getattr(whole, name)[at] for name in _SAMPLED}
    channels = {name: values[at] for name, values in whole.channels.items()}
    return replace(whole, **sampled, channels=channels, **_OF_A_RUN, _slopes={})


def join_signals(parts: Iterable[Signals]) -> Signals:
    """Signals of several runs end to end."""
    every = list(parts)
    sampled: dict[str, Any] = {
        name: np.concatenate([getattr(one, name) for one in every]) for name in _SAMPLED
    }
    channels = {name: np.concatenate([one.channels[name] for one in every]) for name in every[0].channels}
    return replace(every[0], **sampled, channels=channels, **_OF_A_RUN, _slopes={})
