"""Questions asked of chosen surrogates: quadratic truths give what the closed forms give."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from scipy.special import ndtr

from wearscope.designs.checks import view_for_axis
from wearscope.designs.factors import PAPER_FACTORS, nominal_levels
from wearscope.designs.kinds import make_design
from wearscope.evaluation.audit import audit_table, choose_audit_points, weigh_evidence
from wearscope.evaluation.sampled_scope import (
    SPREAD,
    ClosedForm,
    Tabulated,
    detect_tabulated,
    estimate_by_kernels,
    interpolation,
    scope_table,
    table_nodes,
    tabulated_points,
    weighted_threshold,
)
from wearscope.evaluation.snr import (
    answer_rows,
    direct_design,
    direct_table,
    draw_snr,
    exact_snr,
    mismatch_design,
    mismatch_table,
    quadrature_snr,
    snr_table,
)
from wearscope.surrogates.chosen import ChosenSurrogate, choose_surrogate
from wearscope.surrogates.fitting import Surrogate, fit_surrogate

NAMES = [factor.name for factor in PAPER_FACTORS]
NOMINAL = nominal_levels(PAPER_FACTORS)
KEY = ("r", "c", 1, "A")
Z = make_design("latin_hypercube", PAPER_FACTORS, {"points": 100}, 2)[NAMES].to_numpy()
DELTAS, SIGMAS = np.linspace(0, 4, 9), np.array([0.05, 0.3, 0.6])
NOISE = 0.05


def truth(z):
    return 1 + z[:, 0] + 0.5 * z[:, 3] + 0.3 * z[:, 5] + 0.1 * z[:, 0] * z[:, 3] + 0.1 * z[:, 3] ** 2


def runs(z, seed=0, noise=NOISE):
    return truth(z) + noise * np.random.default_rng(seed).standard_normal(len(z))


@pytest.fixture(scope="module")
def quadratic():
    """The same runs as a chosen surrogate and as the paper's full model."""
    y = runs(Z)
    return choose_surrogate(Z, y, NAMES, NOMINAL, ["quadratic"])[0], fit_surrogate(Z, y, NAMES, "full")


@pytest.fixture(scope="module")
def process():
    return choose_surrogate(Z, runs(Z), NAMES, NOMINAL, ["gaussian_process"])[0]


def test_quadrature_gives_the_exact_moments_of_a_quadratic_form(quadratic):
    chosen, full = quadratic
    for sigma in (0.1, 0.25, 0.4):
        expected = float(exact_snr(full.theta, full.terms, sigma=sigma))
        assert quadrature_snr(chosen, sigma=sigma) == pytest.approx(expected, rel=0.01)


def test_the_snr_s_interval_is_that_of_the_coefficients(quadratic):
    chosen, full = quadratic
    drawn = draw_snr(chosen, np.random.default_rng(0), 2000)
    theta = full.draw_coefficients(np.random.default_rng(1), 2000)
    expected = exact_snr(theta, full.terms)
    assert np.median(drawn) == pytest.approx(np.median(expected), rel=0.03)
    assert drawn.std() == pytest.approx(chosen.spread * expected.std(), rel=0.2)


def test_the_interval_holds_the_truth(process):
    terms = fit_surrogate(Z, truth(Z), NAMES, "full")
    expected = float(exact_snr(terms.theta, terms.terms))
    held = []
    for seed in range(6):
        chosen = choose_surrogate(Z, runs(Z, seed), NAMES, NOMINAL, ["gaussian_process"])[0]
        low, high = np.quantile(draw_snr(chosen, np.random.default_rng(seed), 300), [0.025, 0.975])
        assert high - low < 0.5 * expected
        held.append(low <= expected <= high)
    assert sum(held) >= 4


