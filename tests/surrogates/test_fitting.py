import numpy as np
import pandas as pd
import pytest
from planted_study import PAPER_OPTIONS, planted_test_quantities
from scipy import stats

from wearscope.designs.bases import model_matrix, model_terms
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import make_design
from wearscope.surrogates.fitting import (
    CELL,
    Surrogate,
    factor_columns,
    fit_surrogate,
    fit_surrogates,
    normalise_coefficients,
    read_surrogate,
    surrogates_of,
)

NAMES = [factor.name for factor in PAPER_FACTORS]
Z = make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS)[NAMES].to_numpy()
TERMS = model_terms("full", NAMES)


@pytest.fixture(scope="module")
def planted():
    return planted_test_quantities(robots=["medium"], cycles=["a"], fdas=["A", "B"])


@pytest.fixture(scope="module")
def table(planted):
    return fit_surrogates(planted[0])


def test_noise_free_coefficients_are_recovered():
    quantities, truth = planted_test_quantities(robots=["m"], cycles=["a"], fdas=["A"], noise=0.0)
    for key, surrogate in surrogates_of(fit_surrogates(quantities, ["full"]), "full"):
        np.testing.assert_allclose(surrogate.theta, truth[key[:-1]], atol=1e-12)


def test_intervals_of_coefficients_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(5)
    theta = rng.normal(size=28)
    clean = model_matrix(Z, NAMES, TERMS) @ theta
    inside = []
    for _ in range(150):
        surrogate = fit_surrogate(Z, clean + 0.3 * rng.standard_normal(45), NAMES, "full")
        half = stats.t.ppf(0.975, surrogate.dof) * np.sqrt(np.diag(surrogate.covariance))
        inside.append(np.abs(surrogate.theta - theta) <= half)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.015)


def test_standard_errors_are_those_of_the_normal_equations(planted, table):
    rows = table[(table["axis"] == 2) & (table["fda"] == "B") & (table["model"] == "simplified")]
    cell = planted[0].query("axis == 2 and fda == 'B' and set == 'identification'")
    phi = model_matrix(cell[NAMES].to_numpy(), NAMES, model_terms("simplified", NAMES))
    theta = np.linalg.solve(phi.T @ phi, phi.T @ cell["y"].to_numpy())
    variance = np.sum((cell["y"].to_numpy() - phi @ theta) ** 2) / (45 - 22)
    np.testing.assert_allclose(rows["theta"], theta, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        rows["stderr"], np.sqrt(variance * np.diag(np.linalg.inv(phi.T @ phi))), rtol=1e-9
    )


def test_table_has_the_columns_users_script_against(table):
    contract = ["robot", "cycle", "axis", "fda", "model", "term", "theta", "theta_normalised", "stderr"]
    assert list(table.columns)[: len(contract)] == contract
    assert table.groupby([*CELL, "model"]).size().groupby("model").max().to_dict() == {
        "main": 7,
        "full": 28,
        "simplified": 22,
    }
    direct = table.loc[table["term"] == "f", "theta_normalised"]
    np.testing.assert_allclose(direct, 1.0)


def test_the_order_of_the_rows_does_not_matter(planted, table):
    shuffled = planted[0].sample(frac=1.0, random_state=3)
    pd.testing.assert_frame_equal(fit_surrogates(shuffled), table)


def test_a_surrogate_survives_its_table(table, refuses):
    rows = table[(table["axis"] == 1) & (table["fda"] == "A") & (table["model"] == "full")]
    surrogate = read_surrogate(rows)
    np.testing.assert_allclose(
        surrogate.predict(Z), model_matrix(Z, NAMES, TERMS) @ surrogate.theta, rtol=1e-12
    )
    np.testing.assert_allclose(np.sqrt(np.diag(surrogate.covariance)), rows["stderr"])
    refuses(read_surrogate, table)


@pytest.mark.parametrize("model", ["main", "full", "simplified"])
def test_quadratic_forms_agree_with_the_regression(table, model):
    rng = np.random.default_rng(0)
    z = rng.uniform(-2, 2, (20, 6))
    for _, surrogate in surrogates_of(table, model):
        expected = model_matrix(z, NAMES, surrogate.terms) @ surrogate.theta
        np.testing.assert_allclose(surrogate.predict(z), expected, rtol=1e-12)
        for row, value in zip(z, expected, strict=True):
            c, g, a = surrogate.at_fault(row[0])
            assert c + g @ row[1:] + row[1:] @ a @ row[1:] == pytest.approx(value)
            levels = dict(zip(NAMES, row, strict=True))
            for k, name in enumerate(NAMES):
                a0, b, c2 = surrogate.along(name, levels)
                assert a0 + b * row[k] + c2 * row[k] ** 2 == pytest.approx(value)


def test_simplified_and_full_agree_where_their_terms_are_orthogonal(table):
    # the fault's cross terms are orthogonal to all of (19) on this design, so theta_0 is the same
    for axis in (1, 2, 3):
        rows = table[(table["axis"] == axis) & (table["fda"] == "A") & (table["term"] == "f")]
        theta = rows.set_index("model")["theta"]
        assert theta["simplified"] == pytest.approx(theta["full"], rel=1e-9)
        assert theta["main"] == pytest.approx(theta["full"], rel=1e-9)


