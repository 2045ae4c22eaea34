"""Rivals of the tracer: published ways of choosing terms, on the same rows and the same blocks.

Every rival reads `rival_table.RivalTable` alone and names effects by joint. None of them was tuned on the
board; their thresholds are those of their sources.
"""

import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pysindy
from numpy.typing import NDArray
from sklearn.ensemble import HistGradientBoostingRegressor
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import ARDRegression, lars_path_gram
from sklearn.model_selection import GroupKFold, cross_val_predict

from wearscope.attribution_board.rival_table import RivalTable, make_tables

Array = NDArray[np.float64]
Rival = Callable[[RivalTable, np.random.Generator], list[str]]

HALVES = 50
"""Half-samples of blocks (in complementary pairs) and bags of blocks."""


class _Grams:
    """Products of columns and target by block, so that a sample of blocks costs no rows."""

    def __init__(self, table: RivalTable):
        whole = np.column_stack([table.columns, table.target])
        count = int(table.blocks.max()) + 1
        self.by_block = np.zeros((count, whole.shape[1], whole.shape[1]))
        for block in range(count):
            rows = whole[table.blocks == block]
            self.by_block[block] = rows.T @ rows
        self.rows = np.bincount(table.blocks, minlength=count)
        self.total = self.by_block.sum(axis=0)

    def left_over(self, chosen: NDArray[np.int64]) -> float:
        """Share of the target's power that least squares on some columns leaves."""
        if len(chosen) == 0:
            return 1.0
        gram = self.total[np.ix_(chosen, chosen)] + 1e-9 * self.total.shape[0] * np.eye(len(chosen))
        right = self.total[chosen, -1]
        power = float(self.total[-1, -1])
        return max(1.0 - float(right @ np.linalg.solve(gram, right)) / power, 1e-12)


def choose_stepwise(table: RivalTable, rng: np.random.Generator) -> list[str]:
    """Forward stepwise by BIC with the number of blocks as the sample size."""
    grams, blocks = _Grams(table), int(table.blocks.max()) + 1
    chosen: list[str] = []
    columns = np.zeros(0, dtype=np.int64)
    score = 0.0
    while True:
        offers = []
        for name in table.names:
            if name not in chosen:
                together = np.concatenate([columns, table.find_columns(name)])
                bic = blocks * np.log(grams.left_over(together)) + len(together) * np.log(blocks)
                offers.append((float(bic), name))
        if not offers or min(offers)[0] >= score:
            return chosen
        score, name = min(offers)
        chosen.append(name)
        columns = np.concatenate([columns, table.find_columns(name)])


