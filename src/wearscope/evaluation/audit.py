"""Audit of surrogates by direct simulation: choice of points, comparison, and withholding of answers.

A detector's answer is withheld where audit, scope and SNR together contradict its surrogate.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import scipy
from numpy.typing import NDArray
from scipy import special

from wearscope.designs.bases import model_matrix
from wearscope.designs.factors import (
    CODED_HIGH,
    CODED_LOW,
    FAULT,
    Factor,
    check_factors,
    nominal_levels,
    worn_factor,
)
from wearscope.designs.kinds import design_table, generator_for
from wearscope.errors import InputError
from wearscope.evaluation.grouping import wilson_interval
from wearscope.evaluation.scope import choose_method
from wearscope.surrogates.chosen import CHOSEN, ChosenSurrogate
from wearscope.surrogates.fitting import CELL, Surrogate, cell_name, cells_of, surrogates_of

#: An answer is withheld where the pooled p-value of the comparison is below this: a correct surrogate would
#: hardly ever differ as much from direct simulation.
CONTRADICTED = 0.001
#: Where the p-value is below this, more points are simulated before anything is withheld.
CLOSE = 0.05


def draw_runs(
    surrogate: Surrogate | ChosenSurrogate, z: NDArray[np.float64], rng: np.random.Generator, draws: int
) -> NDArray[np.float64]:
    """Draw values of new runs (draws, M) at coded levels (M, n) from a surrogate's uncertainty and noise.

    A draw uses one response function for all points, so that its errors at nearby points are correlated.
    """
    if isinstance(surrogate, ChosenSurrogate):
        mean, noise = surrogate.draw(z, rng, draws), surrogate.spread_at(z) * surrogate.noise
    else:
        terms = model_matrix(z, surrogate.names, surrogate.terms)
        mean = surrogate.draw_coefficients(rng, draws) @ terms.T
        noise = np.full(len(z), surrogate.sigma)
    return np.asarray(mean + noise * rng.standard_normal(mean.shape))


def weigh_evidence(
    audit: pd.DataFrame, verdicts: pd.DataFrame | None = None, direct: pd.DataFrame | None = None
) -> pd.DataFrame:
    """Decide which detectors' answers are given, and which are withheld.

    Direct simulation tests three things. Do more values lie outside their 95 % intervals than chance
    explains? (The errors of one surrogate are correlated, which the test allows for.) Do the scope's verdicts
    disagree more often than chance explains? Does the SNR differ? The three p-values are pooled by the Cauchy
    combination, which is valid however the tests depend on each other. So one unlucky test of three withholds
    nothing.

    Parameters
    ----------
    audit : DataFrame
        From `wearscope.evaluation.audit.audit_table`.
    verdicts : DataFrame, optional
        From `wearscope.evaluation.audit.audit_verdicts`.
    direct : DataFrame, optional
        From `wearscope.evaluation.snr.direct_table`.

    Returns
    -------
    DataFrame
        ``fda``, ``model``, ``n``, ``n_inside``, ``share_inside``, ``share_low``, ``share_high``;
        p-values ``p_audit``, ``p_scope``, ``p_direct``, NaN for a test that was not made; ``p``, the pooled
        p-value; ``close``, whether it is below `CLOSE`; ``answer``: ``given``, ``withheld`` where it is below
        `CONTRADICTED`, or ``not audited`` where every audited value failed.

    References
    ----------
    Liu, Y. and Xie, J. (2020). Cauchy combination test. Journal of the American Statistical Association.
    """
    records = []
    for (fda, model), rows in audit.groupby(["fda", "model"], sort=True, observed=True):
        good = rows[~rows["failed"]]
        inside, count = int(good["inside"].sum()), len(good)
        low, high = wilson_interval(inside, count)
        found = {
            "p_audit": _test_coverage(good),
            "p_scope": _test_verdicts(verdicts[verdicts["fda"] == fda]) if verdicts is not None else np.nan,
            "p_direct": _test_snr(direct[direct["fda"] == fda]) if direct is not None else np.nan,
        }
        pooled = combine(np.array(list(found.values())))
        answer = "withheld" if pooled < CONTRADICTED else "given"
        records.append(
            {
                "fda": fda,
                "model": model,
                "n": count,
                "n_inside": inside,
                "share_inside": inside / count if count else np.nan,
                "share_low": low,
                "share_high": high,
                **found,
                "p": pooled,
                "close": bool(pooled < CLOSE),
                "answer": answer if count else "not audited",
            }
        )
    return pd.DataFrame(records)


def combine(p: NDArray[np.float64]) -> float:
    """Pool p-values (K,) by the Cauchy combination; NaN are left out, and the result is NaN where all are.

    A p-value above 0.5 counts as 0.5, so that agreement in one test cannot outweigh contradiction in another.
    """
    known = np.clip(p[~np.isnan(p)], 1e-15, 0.5)
    return float(scipy.stats.cauchy.sf(np.mean(scipy.stats.cauchy.isf(known)))) if known.size else np.nan


def resample_evidence(
    audit: pd.DataFrame, verdicts: pd.DataFrame, direct: pd.DataFrame | None, stream: np.random.Generator
) -> list[str]:
    """Return the detectors that are withheld when audited values and scope verdicts are resampled."""
    values, agreed = (
        table.iloc[stream.integers(0, len(table), len(table))] if len(table) else table
        for table in (audit, verdicts)
    )
    return withheld_answers(weigh_evidence(values, agreed, direct))


def withheld_answers(answers: pd.DataFrame) -> list[str]:
    """Return the detectors whose answers are withheld, sorted."""
    return sorted(answers.loc[answers["answer"] == "withheld", "fda"])


def _test_coverage(good: pd.DataFrame) -> float:
    """Return the probability that a correct surrogate has at least as many values outside their intervals.

    The number of these values follows a negative binomial distribution, as the errors are correlated.
    """
    if good.empty:
        return np.nan
    outside, expected = int((~good["inside"]).sum()), 0.05 * len(good)
    variance = max(float(good["variance"].sum()), 1.001 * expected)
    size = expected**2 / (variance - expected)
    return float(scipy.stats.nbinom.sf(outside - 1, size, size / (size + expected)))


def _test_verdicts(verdicts: pd.DataFrame) -> float:
    """Return the probability that a correct surrogate disagrees in at least as many scope verdicts."""
    if verdicts.empty:
        return np.nan
    return float(scipy.stats.poisson.sf(int((~verdicts["agrees"]).sum()) - 1, verdicts["chance"].sum()))


def _test_snr(direct: pd.DataFrame) -> float:
    """Return the probability that a correct surrogate's SNR is at least as far from direct simulation."""
    names = ["snr_direct", "direct_low", "direct_high", "snr_surrogate", "surrogate_low", "surrogate_high"]
    rows = direct[names].dropna().to_numpy(dtype=float)
    if not len(rows):
        return np.nan
    spread = np.hypot(rows[:, 2] - rows[:, 1], rows[:, 5] - rows[:, 4]) / (2 * special.ndtri(0.975))
    away = (rows[:, 0] - rows[:, 3]) / np.maximum(spread, 1e-12)
    return float(scipy.stats.chi2.sf(np.sum(away**2), len(away)))