def test_monte_carlo_agrees_within_its_error_and_the_table_has_the_contract_s_columns(process):
    table = snr_table([(KEY, process)], noise={KEY: NOISE}, runs=20_000, seed=4)
    row = table.iloc[0]
    assert list(table.columns) == [
        *("robot", "cycle", "axis", "fda", "model", "snr", "snr_exact", "snr_low", "snr_high"),
        *("snr_stderr", "status"),
    ]
    assert abs(row["snr"] - row["snr_exact"]) < 4 * row["snr_stderr"] + 0.01 * row["snr_exact"]
    assert row["snr_low"] < row["snr_exact"] < row["snr_high"]
    assert row["status"] == "ok" and row["model"] == "chosen"


def test_no_noise_no_change_and_a_falling_value_are_told_apart(process):
    falling = choose_surrogate(Z, -runs(Z), NAMES, NOMINAL, ["quadratic"])[0]
    same = ChosenSurrogate(None, tuple(NAMES), 1.0, 0.3)
    keys = [("r", "c", 1, name) for name in ("free", "falling", "same")]
    table = snr_table(
        zip(keys, (process, falling, same), strict=True),
        noise=dict(zip(keys, (0.0, NOISE, 0.0), strict=True)),
        runs=500,
    ).set_index("fda")
    assert table["status"].to_dict() == {"free": "noise-free", "falling": "decreasing", "same": "constant"}
    assert table.loc[["free", "same"], ["snr", "snr_exact", "snr_low", "snr_high"]].isna().all(axis=None)
    assert table.loc["falling", "snr_exact"] < 0


@pytest.mark.parametrize("factor", ["w3", "w5"])
def test_tabulated_scope_is_the_closed_form_where_nothing_is_held(quadratic, factor):
    chosen, full = quadratic
    nodes = table_nodes()
    z = tabulated_points(NAMES, factor, -2.0 + np.concatenate([[0.0], DELTAS]), nodes, NOMINAL)
    table = Tabulated(chosen, factor, NOMINAL | {factor: 0.0}, DELTAS, -2.0)
    assert table.mean.ravel() == pytest.approx(chosen.predict(z))
    line = ClosedForm(full, factor, NOMINAL, DELTAS, -2.0)
    wanted = np.array([0.01])
    np.testing.assert_allclose(table.detect(SIGMAS, wanted)[1], line.detect(SIGMAS, wanted)[1], atol=0.02)
    # Both ask the same runs.
    one, other = (estimate_by_kernels(response, SIGMAS, 0.01, 20_000, 0) for response in (table, line))
    np.testing.assert_allclose(one, other, atol=0.02)


def test_without_change_the_alarm_rate_is_the_false_one(process):
    nodes = table_nodes()
    z = tabulated_points(NAMES, "w3", np.array([-2.0, -2.0]), nodes, NOMINAL)
    values = process.predict(z).reshape(2, -1)
    np.testing.assert_allclose(detect_tabulated(values, nodes, SIGMAS, 0.05)[1], 0.05, atol=0.003)
    flat = np.zeros((3, len(nodes)))
    flat[2] = 1.0
    _, p_d = detect_tabulated(flat, nodes, SIGMAS)
    np.testing.assert_allclose(p_d, [[0.0, 1.0]] * len(SIGMAS), atol=1e-12)


def test_scope_table_has_both_methods_and_a_confidence_that_follows_the_uncertainty(process, refuses):
    same = ChosenSurrogate(None, tuple(NAMES), 1.0, 0.3)
    cells = [(KEY, process), (("r", "c", 1, "S"), same)]
    table = scope_table(cells, ["w3"], NOMINAL, DELTAS, SIGMAS, runs=2000, draws=40)
    assert len(table) == 2 * 2 * DELTAS.size * SIGMAS.size
    exact = table[(table["method"] == "exact") & (table["fda"] == "A")]
    sure = exact["confidence"].to_numpy()
    assert ((sure >= 0) & (sure <= 1)).all()
    assert sure[exact["passes"]].mean() > 0.7 > 0.3 > sure[~exact["passes"]].mean()
    constant = table[table["fda"] == "S"]
    assert (constant["p_d"] == 0).all() and (constant["status"] == "constant").all()
    refuses(scope_table, cells, ["f"], NOMINAL, DELTAS, SIGMAS)