def choose_stable(table: RivalTable, rng: np.random.Generator) -> list[str]:
    """Stability selection by lasso paths on complementary halves of the blocks.

    Meinshausen and Buehlmann 2010, Shah and Samworth 2013: of each half the first q columns to enter, with q
    such that at most one false column is expected at the share 0.9 (q^2 = 0.8 p).
    """
    grams, p = _Grams(table), table.columns.shape[1]
    blocks, enter = len(grams.rows), max(1, int(np.sqrt(0.8 * p)))
    counts = np.zeros(p)
    for _ in range(HALVES // 2):
        order = rng.permutation(blocks)
        for half in (order[: blocks // 2], order[blocks // 2 : 2 * (blocks // 2)]):
            gram, rows = grams.by_block[half].sum(axis=0), int(grams.rows[half].sum())
            if rows == 0:
                continue
            with warnings.catch_warnings():
                # a column that is a sum of others is left out of the path, and said so if rounding lets it
                warnings.simplefilter("ignore", ConvergenceWarning)
                _, active, _ = lars_path_gram(
                    gram[:-1, -1], gram[:-1, :-1], n_samples=rows, method="lasso", max_iter=enter
                )
            counts[np.asarray(active[:enter], dtype=int)] += 1
    share = counts / max(2 * (HALVES // 2), 1)
    return [name for name in table.names if share[table.find_columns(name)].max() >= 0.9]


def find_inclusion(
    table: RivalTable, rng: np.random.Generator, sweeps: int = 300, burn: int = 50
) -> dict[str, float]:
    """Posterior inclusion probability of every effect under a spike and slab with Zellner's g-prior.

    Gibbs sampling over inclusions with the marginal likelihood in closed form (Liang et al. 2008, eq. 6), g
    and the sample size being the number of blocks; each effect is as likely to be in as one in 1/p.
    """
    grams, blocks = _Grams(table), int(table.blocks.max()) + 1
    names = table.names
    prior = np.log(1.0 / len(names)) - np.log1p(-1.0 / len(names)) if len(names) > 1 else 0.0
    known: dict[tuple[int, ...], float] = {}

    def evidence(inside: tuple[int, ...]) -> float:
        if inside not in known:
            parts = [table.find_columns(names[i]) for i in inside]
            columns = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
            left, g = grams.left_over(columns), float(blocks)
            known[inside] = 0.5 * (blocks - 1 - len(columns)) * np.log1p(g) - 0.5 * (blocks - 1) * np.log1p(
                g * left
            )
        return known[inside] + prior * len(inside)

    inside: set[int] = set()
    counts = np.zeros(len(names))
    for sweep in range(sweeps):
        for i in rng.permutation(len(names)):
            with_it = evidence(tuple(sorted(inside | {int(i)})))
            without = evidence(tuple(sorted(inside - {int(i)})))
            share = 1.0 / (1.0 + np.exp(np.clip(without - with_it, -500, 500)))
            inside = inside | {int(i)} if rng.uniform() < share else inside - {int(i)}
        if sweep >= burn:
            counts[sorted(inside)] += 1
    return dict(zip(names, (counts / (sweeps - burn)).tolist(), strict=True))


def choose_spike_and_slab(table: RivalTable, rng: np.random.Generator) -> list[str]:
    """Effects whose posterior inclusion probability is above 0.9."""
    return [name for name, share in find_inclusion(table, rng).items() if share > 0.9]


def choose_sindy(table: RivalTable, rng: np.random.Generator) -> list[str]:
    """Ensemble SINDy: thresholded least squares on bags of blocks, kept where 60 % of them have it.

    Fasel et al. 2022. The threshold is a tenth of the target's RMS on columns of unit RMS.
    """
    blocks = int(table.blocks.max()) + 1
    members = [np.flatnonzero(table.blocks == block) for block in range(blocks)]
    scale = float(np.sqrt(np.mean(table.target**2))) + 1e-300
    counts = np.zeros(table.columns.shape[1])
    for _ in range(HALVES):
        rows = np.concatenate([members[i] for i in rng.integers(blocks, size=blocks)])
        left, kept = table.columns[rows], np.arange(len(counts))
        optimizer = pysindy.STLSQ(threshold=0.1, alpha=1e-3 * len(rows), max_iter=20)
        solution = np.asarray(_fit_quietly(optimizer, left, table.target[rows, None] / scale)).ravel()
        counts[kept[np.abs(solution) > 0]] += 1
    return [name for name in table.names if counts[table.find_columns(name)].max() > 0.6 * HALVES]


def _fit_quietly(optimizer: Any, columns: Array, target: Array) -> Any:
    """Coefficients; an optimizer that throws everything out says so by a warning, which is an answer here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        optimizer.fit(columns, target)
    return optimizer.coef_


def choose_ard(table: RivalTable, rng: np.random.Generator) -> list[str]:
    """Automatic relevance determination, kept where the coefficient is 3 errors by block from zero."""
    scale = float(np.sqrt(np.mean(table.target**2))) + 1e-300
    fit = ARDRegression(fit_intercept=False).fit(table.columns, table.target / scale)
    kept = np.flatnonzero(np.abs(fit.coef_) > 1e-6)
    if len(kept) == 0:
        return []
    columns = table.columns[:, kept]
    inverse = np.linalg.pinv(columns.T @ columns)
    solution = inverse @ (columns.T @ table.target)
    scores = columns * (table.target - columns @ solution)[:, None]
    summed = np.zeros((int(table.blocks.max()) + 1, len(kept)))
    np.add.at(summed, table.blocks, scores)
    error = np.sqrt(np.clip(np.diag(inverse @ (summed.T @ summed) @ inverse), 1e-300, None))
    named = {table.labels[kept[i]] for i in np.flatnonzero(np.abs(solution) > 3 * error)}
    return [name for name in table.names if name in named]


RIVALS: dict[str, Rival] = {
    "stepwise_bic": choose_stepwise,
    "stability_selection": choose_stable,
    "spike_and_slab": choose_spike_and_slab,
    "ensemble_sindy": choose_sindy,
    "ard": choose_ard,
}


def bound_gain(table: RivalTable, folds: int = 4) -> float:
    """Share of the target's power that gradient boosting explains out of fold, with whole blocks held out.

    It is the bound of what any name could explain from these signals.
    """
    folds = min(folds, int(table.blocks.max()) + 1)
    # neighbouring blocks stay together, or the smoothing would leak from fold to fold
    groups = table.blocks // 8
    folds = min(folds, len(np.unique(groups)))
    if folds < 2:
        return float("nan")
    model = HistGradientBoostingRegressor(max_iter=150, random_state=0)
    said = cross_val_predict(model, table.signals, table.target, groups=groups, cv=GroupKFold(folds))
    return float(1.0 - np.mean((table.target - said) ** 2) / np.mean(table.target**2))


def run_rivals(dataset: str | Path, seed: int) -> dict[str, dict[str, Any]]:
    """What every rival says of a data set, in the form of ``verdict.json``; and the bound by joint.

    Parameters
    ----------
    dataset : path-like
        The data set's folder.
    seed : int

    Returns
    -------
    dict
        By rival, `verdict` and `joints` (empty); under ``boosting``, the `bound` by joint.
    """
    tables = make_tables(dataset)
    out: dict[str, dict[str, Any]] = {}
    for number, (rival, choose) in enumerate(RIVALS.items()):
        entries = []
        for j, table in enumerate(tables):
            rng = np.random.default_rng(np.random.SeedSequence([seed, number, j]))
            entries += [
                {"joint": table.joint, "effect": name, "equivalent": [], "parameters": {}}
                for name in choose(table, rng)
            ]
        out[rival] = {"verdict": entries, "joints": {}}
    out["boosting"] = {"bound": {table.joint: bound_gain(table) for table in tables}}
    return out
