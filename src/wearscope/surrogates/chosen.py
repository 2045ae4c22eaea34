"""Choice of each cell's surrogate by cross-validation on the training runs, and the table of the choices.

The table states kind, fit, noise ceiling, number of points and state of each surrogate.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from scipy import special

from wearscope.designs.factors import Factor, nominal_levels
from wearscope.errors import InputError
from wearscope.surrogates.fitting import (
    CELL,
    IDENTIFICATION,
    VALIDATION,
    Surrogate,
    cell_name,
    cells_of,
    factor_columns,
    surrogates_of,
    usable_points,
)
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
#: Fit [%] by which a polynomial must be better than a Gaussian process to be chosen.
MARGIN = 1.0
#: The scope uses points at which at most this many factors differ from nominal: the fault and one nuisance.
OFF = 2
#: Fewest training runs at such points for a spread of their own. It is the root mean square of the
#: cross-validation errors in units of their stated deviation, as a quantile would need many more runs.
FEWEST = 10
#: A test quantity counts as constant where it varies by at most this share of its magnitude.
_CONSTANT = 1e-12


@dataclass(frozen=True)
class ChosenSurrogate:
    """The chosen surrogate of a cell.

    Attributes
    ----------
    fitted : FittedSurrogate or None
        None where y is constant.
    names : tuple of str
        Factor names, in column order.
    spread : float
        Factor on the surrogate's own standard deviations. With it, 95 % of the training values lie in the 95
        % intervals of their cross-validated predictions.
    constant : float
        Value of a constant y, else NaN.
    spread_asked : float
        As `spread`, for points that the scope uses: at most `OFF` factors differ from nominal.
    nominal : tuple of float
        Coded nominal levels; empty where `spread` applies everywhere.
    """

    fitted: FittedSurrogate | None
    names: tuple[str, ...]
    spread: float = 1.0
    constant: float = np.nan
    spread_asked: float = np.nan
    nominal: tuple[float, ...] = ()

    @property
    def kind(self) -> str:
        """Kind of surrogate, one of `KINDS` or ``constant``."""
        return CONSTANT if self.fitted is None else self.fitted.kind

    @property
    def status(self) -> str:
        """``constant`` or ``ok``."""
        return CONSTANT if self.fitted is None else "ok"

    @property
    def noise(self) -> float:
        """Standard deviation of one run about the response, as the surrogate itself estimates it."""
        return 0.0 if self.fitted is None else self.fitted.noise

    def spread_at(self, z: ArrayLike) -> Array:
        """Return the factor (M,) on the standard deviations at coded levels (M, n)."""
        if not self.nominal:
            return np.full(len(np.atleast_2d(z)), self.spread)
        return np.where(is_asked(z, self.nominal), self.spread_asked, self.spread)

    @property
    def sigma(self) -> float:
        """Standard deviation of one run about the response, times `spread`."""
        return self.spread * self.noise

    def predict(self, z: ArrayLike) -> Array:
        """Return the mean response (M,) at coded levels (M, n)."""
        if self.fitted is None:
            return np.full(len(np.atleast_2d(z)), self.constant)
        if isinstance(self.fitted, GaussianProcess):
            return self.fitted.predict_mean(z)
        return self.fitted.predict(z)[0]

    def standard_error(self, z: ArrayLike) -> Array:
        """Return the standard deviation (M,) of the mean response at coded levels (M, n)."""
        if self.fitted is None:
            return np.zeros(len(np.atleast_2d(z)))
        return self.spread_at(z) * self.fitted.predict(z)[1]

    def prediction_interval(self, z: ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
        """Return the ends (M,) of the interval that contains one new run with probability `level`."""
        value = self.predict(z)
        noise = self.spread_at(z) * self.noise
        half = special.ndtri(0.5 + level / 2) * np.hypot(self.standard_error(z), noise)
        return value - half, value + half

    def draw(self, z: ArrayLike, rng: np.random.Generator, draws: int) -> Array:
        """Draw response functions (draws, M) from the surrogate's uncertainty, which `spread` scales."""
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
    """Choose the surrogate with the best cross-validated fit; a Gaussian process gets `MARGIN` as a bonus.

    The reason is that the intervals of a polynomial ignore what its terms cannot express. Those of a process
    include it.

    Parameters
    ----------
    z, y : array (N, n), (N,)
        Training runs; all values are finite.
    names : sequence of str, (n,)
    nominal : mapping of str to float
        Coded nominal levels. A bent process bends the factor with the shortest length scale at its nominal
        level.
    kinds : sequence of str
        Kinds to try, of `KINDS`.

    Returns
    -------
    chosen : ChosenSurrogate
    fits : dict of str to float
        Fit (6) [%] of the cross-validated predictions, by kind that could be fitted. Polynomial chaos has an
        optimistic value where even that is worse than the others (see `fit_polynomial_chaos`).
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
    # The standard deviation comes from few values, so Student's t replaces the normal distribution.
    few = special.stdtrit(len(ratio), 0.975) / special.ndtri(0.975)
    there = float(few * np.sqrt(np.mean(ratio**2)))
    return ChosenSurrogate(best, tuple(names), spread, np.nan, there, levels), fits


def is_asked(z: ArrayLike, nominal: Sequence[float]) -> NDArray[np.bool_]:
    """Return which coded points (M, n) are of the kind that the scope uses: at most `OFF` factors vary."""
    off = np.abs(np.atleast_2d(np.asarray(z, dtype=float)) - np.asarray(nominal)) > 1e-9
    return off.sum(axis=1) <= OFF


def calibrate_spread(fitted: FittedSurrogate, y: Array) -> float:
    """Return the factor on the standard deviations by which 95 % of the values lie in their intervals.

    The intervals are those of cross-validated predictions. The factor is the split-conformal quantile of
    |y - prediction| / deviation over the quantile of a normal distribution.
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
    """Build the chosen surrogate again from its kind, parameters and training runs, without a search.

    Raises
    ------
    ValueError
        Where the runs do not determine it, so that they are not those of the choice.
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


FILLING = "filling"
CHECKING = "checking"
#: Sets whose runs a chosen surrogate learns from; the runs of `CHECKING` are used for no fit and no choice.
TRAINING = (IDENTIFICATION, VALIDATION, FILLING)


def training_runs(
    cell: pd.DataFrame, names: Sequence[str], max_failed_share: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return the coded levels (N, n) and values (N,) of a cell's training runs, sorted by set and point."""
    rows = cell[cell["set"].isin(TRAINING)].sort_values(["set", "point"])
    key = tuple(rows[CELL].iloc[0]) if len(rows) else ()
    good = usable_points(rows, key, max_failed_share)
    return good[list(names)].to_numpy(dtype=float), good["y"].to_numpy(dtype=float)


