"""Which kind of surrogate a cell takes: chosen by cross-validation on the training runs alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import special

from wearscope.surrogates.kinds.base import FittedSurrogate, model_fit, pure_error
from wearscope.surrogates.kinds.gaussian_process import (
    BENT_GAUSSIAN_PROCESS,
    GAUSSIAN_PROCESS,
    SHAPES,
    GaussianProcess,
    fit_gaussian_process,
)
from wearscope.surrogates.kinds.linear import (
    POLYNOMIAL_CHAOS,
    QUADRATIC,
    fit_polynomial_chaos,
    fit_quadratic,
    rebuild_polynomial_chaos,
)

Array = NDArray[np.float64]
KINDS = (QUADRATIC, POLYNOMIAL_CHAOS, GAUSSIAN_PROCESS, BENT_GAUSSIAN_PROCESS)
CONSTANT = "constant"
CHOSEN = "chosen"
#: Cross-validated fit [%] above which neither polynomial chaos nor a bent process is tried.
ENOUGH = 98.0
#: Fit [%] by which a polynomial must be better than a Gaussian process to be taken.
MARGIN = 1.0
#: Largest number of factors off nominal on the lines that the scope asks about: the fault and one nuisance.
OFF = 2
#: Fewest runs on these lines that give them a spread of their own. A quantile would need many more runs, so
#: the spread is the root mean square of the left-out errors in units of their stated deviation.
FEWEST = 10
_CONSTANT = 1e-12


@dataclass(frozen=True)
class ChosenSurrogate:
    """The surrogate that answers a cell's questions.

    Attributes
    ----------
    fitted : FittedSurrogate or None
        None where y is always the same.
    names : tuple of str
        Factor names, in column order.
    spread : float
        By what the surrogate's own standard deviations are multiplied, so that 95 % of the left-out training
        values lie in their 95 % intervals.
    constant : float
        y where it is always the same, else NaN.
    spread_asked : float
        The same where the scope asks: at points with at most `OFF` factors off nominal.
    nominal : tuple of float
        Coded nominal levels; empty where `spread` holds everywhere.
    """

    fitted: FittedSurrogate | None
    names: tuple[str, ...]
    spread: float = 1.0
    constant: float = np.nan
    spread_asked: float = np.nan
    nominal: tuple[float, ...] = ()

    @property
    def kind(self) -> str:
        """Name of the kind."""
        return CONSTANT if self.fitted is None else self.fitted.kind

    @property
    def status(self) -> str:
        """``constant`` or ``ok``."""
        return CONSTANT if self.fitted is None else "ok"

    @property
    def noise(self) -> float:
        """Standard deviation of one run about the response, as the surrogate estimates it."""
        return 0.0 if self.fitted is None else self.fitted.noise

    def spread_at(self, z: ArrayLike) -> Array:
        """Factor on the standard deviations at coded levels (M, n), shape (M,)."""
        if not self.nominal:
            return np.full(len(np.atleast_2d(z)), self.spread)
        return np.where(is_asked(z, self.nominal), self.spread_asked, self.spread)

    @property
    def sigma(self) -> float:
        """Standard deviation of one run about the surrogate, widened by `spread`."""
        return self.spread * self.noise

    def predict(self, z: ArrayLike) -> Array:
        """Mean response at coded levels (M, n), shape (M,)."""
        if self.fitted is None:
            return np.full(len(np.atleast_2d(z)), self.constant)
        if isinstance(self.fitted, GaussianProcess):
            return self.fitted.predict_mean(z)
        return self.fitted.predict(z)[0]

    def standard_error(self, z: ArrayLike) -> Array:
        """Standard deviation of the mean response at coded levels (M, n), shape (M,)."""
        if self.fitted is None:
            return np.zeros(len(np.atleast_2d(z)))
        return self.spread_at(z) * self.fitted.predict(z)[1]

    def prediction_interval(self, z: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Interval that holds one new run with probability `level`, low and high (M,)."""
        value = self.predict(z)
        noise = self.spread_at(z) * self.noise
        half = special.ndtri(0.5 + level / 2) * np.hypot(self.standard_error(z), noise)
        return value - half, value + half

    def draw(self, z: ArrayLike, rng: np.random.Generator, draws: int) -> Array:
        """Response functions that the runs allow, shape (draws, M), their scatter widened by `spread`."""
        if self.fitted is None:
            return np.full((draws, len(np.atleast_2d(z))), self.constant)
        mean = self.predict(z)
        return mean + self.spread_at(z) * (self.fitted.draw(z, rng, draws) - mean)


