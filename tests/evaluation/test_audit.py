import numpy as np
import pandas as pd
import pytest
from scipy import stats

from wearscope.designs.checks import view_for_axis
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.evaluation.audit import (
    audit_table,
    audit_verdicts,
    choose_audit_points,
    choose_more_points,
    combine,
    scope_boundary,
    weigh_evidence,
)
from wearscope.evaluation.sampled_scope import scope_table
from wearscope.surrogates.fitting import surrogates_of

NAMES = [factor.name for factor in PAPER_FACTORS]
EDGES = {"w3": (1.0, 0.5), "w5": (2.0, 0.8)}


@pytest.fixture(scope="module")
def surrogates(surrogates):
    """Those of the nine cells of one robot and test-cycle."""
    return surrogates[(surrogates["robot"] == "medium") & (surrogates["cycle"] == "a")]


@pytest.fixture(scope="module")
def points():
    return choose_audit_points(PAPER_FACTORS, EDGES, points=17)


def directly(surrogates, points, noise, shift=0.0, seed=0):
    """Direct test quantities that are the surrogate's own values plus noise."""
    rng = np.random.default_rng(seed)
    parts = []
    for (robot, cycle, axis, fda, _), surrogate in surrogates_of(surrogates, "full"):
        part = view_for_axis(points, axis)[["point", *NAMES]]
        y = surrogate.predict(part[NAMES].to_numpy()) + shift + noise * rng.standard_normal(len(part))
        parts.append(part.assign(robot=robot, cycle=cycle, axis=axis, fda=fda, set="audit", y=y))
    return pd.concat(parts, ignore_index=True)


def test_the_first_point_is_the_nominal_one_and_the_rest_decide_verdicts(points):
    assert points.loc[0, NAMES].tolist() == [-2, -2, -2, 0, 0, 0]
    assert points["point"].tolist() == list(range(1, 18))
    first = points.iloc[1:5]
    assert first["hypothesis"].tolist() == ["H1", "H1", "H0", "H0"]
    np.testing.assert_allclose(first["w3"].abs(), 0.5 * 2.3263, rtol=1e-4)
    assert first["f"].tolist() == [-1, -1, -2, -2]
    assert first["f_natural"].tolist() == [12.5, 12.5, 0, 0]
    worn = points[points["hypothesis"] == "H1"]
    assert worn.groupby("factor")["worn_axis"].apply(sorted).tolist() == [[1, 1, 2, 2, 3, 3]] * 2
    for _, row in worn.iterrows():
        view = view_for_axis(points[points["point"] == row["point"]], row["worn_axis"])
        assert view[["f", "w1", "w2"]].to_numpy().tolist() == [[-2 + row["delta"], -2, -2]]


def test_points_stay_within_the_levels_and_the_number_asked_for(refuses):
    points = choose_audit_points(PAPER_FACTORS, {"w3": (4.0, 1.0)}, points=4)
    assert len(points) == 4
    assert points[NAMES].abs().to_numpy().max() == 2
    assert points["w3_natural"].min() >= 30
    refuses(choose_audit_points, PAPER_FACTORS, EDGES, points=0)
    refuses(choose_audit_points, PAPER_FACTORS, {"f": (1.0, 1.0)})


def test_the_boundary_is_where_half_the_cells_pass(surrogates, refuses):
    cells, sigmas = surrogates_of(surrogates, "full"), [0.1, 0.3, 0.6]
    scope = scope_table(cells, ["w3"], methods=["exact"], deltas=np.linspace(0, 4, 9), sigmas=sigmas)
    delta, sigma = scope_boundary(scope, "w3")
    share = scope[scope["sigma"] == sigma].groupby("delta")["passes"].mean()
    assert share[delta] >= 0.5
    assert share[share.index < delta].max() < 0.5
    nowhere = scope.assign(passes=False)
    assert scope_boundary(nowhere, "w3") == (4.0, 0.1)
    refuses(scope_boundary, scope, "w5")


def test_the_interval_holds_a_simulator_that_is_as_the_surrogate_says(surrogates, points):
    audit = audit_table(directly(surrogates, points, noise=0.0), surrogates, points)
    assert len(audit) == 9 * 17
    assert audit["inside"].all()
    np.testing.assert_allclose(audit["y_surrogate"], audit["y_direct"])
    # z0 lies outside the region: 3.27 times a run's variance
    np.testing.assert_allclose(audit.loc[audit["point"] == 1, "leverage"], 3.2667, rtol=1e-3)
    assert audit.loc[audit["point"] == 1, "extrapolated"].all()
    assert (audit["low"] < audit["high"]).all()


def test_the_interval_does_not_hold_a_simulator_that_differs(surrogates, points):
    audit = audit_table(directly(surrogates, points, noise=0.0, shift=1.0), surrogates, points)
    assert not audit["inside"].any()
    answers = weigh_evidence(audit)
    assert (answers["share_inside"] == 0).all() and (answers["answer"] == "withheld").all()
    assert answers["n"].sum() == len(audit)