def noise_ceiling(y: np.ndarray, squares: float, freedom: int) -> tuple[float, float]:
    """Return the fit (6) [%] that a perfect surrogate would have, as noise limits it, and its lower bound.

    Parameters
    ----------
    y : array (M,)
        Runs on which the fit is computed.
    squares, freedom : float, int
        Sum of squares and degrees of freedom of the noise, from replicated runs.

    Returns
    -------
    ceiling, low : float
        Fit [%], and its lower end by the uncertainty of the noise (95 %). Both are NaN without replicates or
        where y is constant.
    """
    if freedom < 1 or len(y) < 2 or np.ptp(y) == 0:
        return np.nan, np.nan
    deviation = float(np.sqrt(np.mean((y - y.mean()) ** 2)))
    largest = squares / special.chdtri(freedom, 0.95)
    return (
        100.0 * (1.0 - float(np.sqrt(squares / freedom)) / deviation),
        100.0 * (1.0 - float(np.sqrt(largest)) / deviation),
    )


def choose_surrogates(
    test_quantities: pd.DataFrame,
    factors: Sequence[Factor],
    kinds: Sequence[str] = KINDS,
    goal: float = 95.0,
    max_failed_share: float = 0.05,
) -> pd.DataFrame:
    """Choose a surrogate for every cell, and compute its fit on the checking runs.

    Parameters
    ----------
    test_quantities : DataFrame
        Test quantities of the sets `TRAINING` and ``checking`` with coded factors; the factor ``f`` is the
        wear of the cell's own axis.
    factors : sequence of Factor
    kinds : sequence of str
    goal : float
        Wanted fit [%].
    max_failed_share : float
        Largest share of NaN test quantities in a cell.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``; ``kind``; ``fit`` [%] (6) on the checking runs; ``ceiling``
        and ``ceiling_low`` [%], see `noise_ceiling`; ``state``: ``reached`` (fit >= goal), ``at ceiling``
        (the noise explains the rest), ``short`` (neither) or ``constant``; ``noise`` (standard deviation of a
        run, from replicates), ``inside`` (share of the checking runs in their 95 % intervals), ``spread`` and
        ``spread_asked`` (see `wearscope.surrogates.chosen.ChosenSurrogate`), ``nominal``, ``n_points``,
        ``n_checking``, ``n_failed``, the cross-validated fit ``left_out_<kind>`` of each kind, and
        ``parameters`` (JSON), from which `read_chosen` builds the surrogate again.

    Raises
    ------
    InputError
        Where there are no checking runs, too many runs failed, or too few remain for any fit.
    """
    names = factor_columns(test_quantities)
    nominal = nominal_levels(factors)
    if not (test_quantities["set"] == CHECKING).any():
        raise InputError("test quantities: no row has the set 'checking'; run the checking points.")
    records = []
    for key, cell in cells_of(test_quantities):
        z, y = training_runs(cell, names, max_failed_share)
        rows = cell[cell["set"] == CHECKING].sort_values("point")
        good = usable_points(rows, key, max_failed_share)
        z_new, y_new = good[names].to_numpy(dtype=float), good["y"].to_numpy(dtype=float)
        try:
            chosen, fits = choose_surrogate(z, y, names, nominal, kinds)
        except ValueError as error:
            raise InputError(f"cell {cell_name(key)}: {error}; add points.") from error
        squares, freedom = pure_error(z, y)
        fit = model_fit(y_new, chosen.predict(z_new))
        ceiling, lowest = noise_ceiling(y_new, squares, freedom)
        low, high = chosen.prediction_interval(z_new)
        records.append(
            {
                **dict(zip(CELL, key, strict=True)),
                "kind": chosen.kind,
                "fit": fit,
                "ceiling": ceiling,
                "ceiling_low": lowest,
                "state": _state(chosen, fit, lowest, goal),
                "noise": float(np.sqrt(squares / freedom)) if freedom else np.nan,
                "inside": float(np.mean((y_new >= low) & (y_new <= high))) if len(y_new) else np.nan,
                "spread": chosen.spread,
                "spread_asked": chosen.spread_asked,
                "nominal": list(chosen.nominal),
                "n_points": len(y),
                "n_checking": len(y_new),
                "n_failed": int((~np.isfinite(cell["y"].to_numpy(dtype=float))).sum()),
                **{f"left_out_{kind}": fits.get(kind, np.nan) for kind in KINDS},
                "parameters": json.dumps({} if chosen.fitted is None else chosen.fitted.parameters),
            }
        )
    return pd.DataFrame(records)


