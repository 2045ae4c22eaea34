import numpy as np
import pandas as pd
import pytest

from wearscope.designs.bases import linear_names, model_matrix, model_terms
from wearscope.designs.checks import (
    _name_some,
    check_design,
    check_estimable,
    defining_relation,
    describe_design,
    prediction_variance,
    resolution,
    term_dependencies,
    view_for_axis,
)
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import fractional_factorial, make_design

NAMES = [factor.name for factor in PAPER_FACTORS]
PAPER = {"generators": {"w5": "f w1 w2 w3 w4"}}


@pytest.fixture(scope="module")
def design():
    return make_design("central_composite", PAPER_FACTORS, PAPER)


def test_terms_of_the_three_models():
    assert model_terms("main", ["f", "w1"]) == ("1", "f", "w1")
    assert model_terms("full", ["f", "w1"]) == ("1", "f", "w1", "f:w1", "f^2", "w1^2")
    assert model_terms("simplified", ["f", "w1", "w2"]) == ("1", "f", "w1", "w2", "w1:w2", "w1^2", "w2^2")
    assert [len(model_terms(model, NAMES)) for model in ("main", "full", "simplified")] == [7, 28, 22]


def test_model_matrix_multiplies_levels(refuses):
    phi = model_matrix([[2.0, 3.0, 5.0]], ["f", "a", "b"], ["1", "f", "a:b", "a^2", "f:a:b"])
    assert phi.tolist() == [[1.0, 2.0, 15.0, 9.0, 30.0]]
    refuses(model_matrix, [[1.0]], ["f"], ["q"])


def test_the_papers_design_is_as_computed_in_the_notes(design):
    table = describe_design(design, PAPER_FACTORS).set_index("model")
    assert table["rank"].to_dict() == {"main": 7, "full": 28, "simplified": 22}
    assert set(table["resolution"]) == {6}
    assert set(table["defining_relation"]) == {"I = f w1 w2 w3 w4 w5"}
    full = table.loc["full"]
    assert full["condition"] == pytest.approx(12.2, abs=0.05)
    assert full["dof"] == 17
    assert full["variance_nominal"] == pytest.approx(3.27, abs=0.005)
    assert full["variance_centre"] == pytest.approx(0.47, abs=0.005)
    assert full["nominal_norm"] == pytest.approx(3.46, abs=0.005)
    assert full["region_norm"] == pytest.approx(2.45, abs=0.005)
    assert full["nominal_outside"]


def test_prediction_variance_is_leverage_at_the_designs_points(design):
    z = design[NAMES].to_numpy()
    phi = model_matrix(z, NAMES, model_terms("full", NAMES))
    hat = phi @ np.linalg.inv(phi.T @ phi) @ phi.T
    got = prediction_variance(z, NAMES, "full", z)
    np.testing.assert_allclose(got, np.diag(hat), rtol=1e-9)
    assert got.sum() == pytest.approx(28)


def test_resolution_of_textbook_fractions():
    # Box, Hunter and Hunter: 2^(7-4) with d=ab, e=ac, f=bc, g=abc has resolution III and 15 words
    names = list("abcdefg")
    cube = fractional_factorial(names, ["d = a b", "e = a c", "f = b c", "g = a b c"])
    words = defining_relation(cube, names)
    assert len(words) == 15
    assert resolution(cube, names) == 3
    assert sum(len(word) == 3 for _, word in words) == 7
    assert resolution(fractional_factorial(list("abcde"), ["e = a b c d"]), list("abcde")) == 5
    assert resolution(fractional_factorial(list("abc")), list("abc")) is None
    assert defining_relation(fractional_factorial(list("abc"), ["c = -a b"]), list("abc")) == [
        (-1, ("a", "b", "c"))
    ]


def test_an_unestimable_design_is_refused_and_the_aliases_are_named(refuses):
    low = make_design("central_composite", PAPER_FACTORS, {"generators": ["w4 = f w1", "w5 = f w1 w2"]})
    refuses(check_estimable, low, "full")
    cube = make_design("fractional_factorial", PAPER_FACTORS, PAPER)
    refuses(check_estimable, cube, "full")
    check_estimable(cube, "main")
    few = make_design("latin_hypercube", PAPER_FACTORS, {"points": 20})
    refuses(check_design, few, PAPER_FACTORS)


