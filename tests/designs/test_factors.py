import numpy as np
import pytest

from wearscope.designs.factors import (
    PAPER_FACTORS,
    Factor,
    check_factors,
    nominal_levels,
    wear_names,
)

TABLE_1 = {
    "f": [0, 12.5, 25, 37.5, 50],
    "w1": [0, 12.5, 25, 37.5, 50],
    "w2": [0, 12.5, 25, 37.5, 50],
    "w3": [30, 40, 50, 60, 70],
    "w4": [25, 37.5, 50, 62.5, 75],
    "w5": [-10, -5, 0, 5, 10],
}
TABLE_3 = {
    "f": ([5, 15, 25, 35, 45], [-1.6, -0.8, 0, 0.8, 1.6]),
    "w1": ([5, 15, 25, 35, 45], [-1.6, -0.8, 0, 0.8, 1.6]),
    "w2": ([5, 15, 25, 35, 45], [-1.6, -0.8, 0, 0.8, 1.6]),
    "w3": ([35, 42, 49, 56, 63], [-1.5, -0.8, -0.1, 0.6, 1.3]),
    "w4": ([31, 41, 51, 61, 71], [-1.52, -0.72, 0.08, 0.88, 1.68]),
    "w5": ([-9, -6, -3, 0, 3], [-1.8, -1.2, -0.6, 0, 0.6]),
}


@pytest.mark.parametrize("factor", PAPER_FACTORS, ids=lambda factor: factor.name)
def test_levels_are_those_of_table_1(factor):
    np.testing.assert_allclose(factor.to_natural([-2, -1, 0, 1, 2]), TABLE_1[factor.name], atol=1e-12)
    np.testing.assert_allclose(factor.to_coded(TABLE_1[factor.name]), [-2, -1, 0, 1, 2], atol=1e-12)


@pytest.mark.parametrize("factor", PAPER_FACTORS, ids=lambda factor: factor.name)
def test_validation_levels_are_those_of_table_3_in_the_identification_coding(factor):
    natural, coded = TABLE_3[factor.name]
    got = factor.validation_to_coded([-2, -1, 0, 1, 2])
    np.testing.assert_allclose(got, coded, atol=1e-12)
    np.testing.assert_allclose(factor.to_natural(got), natural, atol=1e-12)


def test_nominal_point_is_eq_18():
    assert list(nominal_levels(PAPER_FACTORS).values()) == [-2, -2, -2, 0, 0, 0]
    assert wear_names(PAPER_FACTORS) == ["f", "w1", "w2"]


def change(k, **fields):
    factors = list(PAPER_FACTORS)
    factors[k] = Factor(**{**factors[k].__dict__, **fields})
    return factors


def test_bad_factors_get_one_sentence(refuses):
    for make in (
        lambda: change(3, low=70, high=30),
        lambda: change(3, levels=1),
        lambda: change(3, validation_low=10),
        lambda: change(3, role="noise"),
        lambda: change(3, nominal=3.0),
        lambda: change(3, name="y"),
        lambda: check_factors(change(3, name="w4")),
        lambda: check_factors(PAPER_FACTORS[1:]),
        lambda: check_factors([PAPER_FACTORS[1], PAPER_FACTORS[0]]),
        lambda: check_factors(change(1, high=60)),
    ):
        refuses(make)
