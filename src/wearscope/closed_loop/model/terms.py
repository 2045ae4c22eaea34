"""A term of a model: an effect at a joint with its shape and the coefficients in use."""

from dataclasses import dataclass

import numpy as np

from wearscope.effects.base import Effect, MeasurementEffect, Signals, TransmissionEffect


@dataclass(frozen=True)
class ModelTerm:
    """An effect at a joint with its shape, some of its coefficients in use.

    Attributes
    ----------
    effect : Effect
    joint : int
    shape : tuple of float
    subset : tuple of int
        Indices of the coefficients in use.
    """

    effect: Effect
    joint: int
    shape: tuple[float, ...]
    subset: tuple[int, ...]

    @property
    def label(self) -> str:
        """Name and joint index."""
        return f"{self.effect.name}@{self.joint}"

    @property
    def is_measurement_error(self) -> bool:
        """Whether the term acts on what the rest of the model predicts to be recorded."""
        return isinstance(self.effect, MeasurementEffect)

    @property
    def is_deflection(self) -> bool:
        """Whether the term is a deflection of a gear."""
        return isinstance(self.effect, TransmissionEffect)

    def columns(self, signals: Signals) -> np.ndarray:
        """Full-rate regressors at every joint, (N, n, m)."""
        x = self.effect.columns(signals, self.joint, np.array(self.shape))[..., list(self.subset)]
        if self.effect.spread:
            return x
        full = np.zeros((len(x), signals.q.shape[1], x.shape[-1]))
        full[:, self.joint] = x
        return full