def direct_values(points, seed=9, shift=0.0):
    part = view_for_axis(points, 1)[["point", *NAMES]].copy()
    part["y"] = runs(part[NAMES].to_numpy(), seed) + shift
    return part.assign(robot="r", cycle="c", axis=1, fda="A")


def test_a_right_surrogate_stands_its_audit_and_a_planted_wrong_one_is_withheld(process):
    points = choose_audit_points(PAPER_FACTORS, {"w3": (1.0, 0.5), "w5": (2.0, 0.8)}, points=17)
    many = pd.concat(
        [direct_values(points, seed).assign(robot=f"r{seed}", set="audit") for seed in range(6)],
        ignore_index=True,
    )
    keys = [(f"r{seed}", "c", 1, "A") for seed in range(6)]
    right = audit_table(many, pd.DataFrame(), points, chosen=dict.fromkeys(keys, process))
    answer = weigh_evidence(right).iloc[0]
    assert answer["answer"] == "given" and answer["share_inside"] >= 0.9
    assert (right["model"] == "chosen").all() and not right["extrapolated"].any()

    # A surrogate of other runs: its effect of wear is a tenth too small.
    y = runs(Z) - 0.3 * Z[:, 0]
    wrong = choose_surrogate(Z, y, NAMES, NOMINAL, ["gaussian_process"])[0]
    failing = weigh_evidence(audit_table(many, pd.DataFrame(), points, chosen=dict.fromkeys(keys, wrong)))
    assert failing["answer"].tolist() == ["withheld"]
    assert failing["share_inside"].item() < 0.5


def test_what_failed_is_not_audited_rather_than_withheld(process):
    points = choose_audit_points(PAPER_FACTORS, {"w3": (1.0, 0.5)}, points=3)
    lost = direct_values(points).assign(set="audit", y=np.nan)
    answer = weigh_evidence(audit_table(lost, pd.DataFrame(), points, chosen={KEY: process})).iloc[0]
    assert answer["answer"] == "not audited" and answer["n"] == 0


def test_direct_runs_agree_with_a_right_surrogate_and_not_with_a_wrong_one(process, refuses):
    design = direct_design(PAPER_FACTORS, 300, 1, seed=1)
    assert design["hypothesis"].value_counts().to_dict() == {"H0": 300, "H1": 300}
    assert set(design.loc[design["hypothesis"] == "H1", "f"]) == {0.5}
    table = direct_values(design).assign(set="direct")
    row = direct_table(table, design, {KEY: process}).iloc[0]
    assert row["agrees"] and row["runs"] == 300 and row["n_failed"] == 0
    assert row["direct_low"] < row["snr_surrogate"] < row["direct_high"]
    free = direct_table(table, design, {KEY: process}, {KEY: 0.0}).iloc[0]
    assert np.isnan(free["snr_direct"]) and np.isnan(free["snr_surrogate"]) and free["agrees"] is None
    loud = direct_table(table, design, {KEY: process}, {KEY: 10.0}).iloc[0]
    assert loud["snr_surrogate"] < 0.2 and not loud["agrees"]  # the noise that is given counts
    doubled = choose_surrogate(Z, runs(Z) + 2 * Z[:, 0], NAMES, NOMINAL, ["gaussian_process"])[0]
    assert not direct_table(table, design, {KEY: doubled}).iloc[0]["agrees"]
    table.loc[table["point"] == 5, "y"] = np.nan
    assert direct_table(table, design, {KEY: process})["runs"].item() == 299
    refuses(direct_table, table.assign(set="audit"), design, {KEY: process})
    refuses(direct_table, table, design, {})