AUDIT = "audit"
#: Name of the set of additional points, which are simulated where the evidence is close.
RECHECK = "recheck"
#: Number of sets of runs that are drawn from a surrogate to find how its errors at the points are correlated.
DRAWS = 400
#: Columns that tell why a point was chosen.
_ABOUT = ["reason", "hypothesis", "factor", "delta", "sigma", "worn_axis"]


def scope_boundary(
    scope: pd.DataFrame, factor: str, share: float = 0.5, place: float = 0.5
) -> tuple[float, float]:
    """Find a point (Delta, sigma) on the boundary of the scope of most cells.

    The boundary is, for each sigma, the smallest Delta at which at least the share `share` of the cells pass.
    The returned point is the one at the share `place` of the sigmas of the boundary. Where no point passes,
    it is the largest Delta and the smallest sigma. The exact method is used where the table has it.

    Raises
    ------
    InputError
        Where the table has no such factor.
    """
    rows = scope[scope["factor"] == factor]
    if rows.empty:
        known = ", ".join(sorted(set(scope["factor"])))
        raise InputError(f"audit: the scope table has no factor '{factor}'; it has {known}.")
    passing = choose_method(rows).groupby(["sigma", "delta"], sort=True)["passes"].mean().unstack("delta")
    deltas, reached = passing.columns.to_numpy(), passing.to_numpy() >= share
    edges = [
        (float(deltas[np.argmax(row)]), float(sigma))
        for sigma, row in zip(passing.index, reached, strict=True)
        if row.any()
    ]
    return edges[int(place * len(edges))] if edges else (float(deltas[-1]), float(passing.index[0]))


