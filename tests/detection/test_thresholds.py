"""Thresholds and their meaning against distributions that are known."""

import numpy as np
import pytest
from scipy import stats

from wearscope.detection.thresholds import (
    WearScale,
    adjust_p_values,
    compare_scatter,
    find_detected_wear,
    find_p_value,
    find_threshold,
    least_runs,
)
from wearscope.errors import InputError


@pytest.mark.parametrize("draw", [np.random.Generator.standard_normal, np.random.Generator.standard_cauchy])
@pytest.mark.parametrize("p_f", [0.01, 0.05])
def test_the_false_alarm_rate_is_the_wanted_one_whatever_the_distribution(draw, p_f):
    rng = np.random.default_rng(1)
    law = stats.norm if draw is np.random.Generator.standard_normal else stats.cauchy
    rates = [law.sf(find_threshold(draw(rng, 299), p_f).value) for _ in range(400)]
    assert np.mean(rates) == pytest.approx(p_f, rel=0.12)
    threshold = find_threshold(draw(rng, 299), p_f)
    inside = np.mean([(threshold.rate_low <= rate) & (rate <= threshold.rate_high) for rate in rates])
    assert 0.92 <= inside <= 0.98


def test_too_few_runs_for_the_wanted_rate_are_refused_with_the_number_needed():
    assert least_runs(0.01) == 99
    find_threshold(np.arange(99.0), 0.01)
    with pytest.raises(InputError, match="takes 99 runs without wear, but there are 98"):
        find_threshold(np.arange(98.0), 0.01)


def test_p_values_are_uniform_without_wear():
    rng = np.random.default_rng(2)
    p = [find_p_value(rng.standard_normal(), rng.standard_normal(199)) for _ in range(600)]
    assert stats.kstest(p, "uniform").pvalue > 0.01
    assert np.isnan(find_p_value(1.0, np.zeros(0)))


def test_detected_wear_is_where_the_true_curve_crosses():
    rng = np.random.default_rng(3)
    wear = np.linspace(0, 50, 2001)
    y = 0.1 * wear + 0.2 * rng.standard_normal(len(wear))
    # y reaches 2 with 99 % from wear 20 + 10 z on; over all greater wears the share is larger, so a little
    # less.
    found = find_detected_wear(wear, y, 2.0, 0.99)
    assert 17.0 < found < 24.7
    assert np.isnan(find_detected_wear(wear, y, 100.0, 0.99))


def test_wear_is_read_back_with_its_interval():
    rng = np.random.default_rng(4)
    wear = rng.uniform(0, 50, 400)

    def measure(f):
        return 0.02 * f + 0.001 * f**2 + (0.05 + 0.002 * f) * rng.standard_normal(np.shape(f))

    scale = WearScale(wear, measure(wear))
    truth = rng.uniform(5, 45, 500)
    read = np.array([scale.read(y) for y in measure(truth)])
    inside = np.mean((read[:, 1] <= truth) & (truth <= read[:, 2]))
    assert 0.90 < inside < 0.99
    assert abs(np.median(read[:, 0] - truth)) < 0.5


def test_a_scatter_that_is_the_simulators_is_taken_for_it_and_others_are_not():
    rng = np.random.default_rng(5)
    alike = [compare_scatter(rng.standard_normal(6), rng.standard_normal(300)).p_value for _ in range(400)]
    assert np.mean(np.array(alike) < 0.05) == pytest.approx(0.05, abs=0.03)
    wide = [compare_scatter(4 * rng.standard_normal(6), rng.standard_normal(300)) for _ in range(100)]
    assert np.mean([one.p_value < 0.05 for one in wide]) > 0.8
    assert 2.5 < np.median([one.ratio for one in wide]) < 5.5
    shifted = [compare_scatter(3 + rng.standard_normal(6), rng.standard_normal(300)) for _ in range(100)]
    assert np.mean([one.p_value < 0.05 for one in shifted]) > 0.8
    assert np.isnan(compare_scatter(rng.standard_normal(2), rng.standard_normal(300)).p_value)


def test_holm_leaves_nan_and_never_lowers():
    p = np.array([0.01, np.nan, 0.04, 0.03])
    np.testing.assert_allclose(adjust_p_values(p), [0.03, np.nan, 0.06, 0.06])