def test_a_robot_that_answers_half_as_much_has_half_the_ratio(process):
    design = direct_design(PAPER_FACTORS, 300, 1, seed=1)
    nominal = design.head(1).drop(columns=["hypothesis", "axis"])
    pairs, learnt = mismatch_design(design, nominal, {"effects.wear.all.alpha": 1.3}, 200)
    assert pairs["point"].tolist() == list(range(1, 401)) and len(learnt) == 1
    same = ["f", "w3", "hypothesis"]
    assert pairs[same].equals(pd.concat([design[:200], design[300:500]], ignore_index=True)[same])
    for table in (pairs, learnt):
        assert set(table["effects.wear.all.alpha_natural"]) == {1.3}

    ideal = direct_table(direct_values(design).assign(set="direct"), design, {KEY: process})
    asked = direct_values(pairs)
    kept = mismatch_table(asked, ideal).iloc[0]
    assert kept["mismatch_low"] < kept["snr_ideal"] < kept["mismatch_high"] and kept["runs"] == 200
    step = np.diff(asked["y"].to_numpy().reshape(2, -1).mean(axis=1))[0]
    halved = mismatch_table(asked.assign(y=asked["y"] - 0.5 * step * (asked["f"] > 0)), ideal).iloc[0]
    assert halved["snr_mismatch"] == pytest.approx(0.5 * kept["snr_mismatch"])
    assert halved["snr_ideal"] == ideal["snr_direct"].item()
    lost = asked.assign(y=asked["y"].where(asked["point"] != 3))
    assert mismatch_table(lost, ideal)[["runs", "n_failed"]].to_numpy().tolist() == [[199, 1]]
    assert np.isnan(mismatch_table(asked, ideal.assign(snr_direct=np.nan))["snr_mismatch"].item())


def test_the_chosen_surrogate_answers_where_the_paper_s_stands_next_to_it():
    snr = pd.DataFrame({"fda": ["A", "A", "D"], "model": "chosen", "snr_exact": [1.0, 3.0, 30.0]})
    both = pd.concat([snr, snr.assign(model="full", snr_exact=[2.0, 2.0, 9.0])], ignore_index=True)
    assert (
        answer_rows(both).equals(snr) and answer_rows(both[both["model"] == "full"])["model"].eq("full").all()
    )


def test_runs_drawn_along_a_line_are_those_drawn_along_its_table():
    """y = 2.5 + f + 0.4 w, w about 0.3: between nodes the table is the line itself."""
    sigmas, deltas = np.array([0.1, 0.3]), np.array([0.4, 0.9])
    straight = SimpleNamespace(names=("f", "w3"), status="ok", predict=lambda z: 2.5 + z @ [1.0, 0.4])
    table = Tabulated(straight, "w3", {"w3": 0.3}, deltas, -2.0)
    found = estimate_by_kernels(table, sigmas, 0.05, 2000, 7)
    moved = Surrogate(("1", "f", "w3"), np.array([2.62, 1.0, 0.4]), np.zeros((3, 3)), 0.0, 9)
    wanted = estimate_by_kernels(ClosedForm(moved, "w3", {}, deltas, -2.0), sigmas, 0.05, 2000, 7)
    assert 0.1 < wanted.min() < 0.99
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


@pytest.mark.parametrize(("sign", "status"), [(1.0, "decreasing"), (-1.0, "ok")])
def test_a_quantity_falls_if_it_does_at_the_largest_change(sign, status):
    """-f (f + 2) is 0 without a change, 1 after one of 1 and -8 after one of 4."""
    y = -sign * Z[:, 0] * (Z[:, 0] + 2.0) + 1e-3 * np.random.default_rng(0).standard_normal(len(Z))
    chosen = choose_surrogate(Z, y, NAMES, NOMINAL, ["quadratic"])[0]
    for deltas in ([1.0, 4.0], [4.0, 1.0]):
        table = scope_table([(KEY, chosen)], ["w3"], NOMINAL, deltas, [0.1], methods=["exact"], draws=0)
        assert set(table["status"]) == {status}


