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

    with :math:`\bar\tau` the mean of the nominal batches of the tested axis. Samples are paired by index over
    those that both have: from the start of the recording, so that every delay of the motion counts as a
    residual, or move by move, so that only what is left within the moves counts. Zero for the nominal batch
    itself, near-quadratic around it.

    A stand-in for FDA A of Samuelsson et al. (2014), which is confidential: parity of measured and expected
    torque, e.g. Isermann, Fault-Diagnosis Systems, Springer 2006, ch. 10.

    Parameters
    ----------
    align : {"start", "moves"}
        Whether samples are paired from the start of the recording or of each move. Moves are the stretches
        between rests of all joints; their number must be that of the nominal batches.
    rest_share : float
        Speed under which a joint counts as at rest, as share of its highest nominal speed.
    min_overlap : float
        Smallest share of the signature that a batch must cover; a shorter batch raises ValueError.
    """

    align: str = "start"
    rest_share: float = 0.01
    min_overlap: float = 0.5
    axis: int = field(default=0, init=False)
    signatures: list[Array] = field(default_factory=list, init=False, repr=False)
    rest_speed: Array = field(default_factory=lambda: np.zeros(0), init=False, repr=False)
    sample_rate: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        if self.align not in ("start", "moves"):
            raise ValueError("align must be 'start' or 'moves'")
        if not 0 < self.min_overlap <= 1:
            raise ValueError("min_overlap must be above 0 and at most 1")
        if not 0 <= self.rest_share < 1:
            raise ValueError("rest_share must be at least 0 and below 1")

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Average the nominal torque over the samples that all nominal batches have."""
        check_nominal(nominal)
        self.axis = axis
        self.sample_rate = nominal[0].sample_rate
        self.rest_speed = self.rest_share * np.max(
            [np.abs(batch.qd).max(axis=0) for batch in nominal], axis=0
        )
        pieces = [self.cut(batch) for batch in nominal]
        if len({len(piece) for piece in pieces}) > 1:
            raise ValueError("the nominal batches differ in their number of moves")
        self.signatures = [_average(stretch) for stretch in zip(*pieces, strict=True)]
        if not any(np.any(signature) for signature in self.signatures):
            raise ValueError("the nominal torque signature is zero throughout")

    def cut(self, batch: Batch) -> list[Array]:
        """Torques of the tested axis, one array for the recording or one a move."""
        torque = batch.tau[:, self.axis]
        if self.align == "start":
            return [torque]
        moving = np.any(np.abs(batch.qd) > self.rest_speed, axis=1)
        edges = np.flatnonzero(np.diff(moving)) + 1
        parts = np.split(torque, edges)
        return parts[0 if moving[0] else 1 :: 2]

    def test_quantity(self, batch: Batch) -> float:
        """Relative residual energy [-], at least 0."""
        check_sample_rate(batch, self.sample_rate)
        pieces = self.cut(batch)
        if len(pieces) != len(self.signatures):
            raise ValueError(f"the batch has {len(pieces)} moves, the nominal data {len(self.signatures)}")
        pairs = [
            (piece[: len(signature)], signature[: len(piece)])
            for piece, signature in zip(pieces, self.signatures, strict=True)
        ]
        common, whole = (sum(map(len, those)) for those in ([n for _, n in pairs], self.signatures))
        if common < self.min_overlap * whole:
            raise ValueError(f"the batch covers {common} of the signature's {whole} samples")
        nominal = np.concatenate([signature for _, signature in pairs])
        residual = np.concatenate([piece for piece, _ in pairs]) - nominal
        return float(residual @ residual / (nominal @ nominal))


def _average(torques: Sequence[Array]) -> Array:
    """Mean over the samples that all have."""
    shortest = min(map(len, torques))
    return np.mean([torque[:shortest] for torque in torques], axis=0)


DETECTOR = ResidualEnergy