def choose_surrogate(
    z: Array,
    y: Array,
    names: Sequence[str],
    nominal: Mapping[str, float],
    kinds: Sequence[str] = KINDS,
) -> tuple[ChosenSurrogate, dict[str, float]]:
    """Surrogate of the best cross-validated fit; a Gaussian process where it is less than `MARGIN` behind.

    The intervals of a polynomial ignore what its terms cannot express; those of a process include it.

    Parameters
    ----------
    z, y : array (N, n), (N,)
        Training runs, finite.
    names : sequence of str, (n,)
    nominal : mapping of str to float
        Coded nominal levels; the factor of the shortest length may be bent at its own.
    kinds : sequence of str
        Those of `KINDS` that are tried.

    Returns
    -------
    chosen : ChosenSurrogate
    fits : dict of str to float
        Fit (6) [%] of the left-out predictions by kind that was tried and could be fitted; that of a
        polynomial chaos that is behind even where it is flattered, flattered.
    """
    fits: dict[str, float] = {}
    if np.ptp(y) <= _CONSTANT * np.abs(y).max():
        return ChosenSurrogate(None, tuple(names), 1.0, float(y[0])), fits
    squares, freedom = pure_error(z, y)
    noise = float(np.sqrt(squares / freedom)) if freedom else 0.0
    tried: list[tuple[float, FittedSurrogate]] = []

    def consider(fitted: FittedSurrogate | None) -> None:
        if fitted is not None:
            fit = model_fit(y, fitted.left_out)
            fits[fitted.kind] = max(fit, fits.get(fitted.kind, -np.inf))
            tried.append((fit + (MARGIN if isinstance(fitted, GaussianProcess) else 0.0), fitted))

    if QUADRATIC in kinds:
        consider(fit_quadratic(z, y, names))
    process = fit_gaussian_process(z, y, noise) if GAUSSIAN_PROCESS in kinds else None
    consider(process)
    if POLYNOMIAL_CHAOS in kinds and max(fits.values(), default=-np.inf) < ENOUGH:
        consider(fit_polynomial_chaos(z, y, max((merit for merit, _ in tried), default=-np.inf)))
    if process is not None and BENT_GAUSSIAN_PROCESS in kinds and max(fits.values()) < ENOUGH:
        column = int(np.argmin(process.parameters["log_lengths"]))
        for shape in SHAPES:
            consider(fit_gaussian_process(z, y, noise, column, nominal[names[column]], shape, process))
    if not tried:
        raise ValueError(f"{len(y)} runs are too few for any of the kinds {', '.join(kinds)}")
    _, best = max(tried, key=lambda one: one[0])
    levels = tuple(float(nominal[name]) for name in names)
    spread = calibrate_spread(best, y)
    asked = is_asked(z, levels)
    if asked.sum() < FEWEST:
        return ChosenSurrogate(best, tuple(names), spread), fits
    ratio = ((y - best.left_out) / best.left_out_deviation)[asked]
    # A standard deviation from few values takes the quantile of Student's t in place of the normal one.
    few = special.stdtrit(len(ratio), 0.975) / special.ndtri(0.975)
    there = float(few * np.sqrt(np.mean(ratio**2)))
    return ChosenSurrogate(best, tuple(names), spread, np.nan, there, levels), fits


def is_asked(z: ArrayLike, nominal: Sequence[float]) -> NDArray[np.bool_]:
    """Which coded points (M, n) lie on the lines that the scope asks about: at most `OFF` factors vary."""
    off = np.abs(np.atleast_2d(np.asarray(z, dtype=float)) - np.asarray(nominal)) > 1e-9
    return off.sum(axis=1) <= OFF


def calibrate_spread(fitted: FittedSurrogate, y: Array) -> float:
    """Factor on the standard deviations that brings 95 % of the left-out values into their intervals.

    The split-conformal quantile of |y - left out| / deviation over that of a normal distribution.
    """
    ratio = np.sort(np.abs(y - fitted.left_out) / fitted.left_out_deviation)
    place = min(int(np.ceil(0.95 * (len(ratio) + 1))), len(ratio))
    return float(ratio[place - 1] / special.ndtri(0.5 + 0.95 / 2))


def rebuild_surrogate(
    kind: str,
    parameters: Mapping[str, Any],
    spread: float,
    z: Array,
    y: Array,
    names: Sequence[str],
    spread_asked: float = np.nan,
    nominal: Sequence[float] = (),
) -> ChosenSurrogate:
    """The surrogate that was chosen, from its kind, parameters and training runs, without any search.

    Raises
    ------
    ValueError
        Where the runs are not those that it was chosen on.
    """
    if kind == CONSTANT:
        return ChosenSurrogate(None, tuple(names), spread, float(y[0]))
    fitted: FittedSurrogate | None
    if kind == QUADRATIC:
        fitted = fit_quadratic(z, y, names)
    elif kind == POLYNOMIAL_CHAOS:
        fitted = rebuild_polynomial_chaos(z, y, dict(parameters))
    else:
        fitted = GaussianProcess(z, y, dict(parameters))
    if fitted is None:
        raise ValueError(f"{len(y)} runs do not determine the {kind} that was chosen")
    levels = () if np.isnan(spread_asked) else tuple(map(float, nominal))
    return ChosenSurrogate(fitted, tuple(names), spread, np.nan, spread_asked, levels)
