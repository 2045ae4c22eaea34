import json
from types import SimpleNamespace

import numpy as np
import pytest
import statsmodels.api as sm
from scipy import special

from wearscope.designs.bases import model_matrix, model_terms
from wearscope.designs.factors import PAPER_FACTORS, nominal_levels
from wearscope.designs.kinds import make_design
from wearscope.surrogates.chosen import (
    KINDS,
    ChosenSurrogate,
    calibrate_spread,
    choose_surrogate,
    rebuild_surrogate,
)
from wearscope.surrogates.kinds import gaussian_process, linear
from wearscope.surrogates.kinds.gaussian_process import GaussianProcess, Likelihood, fit_gaussian_process
from wearscope.surrogates.kinds.linear import (
    fit_polynomial_chaos,
    fit_quadratic,
    legendre_basis,
)
from wearscope.surrogates.validation import model_fit

NAMES = [factor.name for factor in PAPER_FACTORS]
NOMINAL = nominal_levels(PAPER_FACTORS)


def points(number, stream):
    design = make_design("latin_hypercube", PAPER_FACTORS, {"points": number, "stream": stream}, 5)
    return design[NAMES].to_numpy()


Z, NEW = points(120, "train"), points(80, "new")


def quadratic(z):
    return 3.0 + z[:, 0] + 0.4 * z[:, 3] + 0.2 * z[:, 0] * z[:, 3] - 0.1 * z[:, 5] ** 2


def cubic(z):
    return quadratic(z) + 0.3 * z[:, 0] ** 3 - 0.2 * z[:, 3] ** 2 * z[:, 5]


def cusp(z):
    return np.sqrt(0.02 + np.abs(z[:, 3])) * (1.0 + 0.1 * z[:, 0]) + 0.3 * (z[:, 3] > 0)


def noisy(truth, z=Z, noise=0.02, seed=1):
    return truth(z) + noise * np.random.default_rng(seed).standard_normal(len(z))


@pytest.fixture(scope="module")
def process():
    return fit_gaussian_process(Z, noisy(cubic), 0.02)


def test_each_kind_recovers_what_it_can_express(process):
    assert model_fit(quadratic(NEW), fit_quadratic(Z, noisy(quadratic), NAMES).predict(NEW)[0]) > 98
    chaos = fit_polynomial_chaos(Z, noisy(cubic))
    assert model_fit(cubic(NEW), chaos.predict(NEW)[0]) > 98
    assert model_fit(cubic(NEW), process.predict(NEW)[0]) > 95
    assert model_fit(cubic(NEW), fit_quadratic(Z, noisy(cubic), NAMES).predict(NEW)[0]) < 80


def test_the_noise_is_recovered(process):
    assert fit_quadratic(Z, noisy(quadratic), NAMES).noise == pytest.approx(0.02, rel=0.25)
    assert fit_polynomial_chaos(Z, noisy(cubic)).noise == pytest.approx(0.02, rel=0.25)
    assert 0.01 - 1e-12 <= process.noise < 0.06  # half of what replicates say at least
    assert fit_gaussian_process(Z, noisy(quadratic, noise=0.5)).noise == pytest.approx(0.5, rel=0.3)


def test_legendre_products_are_orthogonal_under_the_uniform_distribution():
    x, w = special.roots_legendre(6)
    grid = np.stack(np.meshgrid(2 * x, 2 * x, indexing="ij"), axis=-1).reshape(-1, 2)
    weights = np.outer(w, w).ravel() / 4
    degrees = [[0, 0], [1, 0], [0, 1], [1, 1], [2, 0], [0, 3]]
    phi = legendre_basis(degrees)(grid)
    norm = [1 / np.prod(2 * np.array(one) + 1) for one in degrees]
    np.testing.assert_allclose(phi.T @ (weights[:, None] * phi), np.diag(norm), atol=1e-12)


def test_left_out_values_of_least_squares_are_those_of_fits_without_the_point():
    y = noisy(cubic)
    whole = fit_quadratic(Z, y, NAMES)
    for k in (0, 17, 101):
        seen = np.arange(len(y)) != k
        part = fit_quadratic(Z[seen], y[seen], NAMES)
        assert whole.left_out[k] == pytest.approx(part.predict(Z[[k]])[0][0], rel=1e-8)


