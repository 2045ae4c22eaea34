"""A study of many robots at a glance: a row for each robot and test-cycle, the worst first."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from wearscope.designs.factors import FAULT, Factor
from wearscope.evaluation.conclusion import Conclusion, count_sure, smallest_change
from wearscope.evaluation.recommendation import choose_method
from wearscope.evaluation.scope import count_scope


def overview_table(
    scope: pd.DataFrame,
    snr: pd.DataFrame,
    fits: pd.DataFrame,
    failed_simulations: pd.DataFrame,
    conclusions: Sequence[Conclusion],
    factors: Sequence[Factor],
) -> pd.DataFrame:
    """Results of the detector that is recommended for each robot, a row for each of its test-cycles.

    Parameters
    ----------
    scope, snr : DataFrame
        Of some robots.
    fits : DataFrame
        ``robot``, ``cycle``, ``fda``, ``fit`` [%] of the surrogates that are asked.
    failed_simulations : DataFrame
        ``robot``, ``cycle``.
    conclusions : sequence of Conclusion
        Of these robots; a robot that is alone has the one of all together.
    factors : sequence of Factor

    Returns
    -------
    DataFrame
        ``robot``, ``cycle``; ``detector``, empty where none is recommended; ``wear``, the smallest change
        that it finds there, natural units, NaN where none; ``cells`` and ``cells_sure`` of it there; ``snr``,
        its median; ``fit`` [%], its lowest; ``failed_simulations``. Sorted by `sort_worst_first`.
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
    """Rows where no wear is found first, then by the smallest wear that is found, then by the SNR."""
    order = overview.assign(wear=overview["wear"].fillna(np.inf), snr=overview["snr"].fillna(-np.inf))
    order = order.sort_values(["wear", "snr", "robot", "cycle"], ascending=[False, True, True, True])
    return overview.loc[order.index].reset_index(drop=True)


def _at(table: pd.DataFrame, robot: object, cycle: object, detector: str) -> pd.Series:
    return (table["robot"] == robot) & (table["cycle"] == cycle) & (table["fda"] == detector)


def _find(scope: pd.DataFrame, one: Conclusion, step: float) -> Mapping[str, object]:
    if scope.empty:
        return {"wear": np.nan, "cells": 0, "cells_sure": 0}
    own = choose_method(scope)
    counts = count_scope(own)
    counts = counts.assign(sure=counts["sure" if one.shown_sure else "passes"])
    delta, borne = smallest_change(counts)
    cells, sure = count_sure(own, delta, borne, one.shown_sure)
    return {"wear": delta * step, "cells": cells, "cells_sure": sure}
