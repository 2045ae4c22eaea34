import numpy as np
import pandas as pd
import pytest
from scipy import stats

from wearscope.designs.kinds import generator_for
from wearscope.evaluation.ranking import rank_by_median
from wearscope.evaluation.snr import (
    exact_snr,
    monte_carlo_error,
    parametric_interval,
    quadratic_moments,
    ratio,
    sample_output,
    snr_table,
)
from wearscope.surrogates.fitting import Surrogate, surrogates_of


@pytest.fixture(scope="module")
def table(surrogates):
    return snr_table(surrogates_of(surrogates, "full"), seed=0, runs=20_000)


def test_moments_agree_with_gauss_hermite_quadrature():
    rng = np.random.default_rng(0)
    c, g, a = 1.3, rng.normal(size=3), rng.normal(size=(3, 3))
    a = a + a.T
    nodes, weights = np.polynomial.hermite_e.hermegauss(8)
    weights = weights / weights.sum()
    w = 0.7 * np.stack(np.meshgrid(nodes, nodes, nodes), axis=-1).reshape(-1, 3)
    p = np.stack(np.meshgrid(weights, weights, weights), axis=-1).reshape(-1, 3).prod(axis=1)
    y = c + w @ g + np.einsum("ij,jk,ik->i", w, a, w)
    mean, deviation = quadratic_moments(c, g, a, 0.7)
    assert mean == pytest.approx(p @ y)
    assert deviation == pytest.approx(np.sqrt(p @ (y - p @ y) ** 2))


def test_the_numerator_under_20_is_exactly_theta_0(surrogates):
    for _, surrogate in surrogates_of(surrogates, "full"):
        mean = [quadratic_moments(*surrogate.at_fault(f), 0.25)[0] for f in (-0.5, 0.5)]
        assert mean[1] - mean[0] == pytest.approx(surrogate.coefficient("f"), abs=1e-12)


def test_monte_carlo_agrees_with_the_exact_snr_within_its_own_error(table):
    z = (table["snr"] - table["snr_exact"]) / table["snr_stderr"]
    assert stats.kstest(z, "norm").pvalue > 1e-3
    assert np.abs(z).max() < 4.5


def simulate_snr(surrogate, k, runs):
    rng = generator_for(1, k)
    return monte_carlo_error(*(sample_output(surrogate, rng, runs, f, 0.25) for f in (-0.5, 0.5)))


def test_the_monte_carlo_error_is_as_large_as_it_says(surrogates):
    _, surrogate = next(surrogates_of(surrogates, "full"))
    runs = [simulate_snr(surrogate, k, 500) for k in range(400)]
    values, errors = np.array(runs).T
    assert np.std(values) == pytest.approx(np.mean(errors), rel=0.12)


def test_the_error_holds_for_a_skewed_output_too():
    # y = 0.2 f + w^2: chi-square, where the covariance of mean and deviation matters
    surrogate = Surrogate(("1", "f", "w1", "w1^2"), np.array([0.0, 0.2, 0.0, 1.0]), np.zeros((4, 4)), 0.0, 9)
    exact = exact_snr(surrogate.theta, surrogate.terms)
    runs = [simulate_snr(surrogate, k, 2000) for k in range(300)]
    values, errors = np.array(runs).T
    assert np.mean(values) == pytest.approx(float(exact), abs=0.02)
    assert np.std(values) == pytest.approx(np.mean(errors), rel=0.15)


def test_the_error_is_that_of_the_first_order_of_each_run():
    """How far a run moves the ratio: by its change of the mean, and of the spread that the mean is over."""
    rng = np.random.default_rng(2)
    for shift, shape, turned, runs in ((3.0, 2.0, 1.0, 400), (0.0, 0.7, -1.0, 90)):
        y0, y1 = rng.gamma(0.5, size=runs), shift + turned * rng.gamma(shape, size=runs)
        snr, error = monte_carlo_error(y0, y1)
        spread = y1.std(ddof=1)
        assert snr == pytest.approx((y1.mean() - y0.mean()) / spread)
        off = (y1 - y1.mean()) / y1.std()
        moved = off - 0.5 * snr * (off**2 - 1.0)
        wanted = np.sqrt((np.mean(moved**2) + y0.var() / spread**2) / len(y1))
        assert error == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_a_spread_of_rounding_is_none_whatever_the_size(size):
    turns = np.array([1.0, -1.0] * 10)
    first, second = size * np.ones(20), 2.0 * size * np.ones(20)
    assert monte_carlo_error(first, second + 1e-13 * size * turns) == (np.inf, 0.0)
    assert monte_carlo_error(second, first + 1e-13 * size * turns) == (-np.inf, 0.0)
    assert np.isnan(monte_carlo_error(first, first + 1e-13 * size * turns)[0])
    # A thousandth of a millionth is none; more of a change than of a spread is asked for.
    snr, error = monte_carlo_error(first, second + 1e-9 * size * turns)
    assert snr == pytest.approx(1e9 * np.sqrt(19.0 / 20.0), rel=1e-4) and np.isfinite(error)
    # A mean that is nil says nothing of the size: the change does.
    assert monte_carlo_error(-second, 1e-13 * size * turns)[0] == np.inf


