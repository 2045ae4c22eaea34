import numpy as np
import pytest
import statsmodels.api as sm
from planted_study import PAPER_OPTIONS, planted_test_quantities
from scipy import stats

from wearscope.designs.bases import model_matrix, model_terms
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import make_design, validation_design
from wearscope.surrogates.fitting import fit_surrogate, fit_surrogates
from wearscope.surrogates.validation import (
    diagnose,
    fault_effect,
    lack_of_fit,
    model_fit,
    press,
    pure_error,
    validate_surrogates,
)

NAMES = [factor.name for factor in PAPER_FACTORS]
Z = make_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS)[NAMES].to_numpy()
Z_V = validation_design("central_composite", PAPER_FACTORS, PAPER_OPTIONS)[NAMES].to_numpy()


@pytest.fixture(scope="module")
def planted():
    return planted_test_quantities(robots=["m"], cycles=["a", "b"], fdas=["A", "B"])[0]


@pytest.fixture(scope="module")
def validation(planted):
    return validate_surrogates(planted, fit_surrogates(planted))


def test_fit_is_zero_for_a_mean_predictor_and_100_for_a_perfect_one():
    y = np.random.default_rng(0).normal(size=45)
    assert model_fit(y, np.full(45, y.mean())) == pytest.approx(0.0)
    assert model_fit(y, y) == 100.0
    assert model_fit(y, 2 * y.mean() - y) == pytest.approx(-100.0)
    # One per cent of the variance is left.
    assert model_fit(y, y.mean() + 0.9 * (y - y.mean())) == pytest.approx(90.0)


def test_fit_of_a_value_that_does_not_vary_is_nan():
    assert np.isnan(model_fit(np.full(5, 0.1), np.zeros(5)))
    assert np.isnan(model_fit([], []))


@pytest.mark.parametrize("model", ["main", "simplified", "full"])
def test_diagnostics_are_those_of_statsmodels(model):
    rng = np.random.default_rng(6)
    y = 2.0 + Z[:, 0] + 0.5 * Z[:, 3] ** 2 + 0.3 * rng.standard_normal(45)
    found = diagnose(fit_surrogate(Z, y, NAMES, model), Z, y, Z_V, Z_V[:, 0])
    phi = model_matrix(Z, NAMES, model_terms(model, NAMES))
    least_squares = sm.OLS(y, phi).fit()
    influence = least_squares.get_influence()
    expected = {
        "sigma": np.sqrt(least_squares.scale),
        "dof": least_squares.df_resid,
        "r2": 1.0 - least_squares.ssr / np.sum((y - y.mean()) ** 2),
        "r2_adjusted": 1.0 - least_squares.scale / np.var(y, ddof=1),
        "r2_predicted": 1.0 - influence.ess_press / np.sum((y - y.mean()) ** 2),
        "press": influence.ess_press,
        "leverage_max": influence.hat_matrix_diag.max(),
        "condition": least_squares.condition_number,
    }
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def test_press_is_nan_where_one_point_alone_determines_a_term():
    phi = np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 1.0]])
    assert np.isnan(press(phi, np.array([0.5, -0.5, 0.0])))


def test_pure_error_of_replicates_by_hand():
    z = [[0.0], [0.0], [1.0], [1.0], [1.0], [2.0]]
    assert pure_error(z, [1.0, 3.0, 4.0, 5.0, 6.0, 9.0]) == (pytest.approx(4.0), 3)


def test_lack_of_fit_against_the_larger_model_is_the_partial_f_test():
    y = np.random.default_rng(2).normal(size=45)
    small, full = (fit_surrogate(Z, y, NAMES, model) for model in ("simplified", "full"))
    f, p, against = lack_of_fit(small, Z, y, full)
    fits = [sm.OLS(y, model_matrix(Z, NAMES, model_terms(m, NAMES))).fit() for m in ("full", "simplified")]
    expected = fits[0].compare_f_test(fits[1])
    assert against == "full model"
    assert (f, p) == (pytest.approx(expected[0]), pytest.approx(expected[1]))


