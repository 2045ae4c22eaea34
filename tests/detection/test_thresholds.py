"""Thresholds and their meaning against distributions that are known."""

import numpy as np
import pytest
from scipy import stats

from wearscope.detection.thresholds import (
    WearScale,
    compare_scatter,
    find_detected_wear,
    find_p_value,
    find_threshold,
    least_runs,
    measure_distances,
    widen,
)


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


def test_the_fewest_runs_give_the_largest_value_as_the_threshold():
    assert least_runs(0.01) == 99
    assert find_threshold(np.arange(99.0), 0.01).value == 98.0


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


@pytest.mark.parametrize("times", [1.0, 3.0, 10.0])
@pytest.mark.parametrize("sessions", [3, 5, 20])
def test_the_false_alarm_rate_holds_on_a_machine_that_scatters_more_than_the_simulator(times, sessions):
    rng = np.random.default_rng(5)
    alarms, plain = [], []
    for _ in range(300):
        simulated = rng.standard_normal(299)
        nominal, later = times * rng.standard_normal(sessions), times * rng.standard_normal(20)
        scatter = compare_scatter(measure_distances(nominal, simulated), sessions, 0.02)
        wide = widen(simulated, np.median(simulated), scatter.widening)
        alarms.append(np.mean(later >= find_threshold(wide, 0.02).value))
        plain.append(np.mean(later >= find_threshold(simulated, 0.02).value))
    assert np.mean(alarms) < 0.025
    assert times == 1.0 or np.mean(plain) > 0.2
    # Many sessions leave a threshold that is nearly as sharp as one of the machine's own scatter.
    assert sessions < 20 or times == 1.0 or np.mean(alarms) > 0.01


def test_a_scatter_is_measured_about_the_simulated_median_and_never_narrows():
    simulated = np.linspace(-1.0, 1.0, 101)

    def compare(machine, sessions=101):
        return compare_scatter(measure_distances(machine, simulated), sessions, 0.02)

    assert compare(simulated / 10).widening == pytest.approx(1.0, abs=0.05)
    assert compare(simulated / 10 + 5.0).ratio == pytest.approx(5.0 / simulated.std(), rel=0.01)
    few = compare(5.0 * simulated, sessions=2)
    assert few.ratio == pytest.approx(5.0) and np.isnan(few.widening)
    assert widen(simulated, 0.0, few.widening) is simulated
    assert np.isnan(compare(np.zeros(0)).ratio)
    assert np.isnan(compare_scatter(measure_distances(simulated, np.ones(5)), 5, 0.02).widening)


def test_a_wider_machine_reads_wear_with_wider_intervals():
    rng = np.random.default_rng(6)
    wear = rng.uniform(0, 50, 400)
    y = 0.1 * wear + 0.1 * rng.standard_normal(400)
    narrow, wide = (WearScale(wear, y, times).read(2.5) for times in (1.0, 3.0))
    assert wide[0] == pytest.approx(narrow[0], abs=0.2)
    assert wide[2] - wide[1] == pytest.approx(3.0 * (narrow[2] - narrow[1]), rel=0.1)
