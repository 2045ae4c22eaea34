import numpy as np
import pandas as pd
import pytest
from planted_study import planted_test_quantities
from scipy.special import ndtr, ndtri

from wearscope.designs.factors import PAPER_FACTORS, nominal_levels
from wearscope.designs.kinds import make_design
from wearscope.evaluation.sampled_scope import (
    detection_table,
    pick_levels,
    response_table,
    scope_table,
    simulated_table,
    weighted_threshold,
)
from wearscope.surrogates.chosen import ChosenSurrogate
from wearscope.surrogates.fitting import CELL, fit_surrogates, surrogates_of
from wearscope.surrogates.kinds.linear import fit_quadratic

LEVELS = nominal_levels(PAPER_FACTORS)


@pytest.fixture(scope="module")
def points():
    table = planted_test_quantities(cycles=("a",), axes=(1, 2), fdas=("A", "C"), seed=5)[0]
    return table[table["robot"] == table["robot"].iloc[0]].assign(status="ok")


@pytest.fixture(scope="module")
def surrogates(points):
    return fit_surrogates(points, ["full"])


@pytest.fixture(scope="module")
def cells(surrogates):
    return [(key[:4], one) for key, one in surrogates_of(surrogates, "full")]


def test_detection_at_the_scope_s_own_false_alarm_is_the_scope(surrogates, cells):
    deltas, sigmas = np.array([1.0, 3.0]), np.array([0.2, 0.9])
    table = detection_table(cells, LEVELS, ["w3", "w5"], deltas, sigmas, -2.0, [0.01, 0.1])
    own = surrogates_of(surrogates, "full")
    scope = scope_table(own, ("w3", "w5"), LEVELS, deltas, sigmas, methods=["exact"], draws=0)
    both = table[table["p_f"] == 0.01].merge(scope, on=[*CELL, "factor", "delta", "sigma"])
    assert len(both) == len(cells) * 2 * 4
    assert both["p_d_x"].to_numpy() == pytest.approx(both["p_d_y"].to_numpy(), abs=1e-12)


def test_more_false_alarms_lower_the_threshold_and_detect_more(cells):
    alarms = [0.001, 0.01, 0.1, 0.5]
    table = detection_table(cells, LEVELS, ["w3"], np.array([2.0]), np.array([0.5]), -2.0, alarms)
    for _, rows in table.groupby(CELL):
        assert (np.diff(rows["threshold"]) < 0).all() and (np.diff(rows["p_d"]) >= 0).all()


def test_the_threshold_of_a_normal_is_its_quantile():
    edges = np.linspace(-6, 6, 4001)
    weights = np.diff(ndtr(np.concatenate([[-np.inf], edges, [np.inf]])))
    values = np.concatenate([[-6.0], 0.5 * (edges[1:] + edges[:-1]), [6.0]])
    for alarm in (0.001, 0.05, 0.5):
        assert weighted_threshold(values, weights, alarm) == pytest.approx(ndtri(1 - alarm), abs=5e-3)
        assert weights[values >= weighted_threshold(values, weights, alarm)].sum() <= alarm + 1e-12


def test_a_threshold_lies_within_the_value_at_which_the_share_is_passed():
    """Of 3, 2 and 1 with weights of 0.2, 0.3 and 0.5: three tenths are a third of the way from 3 to 2."""
    values, weights = np.array([2.0, 3.0, 1.0]), np.array([0.3, 0.2, 0.5])
    for alarm, wanted in ((0.3, 3.0 - 1.0 / 3.0), (0.2, 3.0), (0.75, 1.5), (1.0, 1.0)):
        assert weighted_threshold(values, weights, alarm) == pytest.approx(wanted)
    assert 3.0 < weighted_threshold(values, weights, 0.1) < 3.0 + 1e-12
    # Equal values are passed together.
    assert 3.0 < weighted_threshold(np.array([3.0, 3.0, 1.0]), weights, 0.4) < 3.0 + 1e-12
    assert weighted_threshold(np.array([3.0, 3.0, 1.0]), weights, 0.6) == pytest.approx(3.0 - 2.0 * 0.2)


