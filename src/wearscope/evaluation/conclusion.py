"""A study's conclusion in numbers: which detector to use, the wear that it finds, the variation it tolerates.

A study of many robots also gets an overview with one row for each robot and test-cycle, the worst first.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field

import numpy as np
import pandas as pd

from wearscope.designs.factors import FAULT, Factor
from wearscope.evaluation.ranking import RESAMPLINGS, Recommendation, pick_detector, reach_table, recommend
from wearscope.evaluation.sampled_scope import Cells, detection_table, largest_passing
from wearscope.evaluation.scope import SURE, add_counts, choose_method, count_scope
from wearscope.surrogates.fitting import CELL

#: Share of a detector's cells in which the requirement must surely be met. The shares are tried in this
#: order, until some change of the fault reaches one.
SHARES = (1.0, 0.5)
#: For each factor there is a largest variation that the detector tolerates at any change of the fault. The
#: concluded change of the fault is the smallest at which it tolerates at least this share of that variation.
ENOUGH = 0.5


@dataclass(frozen=True)
class Bound:
    """The variation of one factor that a detector tolerates.

    Attributes
    ----------
    factor : str
    sigma : float
        Largest standard deviation, in natural units, up to which the requirement is met.
    largest : bool
        Whether that is the end of the grid, so that the detector may tolerate more.
    """

    factor: str
    sigma: float
    largest: bool


@dataclass(frozen=True)
class Conclusion:
    """Conclusion of a study, or of its part for one robot.

    Attributes
    ----------
    robot : str
        Empty for all robots together.
    detector : str
        Recommended detector; empty where none may be recommended.
    tied_with : list of str
        Detectors whose SNR does not differ significantly from that of the recommended one.
    withheld : list of str
        Detectors that direct simulation contradicts.
    wear : float
        Smallest change of wear that the detector finds, in natural units; NaN where it finds none.
    bounds : list of Bound
        Tolerated variation of each factor at that change of wear.
    cells, cells_sure : int
        Number of the detector's cells (robot, test-cycle, axis), and of those in which the requirement is
        surely met within the bounds.
    shown_sure : bool
        Whether the uncertainty of the surrogates was included; otherwise only their estimates were used.
    p_f, p_d : float
        Largest allowed probability of a false alarm, and least required probability of detection.
    upper : list of str
        Detectors that know the simulator's friction law. They are upper bounds and never recommended.
    agree, resamplings : int
        Number of repetitions of the choice on resampled cells that chose the same detector, and number of
        repetitions.
    cells_first : int
        Number of cells in which the detector has the largest SNR of all that may be recommended.
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
    upper: list[str] = field(default_factory=list)
    agree: int = 0
    resamplings: int = 0
    cells_first: int = 0

    def to_mapping(self) -> dict[str, object]:
        """Return the fields in a form that JSON holds; NaN becomes null."""
        fields = asdict(self)
        fields["wear"] = None if np.isnan(self.wear) else self.wear
        return fields


def read_conclusion(fields: Mapping[str, object]) -> Conclusion:
    """Return the conclusion from the fields that `Conclusion.to_mapping` returned."""
    given = dict(fields)
    given["wear"] = np.nan if given["wear"] is None else given["wear"]
    given["bounds"] = [Bound(**one) for one in given["bounds"]]  # type: ignore[attr-defined]
    return Conclusion(**given)  # type: ignore[arg-type]


