"""Which detector to use, what it finds and what it bears: the study's answer in numbers, not yet in words."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from wearscope.designs.factors import FAULT, Factor
from wearscope.evaluation.detection import detection_table
from wearscope.evaluation.responses import Cells
from wearscope.evaluation.snr import rank_by_median
from wearscope.surrogates.fitting import CELL

Array = NDArray[np.float64]
#: Share of the draws of a surrogate for which a grid cell must pass to count as sure.
SURE = 0.95
#: Shares of a group's cells that are asked to be sure, the first one that any change of the fault reaches.
SHARES = (1.0, 0.5)
#: Of the largest variation that a detector bears at any change of the fault: what is enough.
ENOUGH = 0.5


@dataclass(frozen=True)
class Bound:
    """What a detector bears of one factor.

    Attributes
    ----------
    factor : str
    sigma : float
        Largest standard deviation, in natural units, up to which the requirement is met.
    largest : bool
        Whether that is the end of the grid, so that it may bear more.
    """

    factor: str
    sigma: float
    largest: bool


@dataclass(frozen=True)
class Conclusion:
    """Answer of a study, or of one robot's part of it.

    Attributes
    ----------
    robot : str
        Empty for all robots together.
    detector : str
        Empty where no detector may be recommended.
    tied_with : list of str
        Detectors that the SNR does not tell apart from it.
    withheld : list of str
        Detectors that direct simulation contradicts.
    wear : float
        Smallest change of wear that is found, natural units; NaN where none is.
    bounds : list of Bound
        By factor, at that change of wear.
    cells, cells_sure : int
        Cells (test-cycle, axis, robot) of the detector, and those in which all of this is sure.
    shown_sure : bool
        Whether the surrogates' uncertainty was counted; else the estimates alone say so.
    p_f, p_d : float
        Probability of false alarm at most, of detection at least.
    """

    robot: str
    detector: str
    tied_with: list[str]
    withheld: list[str]
    wear: float
    bounds: list[Bound]
    cells: int
    cells_sure: int
    shown_sure: bool
    p_f: float
    p_d: float

    def to_mapping(self) -> dict[str, object]:
        """Fields as JSON holds them; NaN is null."""
        fields = asdict(self)
        fields["wear"] = None if np.isnan(self.wear) else self.wear
        return fields


def read_conclusion(fields: Mapping[str, object]) -> Conclusion:
    """The inverse of `Conclusion.to_mapping`."""
    given = dict(fields)
    given["wear"] = np.nan if given["wear"] is None else given["wear"]
    given["bounds"] = [Bound(**one) for one in given["bounds"]]  # type: ignore[attr-defined]
    return Conclusion(**given)  # type: ignore[arg-type]


def draw_conclusion(
    scope: pd.DataFrame,
    snr: pd.DataFrame,
    ranking: pd.DataFrame,
    factors: Sequence[Factor],
    p_f: float,
    p_d: float,
    withheld: Collection[str] = (),
    robot: str = "",
) -> Conclusion:
    """Detector to use, the smallest change of wear that it finds, and what it bears of each factor.

    Of the detectors with the best median SNR and those not told apart from it, the one whose scope is sure on
    the largest part of the grid. The change of wear is the smallest at which it bears, of every factor, half
    of the largest variation that it bears at any change: below, a little less wear costs much tolerance.

    Parameters
    ----------
    scope : DataFrame
        From `wearscope.evaluation.scope`; one factor varies at a time.
    snr : DataFrame
    ranking : DataFrame
        Of these cells, by detector.
    factors : sequence of Factor
    p_f, p_d : float
        What the scope asks.
    withheld : collection of str
    robot : str
        For the record.
    """
    exact = scope[scope["method"] == ("exact" if (scope["method"] == "exact").any() else "kde")]
    shown_sure = bool(exact["confidence"].notna().any())
    sure = exact["confidence"] >= SURE if shown_sure else exact["passes"]
    exact = exact.assign(sure=sure.to_numpy(dtype=float))
    kept = ranking[~ranking["fda"].isin(list(withheld)) & (ranking["median"] > 0)]
    none = Conclusion(robot, "", [], sorted(withheld), np.nan, [], 0, 0, shown_sure, p_f, p_d)
    if kept.empty:
        return none
    best = kept.iloc[0]
    tied = [name for name in str(best["tied_with"]).split(", ") if name in set(kept["fda"])]
    candidates = [str(best["fda"]), *tied]
    reach = exact.groupby("fda")["sure"].mean()
    chosen = max(candidates, key=lambda name: (float(reach.get(name, 0.0)), -candidates.index(name)))
    own = exact[exact["fda"] == chosen]
    cells = len(own[CELL].drop_duplicates())
    wear, bounds, count = _smallest_change(own, factors)
    return Conclusion(
        robot, chosen, sorted(set(candidates) - {chosen}), sorted(withheld), wear, bounds, cells, count,
        shown_sure, p_f, p_d,
    )  # fmt: skip


def _smallest_change(own: pd.DataFrame, factors: Sequence[Factor]) -> tuple[float, list[Bound], int]:
    """Change of wear, bounds of the factors, and in how many cells; NaN where nothing is found."""
    by_name = {factor.name: factor for factor in factors}
    for share in SHARES:
        borne, ends, deltas = {}, {}, np.zeros(0)
        for name, rows in own.groupby("factor", sort=True):
            wide = rows.pivot_table(index="delta", columns="sigma", values="sure", aggfunc="sum")
            # A factor that moves nothing of a robot has no scope there, and holds it back in nothing.
            needed = int(np.ceil(share * len(rows[CELL].drop_duplicates())))
            deltas, sigmas = wide.index.to_numpy(float), wide.columns.to_numpy(float)
            borne[str(name)] = tolerated(wide.to_numpy(float) >= needed, sigmas)
            ends[str(name)] = float(sigmas[-1])
        stacked = np.stack(list(borne.values()))
        possible = (stacked > 0).all(axis=0) & (deltas > 0)
        if not possible.any():
            continue
        enough = ENOUGH * np.where(possible, stacked, 0.0).max(axis=1)
        k = int(np.argmax(possible & (stacked >= enough[:, None]).all(axis=0)))
        at = own[np.isclose(own["delta"], deltas[k])]
        sure = pd.Series(True, index=at[CELL].drop_duplicates().set_index(CELL).index)
        for name, values in borne.items():
            rows = at[(at["factor"] == name) & (at["sigma"] <= values[k] * (1 + 1e-9))]
            sure &= rows.groupby(CELL)["sure"].min().reindex(sure.index, fill_value=1.0).astype(bool)
        bounds = [
            Bound(name, float(values[k] * natural_step(by_name[name])), bool(values[k] >= ends[name]))
            for name, values in borne.items()
        ]
        return float(deltas[k] * natural_step(by_name[FAULT])), bounds, int(sure.sum())
    return np.nan, [], 0


def tolerated(passes: NDArray[np.bool_], sigmas: Array) -> Array:
    """Largest sigma (J,) up to which every grid cell (J, S) passes; 0 where not even the smallest does."""
    reached = np.where(passes.all(axis=1), passes.shape[1], np.argmin(passes, axis=1))
    return np.where(reached > 0, sigmas[np.maximum(reached, 1) - 1], 0.0)


def natural_step(factor: Factor) -> float:
    """Natural units in one coded unit."""
    return (factor.high - factor.low) / 4.0


def threshold_table(
    cells: Cells,
    conclusion: Conclusion,
    factors: Sequence[Factor],
    levels: Mapping[str, float],
    f0: float,
) -> pd.DataFrame:
    """Alarm threshold of every cell of the recommended detector.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``threshold``: the largest that any of the factors asks at
        its bound. Empty where nothing is recommended.
    """
    columns = [*CELL, "threshold"]
    by_name = {factor.name: factor for factor in factors}
    if not conclusion.detector or np.isnan(conclusion.wear):
        return pd.DataFrame(columns=columns)
    delta = conclusion.wear / natural_step(by_name[FAULT])
    cells = [(key, one) for key, one in cells if key[3] == conclusion.detector]
    parts = [
        detection_table(
            cells, levels, [one.factor], np.array([delta]),
            np.array([one.sigma / natural_step(by_name[one.factor])]), f0, [conclusion.p_f],
        )
        for one in conclusion.bounds
    ]  # fmt: skip
    found = pd.concat(parts, ignore_index=True).groupby(CELL, sort=True)
    return found["threshold"].max().reset_index()[columns]


def conclude_study(
    scope: pd.DataFrame,
    snr: pd.DataFrame,
    factors: Sequence[Factor],
    p_f: float,
    p_d: float,
    withheld: Collection[str] = (),
    seed: int = 0,
) -> tuple[list[Conclusion], pd.DataFrame]:
    """Conclusions of all robots together and, where there are several, of each; and their rankings.

    Returns
    -------
    conclusions : list of Conclusion
        That of all robots first.
    rankings : DataFrame
        ``robot`` (empty for all together) and the columns of `wearscope.evaluation.snr.rank_by_median`.
    """
    robots = sorted(snr["robot"].unique())
    conclusions, rankings = [], []
    for robot in ["", *(robots if len(robots) > 1 else [])]:
        asked = (scope, snr) if not robot else (scope[scope["robot"] == robot], snr[snr["robot"] == robot])
        ranking = rank_by_median(asked[1], by=("fda",), seed=seed)
        rankings.append(ranking.assign(robot=robot))
        conclusions.append(draw_conclusion(*asked, ranking, factors, p_f, p_d, withheld, robot))
    table = pd.concat(rankings, ignore_index=True)
    return conclusions, table[["robot", *(name for name in table.columns if name != "robot")]]