def choose_audit_points(
    factors: Sequence[Factor],
    boundaries: Mapping[str, tuple[float, float]],
    points: int = 9,
    axes: Sequence[int] = (1, 2, 3),
    f0: float = -2.0,
    detection: float = 0.99,
) -> pd.DataFrame:
    """Choose the points to simulate for the audit, the most informative first.

    The first is the nominal point z0, to which the study extrapolates. Then come, for each factor of
    `boundaries`, the four runs that decide a verdict at (Delta, sigma) if y is monotone in the factor. These
    are H0 and H1, each with the factor at both its `detection` quantiles (clipped to -2..2). Each factor has
    wear on one axis, in turn; points with wear on the other axes come last.

    Parameters
    ----------
    factors : sequence of Factor
    boundaries : mapping of str to (Delta, sigma)
        E.g. from `scope_boundary`; coded.
    points : int
        Number of points, at least 1.
    axes : sequence of int
        Axes that may wear.
    f0 : float
        Coded fault level of H0.
    detection : float
        Required probability of detection P_d'.

    Returns
    -------
    DataFrame
        ``point`` (from 1), the coded and natural columns of a design, ``reason``, ``hypothesis`` (H0, H1),
        ``factor``, ``delta``, ``sigma``, ``worn_axis`` (0: none).
    """
    check_factors(factors)
    if points < 1 or not axes:
        raise InputError(f"audit: {points} points on axes {list(axes)}; give at least one of each.")
    names = [factor.name for factor in factors]
    nominal = nominal_levels(factors)
    reach = float(special.ndtri(detection))
    first: list[tuple[dict[str, float], dict[str, object]]] = [
        (dict(nominal), dict(zip(_ABOUT, ["nominal point", "H0", "", 0.0, 0.0, 0], strict=True)))
    ]
    later: list[tuple[dict[str, float], dict[str, object]]] = []
    for k, (factor, (delta, sigma)) in enumerate(boundaries.items()):
        if factor not in names or factor == FAULT:
            raise InputError(
                f"audit: '{factor}' is no nuisance; use {', '.join(one for one in names if one != FAULT)}."
            )
        turn = axes[k % len(axes)]
        for hypothesis, axis in [("H1", turn), ("H0", 0), *(("H1", a) for a in axes if a != turn)]:
            for side in (-1, 1):
                z = dict(nominal)
                if hypothesis == "H1":
                    z[worn_factor(factors, axis)] = f0 + delta
                z[factor] = float(np.clip(side * reach * sigma, CODED_LOW, CODED_HIGH))
                about = ["scope boundary", hypothesis, factor, delta, sigma, axis]
                entry = (z, dict(zip(_ABOUT, about, strict=True)))
                (first if hypothesis == "H0" or axis == turn else later).append(entry)
    chosen = (first + later)[:points]
    coded = np.array([[z[name] for name in names] for z, _ in chosen])
    return design_table(coded, factors).assign(**{name: [one[name] for _, one in chosen] for name in _ABOUT})


def choose_more_points(
    factors: Sequence[Factor],
    scope: pd.DataFrame,
    about: Sequence[str],
    places: Sequence[float],
    axes: Sequence[int] = (1, 2, 3),
    f0: float = -2.0,
    detection: float = 0.99,
    first: int = 1,
) -> pd.DataFrame:
    """Choose additional points where the audit leaves the verdict open, at other places of each boundary.

    Parameters
    ----------
    factors, axes, f0, detection
        As in `choose_audit_points`.
    scope : DataFrame
    about : sequence of str
        Nuisance factors whose boundaries are used.
    places : sequence of float
        Places on each boundary, as in `scope_boundary`.
    first : int
        Number of the first point.

    Returns
    -------
    DataFrame
        As from `choose_audit_points`, with 4 points for each place and nuisance.
    """
    parts = []
    for place in places:
        edges = {name: scope_boundary(scope, name, place=place) for name in about}
        found = choose_audit_points(factors, edges, 1 + 4 * len(edges), axes, f0, detection)
        parts.append(found[found["reason"] == "scope boundary"])
    table = pd.concat(parts, ignore_index=True)
    return table.assign(point=np.arange(first, first + len(table)))