@pytest.mark.parametrize("against", ["pure error", "validation runs"])
def test_lack_of_fit_of_a_right_model_is_as_unlikely_as_it_says(against):
    rng = np.random.default_rng(4)
    theta = rng.normal(size=28)
    z = np.vstack([Z, Z[-1:], Z[-1:], Z[-1:], Z[:3]]) if against == "pure error" else Z
    terms = model_terms("full", NAMES)
    p_values = []
    for _ in range(120):
        y = model_matrix(z, NAMES, terms) @ theta + rng.standard_normal(len(z))
        y_v = model_matrix(Z_V, NAMES, terms) @ theta + rng.standard_normal(45)
        surrogate = fit_surrogate(z, y, NAMES, "full")
        _, p, told = lack_of_fit(surrogate, z, y, None, Z_V, y_v)
        assert told == against
        p_values.append(p)
    assert stats.kstest(p_values, "uniform").pvalue > 1e-3


def test_lack_of_fit_finds_what_the_identification_levels_hide():
    # sin(pi w3) is zero at every identification level
    rng = np.random.default_rng(4)
    y, y_v = (z[:, 0] + np.sin(np.pi * z[:, 3]) + 0.05 * rng.standard_normal(45) for z in (Z, Z_V))
    surrogate = fit_surrogate(Z, y, NAMES, "full")
    assert lack_of_fit(surrogate, Z, y, None, Z_V, y_v)[1] < 1e-4


def test_validation_of_planted_surrogates(validation):
    full = validation[validation["model"] == "full"]
    assert np.all(full["fit"] > 95)
    wide = validation.pivot(index=["cycle", "axis", "fda"], columns="model", values="fit")
    assert np.all(wide["full"] > wide["simplified"])
    np.testing.assert_allclose(full["condition"], 12.2, atol=0.05)
    assert np.all(full["r2_predicted"] < full["r2"])
    assert set(full["lack_of_fit_against"]) == {"validation runs"}
    assert set(validation.loc[validation["model"] == "main", "lack_of_fit_against"]) == {"full model"}
    assert np.all(validation.loc[validation["model"] == "simplified", "lack_of_fit_p"] < 0.01)
    assert set(full["fault_effect"]) == {"rises"}


def test_fit_uses_the_identification_coding(planted):
    wrong = planted.copy()
    validation = wrong["set"] == "validation"
    levels = np.tile(Z, (int(validation.sum()) // 45, 1))
    wrong.loc[validation, NAMES] = levels
    surrogates = fit_surrogates(planted, ["full"])
    right = validate_surrogates(planted, surrogates)["fit"]
    assert np.all(validate_surrogates(wrong, surrogates)["fit"] < right - 5)


def test_a_falling_and_a_constant_detector_are_reported(planted):
    quantities = planted.copy()
    falling, constant = quantities["fda"] == "A", quantities["fda"] == "B"
    quantities.loc[falling, "y"] *= -1
    quantities.loc[constant, "y"] = 7.0
    table = validate_surrogates(quantities, fit_surrogates(quantities, ["full"]))
    assert set(table.loc[table["fda"] == "A", "fault_effect"]) == {"falls"}
    still = table[table["fda"] == "B"]
    assert set(still["fault_effect"]) == {"none"}
    assert set(still["status"]) == {"constant"}
    assert still[["fit", "r2", "press", "lack_of_fit"]].isna().all().all()


def test_an_effect_within_its_own_error_is_unclear():
    y = np.random.default_rng(0).normal(size=45)
    y -= Z[:, 0] * (Z[:, 0] @ y) / (Z[:, 0] @ Z[:, 0]) * 0.999
    assert fault_effect(fit_surrogate(Z, y, NAMES, "main")) == "unclear"


def test_failed_validation_points_are_counted_and_refused(planted, refuses):
    surrogates = fit_surrogates(planted, ["full"])
    quantities = planted.copy()
    where = quantities.index[(quantities["set"] == "validation") & (quantities["fda"] == "B")]
    quantities.loc[where[:4], "y"] = np.nan
    table = validate_surrogates(quantities, surrogates, max_failed_share=0.1)
    assert table["n_validation_failed"].max() == 4
    assert table["n_validation"].min() == 41
    refuses(validate_surrogates, quantities, surrogates, max_failed_share=0.05)
    refuses(validate_surrogates, planted[planted["set"] == "identification"], surrogates)
