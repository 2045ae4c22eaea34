"""Alarm threshold for a wanted false-alarm rate, wear that a value indicates, scatter of the machine.

The panel, all detectors of the study at every moving joint, is fitted once and then applied to each batch.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from wearscope import plugins
from wearscope.detectors.base import Array, Batch, Detector, make_detector
from wearscope.detectors.questions import Answer, DetectorSpec, ask_detector
from wearscope.errors import tell_error
from wearscope.robots.model import RobotModel

#: Number of wear levels at which the density of the wear is evaluated.
_GRID = 401
#: Fewest sessions of nominal recordings from which the machine's scatter is taken.
LEAST_NOMINAL = 3


@dataclass(frozen=True)
class Threshold:
    """Alarm threshold from runs without wear.

    Attributes
    ----------
    value : float
        A test quantity at or above it is an alarm.
    rate_low, rate_high : float
        95 % interval of its false-alarm rate, for any distribution of y.
    """

    value: float
    rate_low: float
    rate_high: float


def least_runs(p_f: float) -> int:
    """Fewest runs without wear that give a threshold with a false-alarm rate of at most `p_f`."""
    return int(np.ceil(1.0 / p_f - 1e-9)) - 1


def find_threshold(y: Array, p_f: float) -> Threshold:
    """Threshold whose mean false-alarm rate is at most the wanted one, from n runs without wear.

    It is the k-th largest value, k = floor((n + 1) p_f): a further run of the same kind reaches it with
    probability k / (n + 1) at most, whatever the distribution (Wilks, Ann. Math. Statist. 12, 1941); the
    rate of the threshold found scatters as Beta(k, n + 1 - k).

    Parameters
    ----------
    y : ndarray (n,)
        Finite test quantities of the runs; n is at least `least_runs`.
    p_f : float
    """
    n = len(y)
    k = int(np.floor((n + 1) * p_f + 1e-9))

    low, high = stats.beta.ppf([0.025, 0.975], k, n + 1 - k)
    return Threshold(float(np.sort(y)[n - k]), float(low), float(high))


def find_p_value(value: float, y: Array) -> float:
    """Probability that a run without wear gives at least `value`, from runs (n,); NaN without runs.

    It is 1 / (n + 1) or more.
    """
    if not len(y):
        return float("nan")
    return float((1 + np.sum(y >= value)) / (len(y) + 1))


def find_detected_wear(wear: Array, y: Array, threshold: float, p_d: float) -> float:
    """Smallest wear from which on at least a share `p_d` of the simulated runs reach the threshold.

    Parameters
    ----------
    wear, y : ndarray (n,)
    threshold, p_d : float

    Returns
    -------
    float
        NaN where not even the most worn run reaches it.
    """
    order = np.argsort(-wear, kind="stable")
    hits = np.cumsum(y[order] >= threshold) / np.arange(1, len(order) + 1)
    short = np.flatnonzero(hits < p_d)
    count = short[0] if len(short) else len(order)
    return float(wear[order[count - 1]]) if count else float("nan")


class WearScale:
    """Wear that a value of the test quantity indicates, from simulated runs of known wear.

    The mean of y is a cubic in the wear and its standard deviation a straight line, both by least squares.
    The density of the wear that belongs to a value follows by Bayes' rule from a uniform prior over the
    simulated range.

    Parameters
    ----------
    wear, y : ndarray (n,)
    widening : float
        Factor by which the machine scatters more than the simulation.
    """

    def __init__(self, wear: Array, y: Array, widening: float = 1.0) -> None:
        self.top = float(wear.max())
        self.grid = np.linspace(0.0, self.top, _GRID)
        mean = np.polynomial.Polynomial.fit(wear, y, 3)
        away = np.abs(y - mean(wear))
        spread = np.polynomial.Polynomial.fit(wear, away, 1)
        # The standard deviation of a normal variable is sqrt(pi / 2) times its mean magnitude.
        least = max(0.1 * float(away.mean()), 1e-12 * float(np.abs(y).max()), 1e-300)
        self.mean = mean(self.grid)
        self.deviation = widening * np.sqrt(np.pi / 2) * np.maximum(spread(self.grid), least)

    def read(self, value: float, level: float = 0.95) -> tuple[float, float, float]:
        """Median and central interval of the wear that a value indicates.

        A value beyond those of all simulated wear indicates the nearest end of the range of wear.
        """
        log = -0.5 * ((value - self.mean) / self.deviation) ** 2 - np.log(self.deviation)
        weight = np.exp(log - log.max())
        share = np.cumsum(weight) - 0.5 * weight
        at = np.interp([0.5, 0.5 - level / 2, 0.5 + level / 2], share / weight.sum(), self.grid)
        return float(at[0]), float(at[1]), float(at[2])


@dataclass(frozen=True)
class Scatter:
    """Scatter of the machine's nominal test quantities, compared with the simulated ones'.

    Attributes
    ----------
    ratio : float
        RMS distance of the machine's values from the simulated median, over that of the simulated values.
    widening : float
        Factor on the distance of simulated values from their median, with which they scatter as the machine's
        values do; NaN where fewer than `LEAST_NOMINAL` of the machine's values are independent.
    """

    ratio: float
    widening: float


def measure_distances(machine: Array, simulated: Array) -> Array:
    """Distances of the machine's values (m,) from the simulated median, over the simulated values' RMS."""
    if not len(machine) or not len(simulated):
        return np.zeros(0)
    away = simulated - np.median(simulated)
    usual = float(np.sqrt(np.mean(away**2)))
    return (machine - np.median(simulated)) / usual if usual > 0 else np.full(len(machine), np.nan)


def compare_scatter(distances: Array, independent: int, p_f: float) -> Scatter:
    """Scatter of the machine's nominal test quantities, from their distances.

    The widening is the ratio, or 1 if that is larger, times the quantile 1 - `p_f` of Student's t over that
    of the normal distribution: a scatter that is known from few sessions predicts a further value less
    surely.

    Parameters
    ----------
    distances : ndarray (m,)
        Distances from `measure_distances`, over all motions.
    independent : int
        Number of independent distances: of the sessions in which they were recorded.
    p_f : float
    """
    ratio = float(np.sqrt(np.mean(distances**2))) if len(distances) else float("nan")
    if independent < LEAST_NOMINAL or not np.isfinite(ratio):
        return Scatter(ratio, float("nan"))
    unsure = float(stats.t.isf(p_f, independent) / stats.norm.isf(p_f)) if p_f < 0.5 else 1.0
    return Scatter(ratio, max(ratio, 1.0) * unsure)


def widen(values: Array, middle: Array | float, widening: float) -> Array:
    """Values with their distances from `middle` times `widening`; unchanged where that is NaN."""
    return values if np.isnan(widening) else middle + widening * (values - middle)


#: Joint and name of a detector.
Cell = tuple[str, str]


@dataclass
class Panel:
    """Detectors fitted to the same nominal batches.

    Attributes
    ----------
    fitted : dict
        Detector by joint and name.
    unfitted : dict
        Reason why a detector could not be fitted, by joint and name.
    """

    fitted: dict[Cell, Detector] = field(default_factory=dict)
    unfitted: dict[Cell, str] = field(default_factory=dict)

    def ask(self, batch: Batch) -> dict[Cell, Answer]:
        """Test quantity and status by joint and detector; NaN where a detector fails."""
        return {
            **{cell: (math.nan, f"cannot be fitted: {told}") for cell, told in self.unfitted.items()},
            **{
                (joint, name): ask_detector(detector, batch, f"fda '{name}', joint '{joint}'")
                for (joint, name), detector in self.fitted.items()
            },
        }


def fit_panel(
    specs: Sequence[DetectorSpec],
    joints: Mapping[str, int],
    nominal: Sequence[Batch],
    model: RobotModel,
) -> Panel:
    """Fit every detector at every joint.

    Parameters
    ----------
    specs : sequence of DetectorSpec
    joints : mapping of str to int
        Column of each joint to test.
    nominal : sequence of Batch
    model : RobotModel

    Raises
    ------
    InputError
        Where a detector cannot be made; one that cannot be fitted is left out, with its reason.
    """
    panel = Panel()
    factories = [plugins.load(spec.reference, "detectors", "DETECTOR") for spec in specs]
    for joint, column in joints.items():
        for spec, factory in zip(specs, factories, strict=True):
            detector = make_detector(factory, spec.reference, spec.options)
            try:
                detector.fit(nominal, column, model)
            except (Exception, SystemExit) as error:
                panel.unfitted[joint, spec.name] = tell_error(error)
            else:
                panel.fitted[joint, spec.name] = detector
    return panel


def read_units(panel: Panel, torque_units: Mapping[str, str]) -> dict[Cell, str]:
    """Unit of each test quantity: the detector's `unit`, where ``torque`` is the joint's; else empty."""
    units = {}
    for (joint, name), detector in panel.fitted.items():
        unit = str(getattr(detector, "unit", ""))
        units[joint, name] = torque_units[joint] if unit == "torque" else unit
    return units