def test_four_aliases_are_named_and_the_rest_counted(refuses):
    level = np.array([1.0, -1.0] * 4)
    for count, rest in ((4, ""), (5, " and 1 more")):
        names = list("fabcde")[: count + 1]
        design = pd.DataFrame(dict.fromkeys(names, level))
        refuses(check_estimable, design, "main", names)
        assert _name_some(names[: count - 1]) == "f and a and b" + rest
    assert _name_some([]).startswith("nothing")


def test_dependencies_state_the_combination():
    a, b = np.array([1.0, -1, 1, -1]), np.array([1.0, 1, -1, -1])
    phi = np.column_stack([np.ones(4), a, b, 2 * a - b])
    assert term_dependencies(phi, ["1", "a", "b", "c"]) == {"c": {"a": 2.0, "b": -1.0}}
    assert term_dependencies(phi[:, :3], ["1", "a", "b"]) == {}


def test_every_axis_sees_a_valid_half_fraction(design):
    check_design(design, PAPER_FACTORS)
    z = design[NAMES].to_numpy()
    phi = model_matrix(z, NAMES, model_terms("full", NAMES))
    for axis in (1, 2, 3):
        view = view_for_axis(design, axis)
        seen = view[NAMES].to_numpy()
        assert {tuple(row) for row in seen} == {tuple(row) for row in z}
        np.testing.assert_array_equal(seen[:32, 5], seen[:32, :5].prod(axis=1))
        gram = model_matrix(seen, NAMES, model_terms("full", NAMES))
        np.testing.assert_allclose(gram.T @ gram, phi.T @ phi, atol=1e-9)


def test_a_view_puts_its_own_axis_first(design, refuses):
    second, third = view_for_axis(design, 2), view_for_axis(design, 3)
    for suffix in ("", "_natural"):
        own = [design[f"{name}{suffix}"].tolist() for name in ("f", "w1", "w2")]
        assert [second[f"{n}{suffix}"].tolist() for n in ("f", "w1", "w2")] == [own[1], own[0], own[2]]
        assert [third[f"{n}{suffix}"].tolist() for n in ("f", "w1", "w2")] == [own[2], own[0], own[1]]
    assert view_for_axis(design, 1).equals(design)
    refuses(view_for_axis, design, 4)


def test_factor_names_of_a_model_are_its_terms_of_one_factor():
    assert linear_names(("1", "f", "w1", "f:w1", "f^2")) == ("f", "w1")
    assert linear_names(("w2", "1", "w1^2", "f:w2")) == ("w2",)


def test_every_axis_with_a_wear_factor_is_checked_where_none_is_named(refuses):
    # Wear of the first axis at two levels alone: its square is a constant. The simplified model has no square
    # of the tested axis' wear, so that the first axis bears it and the others do not.
    design = make_design("latin_hypercube", PAPER_FACTORS, {"points": 80}, 1)
    design = design.assign(f=np.where(np.arange(80) % 2, 1.0, -1.0))
    check_design(design, PAPER_FACTORS, ["simplified"], axes=[1])
    refuses(check_design, design, PAPER_FACTORS, ["simplified"], axes=[1, 3])
    refuses(check_design, design, PAPER_FACTORS, ["simplified"])


def test_largest_leverage_is_that_of_the_hat_matrix_of_every_point():
    # One far point at the head of a line: leverage 1/n + (x - mean)^2 / sum of squares, by hand.
    x = np.array([1.0, -0.2, -0.1, 0.0, 0.1, 0.2])
    table = describe_design(pd.DataFrame({"f": x}), PAPER_FACTORS[:1], ["main"]).set_index("model")
    leverage = 1 / 6 + (x - x.mean()) ** 2 / ((x - x.mean()) ** 2).sum()
    assert table.loc["main", "leverage_max"] == pytest.approx(leverage.max())
    assert leverage.argmax() == 0