def kernel_of(columns):
    """The same covariance without noise, by scikit-learn."""
    from sklearn.gaussian_process.kernels import ConstantKernel, DotProduct, Matern

    matern = ConstantKernel(1.0) * Matern(np.full(columns, 4.0), nu=2.5)
    return matern + ConstantKernel(0.1) * DotProduct(1.0) ** 2


def condition(process, z, y):
    """A process of scikit-learn's with the hyperparameters of `process`, on other runs."""
    from sklearn.gaussian_process import GaussianProcessRegressor

    kernel = kernel_of(z.shape[1]).clone_with_theta(np.array(process.parameters["theta"]))
    noise = np.exp(process.parameters["log_noise"])
    return GaussianProcessRegressor(kernel, alpha=noise, optimizer=None).fit(z, y)


def test_a_process_predicts_as_scikit_learn_s(process):
    y = noisy(cubic)
    other = condition(process, Z, (y - y.mean()) / y.std())
    mean, deviation = other.predict(NEW, return_std=True)
    np.testing.assert_allclose(process.predict(NEW)[0], y.mean() + y.std() * mean, rtol=1e-9)
    np.testing.assert_allclose(process.predict(NEW)[1], y.std() * deviation, rtol=1e-6)
    covariance = other.predict(NEW[:9], return_cov=True)[1]
    root = np.linalg.cholesky(covariance + gaussian_process.JITTER * np.eye(9))
    drawn = (process.draw(NEW[:9], np.random.default_rng(2), 3) - process.predict(NEW[:9])[0]) / y.std()
    expected = np.random.default_rng(2).standard_normal((3, 9)) @ root.T
    np.testing.assert_allclose(drawn, expected, rtol=1e-5, atol=1e-7)


def test_terms_are_taken_in_the_order_of_scikit_learn_s_least_angle_regression():
    """Where the constant is the first that it would take."""
    from sklearn.linear_model import lars_path

    phi = linear.legendre_basis([[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2], [3, 0]])(Z[:, :2])
    for truth in (cubic, quadratic):
        y = 20.0 + noisy(truth, noise=0.3)
        order = lars_path(phi, y, method="lar")[1]
        *_, taken = linear._take_terms(phi, y)
        assert taken == list(order)


def test_terms_that_are_kept_do_not_depend():
    """A factor of three levels: its cube is a multiple of itself."""
    z = np.column_stack([2.0 * np.round(Z[:, 0] / 2.0), Z[:, 1]])
    y = 3.0 + z[:, 0] + z[:, 1] ** 2 + 0.1 * np.random.default_rng(4).standard_normal(len(z))
    kept = linear.choose_terms(z, y)
    assert [0, 0] in kept and [0, 2] in kept and ([1, 0] in kept) != ([3, 0] in kept)
    assert np.linalg.matrix_rank(linear.legendre_basis(kept)(z)) == len(kept)


def test_left_out_values_of_a_process_are_those_of_conditioning_without_the_point(process):
    y = noisy(cubic)
    middle, scale = y.mean(), y.std()
    for k in (0, 17, 101):
        seen = np.arange(len(y)) != k
        # Hyperparameters and standardisation of the whole, one run fewer to condition on.
        part = condition(process, Z[seen], (y[seen] - middle) / scale)
        mean, deviation = part.predict(Z[[k]], return_std=True)
        assert process.left_out[k] == pytest.approx(middle + scale * mean[0], rel=1e-6)
        total = np.hypot(scale * deviation[0], process.noise)
        assert process.left_out_deviation[k] == pytest.approx(total, rel=1e-5)


def test_draws_scatter_as_the_kind_states(process):
    for fitted in (process, fit_quadratic(Z, noisy(quadratic), NAMES)):
        mean, deviation = fitted.predict(NEW[:10])
        drawn = fitted.draw(NEW[:10], np.random.default_rng(0), 4000)
        np.testing.assert_allclose(drawn.mean(axis=0), mean, atol=0.1 * deviation.max())
        np.testing.assert_allclose(drawn.std(axis=0), deviation, rtol=0.1)