def audit_table(
    test_quantities: pd.DataFrame,
    surrogates: pd.DataFrame,
    points: pd.DataFrame | None = None,
    model: str = "full",
    chosen: Mapping[tuple, ChosenSurrogate] | None = None,
) -> pd.DataFrame:
    """Compare the simulated value with that of the surrogate at every audited point of every cell.

    Parameters
    ----------
    test_quantities : DataFrame
        Directly simulated test quantities of the set ``audit``, with coded factors; the factor ``f`` is the
        wear of the cell's own axis.
    surrogates : DataFrame
    points : DataFrame, optional
        From `choose_audit_points`; adds why each point was chosen.
    model : str
    chosen : mapping, optional
        Chosen surrogate by cell, audited in place of `model`. Chosen surrogates have no leverage, and their
        runs cover the range -2..2.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``model``, ``point``, the coded factors, ``y_surrogate``,
        ``low``, ``high`` (95 % prediction interval), ``y_direct``, ``inside`` (False where ``y_direct`` is
        NaN), ``failed`` (``y_direct`` is NaN), ``status`` where the test quantities have it, ``leverage``
        (variance of the predicted mean over that of a run), ``extrapolated`` (leverage > 1), ``variance``
        (variance of the number of the cell's values outside by chance, over the number of values); and the
        columns of `points`.

    Raises
    ------
    InputError
        Where there are no audit rows, or a cell has no surrogate.
    """
    rows = test_quantities[test_quantities["set"] == AUDIT]
    if rows.empty:
        raise InputError("audit: no test quantity has the set 'audit'; simulate the audit points first.")
    models: Mapping[tuple, Surrogate | ChosenSurrogate]
    if chosen is None:
        models = {key[:-1]: surrogate for key, surrogate in surrogates_of(surrogates, model)}
    else:
        models, model = chosen, CHOSEN
    parts = []
    for key, cell in cells_of(rows):
        if key not in models:
            raise InputError(f"audit: cell {cell_name(key)} has no surrogate; fit it first.")
        surrogate = models[key]
        cell = cell.sort_values("point")
        names = list(surrogate.names)
        z, direct = cell[names].to_numpy(dtype=float), cell["y"].to_numpy(dtype=float)
        low, high = surrogate.prediction_interval(z)
        known = chosen is None and np.isfinite(surrogate.sigma) and surrogate.sigma > 0
        leverage = (surrogate.standard_error(z) / surrogate.sigma) ** 2 if known else np.full(len(z), np.nan)
        predicted = surrogate.predict(z)
        slack = 1e-9 * np.maximum(np.abs(direct), np.abs(predicted))
        runs = draw_runs(surrogate, z, generator_for(0, "audit", cell_name(key)), DRAWS)
        outside = np.sum((runs < low - slack) | (runs > high + slack), axis=1)
        part = cell[CELL].assign(
            model=model,
            **cell[["point", *names]],
            y_surrogate=predicted,
            low=low,
            high=high,
            y_direct=direct,
            inside=(direct >= low - slack) & (direct <= high + slack),
            failed=~np.isfinite(direct),
            **cell[[name for name in ("status",) if name in cell]],
            leverage=leverage,
            extrapolated=leverage > 1,
            variance=outside.var() / len(z),
        )
        parts.append(part)
    table = pd.concat(parts, ignore_index=True)
    if points is not None:
        about = [name for name in _ABOUT if name in points.columns]
        table = table.merge(points[["point", *about]], on="point", how="left", validate="many_to_one")
    return table


def audit_verdicts(audit: pd.DataFrame) -> pd.DataFrame:
    """Compare scope verdicts at the audited points (Delta, sigma): by direct runs, and by the surrogate.

    If y is monotone in the factor, its quantiles are its values at the factor's quantiles. With
    P_f' = 1 - P_d', four runs then decide requirement (12): the point passes where the smaller value under H1
    is not below the larger value under H0.

    Parameters
    ----------
    audit : DataFrame
        From `audit_table` with `points`.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``model``, ``factor``, ``delta``, ``sigma``,
        ``passes_surrogate``, ``passes_direct``, ``agrees``, and ``chance``: the probability of a disagreement
        if the surrogate is correct. There is a row where the cell's own axis was worn and all four runs have
        a value.
    """
    scatter = generator_for(0, "audit verdicts").standard_normal((2000, 2))
    rows = audit[(audit["factor"] != "") & ~audit["failed"]]
    keys = [*CELL, "model", "factor", "delta", "sigma"]
    records = []
    for key, group in rows.groupby(keys, sort=True, observed=True):
        null = group[group["hypothesis"] == "H0"]
        worn = group[(group["hypothesis"] == "H1") & (group["worn_axis"] == group["axis"])]
        if len(null) < 2 or len(worn) < 2:
            continue
        verdict = {
            f"passes_{name}": bool(worn[f"y_{name}"].min() >= null[f"y_{name}"].max())
            for name in ("surrogate", "direct")
        }
        agrees = verdict["passes_surrogate"] == verdict["passes_direct"]
        edge = _scatter(worn, scatter).min(axis=1) >= _scatter(null, scatter[::-1]).max(axis=1)
        chance = float(np.mean(edge != verdict["passes_surrogate"]))
        records.append({**dict(zip(keys, key, strict=True)), **verdict, "agrees": agrees, "chance": chance})
    columns = [*keys, "passes_surrogate", "passes_direct", "agrees", "chance"]
    return pd.DataFrame(records, columns=columns)


def _scatter(rows: pd.DataFrame, scatter: np.ndarray) -> np.ndarray:
    """Return values (N, 2) of two audited runs, scattered within the surrogate's intervals."""
    values = rows[["y_surrogate", "low", "high"]].to_numpy(dtype=float)[:2].T
    return values[0] + scatter * (values[2] - values[1]) / (2 * special.ndtri(0.975))
