import numpy as np
import pandas as pd
import pytest

from wearscope.evaluation.ranking import RESAMPLINGS, recommend

CELLS = [("r", f"c{k}", axis) for k in range(2) for axis in (1, 2, 3)]


def make_snr(medians, spread=0.05, cells=CELLS, seed=0):
    """SNR of each detector in some cells, scattered about its median, with an interval of +-0.1."""
    rng = np.random.default_rng(seed)
    rows = [
        {"robot": r, "cycle": c, "axis": a, "fda": fda, "snr_exact": median + spread * rng.standard_normal()}
        for r, c, a in cells for fda, median in medians.items()
    ]  # fmt: skip
    table = pd.DataFrame(rows)
    return table.assign(snr_low=table["snr_exact"] - 0.1, snr_high=table["snr_exact"] + 0.1)


def make_reach(snr, reach):
    return snr[["robot", "cycle", "axis", "fda"]].assign(reach=snr["fda"].map(reach))


@pytest.mark.parametrize("cells", [CELLS, CELLS[:3]])
def test_a_clear_best_comes_out_each_time(cells):
    snr = make_snr({"A": 1.0, "B": 2.0, "U": 9.0}, cells=cells)
    found, ranking = recommend(snr, make_reach(snr, {"A": 0.9, "B": 0.1, "U": 1.0}), upper=["U"])
    assert (found.detector, found.tied_with, found.agree) == ("B", [], RESAMPLINGS)
    assert (found.cells, found.cells_first) == (len(cells), len(cells))
    assert ranking["fda"].tolist() == ["B", "A", "U"]


def test_of_equal_detectors_the_one_that_reaches_more_comes_out():
    snr = make_snr({"A": 2.0, "B": 2.0}, spread=0.3)
    values = ["snr_exact", "snr_low", "snr_high"]
    snr.loc[snr["fda"] == "B", values] = snr.loc[snr["fda"] == "A", values].to_numpy()[::-1]
    for better in "AB":
        reach = make_reach(snr, {"A": 0.4, "B": 0.4} | {better: 0.6})
        found, _ = recommend(snr, reach)
        assert found.detector == better and found.agree >= 17 and found.tied_with


def test_what_is_withheld_in_some_resamplings_lowers_the_count():
    snr = make_snr({"A": 1.0, "B": 2.0})
    reach = make_reach(snr, {"A": 0.5, "B": 0.5})
    turns = iter([["B"]] * 6 + [[]] * (RESAMPLINGS - 6))
    found, _ = recommend(snr, reach, again=lambda stream: next(turns))
    assert (found.detector, found.agree) == ("B", RESAMPLINGS - 6)
    turns = iter([["B"]] * 14 + [[]] * (RESAMPLINGS - 14))
    other, _ = recommend(snr, reach, again=lambda stream: next(turns))
    assert (other.detector, other.agree, other.tied_with) == ("A", 14, ["B"])
    assert other.cells_first == 0


def test_the_choice_does_not_depend_on_the_seed_where_it_is_clear():
    snr = make_snr({"A": 1.5, "B": 2.0, "C": 0.4}, spread=0.5)
    reach = make_reach(snr, {"A": 0.4, "B": 0.5, "C": 0.1})
    found = [recommend(snr, reach, seed=seed)[0] for seed in range(2)]
    assert {one.detector for one in found} == {"B"} and min(one.agree for one in found) >= 15


def test_nothing_is_recommended_where_all_is_withheld_or_blind():
    snr = make_snr({"A": 1.0, "B": 2.0})
    reach = make_reach(snr, {"A": 0.5, "B": 0.5})
    assert recommend(snr, reach, withheld=["A", "B"])[0].detector == ""
    blind = make_snr({"A": -1.0, "B": -2.0})
    found = recommend(blind, make_reach(blind, {"A": 0.5, "B": 0.5}))[0]
    assert (found.detector, found.agree) == ("", RESAMPLINGS)