def test_one_point_asked_for_many_times_has_one_value_a_draw(process):
    """Its covariance is singular: a multiple of a matrix of ones."""
    mean, deviation = process.predict(NEW[:1])
    drawn = process.draw(np.repeat(NEW[:1], 20, axis=0), np.random.default_rng(0), 500)
    assert np.ptp(drawn, axis=1).max() < 1e-3 * process.scale
    np.testing.assert_allclose(drawn[:, 0].std(), deviation[0], rtol=0.1)
    np.testing.assert_allclose(drawn[:, 0].mean(), mean[0], atol=0.2 * deviation[0])


def test_a_cusp_at_nominal_is_met_by_bending_the_factor_that_has_it():
    y = noisy(cusp, noise=0.005)
    plain, bent = fit_gaussian_process(Z, y), fit_gaussian_process(Z, y, 0.0, 3, 0.0)
    fits = [model_fit(cusp(NEW), one.predict(NEW)[0]) for one in (plain, bent)]
    assert fits[1] > fits[0] + 5
    chosen, tried = choose_surrogate(Z, y, NAMES, NOMINAL)
    assert chosen.kind == "bent_gaussian_process"
    assert chosen.fitted.parameters["bent"] == 3
    assert set(tried) == set(KINDS)


def test_a_polynomial_is_taken_only_where_it_is_clearly_better():
    chosen, fits = choose_surrogate(Z, noisy(cubic, noise=0.001), NAMES, NOMINAL)
    assert fits["polynomial_chaos"] > fits["quadratic"] + 10
    best = max(fits, key=fits.get)
    if chosen.kind != best:
        assert fits[chosen.kind] > fits[best] - 1.0
    only, _ = choose_surrogate(Z, noisy(cubic), NAMES, NOMINAL, ["quadratic"])
    assert only.kind == "quadratic"


@pytest.mark.parametrize(
    ("polynomial", "process", "chosen"),
    [(95.0, 94.5, "gaussian_process"), (95.0, 93.5, "quadratic"), (95.0, 97.0, "gaussian_process")],
)
def test_a_process_less_than_one_per_cent_behind_is_taken(monkeypatch, polynomial, process, chosen):
    y = noisy(cubic)

    def fit_as_well(kind, fit):
        """What leaves the stated fit: left-out values part of the way from the mean to y."""
        fitted = object.__new__(GaussianProcess) if kind == "gaussian_process" else SimpleNamespace()
        fitted.kind, fitted.left_out_deviation = kind, np.ones(len(y))
        fitted.left_out = y.mean() + fit / 100.0 * (y - y.mean())
        return lambda *given: fitted

    monkeypatch.setattr("wearscope.surrogates.chosen.fit_quadratic", fit_as_well("quadratic", polynomial))
    monkeypatch.setattr(
        "wearscope.surrogates.chosen.fit_gaussian_process", fit_as_well("gaussian_process", process)
    )
    best, fits = choose_surrogate(Z, y, NAMES, NOMINAL, ["quadratic", "gaussian_process"])
    assert fits == pytest.approx({"quadratic": polynomial, "gaussian_process": process})
    assert best.kind == chosen


def test_the_spread_brings_left_out_values_into_their_intervals():
    y = noisy(cusp)
    chosen, _ = choose_surrogate(Z, y, NAMES, NOMINAL, ["quadratic"])
    ratio = np.abs(y - chosen.fitted.left_out) / (chosen.spread * chosen.fitted.left_out_deviation)
    assert np.mean(ratio <= special.ndtri(0.975) * (1 + 1e-12)) == pytest.approx(0.95, abs=0.02)
    assert calibrate_spread(chosen.fitted, y) == chosen.spread


def test_the_spread_is_a_quantile_of_the_left_out_errors_by_their_place():
    """Of 19 errors the last one, of 39 the 38th, of 100 the 96th; 95 % of a normal lie within 1.96."""
    for count, place in ((5, 5), (19, 19), (39, 38), (100, 96)):
        error = np.random.default_rng(0).permutation(np.arange(1.0, count + 1.0))
        left = SimpleNamespace(left_out=np.full(count, 7.0), left_out_deviation=np.full(count, 0.5))
        spread = calibrate_spread(left, 7.0 + error * (-1.0) ** np.arange(count))
        assert spread == pytest.approx(place / 0.5 / 1.959964, rel=1e-6)