def test_exact_snr_by_hand():
    # y = 2 f + 3 w: change 2, deviation 0.75
    assert exact_snr([1.0, 2.0, 3.0], ("1", "f", "w1")) == pytest.approx(2 / 0.75)
    many = exact_snr([[1.0, 2.0, 3.0], [1.0, 4.0, 3.0]], ("1", "f", "w1"))
    np.testing.assert_allclose(many, [2 / 0.75, 4 / 0.75])


def test_ratio_is_explicit_about_zero():
    np.testing.assert_array_equal(
        ratio([0.0, 1.0, -1.0, 3.0], [0.0, 0.0, 0.0, 2.0]), [np.nan, np.inf, -np.inf, 1.5]
    )


def test_each_cell_has_its_own_stream_whatever_else_is_computed(surrogates, table):
    cells = [*surrogates_of(surrogates[surrogates["robot"] == "large"], "full")]
    part = snr_table(cells, seed=0, runs=20_000)
    expected = table[table["robot"] == "large"].reset_index(drop=True)
    pd.testing.assert_frame_equal(part, expected)
    other = snr_table(cells, seed=1, runs=20_000)
    assert np.all(other["snr"] != part["snr"])
    assert list(table.columns[:7]) == ["robot", "cycle", "axis", "fda", "model", "snr", "snr_exact"]


def test_the_interval_holds_the_true_snr(quantities):
    from planted_study import PAPER_OPTIONS

    from wearscope.designs.bases import model_matrix, model_terms
    from wearscope.designs.factors import PAPER_FACTORS
    from wearscope.designs.kinds import make_design
    from wearscope.surrogates.fitting import fit_surrogate

    names = [factor.name for factor in PAPER_FACTORS]
    z = make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS)[names].to_numpy()
    terms = model_terms("full", names)
    rng = np.random.default_rng(8)
    theta = np.r_[3.0, 1.0, rng.normal(0, 0.3, 26)]
    truth = float(exact_snr(theta, terms))
    inside = 0
    for k in range(100):
        surrogate = fit_surrogate(
            z, model_matrix(z, names, terms) @ theta + 0.3 * rng.standard_normal(45), names, "full"
        )
        low, high = parametric_interval(surrogate, generator_for(0, k), 400)
        inside += low <= truth <= high
    assert 88 <= inside <= 100


def test_constant_and_falling_detectors_are_reported(odd):
    table = snr_table(surrogates_of(odd, "full"), runs=1000).groupby("fda")
    found = {fda: set(rows["status"]) for fda, rows in table}
    assert found == {"A": {"ok"}, "B": {"decreasing"}, "C": {"constant"}}
    constant, falling = table.get_group("C"), table.get_group("B")
    assert constant[["snr", "snr_exact", "snr_low", "snr_high"]].isna().all().all()
    assert np.all(falling["snr"] < 0) and np.all(falling["snr_exact"] < 0)


def ranked(shift, spread=1.0, cells=24):
    rng = np.random.default_rng(0)
    rows = []
    for k in range(cells):
        common = rng.normal()
        rows += [
            ("m", str(k), 1, fda, level + common + spread * rng.normal()) for fda, level in shift.items()
        ]
    table = pd.DataFrame(rows, columns=["robot", "cycle", "axis", "fda", "snr"])
    return rank_by_median(table, "snr", seed=0).set_index("fda")


def test_planted_ranks_are_found_and_ties_are_stated():
    table = ranked({"A": 0.0, "B": 5.0, "C": 0.02}, spread=0.5)
    assert table.index[0] == "B" and table["rank"].tolist() == [1, 2, 3]
    assert (table.loc["B", "rank_low"], table.loc["B", "rank_high"]) == (1, 1)
    assert table.loc["B", "tied_with"] == ""
    assert table.loc["A", "tied_with"] == "C" and table.loc["C", "tied_with"] == "A"
    assert (table.loc["A", "rank_low"], table.loc["A", "rank_high"]) == (2, 3)
    assert np.all((table["median_low"] <= table["median"]) & (table["median"] <= table["median_high"]))


def test_a_group_without_values_ranks_last(table, refuses):
    holed = table.copy()
    holed.loc[holed["fda"] == "B", "snr_exact"] = np.nan
    ranking = rank_by_median(holed, seed=0)
    assert ranking["fda"].iloc[-1] == "B"
    assert (ranking["n"].iloc[-1], ranking["n_nan"].iloc[-1]) == (0, 12)
    assert np.isnan(ranking["median"].iloc[-1])
    refuses(rank_by_median, table, by=[])


@pytest.mark.parametrize("missing", [False, True])
def test_medians_are_those_of_the_columns_without_what_is_missing(missing):
    rng = np.random.default_rng(3)
    values = rng.lognormal(size=(9, 4))
    if missing:
        values[2, 1] = np.nan
    rows = [
        {"robot": "r", "cycle": "c", "axis": axis, "fda": fda, "snr_exact": values[axis, k]}
        for axis in range(9)
        for k, fda in enumerate("ABCD")
    ]
    ranking = rank_by_median(pd.DataFrame(rows), draws=10, seed=0).set_index("fda")
    for k, fda in enumerate("ABCD"):
        assert ranking.loc[fda, "median"] == np.nanmedian(values[:, k])


