"""Friction as a smooth function of temperature of which nothing else is known.

What a joint's friction gains from one temperature to another is a Gaussian process with the squared
exponential kernel, written in its features about the reference's mean temperature (Rasmussen and Williams
2006, sec. 4.3). Where the reference shows temperatures, its runs determine the function there and a little
beyond; where it shows none, the prior is all that is known, and a change of friction cannot be told from one
of temperature.
"""

import math

import numpy as np

#: Temperature [K] over which friction changes its slope: viscosities fall by e in 16 to 40 K.
LENGTH = 25.0
#: Prior standard deviation of the slope, as a share of the joint's friction [1/K].
SLOPE = 0.03
#: Standard deviation [K] of a temperature that nobody recorded.
UNRECORDED = 10.0
#: Features: beyond these nothing is left within two lengths of the mean.
_ORDERS = 8


def count_features() -> int:
    """Number of features of one function of temperature."""
    return _ORDERS


def temperature_features(temperature: np.ndarray, mean: float) -> np.ndarray:
    """Features (N, k) of a temperature (N,) [deg C], zero at `mean`, whose weights are standard normal.

    Their sum with such weights is the change of friction, as a share of it.
    """
    x = (temperature - mean) / LENGTH
    bell = np.exp(-0.5 * x**2)
    powers = [bell * x**p / math.sqrt(math.factorial(p)) for p in range(1, _ORDERS)]
    return SLOPE * LENGTH * np.column_stack([bell - 1.0, *powers])
