"""Distance between torque distributions (detector B of the default study)."""

from collections.abc import Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from wearscope.detectors.base import OPTIONS, Array, Batch, Positive, Share, check_nominal


@dataclass(config=OPTIONS)
class DistributionDistance:
    r"""Symmetrised Kullback-Leibler divergence between the torque densities of a batch and of nominal data.

    .. math:: y = \int (p - p_0) \log(p / p_0) \, d\tau

    The densities are Gaussian kernel estimates on a grid. Bandwidth (Silverman's rule, :math:`0.9 \min(s, IQR
    / 1.34) N^{-1/5}`, at least the grid step) and grid come from the nominal data alone. They are the same
    for every batch, so that two batches differ by their data only. The samples are binned linearly on the
    grid and then convolved with the kernel. Samples beyond the grid count at its end. Each density is mixed
    with a uniform one of weight `floor`, which bounds the logarithm where one of them is empty. The order of
    the samples does not matter.

    A stand-in for FDA B of Samuelsson et al. (2014), after Bittencourt, Saarinen, Sander-Tavallaey,
    Gunnarsson, Norrlöf, A data-driven approach to diagnostics of repetitive processes in the distribution
    domain, Mechatronics 24 (2014). Binning: Wand, Fast computation of multivariate kernel estimators,
    J. Comput. Graph. Stat. 3 (1994).

    Parameters
    ----------
    bandwidth : float, optional
        Standard deviation of the kernel [N m]; by default from Silverman's rule.
    grid_size : int
        Number of grid nodes.
    margin : float
        Distance by which the grid extends beyond the nominal torques at both ends, as a share of their range.
    floor : float
        Weight of the uniform density, in (0, 1).
    """

    bandwidth: Positive | None = None
    grid_size: Annotated[int, Field(ge=16)] = 512
    margin: Annotated[float, Field(ge=0)] = 0.25
    floor: Share = 1e-3
    unit: ClassVar[str] = "nat"
    knows: ClassVar[str] = "nothing"

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Set bandwidth, grid and nominal density from the pooled nominal torques."""
        check_nominal(nominal)
        self.axis = axis
        torque = np.concatenate([batch.tau[:, axis] for batch in nominal])
        low, high = float(torque.min()), float(torque.max())
        if not high > low:
            raise ValueError("the nominal torque is constant, so it has no density")
        self.width = self.bandwidth if self.bandwidth is not None else _silverman(torque)
        reach = self.margin * (high - low) + 3 * self.width
        self.grid = np.linspace(low - reach, high + reach, self.grid_size)
        step = self.grid[1] - self.grid[0]
        if self.width < step:
            if self.bandwidth is not None:
                raise ValueError(f"bandwidth {self.width:g} N m is below the grid step {step:g} N m")
            self.width = float(step)
        kernel = np.exp(-0.5 * ((self.grid[:, None] - self.grid[None, :]) / self.width) ** 2)
        # Each node's kernel is normalised on the grid, so that no probability is lost near its ends.
        self.kernel = kernel / kernel.sum(axis=0)
        self.nominal = self.estimate_mass(torque)

    def estimate_mass(self, torque: Array) -> Array:
        """Estimate the probability of each grid node, including the uniform part; they add up to 1.

        Parameters
        ----------
        torque : array (N,)
            Torque samples [N m].
        """
        nodes = self.grid_size
        position = (torque - self.grid[0]) / (self.grid[1] - self.grid[0])
        position = np.clip(position, 0, nodes - 1)
        left = np.minimum(position.astype(np.int64), nodes - 2)
        weight = position - left
        mass = np.bincount(left, 1 - weight, nodes) + np.bincount(left + 1, weight, nodes)
        return (1 - self.floor) * (self.kernel @ mass) / len(torque) + self.floor / nodes

    def test_quantity(self, batch: Batch) -> float:
        """Return the symmetrised Kullback-Leibler divergence [nat], at least 0."""
        torque = batch.tau[:, self.axis]
        if not np.isfinite(torque).all():
            raise ValueError("the batch holds torque samples that are not finite")
        mass = self.estimate_mass(torque)
        return float(np.sum((mass - self.nominal) * np.log(mass / self.nominal)))


def _silverman(sample: Array) -> float:
    """Return the bandwidth by Silverman's rule of thumb (Density Estimation, 1986, eq. 3.31)."""
    quartiles = np.percentile(sample, [25, 75])
    spread = [float(sample.std(ddof=1)), float(quartiles[1] - quartiles[0]) / 1.34]
    return 0.9 * min(value for value in spread if value > 0) * len(sample) ** -0.2


DETECTOR = DistributionDistance