def _state(chosen: ChosenSurrogate, fit: float, lowest: float, goal: float) -> str:
    """Return the state of a surrogate: ``constant``, ``reached``, ``at ceiling`` or ``short``."""
    if chosen.fitted is None:
        return "constant"
    if fit >= goal:
        return "reached"
    return "at ceiling" if fit >= lowest else "short"


def read_chosen(
    chosen: pd.DataFrame, test_quantities: pd.DataFrame
) -> Iterator[tuple[tuple, ChosenSurrogate]]:
    """Yield key (robot, cycle, axis, fda) and chosen surrogate of each cell, in sorted order.

    Parameters
    ----------
    chosen : DataFrame
        From `choose_surrogates`.
    test_quantities : DataFrame
        Test quantities on which the choice was made.

    Raises
    ------
    InputError
        Where a cell has no training runs, or another number of them than at the choice.
    """
    names = factor_columns(test_quantities)
    cells = dict(cells_of(test_quantities))
    for row in chosen.sort_values(CELL).to_dict("records"):
        key = tuple(row[name] for name in CELL)
        if key not in cells:
            raise InputError(f"cell {cell_name(key)}: it has no test quantities; make them again.")
        z, y = training_runs(cells[key], names)
        if len(y) != row["n_points"]:
            raise InputError(
                f"cell {cell_name(key)}: its surrogate was chosen on {row['n_points']} runs, but there are "
                f"{len(y)}; choose the surrogates again."
            )
        parameters = json.loads(row["parameters"])
        spreads = float(row["spread"]), float(row["spread_asked"])
        yield (
            key,
            rebuild_surrogate(
                row["kind"], parameters, spreads[0], z, y, names, spreads[1], list(row["nominal"])
            ),
        )


def read_cells(
    model: str, test_quantities: pd.DataFrame, surrogates: pd.DataFrame, chosen: pd.DataFrame | None
) -> list[tuple[tuple, ChosenSurrogate | Surrogate]]:
    """Return key (robot, cycle, axis, fda) and surrogate of each cell, in sorted order.

    Parameters
    ----------
    model : str
        ``chosen``, or the name of a quadratic model.
    test_quantities, surrogates : DataFrame
    chosen : DataFrame or None
        Needed where `model` is ``chosen``.

    Raises
    ------
    InputError
        Where the table has no such model, or no surrogate was chosen.
    """
    if model != CHOSEN:
        return [(key[:4], one) for key, one in surrogates_of(surrogates, model)]
    if chosen is None:
        raise InputError("surrogates: none was chosen; set surrogates.filling.enabled, or ask another model.")
    return list(read_chosen(chosen, test_quantities))


def read_noise(chosen: pd.DataFrame) -> dict[tuple, float]:
    """Return the standard deviation of a run by cell (robot, cycle, axis, fda); NaN without replicates."""
    return {tuple(row[name] for name in CELL): float(row["noise"]) for row in chosen.to_dict("records")}