@pytest.mark.parametrize("asked", [9, 10, 14])
def test_where_the_scope_asks_the_spread_is_the_root_mean_square_of_its_own_runs(asked):
    """Of residuals over what is left of their deviation, as statsmodels has it; from ten runs on."""
    z = Z.copy()
    z[:14] = [NOMINAL[name] for name in NAMES]
    z[:14, 0], z[:14, 3] = Z[:14, 0], Z[:14, 3]
    z[asked:14, 4:] = Z[asked:14, 4:]
    y = 5.0 + noisy(cubic, z, 0.3)
    chosen, _ = choose_surrogate(z, y, NAMES, NOMINAL, ["quadratic"])
    if asked < 10:
        assert np.isnan(chosen.spread_asked) and (chosen.spread_at(z) == chosen.spread).all()
        return
    fit = sm.OLS(y, model_matrix(z, NAMES, model_terms("full", NAMES))).fit()
    ratio = fit.get_influence().resid_studentized_internal[:asked]
    few = {10: 2.228139, 14: 2.144787}[asked] / 1.959964
    assert chosen.spread_asked == pytest.approx(few * np.sqrt(np.mean(ratio**2)), rel=1e-6)
    spread = np.where(np.arange(len(z)) < asked, chosen.spread_asked, chosen.spread)
    np.testing.assert_array_equal(chosen.spread_at(z), spread)
    # 95 % of a normal of both the mean's error and a run's noise.
    low, high = chosen.prediction_interval(z[:2])
    half = 1.959964 * np.hypot(chosen.fitted.predict(z[:2])[1], fit.mse_resid**0.5) * chosen.spread_asked
    np.testing.assert_allclose(0.5 * (high - low), half, rtol=1e-6)


def test_intervals_hold_new_runs_at_their_rate():
    inside = []
    for seed in range(3):
        y = noisy(cubic, noise=0.1, seed=seed)
        chosen, _ = choose_surrogate(Z, y, NAMES, NOMINAL, ["polynomial_chaos", "gaussian_process"])
        low, high = chosen.prediction_interval(NEW)
        new = noisy(cubic, NEW, 0.1, seed + 50)
        inside.append((new >= low) & (new <= high))
    assert 0.9 <= np.mean(inside) <= 0.99


@pytest.mark.parametrize("kind", KINDS)
def test_a_chosen_surrogate_is_made_again_from_its_parameters(kind):
    y = noisy(cusp if kind.startswith("bent") else cubic)
    kinds = ["gaussian_process", kind] if kind.startswith("bent") else [kind]
    chosen, _ = choose_surrogate(Z, y, NAMES, NOMINAL, kinds)
    assert chosen.kind == kind
    text = json.dumps(chosen.fitted.parameters)
    again = rebuild_surrogate(kind, json.loads(text), chosen.spread, Z, y, NAMES)
    np.testing.assert_allclose(again.predict(NEW), chosen.predict(NEW), rtol=1e-9)
    np.testing.assert_allclose(again.standard_error(NEW), chosen.standard_error(NEW), rtol=1e-5)


def test_a_value_that_never_changes_is_a_constant():
    chosen, fits = choose_surrogate(Z, np.full(len(Z), 0.3), NAMES, NOMINAL)
    assert (chosen.kind, chosen.status, fits) == ("constant", "constant", {})
    np.testing.assert_array_equal(chosen.predict(NEW), 0.3)
    assert choose_surrogate(Z, np.zeros(len(Z)), NAMES, NOMINAL)[0].kind == chosen.kind
    low, high = chosen.prediction_interval(NEW)
    np.testing.assert_array_equal(low, high)
    assert (chosen.draw(NEW, np.random.default_rng(0), 3) == 0.3).all()


def test_too_few_runs_are_refused():
    with pytest.raises(ValueError, match="8 runs are too few"):
        choose_surrogate(Z[:8], cubic(Z[:8]), NAMES, NOMINAL)
    assert isinstance(fit_gaussian_process(Z[:12], cubic(Z[:12])), GaussianProcess)
    assert ChosenSurrogate(None, tuple(NAMES), 1.0, 2.0).sigma == 0.0


