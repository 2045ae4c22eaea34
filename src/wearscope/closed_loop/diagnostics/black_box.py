"""How much of a residual a regressor without names explains: what structure is left unnamed."""

import numpy as np
import pandas as pd
from sklearn.ensemble import HistGradientBoostingRegressor

from wearscope.closed_loop.diagnostics.dependence import code_signals
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.model.prediction import Predicted, bootstrap_rms, pooled_rms

#: Most rows that trees are grown on, and most trees.
_MOST_ROWS, _MOST_TREES = 6000, 80
_SEED = 11
#: Share of a single training run that the number of trees is chosen on.
_LAST = 0.25


def make_features(run: dict[str, np.ndarray], with_time: bool) -> np.ndarray:
    """Signals of all joints side by side, (M, F)."""
    return np.concatenate([x for code, x in run.items() if with_time or code != "t"], axis=1)


def _split(lengths: list[int]) -> np.ndarray:
    """Rows that the number of trees is chosen on: the last run, or the end of the only one."""
    chosen = np.zeros(sum(lengths), dtype=bool)
    size = lengths[-1] if len(lengths) > 1 else int(_LAST * lengths[-1])
    chosen[len(chosen) - size :] = True
    return chosen


def grow(trees: int) -> HistGradientBoostingRegressor:
    """So many boosted trees, not fitted yet."""
    return HistGradientBoostingRegressor(
        max_iter=trees,
        learning_rate=0.1,
        max_leaf_nodes=15,
        min_samples_leaf=30,
        l2_regularization=1.0,
        early_stopping=False,
        random_state=_SEED,
    )


def fit_black_box(x: np.ndarray, y: np.ndarray, chosen: np.ndarray) -> HistGradientBoostingRegressor | None:
    """Boosted trees, as many as serve rows that they were not grown on; None where none does.

    Parameters
    ----------
    x : ndarray (M, F)
    y : ndarray (M,)
    chosen : ndarray (M,) of bool
        Rows that the number of trees is chosen on, before trees are grown anew on all.
    """
    if chosen.all() or not chosen.any():
        return None
    first = grow(_MOST_TREES).fit(x[~chosen], y[~chosen])
    start = np.mean(y[~chosen])
    losses = [np.mean((y[chosen] - start) ** 2)]
    losses += [np.mean((y[chosen] - guess) ** 2) for guess in first.staged_predict(x[chosen])]
    trees = int(np.argmin(losses))
    return grow(trees).fit(x, y) if trees else None


def judge_black_box(prepared: Prepared, predicted: list[Predicted]) -> pd.DataFrame:
    """What gradient-boosted trees on all joints' signals leave of the residuals of the test runs.

    They are grown on the training runs' residuals, on position, speed, direction, acceleration, load,
    temperature and, where there are several of them, time.

    Parameters
    ----------
    prepared : Prepared
    predicted : list of Predicted
        Of every run.

    Returns
    -------
    DataFrame
        One row a joint and stage (residual before, after): `rms` of the stage's residual on the test runs,
        `rms_black_box` of what the trees leave, each with its 95 % interval (`_low`, `_high`),
        `share_removed` of the variance, `trees` grown (0: no structure that carries over to rows not grown
        on). NaN for joints that do not move.
    """
    train = [p for p in predicted if p.run.use == "train"]
    test = [p for p in predicted if p.run.use == "test"]
    # Within a single run, time says which sample it is.
    features = {p.run.label: make_features(code_signals(p.run), len(train) > 1) for p in predicted}
    every = np.concatenate([features[p.run.label] for p in train])
    useful = np.isfinite(every).all(axis=0) & (np.ptp(every, axis=0) > 0)
    rows = max(4, int(4 * prepared.band.torque))
    records = []
    for stage in ("before", "after"):
        left = [(p.run.measured - getattr(p, stage)).copy() for p in test]
        trees = np.zeros(prepared.n, dtype=int)
        for j in map(int, np.flatnonzero(prepared.moving)):
            kept = [p.run.keep[:, j] for p in train]
            x = every[np.concatenate(kept)][:, useful]
            y = np.concatenate(
                [(p.run.measured - getattr(p, stage))[k, j] for p, k in zip(train, kept, strict=True)]
            )
            chosen = _split([int(k.sum()) for k in kept])
            thin = slice(None, None, max(1, len(y) // _MOST_ROWS))
            model = fit_black_box(x[thin], y[thin], chosen[thin]) if len(y) else None
            if model is not None:
                trees[j] = int(model.n_iter_)
                for p, residual in zip(test, left, strict=True):
                    residual[:, j] -= model.predict(features[p.run.label][:, useful])
        own = [(p.run.measured - getattr(p, stage), p.run.keep) for p in test]
        rest = [(residual, p.run.keep) for p, residual in zip(test, left, strict=True)]
        sizes = {"rms": own, "rms_black_box": rest}
        value = {name: pooled_rms(parts) for name, parts in sizes.items()}
        interval = {name: bootstrap_rms(parts, rows, _SEED) for name, parts in sizes.items()}
        for j, joint in enumerate(prepared.dataset.joints):
            record: dict = {"joint": joint, "stage": stage}
            for name in sizes:
                moving = bool(prepared.moving[j])
                record[name] = value[name][j] if moving else np.nan
                record[f"{name}_low"], record[f"{name}_high"] = (
                    interval[name][:, j] if moving else (np.nan, np.nan)
                )
            record["share_removed"] = 1.0 - (record["rms_black_box"] / record["rms"]) ** 2
            record["trees"] = int(trees[j])
            records.append(record)
    return pd.DataFrame(records)
