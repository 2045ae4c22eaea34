"""Optimal-transport distance between torque distributions."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy

from wearscope.detectors.base import Batch, check_nominal


@dataclass
class Wasserstein:
    r"""First Wasserstein distance between the torques of a batch and the nominal torques.

    .. math:: y = \int_0^1 |F^{-1}(u) - F_0^{-1}(u)| \, du

    It is the mean distance [N m] by which torque must be moved to turn one distribution into the other. It
    needs no bandwidth, grid or floor. The order of the samples does not matter. Villani, Topics in Optimal
    Transportation, AMS 2003, sec. 2.2.
    """

    unit: ClassVar[str] = "torque"
    knows: ClassVar[str] = "nothing"

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Pool the nominal torques of the tested axis."""
        check_nominal(nominal)
        self.axis = axis
        self.nominal = np.sort(np.concatenate([batch.tau[:, axis] for batch in nominal]))

    def test_quantity(self, batch: Batch) -> float:
        """Return the first Wasserstein distance [N m], at least 0."""
        torque = batch.tau[:, self.axis]
        if not np.isfinite(torque).all():
            raise ValueError("the batch holds torque samples that are not finite")
        return float(scipy.stats.wasserstein_distance(torque, self.nominal))


DETECTOR = Wasserstein
