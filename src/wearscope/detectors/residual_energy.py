"""Energy of the torque residual against a nominal torque signature (detector A of the default study)."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from wearscope.detectors.base import OPTIONS, SAME_RATE, Array, Batch, Share, check_nominal


@dataclass(config=OPTIONS)
class ResidualEnergy:
    r"""Relative energy of the difference to the nominal torque signature, sample by sample.

    .. math:: y = \sum_k (\tau_k - \bar\tau_k)^2 / \sum_k \bar\tau_k^2

    with :math:`\bar\tau` the mean of the nominal batches of the tested axis. Samples are paired in one of two
    ways. By time since the start of the recording, every delay of the motion causes a residual; the signature
    is interpolated for a batch with another sample rate. By the path that the joints have covered while in
    motion, a delay at rest causes none. The energy is zero for the nominal batch itself, and nearly quadratic
    around it.

    A stand-in for FDA A of Samuelsson et al. (2014), which is confidential: parity of measured and expected
    torque, e.g. Isermann, Fault-Diagnosis Systems, Springer 2006, ch. 10.

    Parameters
    ----------
    align : {"start", "path"}
        How samples are paired: by time, or by path. The path is the sum of the motions of all joints, each in
        units of its highest nominal speed, as a share of the whole batch's path.
    rest_share : float
        For ``path``: speed below which a joint counts as at rest, as a share of its highest nominal speed.
    min_overlap : float
        For ``start``: smallest share of the signature that a batch must cover; a shorter batch raises
        ValueError.
    """

    align: Literal["start", "path"] = "start"
    rest_share: Share = 0.01
    min_overlap: Annotated[float, Field(gt=0, le=1)] = 0.5
    unit: ClassVar[str] = "1"
    knows: ClassVar[str] = "nothing"

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Average the nominal torque over the samples that all nominal batches have."""
        check_nominal(nominal)
        self.axis = axis
        self.sample_rate = nominal[0].sample_rate
        if self.align == "path":
            self.top_speed = np.max([np.abs(batch.qd).max(axis=0) for batch in nominal], axis=0)
            self.path, _ = self._follow_path(nominal[0])
            torques = [np.interp(self.path, *self._follow_path(batch)) for batch in nominal]
        else:
            shortest = min(len(batch.t) for batch in nominal)
            torques = [batch.tau[:shortest, axis] for batch in nominal]
        self.signature = np.mean(torques, axis=0)
        if not np.any(self.signature):
            raise ValueError("the nominal torque signature is zero throughout")

    def _follow_path(self, batch: Batch) -> tuple[Array, Array]:
        """Return the covered path (M,), from 0 to 1, and the torque (M,) at the samples in motion."""
        speed = np.abs(batch.qd) / np.where(self.top_speed > 0, self.top_speed, np.inf)
        progress = np.where(speed > self.rest_share, speed, 0.0).sum(axis=1)
        moving = progress > 0
        if not moving.any():
            raise ValueError("no joint moves")
        path = np.cumsum(progress)[moving] - 0.5 * progress[moving]
        return path / progress.sum(), batch.tau[moving, self.axis]

    def test_quantity(self, batch: Batch) -> float:
        """Return the relative residual energy [-], at least 0."""
        if self.align == "path":
            nominal = self.signature
            residual = np.interp(self.path, *self._follow_path(batch)) - nominal
        else:
            nominal = self._expect(batch)
            residual = batch.tau[: len(nominal), self.axis] - nominal
        return float(residual @ residual / (nominal @ nominal))

    def _expect(self, batch: Batch) -> Array:
        """Return the nominal torque (M,) at the samples of a batch, up to the end of the shorter of both."""
        whole = len(self.signature)
        every = self.sample_rate / batch.sample_rate
        same = abs(every - 1.0) <= SAME_RATE
        common = min(len(batch.t), whole if same else int((whole - 1) / every) + 1)
        if common * every < self.min_overlap * whole:
            raise ValueError(f"the batch covers {common * every:.0f} of the signature's {whole} samples")
        if same:
            return self.signature[:common]
        return np.interp(every * np.arange(common), np.arange(whole), self.signature)


DETECTOR = ResidualEnergy
