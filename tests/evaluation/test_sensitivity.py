import numpy as np
import pytest

from wearscope.evaluation.grouping import box_statistics, wilson_interval
from wearscope.evaluation.sensitivity import group_matrices, sensitivity_of


def test_group_matrices_have_a_row_a_cell_and_a_column_a_coefficient(surrogates):
    matrices = group_matrices(surrogates, "simplified", ["fda"])
    assert list(matrices) == [("A",), ("B",), ("C",)]
    assert all(matrix.shape == (12, 21) for matrix in matrices.values())
    value = surrogates.query(
        "robot == 'large' and cycle == 'b' and axis == 2 and fda == 'B' and model == 'simplified'"
    ).set_index("term")["theta"]
    assert matrices[("B",)].loc[("large", "b", 2), "w3"] == value["w3"] / value["f"]
    np.testing.assert_array_equal(matrices[("A",)]["f"], 1.0)


@pytest.mark.parametrize(
    ("by", "groups", "cells"),
    [([], 1, 36), (["robot"], 2, 18), (["robot", "axis"], 6, 6), (["robot", "cycle", "axis", "fda"], 36, 1)],
)
def test_any_subset_of_design_parameters_forms_groups(surrogates, by, groups, cells):
    matrices = group_matrices(surrogates, "full", by)
    assert len(matrices) == groups
    assert {matrix.shape for matrix in matrices.values()} == {(cells, 27)}


def test_box_statistics_of_known_values():
    stats = box_statistics([1.0, 2.0, 3.0, 4.0, 100.0, np.nan])
    assert stats == {
        "n": 5, "n_nan": 1, "median": 3.0, "q1": 2.0, "q3": 4.0, "whisker_low": 1.0, "whisker_high": 4.0,
        "n_outliers": 1,
    }  # fmt: skip
    # Quartiles 10 and 14: whiskers reach from 4 to 20, both included.
    stats = box_statistics([20.1, 20.0, 14.0, 13.0, 12.0, 11.0, 10.0, 4.0, 3.9])
    assert (stats["q1"], stats["median"], stats["q3"]) == (10.0, 12.0, 14.0)
    assert (stats["whisker_low"], stats["whisker_high"], stats["n_outliers"]) == (4.0, 20.0, 2)
    empty = box_statistics([np.nan])
    assert empty["n"] == 0 and np.isnan(empty["median"])


def test_wilson_interval_of_published_values():
    # Newcombe (1998), Table I: 81/263 gives 0.2553 to 0.3662, 0/20 gives 0 to 0.1611
    assert wilson_interval(81, 263) == (pytest.approx(0.2553, abs=5e-5), pytest.approx(0.3662, abs=5e-5))
    assert wilson_interval(0, 20) == (0.0, pytest.approx(0.1611, abs=5e-5))
    assert wilson_interval(20, 20)[1] == 1.0
    assert np.isnan(wilson_interval(0, 0)).all()


def test_a_dominant_nuisance_is_found_and_stated_with_its_interval(quantities):
    from wearscope.surrogates.fitting import fit_surrogates

    loud = quantities.copy()
    loud["y"] += 5.0 * loud["w3"]
    table = sensitivity_of([fit_surrogates(loud, ["simplified"])])
    found = table[(table["share_relevant"] > 0.5) & (table["term"] != "f")]
    assert set(found["term"]) == {"w3"}
    assert len(found) == 3 and (found["share_low"] > 0.5).all()
    row = found.iloc[0]
    assert (row["n"], row["n_relevant"], row["share_relevant"]) == (12, 12, 1.0)
    assert row["share_low"] == pytest.approx(0.7575, abs=5e-4)


def test_a_cell_without_direct_effect_is_nan_not_zero(odd):
    table = sensitivity_of([odd])
    constant = table[table["fda"] == "C"]
    assert (constant["n_nan"] == 3).all() and (constant["n"] == 0).all()
    assert constant[["median", "share_relevant", "share_low"]].isna().all().all()
    falling = table[(table["fda"] == "B") & (table["term"] == "f")]
    assert falling["median"].item() == 1.0


def test_bad_groupings_get_one_sentence(surrogates, refuses):
    refuses(group_matrices, surrogates, "full", ["point"])
    refuses(group_matrices, surrogates, "full", ["fda", "fda"])
    refuses(group_matrices, surrogates, "main")
