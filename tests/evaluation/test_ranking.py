"""Upper bounds have no rank and are never recommended."""

import numpy as np
import pandas as pd
import pytest

from wearscope.detectors.base import list_bounds, name_knowledge
from wearscope.evaluation.ranking import rank_by_median, rank_deployable


@pytest.fixture
def snr():
    """Twelve cells a detector; D is by far the best."""
    rng = np.random.default_rng(5)
    rows = [
        ("r", cycle, axis, fda, level + rng.normal(0, 0.1))
        for fda, level in (("A", 1.0), ("C", 3.0), ("D", 300.0))
        for cycle in ("a", "b", "c")
        for axis in range(4)
    ]
    return pd.DataFrame(rows, columns=["robot", "cycle", "axis", "fda", "snr_exact"])


def test_an_upper_bound_follows_without_a_rank(snr):
    found = rank_deployable(snr, ["D"], draws=100)
    assert found["fda"].to_list() == ["C", "A", "D"]
    assert found["rank"].to_list()[:2] == [1, 2] and np.isnan(found["rank"].iloc[2])
    assert found["median"].iloc[2] == pytest.approx(300, abs=1)
    without = rank_by_median(snr[snr["fda"] != "D"], draws=100)
    shared = without.columns.drop(["rank", "rank_low", "rank_high"])
    pd.testing.assert_frame_equal(found.loc[:1, shared], without[shared])


def test_without_bounds_it_is_the_plain_ranking(snr):
    pd.testing.assert_frame_equal(rank_deployable(snr, draws=100), rank_by_median(snr, draws=100))


def test_groups_of_several_detectors_hold_no_bound(snr):
    found = rank_deployable(snr, ["D"], by=("axis",), draws=50)
    assert found["median"].max() < 10


def test_bounds_alone_give_no_first_place(snr, refuses):
    found = rank_deployable(snr[snr["fda"] == "D"], ["D"], draws=50)
    assert found["rank"].isna().all()
    refuses(rank_deployable, snr[snr["fda"] == "D"], ["D"], by=("axis",), draws=50)


def test_what_the_built_in_detectors_are_told():
    asked = {"C": "friction_fit", "D": "wear_temperature_fit", "A": "residual_energy"}
    assert list_bounds({name: {"use": use} for name, use in asked.items()}) == ["D"]
    assert name_knowledge("friction_change") == "nominal model"
    assert name_knowledge("wasserstein") == "nothing"


def test_a_detector_that_says_something_else_is_refused(tmp_path, refuses):
    file = tmp_path / "odd.py"
    file.write_text(
        "class Odd:\n    knows = 'all'\n    def fit(self, n, a, m): pass\n"
        "    def test_quantity(self, b): return 0.0\n\n\nDETECTOR = Odd\n"
    )
    refuses(name_knowledge, str(file))