def test_nothing_lies_above_the_threshold_of_a_quantity_that_does_not_vary():
    assert weighted_threshold(np.full(5, 2.0), np.full(5, 0.2), 0.3) > 2.0


def test_responses_are_the_surrogate_and_its_interval(cells):
    table = response_table(cells, PAPER_FACTORS, LEVELS, steps=5)
    key, surrogate = cells[0]
    rows = table[(table[CELL] == list(key)).all(axis=1) & (table["factor"] == "w3")]
    z = pd.DataFrame([LEVELS] * 5)[list(surrogate.names)].assign(w3=np.linspace(-2, 2, 5))
    assert rows["y"].to_numpy() == pytest.approx(surrogate.predict(z.to_numpy()))
    assert rows["natural"].to_list() == [30.0, 40.0, 50.0, 60.0, 70.0]
    low, high = surrogate.prediction_interval(z.to_numpy())
    assert rows["low"].to_numpy() == pytest.approx(low) and rows["high"].to_numpy() == pytest.approx(high)


def test_runs_taken_back_to_nominal_lie_as_far_from_the_surrogate_as_before(points, cells):
    table = simulated_table(cells, points, PAPER_FACTORS, LEVELS)
    responses = response_table(cells, PAPER_FACTORS, LEVELS, steps=401)
    key, surrogate = cells[0]
    own = points[(points[CELL] == list(key)).all(axis=1)].sort_values(["set", "point"])
    left = own["y"].to_numpy() - surrogate.predict(own[list(surrogate.names)].to_numpy())
    for name in ("f", "w5"):
        rows = table[(table[CELL] == list(key)).all(axis=1) & (table["factor"] == name)]
        line = responses[(responses[CELL] == list(key)).all(axis=1) & (responses["factor"] == name)]
        at = np.interp(rows["natural"], line["natural"], line["y"])
        assert rows["y_held"].to_numpy() - at == pytest.approx(left, abs=1e-3 * np.ptp(own["y"]))
        assert rows["y"].to_numpy() == pytest.approx(own["y"].to_numpy())


def test_levels_are_picked_over_the_whole_grid():
    assert (
        pick_levels(np.linspace(0, 4, 30), 8)[-1] == 4.0 and len(pick_levels(np.linspace(0, 4, 30), 8)) == 8
    )
    assert pick_levels(np.array([0.0, 4.0]), 8)[-1] == 4.0


def test_detection_of_a_chosen_surrogate_is_that_of_two_normals_where_it_is_linear():
    """y = 2 + 0.8 f + 0.5 w3: normal of standard deviation 0.5 sigma about either mean, 0.8 delta apart."""
    names = [factor.name for factor in PAPER_FACTORS]
    z = make_design("latin_hypercube", PAPER_FACTORS, {"points": 120}, 3)[names].to_numpy()
    y = 2.0 + 0.8 * z[:, names.index("f")] + 0.5 * z[:, names.index("w3")]
    chosen = ChosenSurrogate(fit_quadratic(z, y, names), tuple(names))
    deltas, sigmas, alarms = np.array([0.0, 0.4, 1.5]), np.array([0.3, 0.8]), [0.01, 0.2]
    cells = [(("r", "c", 1, "A"), chosen)]
    table = detection_table(cells, LEVELS, ["w3"], deltas, sigmas, -2.0, alarms)
    width = 0.5 * table["sigma"].to_numpy()
    quantile = ndtri(1.0 - table["p_f"].to_numpy())
    healthy = 2.0 - 0.8 * 2.0 + 0.5 * LEVELS["w3"]
    np.testing.assert_allclose(table["threshold"], healthy + width * quantile, atol=0.02 * width.max())
    detected = ndtr(0.8 * table["delta"].to_numpy() / width - quantile)
    np.testing.assert_allclose(table["p_d"], detected, atol=0.02)
    assert table["p_d"].min() < 0.011 and table["p_d"].max() > 0.95
