import numpy as np
import pandas as pd
import pytest
from scipy import optimize, stats

from wearscope.designs.factors import PAPER_FACTORS, nominal_levels
from wearscope.evaluation.sampled_scope import ClosedForm, estimate_by_kernels, scope_table
from wearscope.evaluation.scope import (
    detection_probability,
    group_scope,
    paper_grid,
    scope_quadratics,
    spread,
    standardise,
    tail_probability,
    threshold,
)
from wearscope.evaluation.scope_kde import bandwidth_factor, bin_runs, detection_probabilities, draw_runs
from wearscope.surrogates.fitting import Surrogate, surrogates_of

LEVELS = nominal_levels(PAPER_FACTORS)
COARSE = {"deltas": np.linspace(0, 4, 7), "sigmas": np.linspace(0.01, 1, 5)}


@pytest.fixture(scope="module")
def scope(surrogates):
    part = surrogates[surrogates["robot"] == "medium"]
    return scope_table(surrogates_of(part, "full"), **COARSE, runs=20_000, seed=0)


def test_tail_is_that_of_the_noncentral_chi_square():
    a, b, c = 0.4, -1.2, 0.7
    h = np.linspace(-0.1, 8, 9)
    vertex = a - b * b / (4 * c)
    oracle = stats.ncx2.sf((h - vertex) / c, 1, (b / (2 * c)) ** 2)
    np.testing.assert_allclose(tail_probability([a, b, c], h), oracle, rtol=1e-10)
    upside_down = tail_probability([-a, -b, -c], -h)
    np.testing.assert_allclose(upside_down, 1 - oracle, rtol=1e-9, atol=1e-14)


def test_tail_has_no_jump_where_the_square_term_vanishes():
    h = np.linspace(-3, 3, 13)
    straight = stats.norm.sf(h, loc=0.5, scale=2.0)
    for c in (0.0, 1e-300, -1e-300, 1e-12, -1e-12):
        np.testing.assert_allclose(tail_probability([0.5, 2.0, c], h), straight, rtol=1e-10)
        np.testing.assert_allclose(tail_probability([0.5, -2.0, c], h), straight, rtol=1e-10)


def test_tail_beyond_the_hard_edge_is_certain():
    assert tail_probability([1.0, 0.0, 2.0], 0.999) == 1.0
    assert tail_probability([1.0, 0.0, -2.0], 1.001) == 0.0
    assert tail_probability([1.0, 0.0, 0.0], 1.0) == 1.0
    assert tail_probability([1.0, 0.0, 0.0], 1.0 + 1e-9) == 0.0


@pytest.mark.parametrize("p", [0.01, 0.3, 0.999])
def test_the_threshold_leaves_just_the_false_alarms_allowed(p):
    quadratic = np.random.default_rng(0).normal(size=(50, 3)) * [5, 1, 1]
    quadratic[:3, 2] = 0.0, 1e-9, -1e-9
    h = threshold(quadratic, p)
    tail = tail_probability(quadratic, h)
    np.testing.assert_allclose(tail, p, rtol=1e-9)
    lower = tail_probability(quadratic, h - 1e-6 * spread(quadratic))
    assert np.all(lower > p)


def bisect_all(quadratic, wanted):
    """The threshold of the same bisection, in which every bracket is halved as often as any."""
    b, c = np.abs(quadratic[:, 1]), quadratic[:, 2]
    shifted = quadratic * [0.0, 1.0, 1.0]
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.where(np.abs(b) < 18 * np.abs(c), -b * b / (4 * c), 0.0)
    ends = np.stack([81 * c - 9 * b, 81 * c + 9 * b, vertex])
    low, high = ends.min(axis=0), ends.max(axis=0)
    for _ in range(200):
        middle = 0.5 * (low + high)
        above = tail_probability(shifted, middle) > wanted
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    return quadratic[:, 0] + high