def test_ranking_groups_over_any_subset(table):
    assert len(rank_by_median(table, by=["robot", "fda"], draws=50)) == 6


def test_bad_settings_get_one_sentence(surrogates, refuses):
    refuses(snr_table, surrogates_of(surrogates, "full"), runs=1)


def few_cells(**intervals):
    rows = [
        {"robot": "r", "cycle": "c", "axis": axis, "fda": fda, "snr_exact": value}
        | {"snr_low": low, "snr_high": high}
        for fda, (value, low, high) in intervals.items()
        for axis in (1, 2)
    ]
    return pd.DataFrame(rows)


def test_few_cells_are_ranked_by_their_own_intervals():
    ranking = rank_by_median(few_cells(A=(3.0, 1.0, 5.0), B=(2.0, 1.5, 2.5), C=(0.5, 0.4, 0.6)))
    assert (ranking["interval_from"] == "each cell").all()
    assert ranking["rank"].tolist() == [1, 2, 3]
    rows = ranking.set_index("fda")
    assert rows.loc["A", ["median", "median_low", "median_high"]].tolist() == [3.0, 1.0, 5.0]
    assert rows.loc["A", "tied_with"] == "B" and rows.loc["B", "tied_with"] == "A"
    assert rows.loc["C", "tied_with"] == ""
    assert rows[["rank_low", "rank_high"]].to_numpy().tolist() == [[1, 2], [1, 2], [3, 3]]


def test_a_group_without_an_interval_is_tied_with_each_that_has_one():
    """Whichever side of the interval is unknown, and however far apart the medians are."""
    nan = float("nan")
    for low, high in ((nan, nan), (nan, 0.3), (0.1, nan)):
        rows = rank_by_median(few_cells(A=(3.0, 1.0, 5.0), B=(0.2, low, high))).set_index("fda")
        apart = high == 0.3  # it is known to end below the other
        assert rows["tied_with"].tolist() == (["", ""] if apart else ["B", "A"])
        assert rows["rank_high"].tolist() == ([1, 2] if apart else [2, 2])
        assert rows["rank_low"].tolist() == ([1, 2] if apart else [1, 1])


def test_one_cell_alone_is_no_certain_ranking():
    one = few_cells(A=(3.0, 1.0, 5.0), B=(2.0, 1.5, 2.5)).query("axis == 1")
    assert rank_by_median(one)["tied_with"].tolist() == ["B", "A"]
    unknown = one.assign(snr_low=np.nan, snr_high=np.nan)
    assert rank_by_median(unknown)["tied_with"].tolist() == ["B", "A"]
    lost = one.assign(snr_exact=[np.nan, 2.0])
    rows = rank_by_median(lost).set_index("fda")
    assert rows.loc["B", ["rank_low", "rank_high"]].tolist() == [1, 1] and rows.loc["A", "n_nan"] == 1


def test_five_cells_are_resampled():
    table = pd.concat([few_cells(A=(3.0, 2.9, 3.1)).assign(cycle=f"c{k}") for k in range(3)])
    assert rank_by_median(table, draws=50)["interval_from"].tolist() == ["choice of cells"]


def test_few_cells_without_intervals_are_all_tied():
    table = few_cells(A=(3.0, 1.0, 5.0), B=(2.0, 1.5, 2.5)).drop(columns=["snr_low", "snr_high"])
    ranking = rank_by_median(table)
    assert ranking["tied_with"].tolist() == ["B", "A"]
    assert ranking[["rank_low", "rank_high"]].to_numpy().tolist() == [[1, 2], [1, 2]]


def test_a_group_with_values_in_few_of_many_cells_is_judged_by_their_intervals():
    cells = [few_cells(A=(3.0, 1.0, 5.0), B=(2.0, 1.9, 2.1)).assign(cycle=f"c{k}") for k in range(6)]
    table = pd.concat(cells)
    lost = (table["fda"] == "A") & (table["cycle"] != "c0")
    ranking = rank_by_median(table.assign(snr_exact=table["snr_exact"].mask(lost))).set_index("fda")
    assert ranking.loc["A", "n"] == 2 and ranking.loc["A", "tied_with"] == "B"
    assert (ranking["interval_from"] == "each cell").all()


def test_a_model_without_noise_has_no_snr(surrogates):
    cells = [*surrogates_of(surrogates[surrogates["robot"] == "large"], "full")]
    free, noisy = (
        snr_table(cells, runs=500, draws=20, noise={key[:4]: noise for key, _ in cells})
        for noise in (0.0, 1.0)
    )
    assert (free["status"] == "noise-free").all()
    assert free[["snr", "snr_exact", "snr_low", "snr_high"]].isna().all(axis=None)
    assert noisy["snr_exact"].notna().any() and "noise-free" not in set(noisy["status"])
