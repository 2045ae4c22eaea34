import json

import numpy as np
import pandas as pd
import pytest

from wearscope.designs.factors import PAPER_FACTORS
from wearscope.evaluation.conclusion import (
    Conclusion,
    conclude_study,
    count_sure,
    draw_conclusion,
    read_conclusion,
)

DELTAS, SIGMAS = np.array([0.0, 1.0, 2.0, 3.0, 4.0]), np.array([0.25, 0.5, 0.75, 1.0])


def make_scope(limit, axes=(1, 2), robots=("r",), confidence=None):
    """Scope that passes where sigma is up to ``limit(fda, factor, axis, robot) * (delta - 1)``."""
    records = [
        {
            "robot": robot, "cycle": "c", "axis": axis, "fda": fda, "model": "full", "factor": factor,
            "delta": delta, "sigma": sigma, "method": "exact",
            "passes": bool(delta > 0 and sigma <= limit(fda, factor, axis, robot) * (delta - 1) + 1e-12),
        }
        for robot in robots for axis in axes for fda in ("A", "B") for factor in ("w3", "w5")
        for delta in DELTAS for sigma in SIGMAS
    ]  # fmt: skip
    table = pd.DataFrame(records)
    return table.assign(confidence=table["passes"] * 1.0 if confidence is None else confidence)


def make_ranking(first="A", tied=""):
    rows = [(first, 5.0, 1.0, tied), ("B" if first == "A" else "A", 2.0, 2.0, first if tied else "")]
    return pd.DataFrame(rows, columns=["fda", "median", "rank", "tied_with"])


def conclude(scope, ranking, **options):
    return draw_conclusion([scope], ranking, PAPER_FACTORS, 0.01, 0.99, **options)


def test_planted_limits_are_found_in_natural_units():
    found = conclude(make_scope(lambda *_: 0.25), make_ranking())
    # It bears 0.25 at delta 2, 0.75 at 4; half of that, 0.5 on this grid, from 3.
    assert found.detector == "A" and found.wear == pytest.approx(3 * 12.5)
    assert {bound.factor: bound.sigma for bound in found.bounds} == pytest.approx({"w3": 5.0, "w5": 2.5})
    assert not any(bound.largest for bound in found.bounds) and (found.cells, found.cells_sure) == (2, 2)


def test_the_end_of_the_grid_is_called_so():
    found = conclude(make_scope(lambda fda, factor, *_: 1.0 if factor == "w3" else 0.25), make_ranking())
    assert {bound.factor: bound.largest for bound in found.bounds} == {"w3": True, "w5": False}


def test_half_the_cells_are_asked_where_all_are_never_sure():
    found = conclude(make_scope(lambda fda, factor, axis, _: 0.25 if axis == 1 else 0.0), make_ranking())
    assert (found.cells_sure, found.cells) == (1, 2) and np.isfinite(found.wear)


def test_what_passes_by_the_estimate_alone_is_not_sure():
    found = conclude(make_scope(lambda *_: 1.0, confidence=0.5), make_ranking())
    assert found.shown_sure and np.isnan(found.wear) and not found.bounds
    unknown = conclude(make_scope(lambda *_: 1.0, confidence=np.nan), make_ranking())
    assert not unknown.shown_sure and np.isfinite(unknown.wear)


def test_of_detectors_not_told_apart_the_one_with_the_larger_sure_scope_is_used():
    scope = make_scope(lambda fda, *_: 0.5 if fda == "B" else 0.1)
    assert conclude(scope, make_ranking("A", tied="B")).detector == "B"
    assert conclude(scope, make_ranking("A", tied="B")).tied_with == ["A"]
    assert conclude(scope, make_ranking("A")).detector == "A"


def test_of_equally_sure_ones_the_better_ranked_is_used():
    scope = make_scope(lambda *_: 0.25)
    for first, other in ("AB", "BA"):
        assert conclude(scope, make_ranking(first, tied=other)).detector == first


def test_a_cell_is_sure_where_each_factor_is_up_to_its_own_bound():
    """At a change of 2 one axis bears 0.25 of w3 and 0.75 of w5, the other less of w5."""
    bears = {("w3", 1): 0.25, ("w5", 1): 0.75, ("w3", 2): 0.25, ("w5", 2): 0.5}
    scope = make_scope(lambda fda, factor, axis, _: bears[factor, axis])
    own = scope[scope["fda"] == "A"]
    for borne, sure in (
        ({"w3": 0.25, "w5": 0.75}, 1), ({"w3": 0.25, "w5": 0.5}, 2), ({"w3": 0.5, "w5": 0.5}, 0), ({}, 2),
    ):  # fmt: skip
        assert count_sure(own, 2.0, borne, shown_sure=True) == (2, sure), borne
    assert count_sure(own, np.nan, {}, shown_sure=True) == (2, 0)
    doubted = own.assign(confidence=0.94)
    assert count_sure(doubted, 2.0, {"w3": 0.25}, shown_sure=True) == (2, 0)
    assert count_sure(doubted, 2.0, {"w3": 0.25}, shown_sure=False) == (2, 2)
    assert count_sure(own.assign(confidence=0.95), 2.0, {"w3": 1.0}, shown_sure=True) == (2, 2)


def test_withheld_and_blind_detectors_are_not_recommended():
    scope = make_scope(lambda *_: 0.5)
    assert conclude(scope, make_ranking(), withheld=["A"]).detector == "B"
    assert conclude(scope, make_ranking(), withheld=["A", "B"]).detector == ""
    assert conclude(scope, make_ranking().assign(median=-1.0)).detector == ""


def test_an_upper_bound_is_never_recommended():
    scope = make_scope(lambda *_: 0.25)
    bound = make_ranking().assign(rank=[np.nan, 1.0])
    found = conclude(scope, bound)
    assert found.detector == "B" and found.upper == ["A"]
    assert read_conclusion(found.to_mapping()) == found
    alone = conclude(scope, make_ranking().assign(rank=np.nan))
    assert alone.detector == "" and alone.upper == ["A", "B"]


def test_a_conclusion_survives_its_file():
    for found in (
        conclude(make_scope(lambda *_: 0.25), make_ranking()),
        conclude(make_scope(lambda *_: 0.0), make_ranking()),
    ):
        again = read_conclusion(json.loads(json.dumps(found.to_mapping(), allow_nan=False)))
        assert isinstance(again, Conclusion) and again.to_mapping() == found.to_mapping()


def with_snr(scope):
    """The scope as the only part, and signal-to-noise ratios of its cells, in which A is the best."""
    snr = scope[["robot", "cycle", "axis", "fda"]].drop_duplicates()
    values = np.where(snr["fda"] == "A", 5.0, 2.0)
    return [scope], snr.assign(snr_exact=values, snr_low=values - 0.1, snr_high=values + 0.1)


def test_robots_are_concluded_side_by_side():
    scope = make_scope(lambda fda, factor, axis, robot: 0.5 if robot == "r" else 0.25, robots=("r", "s"))
    conclusions, rankings = conclude_study(*with_snr(scope), PAPER_FACTORS, 0.01, 0.99)
    assert [one.robot for one in conclusions] == ["", "r", "s"]
    assert conclusions[1].wear < conclusions[2].wear
    assert conclusions[0].wear == conclusions[2].wear
    assert sorted(rankings["robot"].unique()) == ["", "r", "s"]


def test_a_robot_alone_is_concluded_once():
    conclusions, rankings = conclude_study(*with_snr(make_scope(lambda *_: 0.25)), PAPER_FACTORS, 0.01, 0.99)
    assert [one.robot for one in conclusions] == [""] and set(rankings["robot"]) == {""}