@pytest.mark.parametrize("p", [1e-9, 0.01, 0.5, 0.999])
def test_thresholds_together_are_those_alone_and_found_ones_are_asked_for_no_more(p, monkeypatch):
    rng = np.random.default_rng(1)
    quadratic = rng.normal(size=(600, 3)) * 10.0 ** rng.integers(-6, 6, (600, 3))
    quadratic[:20, 2], quadratic[20:40, 1], quadratic[40:50, 1:] = 0.0, 0.0, 0.0
    asked = []

    def count(quadratic, h):
        asked.append(np.size(h))
        return tail_probability(quadratic, h)

    monkeypatch.setattr("wearscope.evaluation.scope.tail_probability", count)
    together = threshold(quadratic, p)
    np.testing.assert_array_equal(together, bisect_all(quadratic, p))
    np.testing.assert_array_equal(threshold(quadratic.reshape(20, 30, 3), p).ravel(), together)
    assert min(asked) < 0.2 * max(asked)


@pytest.mark.parametrize("far", [4.0, 6.0, 8.0])
def test_a_threshold_near_an_output_s_turning_point_is_found(far):
    """y = far^2 - (x - far)^2 turns where x = far: at h it is left by |x - far| > sqrt(far^2 - h)."""
    half = optimize.brentq(lambda d: stats.norm.sf(far - d) - stats.norm.sf(far + d) - 1e-4, 0.0, 20.0)
    assert threshold([0.0, 2 * far, -1.0], 1e-4) == pytest.approx(far**2 - half**2, rel=1e-7)


def test_standardised_coefficients_give_the_same_output():
    x = np.linspace(-2, 2, 5)
    w = 0.5 * x
    a, b, c = standardise([1.0, 2.0, 3.0], 0.5)
    np.testing.assert_allclose(a + b * x + c * x * x, 1 + 2 * w + 3 * w * w)
    assert spread([0.0, 3.0, 4.0]) == pytest.approx(np.sqrt(9 + 32))


def test_exact_detection_agrees_with_brute_force_within_its_error(surrogates):
    rng = np.random.default_rng(0)
    n = 200_000
    for _, surrogate in list(surrogates_of(surrogates, "full"))[:4]:
        null, alternatives = scope_quadratics(surrogate, "w3", np.array([0.5, 1.5]), np.array([0.4]))
        exact = detection_probability(null, alternatives)[0]
        h = threshold(null[0], 0.01)
        z0 = np.array([-2.0, -2, -2, 0, 0, 0])
        for delta, value in zip((0.5, 1.5), exact, strict=True):
            z = np.tile(z0 + np.r_[delta, np.zeros(5)], (n, 1))
            z[:, 3] = 0.4 * rng.standard_normal(n)
            share = np.mean(surrogate.predict(z) >= h)
            assert abs(share - value) < 4.5 * np.sqrt(max(value * (1 - value), 1e-6) / n)


def test_false_alarms_are_the_detections_of_no_change(scope):
    none = scope[(scope["delta"] == 0) & (scope["method"] == "exact")]
    np.testing.assert_allclose(none["p_d"], 0.01, rtol=1e-6)
    assert not none["passes"].any()


def test_kernel_estimate_is_scipys():
    rng = np.random.default_rng(0)
    x0, x1 = rng.standard_normal(4000), rng.standard_normal(4000)
    null, alternative = np.array([0.0, 1.0, 0.4]), np.array([[2.0, 0.8, 0.4], [5.0, 0.5, -0.3]])
    x, *weights = bin_runs(x0, x1)
    powers = np.stack([np.ones_like(x), x, x * x])
    got = detection_probabilities(null @ powers, alternative @ powers, *weights, len(x0), 0.01)
    y0 = stats.gaussian_kde(null[0] + null[1] * x0 + null[2] * x0**2, "silverman")
    low, high = y0.dataset.min() - 2, y0.dataset.max() + 2
    for _ in range(40):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if y0.integrate_box_1d(middle, np.inf) > 0.01 else (low, middle)
    for row, value in zip(alternative, got, strict=True):
        y1 = stats.gaussian_kde(row[0] + row[1] * x1 + row[2] * x1**2, "silverman")
        assert value == pytest.approx(y1.integrate_box_1d(high, np.inf), abs=2e-4)
    assert bandwidth_factor(4000) == pytest.approx(y0.factor)


