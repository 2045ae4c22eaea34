"""Whether direct simulation contradicts a detector's surrogates: audit, scope and SNR weighed together."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import special, stats

from wearscope.designs.bases import model_matrix
from wearscope.evaluation.grouping import wilson_interval
from wearscope.surrogates.selection import ChosenSurrogate
from wearscope.surrogates.surrogate import Surrogate

#: Answers are withheld where a right surrogate would see evidence this contrary with less than this
#: probability.
CONTRADICTED = 0.001
#: Below this probability the evidence is close: more points are simulated before anything is withheld.
CLOSE = 0.05


def draw_runs(
    surrogate: Surrogate | ChosenSurrogate, z: NDArray[np.float64], rng: np.random.Generator, draws: int
) -> NDArray[np.float64]:
    """New runs that a surrogate allows at coded levels (M, n), shape (draws, M), neighbours correlated."""
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
    """Which detectors' answers stand, and which are withheld.

    Direct simulation answers three questions: whether no more values lie outside their 95 % intervals than
    chance allows, given that the misses of one surrogate are correlated; whether the scope's verdicts agree
    as often as they should; whether the SNR is the same. Their probabilities under a right surrogate are
    pooled by the Cauchy combination, which holds however the three depend on one another. One unlucky test of
    three withholds nothing.

    Parameters
    ----------
    audit : DataFrame
        From `wearscope.evaluation.audit.audit_table`.
    verdicts : DataFrame, optional
        From `wearscope.evaluation.audit.audit_verdicts`.
    direct : DataFrame, optional
        From `wearscope.evaluation.direct.direct_table`.

    Returns
    -------
    DataFrame
        ``fda``, ``model``, ``n``, ``n_inside``, ``share_inside``, ``share_low``, ``share_high``;
        ``p_audit``, ``p_scope``, ``p_direct``, NaN where not asked; ``p``, pooled; ``close``, whether it is
        below `CLOSE`; ``answer``: ``given``, ``withheld`` where it is below `CONTRADICTED`, or ``not
        audited`` where every audited value failed.

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
    """Several probabilities pooled by the Cauchy combination; NaN are left out, NaN where all are NaN.

    A probability above a half counts as a half, so that no agreement outweighs a contradiction.
    """
    known = np.clip(p[~np.isnan(p)], 1e-15, 0.5)
    return float(stats.cauchy.sf(np.mean(stats.cauchy.isf(known)))) if known.size else np.nan


def resample_evidence(
    audit: pd.DataFrame, verdicts: pd.DataFrame, direct: pd.DataFrame | None, stream: np.random.Generator
) -> list[str]:
    """Detectors that are withheld where audited values and scope verdicts are resampled."""
    values, agreed = (
        table.iloc[stream.integers(0, len(table), len(table))] if len(table) else table
        for table in (audit, verdicts)
    )
    return withheld_answers(weigh_evidence(values, agreed, direct))


def withheld_answers(answers: pd.DataFrame) -> list[str]:
    """Detectors whose answers are withheld, sorted."""
    return sorted(answers.loc[answers["answer"] == "withheld", "fda"])


def _test_coverage(good: pd.DataFrame) -> float:
    """Probability that a right surrogate leaves at least as many values outside their intervals."""
    if good.empty:
        return np.nan
    outside, expected = int((~good["inside"]).sum()), 0.05 * len(good)
    variance = max(float(good["variance"].sum()), 1.001 * expected)
    size = expected**2 / (variance - expected)
    return float(stats.nbinom.sf(outside - 1, size, size / (size + expected)))


def _test_verdicts(verdicts: pd.DataFrame) -> float:
    """Probability that a right surrogate disagrees in at least as many scope verdicts."""
    if verdicts.empty:
        return np.nan
    return float(stats.poisson.sf(int((~verdicts["agrees"]).sum()) - 1, verdicts["chance"].sum()))


def _test_snr(direct: pd.DataFrame) -> float:
    """Probability that a right surrogate's SNR is at least as far from the directly simulated one."""
    names = ["snr_direct", "direct_low", "direct_high", "snr_surrogate", "surrogate_low", "surrogate_high"]
    rows = direct[names].dropna().to_numpy(dtype=float)
    if not len(rows):
        return np.nan
    spread = np.hypot(rows[:, 2] - rows[:, 1], rows[:, 5] - rows[:, 4]) / (2 * special.ndtri(0.975))
    away = (rows[:, 0] - rows[:, 3]) / np.maximum(spread, 1e-12)
    return float(stats.chi2.sf(np.sum(away**2), len(away)))
