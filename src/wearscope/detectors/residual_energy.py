"""Energy of the torque residual against a nominal torque signature (detector A of the default study)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from wearscope.detectors.base import Array, Batch, check_nominal, check_sample_rate


@dataclass
class ResidualEnergy:
    r"""Relative energy of the difference to the nominal torque signature, sample by sample.

    .. math:: y = \sum_k (\tau_k - \bar\tau_k)^2 / \sum_k \bar\tau_k^2

    with :math:`\bar\tau` the mean of the nominal batches of the tested axis. Samples are paired by index from
    the start of the recording, over the samples that both have, so that a delay in the motion counts as a
    residual, as does any change of load. Zero for the nominal batch itself, near-quadratic around it.

    A stand-in for FDA A of Samuelsson et al. (2014), which is confidential: parity of measured and expected
    torque, e.g. Isermann, Fault-Diagnosis Systems, Springer 2006, ch. 10.

    Parameters
    ----------
    min_overlap : float
        Smallest share of the signature that a batch must cover; a shorter batch raises ValueError.
    """

    min_overlap: float = 0.5
    axis: int = field(default=0, init=False)
    signature: Array = field(default_factory=lambda: np.zeros(0), init=False, repr=False)
    sample_rate: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        if not 0 < self.min_overlap <= 1:
            raise ValueError("min_overlap must be above 0 and at most 1")

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Average the nominal torque over the samples that all nominal batches have."""
        check_nominal(nominal)
        shortest = min(len(batch.t) for batch in nominal)
        self.axis = axis
        self.sample_rate = nominal[0].sample_rate
        self.signature = np.mean([batch.tau[:shortest, axis] for batch in nominal], axis=0)
        if not np.any(self.signature):
            raise ValueError("the nominal torque signature is zero throughout")

    def test_quantity(self, batch: Batch) -> float:
        """Relative residual energy [-], at least 0."""
        check_sample_rate(batch, self.sample_rate)
        common = min(len(batch.t), len(self.signature))
        if common < self.min_overlap * len(self.signature):
            raise ValueError(f"the batch has {len(batch.t)} samples, the signature {len(self.signature)}")
        nominal = self.signature[:common]
        residual = batch.tau[:common, self.axis] - nominal
        return float(residual @ residual / (nominal @ nominal))


DETECTOR = ResidualEnergy