def test_prediction_intervals_hold_new_values():
    rng = np.random.default_rng(1)
    theta = rng.normal(size=28)
    at = rng.uniform(-2, 2, (10, 6))
    inside = []
    for _ in range(200):
        y = model_matrix(Z, NAMES, TERMS) @ theta + 0.2 * rng.standard_normal(45)
        low, high = fit_surrogate(Z, y, NAMES, "full").prediction_interval(at, 0.9)
        new = model_matrix(at, NAMES, TERMS) @ theta + 0.2 * rng.standard_normal(10)
        inside.append((new >= low) & (new <= high))
    assert np.mean(inside) == pytest.approx(0.9, abs=0.025)


@pytest.mark.parametrize("value", [0.0, -3.0, 1e-300, 0.1])
def test_any_value_that_does_not_change_is_constant(value):
    surrogate = fit_surrogate(Z, np.full(45, value), NAMES, "full")
    assert surrogate.status == "constant"
    assert surrogate.theta.tolist() == [value] + [0.0] * 27
    assert np.all(np.isnan(normalise_coefficients(surrogate.theta, surrogate.terms)))
    for predicted in (surrogate.predict(Z), *surrogate.prediction_interval(Z)):
        np.testing.assert_array_equal(predicted, value)


def spoil(quantities, count, value=np.nan):
    quantities = quantities.copy()
    rows = quantities.index[(quantities["axis"] == 1) & (quantities["fda"] == "A")]
    rows = rows[quantities.loc[rows, "set"] == "identification"]
    quantities.loc[rows[:count], "y"] = value
    return quantities


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_failed_points_are_counted_and_refused_above_the_share(planted, value, refuses):
    table = fit_surrogates(spoil(planted[0], 3, value), ["main"], max_failed_share=0.1)
    counts = table.groupby(CELL)[["n_points", "n_failed"]].first()
    assert counts.loc[("medium", "a", 1, "A")].tolist() == [42, 3]
    assert counts.loc[("medium", "a", 2, "A")].tolist() == [45, 0]
    assert np.all(np.isfinite(table["theta"]))
    refuses(fit_surrogates, spoil(planted[0], 6, value), ["main"], max_failed_share=0.1)


def test_too_few_points_for_a_model_are_refused(planted, refuses):
    refuses(fit_surrogates, spoil(planted[0], 20), ["full"], max_failed_share=0.9)


def test_without_residual_freedom_the_uncertainty_is_nan():
    z = np.array([[-1.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    surrogate = fit_surrogate(z, np.array([1.0, 2.0, 4.0]), ["f", "w1"], "main")
    assert surrogate.dof == 0
    assert np.isnan(surrogate.sigma) and np.all(np.isnan(surrogate.covariance))
    assert np.all(np.isnan(surrogate.prediction_interval(z)[0]))


def test_bad_tables_get_one_sentence(planted, table, refuses):
    refuses(factor_columns, planted[0].drop(columns="fda"))
    refuses(fit_surrogates, planted[0][planted[0]["set"] == "validation"])
    refuses(fit_surrogates, planted[0], ["cubic"])
    refuses(next, surrogates_of(table, "cubic"))


def test_factor_columns_leave_out_what_is_no_coded_factor(planted):
    quantities = planted[0].assign(f_natural=1.0, status="ok")
    assert factor_columns(quantities) == NAMES


def test_coefficients_are_drawn_from_the_t_distribution_of_their_estimate():
    """Mean theta, covariance C dof / (dof - 2): Kotz and Nadarajah 2004, Multivariate t Distributions."""
    theta, covariance = np.array([2.0, -1.0]), np.array([[4.0, 1.2], [1.2, 0.81]])
    surrogate = Surrogate(("1", "f"), theta, covariance, 1.0, 12)
    drawn = surrogate.draw_coefficients(np.random.default_rng(0), 200_000)
    np.testing.assert_allclose(drawn.mean(axis=0), theta, atol=0.02)
    np.testing.assert_allclose(np.cov(drawn.T), covariance * 12 / 10, rtol=0.03)
    # Their kurtosis is that of a t distribution, 6 / (dof - 4) above a normal one's.
    standard = (drawn[:, 0] - 2.0) / drawn[:, 0].std()
    assert (standard**4).mean() - 3 == pytest.approx(6 / 8, abs=0.15)
    certain = Surrogate(("1", "f"), theta, np.zeros((2, 2)), 0.0, 3)
    assert (certain.draw_coefficients(np.random.default_rng(0), 4) == theta).all()
    assert np.isnan(
        Surrogate(("1", "f"), theta, covariance, np.nan, 0).draw_coefficients(np.random.default_rng(0), 2)
    ).all()


def test_planted_coefficients_scatter_as_stated():
    """Direct effects by 0.3, squares and products by 0.05, each within 5 of its standard errors."""
    truth = np.array(list(planted_test_quantities()[1].values()))
    count = 1 + len(PAPER_FACTORS)
    for part, deviation in ((truth[:, 2:count], 0.3), (truth[:, count:], 0.05)):
        assert part.std() == pytest.approx(deviation, rel=5 / np.sqrt(2 * part.size))