def draw_conclusion(
    scope: Iterable[pd.DataFrame],
    ranking: pd.DataFrame,
    factors: Sequence[Factor],
    p_f: float,
    p_d: float,
    withheld: Collection[str] = (),
    robot: str = "",
    recommended: Recommendation | None = None,
) -> Conclusion:
    """Conclude which detector to use, the smallest wear that it finds, and the variation that it tolerates.

    The wear is the smallest change at which the detector tolerates, for every factor, at least half of the
    largest variation that it tolerates at any change. Below it, a little less wear costs much tolerance.

    Parameters
    ----------
    scope : iterable of DataFrame
        Parts of the table from `wearscope.evaluation.scope`, each with other cells; one factor varies at a
        time. It is iterated twice, with one part in memory at a time.
    ranking : DataFrame
        Ranking of these cells, by detector; an upper bound has no rank (see `rank_deployable`).
    factors : sequence of Factor
    p_f, p_d : float
        Requirement of the scope: probabilities of false alarm and of detection.
    withheld : collection of str
    robot : str
        Robot of these cells; empty for all robots.
    recommended : Recommendation, optional
        Result of `recommend`; by default the detector is picked from the ranking alone.
    """
    counts = add_counts(count_scope(choose_method(part)) for part in scope)
    shown_sure = bool(counts["known"].any())
    # Where the scope table has no confidence, the estimates alone decide.
    counts = counts.assign(sure=counts["sure" if shown_sure else "passes"])
    upper = sorted(ranking.loc[ranking["rank"].isna(), "fda"])
    if recommended is None:
        totals = counts.groupby("fda")[["sure", "cells"]].sum()
        recommended = Recommendation(*pick_detector(ranking, totals["sure"] / totals["cells"], withheld))
    chosen, again = recommended.detector, RESAMPLINGS if recommended.agree else 0
    if not chosen:
        return Conclusion(robot, "", [], sorted(withheld), np.nan, [], 0, 0, shown_sure, p_f, p_d, upper)
    delta, borne = smallest_change(counts[counts["fda"] == chosen])
    cells, sure = 0, 0
    for part in scope:
        own = choose_method(part)
        found = count_sure(own[own["fda"] == chosen], delta, borne, shown_sure)
        cells, sure = cells + found[0], sure + found[1]
    steps = {factor.name: factor.step for factor in factors}
    ends = counts.groupby("factor")["sigma"].max()
    bounds = [
        Bound(name, float(sigma * steps[name]), bool(sigma >= ends[name])) for name, sigma in borne.items()
    ]
    return Conclusion(
        robot, chosen, recommended.tied_with, sorted(withheld), float(delta * steps[FAULT]),
        bounds, cells, sure, shown_sure, p_f, p_d, upper, recommended.agree, again, recommended.cells_first,
    )  # fmt: skip


def smallest_change(own: pd.DataFrame) -> tuple[float, dict[str, float]]:
    """Return the smallest coded change of wear that a detector finds, and the tolerated coded variations.

    `own` are the detector's counts on the grid; both results are explained at `draw_conclusion`.
    """
    for share in SHARES:
        limits, deltas = {}, np.zeros(0)
        for name, rows in own.groupby("factor", sort=True):
            wide = rows.pivot(index="delta", columns="sigma", values="sure")
            # A factor that was dropped for a robot has no rows there, and so fewer cells.
            needed = int(np.ceil(share * rows["cells"].max()))
            deltas, sigmas = wide.index.to_numpy(float), wide.columns.to_numpy(float)
            limits[str(name)] = largest_passing(wide.to_numpy(float) >= needed, sigmas)
        stacked = np.stack(list(limits.values()))
        possible = (stacked > 0).all(axis=0) & (deltas > 0)
        if not possible.any():
            continue
        enough = ENOUGH * np.where(possible, stacked, 0.0).max(axis=1)
        k = int(np.argmax(possible & (stacked >= enough[:, None]).all(axis=0)))
        return float(deltas[k]), {name: float(values[k]) for name, values in limits.items()}
    return np.nan, {}


def count_sure(
    own: pd.DataFrame, delta: float, borne: Mapping[str, float], shown_sure: bool
) -> tuple[int, int]:
    """Return the number of a detector's cells, and of those in which it surely meets the requirement.

    The requirement must be met at a change of wear, for all variations up to the tolerated ones.
    """
    cells = own[CELL].drop_duplicates()
    if np.isnan(delta):
        return len(cells), 0
    at = own[np.isclose(own["delta"], delta)]
    at = at.assign(sure=at["confidence"] >= SURE if shown_sure else at["passes"])
    sure = pd.Series(True, index=pd.MultiIndex.from_frame(cells))
    for name, sigma in borne.items():
        rows = at[(at["factor"] == name) & (at["sigma"] <= sigma * (1 + 1e-9))]
        sure &= rows.groupby(CELL)["sure"].min().reindex(sure.index, fill_value=True).astype(bool)
    return len(cells), int(sure.sum())