def test_runs_are_drawn_once_a_row_and_keep_their_mean_and_spread_when_binned():
    x, *weights = draw_runs(3, 5, 50_000)
    assert draw_runs(3, 5, 50_000)[0] is x
    other, *_ = draw_runs(3, 6, 50_000)
    assert not np.array_equal(x, other)
    for one in weights:
        assert one.sum() == pytest.approx(1.0)
        # Five standard errors of 50,000 runs.
        assert abs(one @ x) < 0.023 and abs(one @ x**2 - 1.0) < 0.032


def test_kernel_estimate_agrees_with_the_exact_scope_in_smooth_cases():
    deltas, sigmas = np.linspace(0, 2, 6), np.array([0.1, 0.3])
    theta = np.array([1.0, 1.0, 1.0])
    surrogate = Surrogate(("1", "f", "w3"), theta, np.zeros((3, 3)), 0.0, 9)
    exact = detection_probability(*scope_quadratics(surrogate, "w3", deltas, sigmas))
    kde = estimate_by_kernels(ClosedForm(surrogate, "w3", LEVELS, deltas, -2.0), sigmas)
    # a kernel of 0.106 deviations widens a normal by 0.6 %; 1e5 runs leave 0.012 deviations on the threshold
    np.testing.assert_allclose(kde, exact, atol=0.02)
    assert np.array_equal(kde >= 0.99, exact >= 0.99)


def test_kernel_estimate_strays_at_a_hard_edge():
    # y = f - w^2 under H0 ends at f0: the kernel smears the threshold beyond that edge
    surrogate = Surrogate(("1", "f", "w3", "w3^2"), np.array([0, 1.0, 0, -1.0]), np.zeros((4, 4)), 0.0, 9)
    deltas, sigmas = np.array([0.2]), np.array([1.0])
    exact = detection_probability(*scope_quadratics(surrogate, "w3", deltas, sigmas))[0, 0]
    edge = -stats.chi2.ppf(0.01, 1)
    assert exact == pytest.approx(stats.chi2.cdf(0.2 - edge, 1))
    line = ClosedForm(surrogate, "w3", LEVELS, deltas, -2.0)
    assert estimate_by_kernels(line, sigmas)[0, 0] < exact - 0.1


def test_hand_made_scope_of_a_linear_detector():
    # y = f + w: passes from Delta = sigma (z_0.99 + z_0.99) on
    surrogate = Surrogate(("1", "f", "w3"), np.array([0.0, 1.0, 1.0]), np.zeros((3, 3)), 0.0, 9)
    deltas, sigmas = paper_grid()
    passes = detection_probability(*scope_quadratics(surrogate, "w3", deltas, sigmas)) >= 0.99
    np.testing.assert_array_equal(passes, deltas[None, :] >= 2 * stats.norm.ppf(0.99) * sigmas[:, None])


def test_a_detector_that_always_says_the_same_gets_no_scope(odd):
    scope = scope_table(surrogates_of(odd, "full"), **COARSE, runs=2000)
    constant = scope[scope["fda"] == "C"]
    assert set(constant["status"]) == {"constant"}
    assert not constant["passes"].any() and (constant["p_d"] == 0).all()


def test_a_falling_detector_is_judged_as_it_is_and_reported(odd):
    scope = scope_table(surrogates_of(odd, "full"), **COARSE, runs=2000)
    falling = scope[(scope["fda"] == "B") & (scope["delta"] > 0)]
    assert set(falling["status"]) == {"decreasing"}
    assert not falling["passes"].any()
    assert falling.loc[falling["method"] == "exact", "p_d"].max() < 0.01


def test_a_detector_untouched_by_the_factor_detects_any_change():
    surrogate = Surrogate(("1", "f", "w3"), np.array([5.0, 1.0, 0.0]), np.zeros((3, 3)), 0.0, 9)
    deltas, sigmas = np.array([0.0, 0.1]), np.array([0.5])
    assert detection_probability(*scope_quadratics(surrogate, "w3", deltas, sigmas)).tolist() == [[0.0, 1.0]]
    line = ClosedForm(surrogate, "w3", LEVELS, deltas, -2.0)
    assert estimate_by_kernels(line, sigmas, runs=1000).tolist() == [[0.0, 1.0]]