def test_as_many_runs_as_coefficients_leave_a_quadratic_no_error_to_tell():
    coefficients = (len(NAMES) + 1) * (len(NAMES) + 2) // 2
    assert fit_quadratic(Z[:coefficients], noisy(quadratic)[:coefficients], NAMES) is None
    assert fit_quadratic(Z[: coefficients + 1], noisy(quadratic)[: coefficients + 1], NAMES) is not None


def test_drawn_responses_lie_about_the_mean_with_the_stated_error():
    fitted = fit_quadratic(Z, noisy(quadratic, noise=0.3), NAMES)
    chosen = ChosenSurrogate(fitted, tuple(NAMES), spread=2.0)
    drawn = chosen.draw(NEW[:5], np.random.default_rng(0), 20_000)
    np.testing.assert_allclose(drawn.mean(axis=0), fitted.predict(NEW[:5])[0], atol=0.02)
    # A t distribution's scatter is wider than its scale by sqrt(dof / (dof - 2)); here dof is 92.
    np.testing.assert_allclose(drawn.std(axis=0), chosen.standard_error(NEW[:5]), rtol=0.04)
    np.testing.assert_allclose(chosen.standard_error(NEW[:5]), 2.0 * fitted.predict(NEW[:5])[1], rtol=1e-12)


@pytest.mark.parametrize("columns", [2, 6])
def test_the_likelihood_and_its_gradient_are_scikit_learn_s(columns):
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import WhiteKernel

    seen, y = Z[:, :columns], noisy(cubic)
    target = (y - y.mean()) / y.std()
    kernel = kernel_of(columns) + WhiteKernel(0.01)
    other = GaussianProcessRegressor(kernel, optimizer=None).fit(seen, target)
    rng = np.random.default_rng(3)
    for _ in range(3):
        theta = kernel.theta + 0.4 * rng.standard_normal(len(kernel.theta))
        value, gradient = Likelihood(seen, target)(theta)
        theirs, their_gradient = other.log_marginal_likelihood(theta, eval_gradient=True)
        assert value == pytest.approx(-theirs, rel=1e-9)
        np.testing.assert_allclose(gradient, -their_gradient, rtol=1e-8, atol=1e-8)


def test_the_likelihood_of_no_covariance_is_infinitely_bad():
    theta = np.log([1.0, 1.0, 1.0, 1e-6, 1.0, 1e-300])
    with np.errstate(under="ignore"):
        value, gradient = Likelihood(np.full((40, 2), 1e6), np.ones(40))(theta)
    assert value == np.inf and not gradient.any()


def test_the_search_for_lengths_begins_more_than_once(monkeypatch):
    """A truth that waves within the region: from long lengths alone the search may end in a poor maximum."""
    truth = lambda z: np.sin(4.0 * z[:, 0]) * (1.0 + 0.3 * z[:, 3])  # noqa: E731
    z = Z[:60]
    y = truth(z)
    both = fit_gaussian_process(z, y)
    value = Likelihood(z, (y - y.mean()) / y.std())
    reached = value(np.array([*both.parameters["theta"], both.parameters["log_noise"]]))[0]
    for length in gaussian_process.FIRST_LENGTHS:
        monkeypatch.setattr(gaussian_process, "FIRST_LENGTHS", (length,))
        one = fit_gaussian_process(z, y)
        assert reached <= value(np.array([*one.parameters["theta"], one.parameters["log_noise"]]))[0] + 1e-9


def test_the_mean_is_the_same_in_parts(process):
    many = np.tile(NEW, (20, 1))  # three parts
    np.testing.assert_allclose(process.predict_mean(many), process.predict(many)[0], rtol=1e-9)


def test_left_out_predictions_of_polynomial_chaos_know_nothing_of_their_fifth():
    y = noisy(cubic)
    changed = y.copy()
    changed[::5] += np.random.default_rng(5).normal(scale=3.0, size=len(y[::5]))
    one, other = fit_polynomial_chaos(Z, y), fit_polynomial_chaos(Z, changed)
    np.testing.assert_array_equal(one.left_out[::5], other.left_out[::5])
    # The terms chosen on all runs know it: kept where they do not win in spite of that.
    flattered = fit_polynomial_chaos(Z, changed, to_beat=100.0)
    assert np.abs(flattered.left_out[::5] - one.left_out[::5]).max() > 0.01
