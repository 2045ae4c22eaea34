from dataclasses import replace

import numpy as np
import pytest
from planted_study import planted_test_quantities

from wearscope.designs.factors import PAPER_FACTORS, nominal_levels
from wearscope.evaluation.sampled_scope import ClosedForm, scope_table
from wearscope.evaluation.scope import (
    along_operator,
    detection_probability,
    scope_quadratics,
)
from wearscope.storage import tables
from wearscope.surrogates.fitting import Surrogate, fit_surrogates, surrogates_of

LEVELS = nominal_levels(PAPER_FACTORS)
DELTAS, SIGMAS = np.linspace(0, 4, 9), np.linspace(0.05, 1, 7)


@pytest.fixture(scope="module")
def noisy():
    quantities, _ = planted_test_quantities(robots=["m"], cycles=["a"], fdas=["A"], noise=0.08, seed=2)
    return fit_surrogates(quantities, ["full", "simplified"])


def find_confidence(surrogate, rng, draws=200):
    return ClosedForm(surrogate, "w3", LEVELS, DELTAS, -2.0).find_confidence(SIGMAS, rng, draws, 0.01, 0.99)


@pytest.mark.parametrize("model", ["full", "simplified"])
def test_the_operator_gives_the_coefficients_along_a_factor(noisy, model):
    for _, surrogate in surrogates_of(noisy, model):
        maps = along_operator(surrogate, "w5", LEVELS, [-2.0, 0.5])
        for f, matrix in zip((-2.0, 0.5), maps, strict=True):
            expected = surrogate.along("w5", {**LEVELS, "f": f})
            np.testing.assert_allclose(surrogate.theta @ matrix, expected, atol=1e-12)


def test_drawn_coefficients_have_the_covariance_of_the_estimate(noisy):
    _, surrogate = next(surrogates_of(noisy, "full"))
    draws = surrogate.draw_coefficients(np.random.default_rng(0), 40_000)
    np.testing.assert_allclose(
        draws.mean(axis=0), surrogate.theta, atol=5 * np.sqrt(surrogate.covariance.max() / 40_000)
    )
    # a t distribution is wider than its scale matrix by dof / (dof - 2)
    expected = surrogate.covariance * surrogate.dof / (surrogate.dof - 2)
    np.testing.assert_allclose(np.cov(draws.T), expected, atol=0.05 * expected.max())


def test_confidence_counts_the_draws_that_pass(noisy):
    for _, surrogate in surrogates_of(noisy, "full"):
        got = find_confidence(surrogate, np.random.default_rng(7), 40)
        count = np.zeros(got.shape)
        for theta in surrogate.draw_coefficients(np.random.default_rng(7), 40):
            moved = replace(surrogate, theta=theta)
            count += detection_probability(*scope_quadratics(moved, "w3", DELTAS, SIGMAS)) >= 0.99
        np.testing.assert_allclose(got, count / 40, atol=1e-12)


def test_a_study_repeated_with_fresh_noise_passes_as_often_as_told():
    # 20 studies of one truth: where a verdict is called sure, it is that of the truth
    sure = wrong = 0
    for seed in range(20):
        quantities, truth = planted_test_quantities(["m"], ["a"], [1], ["A"], noise=0.2, seed=0)
        quantities["y"] += 0.2 * np.random.default_rng(seed).standard_normal(len(quantities))
        table = fit_surrogates(quantities, ["full"])
        scope = scope_table(surrogates_of(table, "full"), methods=["exact"], deltas=DELTAS, sigmas=SIGMAS)
        _, surrogate = next(surrogates_of(table, "full"))
        exact = replace(surrogate, theta=truth["m", "a", 1, "A"])
        for factor in ("w3", "w5"):
            right = detection_probability(*scope_quadratics(exact, factor, DELTAS, SIGMAS)) >= 0.99
            confidence = scope.loc[scope["factor"] == factor, "confidence"].to_numpy().reshape(right.shape)
            certain = (confidence > 0.975) | (confidence < 0.025)
            sure += int(certain.sum())
            wrong += int(np.sum(certain & ((confidence > 0.5) != right)))
    assert sure > 1000
    assert wrong / sure < 0.03


def test_only_the_exact_method_carries_a_confidence(noisy):
    kde = scope_table(surrogates_of(noisy, "full"), methods=["kde"], deltas=[1.0], sigmas=[0.5], runs=500)
    assert kde["confidence"].isna().all()
    none = scope_table(surrogates_of(noisy, "full"), methods=["exact"], deltas=[1.0], sigmas=[0.5], draws=0)
    assert none["confidence"].isna().all()


def test_degenerate_surrogates_have_an_explicit_confidence():
    rng = np.random.default_rng(0)
    constant = Surrogate(("1", "f", "w3"), np.zeros(3), np.zeros((3, 3)), 0.0, 9, "constant")
    table = scope_table([(("m", "a", 1, "A", "full"), constant)], ["w3"], runs=500)
    assert not table["passes"].any() and (table["p_d"] == 0).all()
    assert (table.loc[table["method"] == "exact", "confidence"] == 0).all()
    saturated = Surrogate(("1", "f", "w3"), np.ones(3), np.full((3, 3), np.nan), np.nan, 0)
    assert np.isnan(find_confidence(saturated, rng)).all()
    exact = Surrogate(("1", "f", "w3"), np.ones(3), np.zeros((3, 3)), 0.0, 9)
    certain = find_confidence(exact, rng)
    passes = detection_probability(*scope_quadratics(exact, "w3", DELTAS, SIGMAS)) >= 0.99
    np.testing.assert_array_equal(certain, passes)


def test_surrogates_keep_their_uncertainty_through_a_file(noisy, tmp_path):
    tables.write_table(tmp_path / "surrogates.parquet", noisy)
    back = tables.read_table(tmp_path / "surrogates.parquet")
    setting = {"methods": ["exact"], "deltas": DELTAS, "sigmas": SIGMAS, "draws": 20}
    first, second = (
        scope_table(surrogates_of(noisy, "full"), **setting),
        scope_table(surrogates_of(back, "full"), **setting),
    )
    np.testing.assert_array_equal(first["confidence"], second["confidence"])
    tables.write_table(tmp_path / "again.parquet", back)
    assert (tmp_path / "again.parquet").read_bytes() == (tmp_path / "surrogates.parquet").read_bytes()