def test_cross_terms_of_the_fault_make_the_models_differ_only_where_they_act():
    full = Surrogate(("1", "f", "w3", "f:w3"), np.array([0.0, 1.0, 0.5, 0.3]), np.zeros((4, 4)), 0.0, 9)
    simplified = Surrogate(("1", "f", "w3"), np.array([0.0, 1.0, 0.5]), np.zeros((3, 3)), 0.0, 9)
    deltas, sigmas = np.array([0.5, 2.0]), np.array([0.8])
    at_zero = [
        detection_probability(*scope_quadratics(s, "w3", -deltas * 0, sigmas, f0=0.0))
        for s in (full, simplified)
    ]
    np.testing.assert_allclose(*at_zero)
    # from f0 = -2 the full model's slope in w3 is -0.1, at Delta = 2 it is 0.5 as the simplified one's
    null, alternatives = scope_quadratics(full, "w3", deltas, sigmas)
    np.testing.assert_allclose(null[0, 0], [-2.0, -0.08, 0.0], atol=1e-12)
    np.testing.assert_allclose(alternatives[0, 1], [0.0, 0.4, 0.0], atol=1e-12)


def test_table_has_the_contracts_columns_and_any_factor_is_a_choice(scope, surrogates):
    contract = "robot cycle axis fda model factor delta sigma p_d passes method"
    assert list(scope.columns)[:11] == contract.split()
    assert len(scope) == 18 * 2 * 35 * 2
    one = surrogates[surrogates["robot"] == "medium"]
    for factor in ("w1", "w4"):
        part = scope_table(surrogates_of(one, "full"), [factor], methods=["exact"], **COARSE)
        assert set(part["factor"]) == {factor} and part["p_d"].between(0, 1).all()


def test_methods_agree_on_most_of_the_map(scope):
    exact, kde = (scope[scope["method"] == m].reset_index(drop=True) for m in ("exact", "kde"))
    assert (exact["passes"] != kde["passes"]).mean() < 0.05


def test_half_a_study_gives_the_same_rows(surrogates, scope):
    part = surrogates.query("robot == 'medium' and cycle == 'b'")
    expected = scope[scope["cycle"] == "b"].reset_index(drop=True)
    pd.testing.assert_frame_equal(
        scope_table(surrogates_of(part, "full"), **COARSE, runs=20_000, seed=0), expected
    )
    other = scope_table(surrogates_of(part, "full"), methods=["kde"], **COARSE, runs=20_000, seed=1)
    assert not np.array_equal(other["p_d"], expected.loc[expected["method"] == "kde", "p_d"])


def test_group_scope_matrices_sum_their_members(scope):
    groups = group_scope(scope)
    assert set(groups["cells"]) == {6}
    assert groups["passes"].between(0, 6).all() and groups["passes"].max() > 0
    assert groups["passes"].sum() == scope["passes"].sum()
    cell = groups.query("fda == 'A' and factor == 'w5' and method == 'exact'")
    members = scope.query("fda == 'A' and factor == 'w5' and method == 'exact'")
    total = members.groupby(["delta", "sigma"])["passes"].sum()
    assert cell.set_index(["delta", "sigma"])["passes"].to_dict() == total.to_dict()
    assert len(total) == 7 * 5
    assert set(group_scope(scope, [])["cells"]) == {18}


def test_more_disturbance_never_helps_a_linear_detector():
    p_d = detection_probability(
        standardise([0.0, 1.0, 0.0], np.linspace(0.1, 1, 9)),
        standardise([1.0, 1.0, 0.0], np.linspace(0.1, 1, 9)),
    )
    assert np.all(np.diff(p_d) < 0)


def test_bad_settings_get_one_sentence(surrogates, refuses):
    for setting in (
        {"factors": ["w9"]},
        {"factors": ["f"]},
        {"methods": ["guess"]},
        {"sigmas": [0.0, 1.0]},
        {"deltas": []},
        {"false_alarm": 0.5, "detection": 0.2},
        {"runs": 10},
    ):
        refuses(scope_table, surrogates_of(surrogates, "full"), **setting)