def test_failed_points_are_counted_and_never_inside(surrogates, points):
    direct = directly(surrogates, points, noise=0.0)
    direct["status"] = np.where(direct["fda"] == "B", "simulation failed: lost", "ok")
    direct.loc[direct["fda"] == "B", "y"] = np.nan
    audit = audit_table(direct, surrogates, points)
    assert set(audit.loc[audit["failed"], "status"]) == {"simulation failed: lost"}
    assert audit.loc[audit["fda"] == "B", "failed"].all()
    assert not audit.loc[audit["fda"] == "B", "inside"].any()
    failed = weigh_evidence(audit).set_index("fda").loc["B"]
    assert failed["n"] == 0 and np.isnan(failed["share_inside"]) and failed["answer"] == "not audited"


def test_verdicts_of_four_runs(surrogates, points):
    audit = audit_table(directly(surrogates, points, noise=0.0), surrogates, points)
    verdicts = audit_verdicts(audit)
    assert len(verdicts) == 2 * len(audit[["cycle", "axis", "fda"]].drop_duplicates())
    assert verdicts["agrees"].all()
    fallen = audit.copy()
    fallen["y_direct"] *= -1
    turned = audit_verdicts(fallen)
    assert verdicts["passes_surrogate"].any()
    assert not turned.loc[turned["passes_surrogate"], "passes_direct"].any()
    few = choose_audit_points(PAPER_FACTORS, EDGES, points=3)
    assert audit_verdicts(audit_table(directly(surrogates, few, 0.0), surrogates, few)).empty


def test_four_runs_decide_as_the_exact_scope_where_y_is_monotone(surrogates):
    straight = surrogates.copy()
    straight.loc[straight["term"].str.contains(r"[:^]"), "theta"] = 0.0
    for delta in (0.3, 2.0):
        edge = {"w3": (delta, 0.5)}
        points = choose_audit_points(PAPER_FACTORS, edge, points=9)
        verdicts = audit_verdicts(audit_table(directly(straight, points, 0.0), straight, points))
        cells = surrogates_of(straight, "full")
        scope = scope_table(cells, ["w3"], methods=["exact"], deltas=[delta], sigmas=[0.5])
        both = verdicts.merge(scope, on=["robot", "cycle", "axis", "fda"])
        assert len(both) == len(verdicts) == 9
        assert (both["passes_surrogate"] == both["passes"]).all()


def test_missing_runs_get_one_sentence(surrogates, quantities, points, refuses):
    refuses(audit_table, quantities, surrogates)
    direct = directly(surrogates, points, 0.0)
    refuses(audit_table, direct, surrogates[surrogates["axis"] > 1])


def make_audit(**columns):
    """Audited values of one detector and model, all alike but for what is given."""
    given = {"fda": "A", "model": "full", "extrapolated": False, "failed": False, "y_surrogate": 10.0}
    return pd.DataFrame(given | {"variance": 0.0475} | columns)


def test_the_share_inside_has_wilsons_interval():
    """Of one half of four: 1/2 -+ 1.96 sqrt(1/16 + 1.96^2/64) / (1 + 1.96^2/4); what failed is left out."""
    audit = make_audit(inside=[True, False, True, False, False], failed=[False] * 4 + [True])
    (row,) = weigh_evidence(audit).to_dict("records")
    assert (row["n"], row["n_inside"], row["share_inside"]) == (4, 2, 0.5)
    assert (row["share_low"], row["share_high"]) == pytest.approx((0.15004, 0.84996), abs=1e-5)


def test_answers_are_withheld_where_chance_allows_it_once_in_a_thousand():
    """Of 108 independent values 5.4 lie outside by chance; 12 or more once in 100, 17 or more once in 2e4."""
    for outside, close, answer in ((9, False, "given"), (12, True, "given"), (17, True, "withheld")):
        (row,) = weigh_evidence(make_audit(inside=np.arange(108) >= outside)).to_dict("records")
        assert (row["answer"], row["close"], row["n"], row["n_inside"]) == (
            answer, close, 108, 108 - outside,
        )  # fmt: skip
        assert row["p_audit"] == pytest.approx(stats.poisson.sf(outside - 1, 5.4), rel=0.05)
    failed = make_audit(inside=[False, False], failed=True)
    assert weigh_evidence(failed)["answer"].item() == "not audited"


def test_misses_that_go_together_count_for_less():
    apart = weigh_evidence(make_audit(inside=np.arange(27) >= 7)).iloc[0]
    together = weigh_evidence(make_audit(inside=np.arange(27) >= 7, variance=0.2)).iloc[0]
    assert apart["answer"] == "withheld" and together["answer"] == "given"