def threshold_table(
    cells: Cells,
    conclusion: Conclusion,
    factors: Sequence[Factor],
    levels: Mapping[str, float],
    f0: float,
) -> pd.DataFrame:
    """Return the alarm threshold of every cell of the recommended detector.

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``, ``axis``, ``fda``, ``threshold``: the largest of the thresholds that each factor
        needs at its tolerated variation. Empty where no detector is recommended.
    """
    columns = [*CELL, "threshold"]
    by_name = {factor.name: factor for factor in factors}
    if not conclusion.detector or np.isnan(conclusion.wear):
        return pd.DataFrame(columns=columns)
    delta = conclusion.wear / by_name[FAULT].step
    cells = [(key, one) for key, one in cells if key[3] == conclusion.detector]
    parts = [
        detection_table(
            cells, levels, [one.factor], np.array([delta]),
            np.array([one.sigma / by_name[one.factor].step]), f0, [conclusion.p_f],
        )
        for one in conclusion.bounds
    ]  # fmt: skip
    found = pd.concat(parts, ignore_index=True).groupby(CELL, sort=True)
    return found["threshold"].max().reset_index()[columns]


def threshold_tables(
    cells: Iterable[Cells],
    conclusions: Sequence[Conclusion],
    factors: Sequence[Factor],
    levels: Mapping[str, float],
    f0: float,
) -> pd.DataFrame:
    """Return the thresholds of the recommended detectors in their cells.

    Column ``asked`` is the robot of the recommendation, empty for the one for all robots.

    Parameters
    ----------
    cells : iterable of cells
        Cells in parts, each iterated once.
    conclusions : sequence of Conclusion
    factors, levels, f0
        As in `threshold_table`.
    """
    found: list[list[pd.DataFrame]] = [[] for _ in conclusions]
    for part in cells:
        part = list(part)
        robots = {key[0] for key, _ in part}
        for one, own in zip(conclusions, found, strict=True):
            if one.robot in ("", *robots):
                about = [(key, cell) for key, cell in part if one.robot in ("", key[0])]
                own.append(threshold_table(about, one, factors, levels, f0))
    thresholds = [
        pd.concat(own, ignore_index=True).sort_values(CELL, ignore_index=True).assign(asked=one.robot)
        for one, own in zip(conclusions, found, strict=True)
    ]
    return pd.concat(thresholds, ignore_index=True)


def conclude_study(
    scope: Iterable[pd.DataFrame],
    snr: pd.DataFrame,
    factors: Sequence[Factor],
    p_f: float,
    p_d: float,
    withheld: Collection[str] = (),
    seed: int = 0,
    upper: Collection[str] = (),
    again: Callable[[np.random.Generator], Collection[str]] | None = None,
) -> tuple[list[Conclusion], pd.DataFrame]:
    """Conclude a study: for all robots together and, where there are several, for each robot.

    Parameters
    ----------
    scope : iterable of DataFrame
        Parts of the scope table, as in `draw_conclusion`, each with all rows of its robots.
    snr : DataFrame
    factors, p_f, p_d, withheld
        As in `draw_conclusion`.
    seed : int
    upper : collection of str
        Detectors that know the simulator's friction law; they get no rank.
    again : callable, optional
        Returns the withheld detectors for a resampling, as in `recommend`.

    Returns
    -------
    conclusions : list of Conclusion
        That of all robots first.
    rankings : DataFrame
        ``robot`` (empty for all together) and the columns of `wearscope.evaluation.ranking.rank_by_median`.
    """
    robots = sorted(snr["robot"].unique())
    robots = robots if len(robots) > 1 else []
    reach = reach_table(scope)
    chosen = {}
    for robot in ("", *robots):
        cells, reached = (table if not robot else table[table["robot"] == robot] for table in (snr, reach))
        chosen[robot] = recommend(cells, reached, upper, withheld, again, seed)
    rankings = {robot: ranking for robot, (_, ranking) in chosen.items()}
    asked = (factors, p_f, p_d, withheld)
    found = {"": draw_conclusion(scope, rankings[""], *asked, recommended=chosen[""][0])}
    for part in scope if robots else ():
        for robot, rows in part.groupby("robot", sort=False):
            own = chosen[str(robot)]
            found[str(robot)] = draw_conclusion([rows], own[1], *asked, str(robot), own[0])
    table = pd.concat([rows.assign(robot=robot) for robot, rows in rankings.items()], ignore_index=True)
    conclusions = [found[robot] for robot in rankings]
    return conclusions, table[["robot", *(name for name in table.columns if name != "robot")]]