def test_intervals_that_touch_agree(process, monkeypatch):
    design = direct_design(PAPER_FACTORS, 60, 1, seed=1)
    table = direct_values(design).assign(set="direct")

    def compare(said=None):
        if said is not None:
            monkeypatch.setattr("wearscope.evaluation.snr.draw_snr", lambda *_, **__: np.full(9, said))
        return direct_table(table, design, {KEY: process}, draws=200).iloc[0]

    row = compare()
    low, high = row["direct_low"], row["direct_high"]
    values = table.sort_values("point")["y"].to_numpy().reshape(2, 60)
    assert row["snr_direct"] == pytest.approx((values[1] - values[0]).mean() / values[1].std(ddof=1))
    assert low < row["snr_direct"] < high
    for said, agrees in (
        (low, True), (high, True), (np.nextafter(low, -np.inf), False), (np.nextafter(high, np.inf), False),
    ):  # fmt: skip
        assert compare(said)["agrees"] == agrees


def test_the_direct_design_wears_the_axis_that_is_tested():
    design = direct_design(PAPER_FACTORS, 20, 3, seed=1)
    view = view_for_axis(design, 3)
    assert set(view["f"]) == {-0.5, 0.5}
    np.testing.assert_array_equal(
        design.loc[design["hypothesis"] == "H0", ["f", "w1", "w3"]],
        design.loc[design["hypothesis"] == "H1", ["f", "w1", "w3"]],
    )


def test_responses_between_their_nodes_are_on_the_lines_that_numpy_draws():
    nodes = np.array([-2.0, -0.5, 0.0, 1.0, 2.0])
    y = np.array([3.0, -1.0, 4.0, 1.0, 5.0])
    at = np.array([-3.0, -2.0, -1.1, -0.5, -0.1, 0.0, 0.7, 1.0, 1.9, 2.0, 7.0])
    left, share = interpolation(nodes, at)
    np.testing.assert_allclose(y[left] + share * (y[left + 1] - y[left]), np.interp(at, nodes, y))


@pytest.mark.parametrize("centre", [0.0, -1.0])
def test_nodes_reach_both_ends_and_are_the_denser_the_nearer_to_the_mean(centre):
    """A quarter of the nodes of a side reach an eighth of its way: 1/4 to the power of 3/2."""
    nodes = table_nodes(centre)
    assert len(nodes) == 33 and (np.diff(nodes) > 0.0).all()
    assert (nodes[0], nodes[16], nodes[-1]) == (-2.0, centre, 2.0)
    assert nodes[20] == pytest.approx(centre + (2.0 - centre) / 8.0)
    assert nodes[12] == pytest.approx(centre - (2.0 + centre) / 8.0)


def test_one_grid_s_thresholds_are_those_of_single_ones():
    """Where two tables of the same thing are cut: at the sample that an alarm's share ends in."""
    nodes, sigmas = table_nodes(0.0), np.array([0.2, 0.7])
    values = np.stack([np.sin(nodes), np.sin(nodes) + 0.3 * nodes**2 + 0.5, np.minimum(nodes, 0.1)])
    edges = np.concatenate([[-np.inf], 0.5 * (SPREAD[1:] + SPREAD[:-1]), [np.inf]])
    weights = np.diff(ndtr(edges))
    for null in (values, values[[2, 0, 1]], values[[0, 0, 0]] * 0.0 + 1.0):
        thresholds, found = detect_tabulated(null, nodes, sigmas, 0.03)
        for s, sigma in enumerate(sigmas):
            healthy, *worn = (np.interp(sigma * SPREAD, nodes, row) for row in null)
            h = weighted_threshold(healthy, weights, 0.03)
            assert thresholds[s] == pytest.approx(h)
            assert found[s] == pytest.approx([weights[y >= h].sum() for y in worn])