def test_one_unlucky_test_of_three_withholds_nothing_and_two_that_fail_do():
    audit = make_audit(inside=np.arange(27) >= 5)
    assert weigh_evidence(audit)["p"].item() == pytest.approx(weigh_evidence(audit)["p_audit"].item())
    verdicts = pd.DataFrame({"fda": "A", "agrees": [True] * 12, "chance": 0.02})
    snr = {"snr_direct": 2.0, "direct_low": 1.8, "direct_high": 2.2}
    same = {"snr_surrogate": 2.0, "surrogate_low": 1.9, "surrogate_high": 2.1}
    direct = pd.DataFrame([{"fda": "A", **snr, **same}])
    row = weigh_evidence(audit, verdicts, direct).iloc[0]
    assert row["p_audit"] < 0.02 < 0.03 < row["p"] and row["answer"] == "given"
    other = direct.assign(snr_surrogate=4.0, surrogate_low=3.9, surrogate_high=4.1)
    assert weigh_evidence(audit, verdicts, other)["answer"].item() == "withheld"
    wrong = verdicts.assign(agrees=[False] * 6 + [True] * 6)
    assert weigh_evidence(audit, wrong, direct)["answer"].item() == "withheld"


def test_a_right_surrogate_is_withheld_at_most_once_in_a_hundred_and_nothing_is_hidden_by_agreement():
    """Values of one surrogate go together: runs drawn from it are its own null."""
    rng = np.random.default_rng(5)
    withheld = 0

    def draw_outside(cells):
        common = rng.standard_normal((cells, 1))
        return np.abs(np.sqrt(0.3) * common + np.sqrt(0.7) * rng.standard_normal((cells, 9))) > 1.96

    variance = draw_outside(20_000).sum(axis=1).var() / 9
    for _ in range(200):
        outside = draw_outside(3)
        audit = make_audit(inside=~outside.ravel(), variance=variance)
        withheld += weigh_evidence(audit)["answer"].item() == "withheld"
    assert withheld <= 2
    assert combine(np.array([1e-6, 1.0, 1.0])) < 1e-5


def test_more_points_lie_at_other_places_of_each_boundary(surrogates):
    grid = {"deltas": np.linspace(0, 4, 9), "sigmas": np.linspace(0.1, 1, 8)}
    scope = scope_table(surrogates_of(surrogates, "full"), ["w3", "w5"], methods=["exact"], **grid)
    points = choose_more_points(PAPER_FACTORS, scope, ["w3", "w5"], [0.25, 0.75], first=10)
    assert points["point"].tolist() == list(range(10, 26))
    assert (points["reason"] == "scope boundary").all()
    middle = {(name, *scope_boundary(scope, name)) for name in ("w3", "w5")}
    places = set(points[["factor", "delta", "sigma"]].itertuples(index=False, name=None))
    assert len(places) == 4 and not places & middle


def test_a_value_at_the_end_of_its_interval_is_inside_but_for_rounding(points):
    """The slack is 1e-9 of the larger of both values, whichever side it is on."""

    class Flat:
        names, sigma, terms = NAMES, np.nan, ("1",)

        def draw_coefficients(self, rng, draws):
            return np.full((draws, 1), 2.0)

        def predict(self, z):
            return np.full(len(z), 2.0)

        def prediction_interval(self, z):
            return np.full(len(z), 1.0), np.full(len(z), 4.0)

    few = view_for_axis(points, 1)[["point", *NAMES]].iloc[:6]
    y = [1.0 - 1e-9, 1.0 - 3e-9, 4.0 + 2e-9, 4.0 + 6e-9, 3.0, np.nan]
    rows = few.assign(robot="r", cycle="c", axis=1, fda="A", set="audit", y=y)
    audit = audit_table(rows, pd.DataFrame(), chosen={("r", "c", 1, "A"): Flat()})
    assert audit["inside"].tolist() == [True, False, True, False, True, False]
    assert audit["failed"].tolist() == [False] * 5 + [True]
    assert audit["leverage"].isna().all() and not audit["extrapolated"].any()


def test_the_boundary_is_in_the_middle_of_those_there_are():
    """Of two cells one passes from a change of 3, 2, 1 on at three sigmas, at the fourth none does."""
    rows = [
        {"factor": "w3", "method": method, "sigma": sigma, "delta": delta, "passes": passes}
        for sigma, first in ((0.1, 3.0), (0.2, 2.0), (0.3, 1.0), (0.4, 9.0)) for delta in (1.0, 2.0, 3.0, 4.0)
        for method, passes in (("exact", delta >= first), ("exact", False), ("kde", True), ("kde", True))
    ]  # fmt: skip
    scope = pd.DataFrame(rows)
    assert scope_boundary(scope, "w3") == (2.0, 0.2)
    assert scope_boundary(scope[scope["sigma"] < 0.3], "w3") == (2.0, 0.2)
    assert scope_boundary(scope, "w3", share=0.51) == (4.0, 0.1)
    assert scope_boundary(scope[scope["method"] == "kde"], "w3") == (1.0, 0.3)