def overview_table(
    scope: pd.DataFrame,
    snr: pd.DataFrame,
    fits: pd.DataFrame,
    failed_simulations: pd.DataFrame,
    conclusions: Sequence[Conclusion],
    factors: Sequence[Factor],
) -> pd.DataFrame:
    """Summarise each robot and test-cycle in one row, for the detector that is recommended for the robot.

    Parameters
    ----------
    scope, snr : DataFrame
        Tables of some robots.
    fits : DataFrame
        ``robot``, ``cycle``, ``fda``, ``fit`` [%] of the surrogates in use.
    failed_simulations : DataFrame
        ``robot``, ``cycle`` of each failed point.
    conclusions : sequence of Conclusion
        Conclusions for these robots; a study of one robot has only the conclusion for all together.
    factors : sequence of Factor

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``; ``detector``, empty where none is recommended; ``wear``, the smallest change
        that it finds there, in natural units, NaN where it finds none; ``cells`` and ``cells_sure`` as in
        `Conclusion`; ``snr``, the median; ``fit``, the lowest [%]; ``failed_simulations``, their number.
        Sorted by `sort_worst_first`.
    """
    step = next(one for one in factors if one.name == FAULT).step
    found = {one.robot: one for one in conclusions}
    failed = failed_simulations.groupby(["robot", "cycle"]).size()
    records = []
    for (robot, cycle), cells in snr.groupby(["robot", "cycle"], sort=True):
        one = found[str(robot)] if str(robot) in found else found[""]
        here = [table[_at(table, robot, cycle, one.detector)] for table in (cells, fits, scope)]
        records.append(
            {
                "robot": robot,
                "cycle": cycle,
                "detector": one.detector,
                **_find(here[2], one, step),
                "snr": float(here[0]["snr_exact"].median()),
                "fit": float(here[1]["fit"].min()),
                "failed_simulations": int(failed.get((robot, cycle), 0)),
            }
        )
    return sort_worst_first(pd.DataFrame(records))


def sort_worst_first(overview: pd.DataFrame) -> pd.DataFrame:
    """Sort rows: those without any found wear first, then by falling wear, then by rising SNR."""
    order = overview.assign(wear=overview["wear"].fillna(np.inf), snr=overview["snr"].fillna(-np.inf))
    order = order.sort_values(["wear", "snr", "robot", "cycle"], ascending=[False, True, True, True])
    return overview.loc[order.index].reset_index(drop=True)


def _at(table: pd.DataFrame, robot: object, cycle: object, detector: str) -> pd.Series:
    """Mark the rows of a robot, test-cycle and detector."""
    return (table["robot"] == robot) & (table["cycle"] == cycle) & (table["fda"] == detector)


def _find(scope: pd.DataFrame, one: Conclusion, step: float) -> Mapping[str, object]:
    """Return ``wear``, ``cells`` and ``cells_sure`` of the rows of a scope table."""
    if scope.empty:
        return {"wear": np.nan, "cells": 0, "cells_sure": 0}
    own = choose_method(scope)
    counts = count_scope(own)
    counts = counts.assign(sure=counts["sure" if one.shown_sure else "passes"])
    delta, borne = smallest_change(counts)
    cells, sure = count_sure(own, delta, borne, one.shown_sure)
    return {"wear": delta * step, "cells": cells, "cells_sure": sure}
