import itertools

import numpy as np
import pytest

from wearscope.designs.factors import PAPER_FACTORS, Factor
from wearscope.designs.kinds import (
    fractional_factorial,
    make_design,
    nominal_design,
    read_generators,
    validation_design,
)

NAMES = [factor.name for factor in PAPER_FACTORS]
PAPER = {"generators": {"w5": "f w1 w2 w3 w4"}}
TABLE_2 = {
    1: [-1, -1, -1, -1, -1, -1],
    2: [-1, -1, -1, -1, 1, 1],
    3: [-1, -1, -1, 1, -1, 1],
    4: [-1, -1, -1, 1, 1, -1],
    5: [-1, -1, 1, -1, -1, 1],
    41: [0, 0, 0, 0, -2, 0],
    42: [0, 0, 0, 0, 2, 0],
    43: [0, 0, 0, 0, 0, -2],
    44: [0, 0, 0, 0, 0, 2],
    45: [0, 0, 0, 0, 0, 0],
}


def rows(design, names=NAMES):
    return {tuple(row) for row in design[list(names)].to_numpy()}


def three():
    return [
        Factor(name, name, "fault" if name == "f" else "nuisance", "other", 0, 4) for name in ("f", "a", "b")
    ]


def test_central_composite_is_table_2_row_for_row():
    design = make_design("central_composite", PAPER_FACTORS, PAPER)
    assert list(design["point"]) == list(range(1, 46))
    for point, row in TABLE_2.items():
        assert list(design.loc[design["point"] == point, NAMES].iloc[0]) == row
    cube = design[NAMES].to_numpy()[:32]
    assert np.all(np.abs(cube) == 1)
    assert len(rows(design)) == 45
    np.testing.assert_array_equal(cube[:, 5], cube[:, :5].prod(axis=1))
    # the base factors in standard order, which is what rows 1 to 5 begin
    expected = np.array(list(itertools.product((-1, 1), repeat=5)))
    np.testing.assert_array_equal(cube[:, :5], expected)


def test_natural_columns_stand_beside_the_coded_ones():
    design = make_design("central_composite", PAPER_FACTORS, PAPER)
    assert list(design.columns) == ["point", *NAMES, *(f"{name}_natural" for name in NAMES)]
    row = design.iloc[3]
    natural = [row[f"{name}_natural"] for name in NAMES]
    assert natural == [12.5, 12.5, 12.5, 60, 62.5, -5]


def test_the_papers_example_of_three_factors():
    design = make_design("face_centred", three())
    corners = set(itertools.product((-2.0, 2.0), repeat=3))
    faces = {tuple(s * 2.0 * np.eye(3)[k]) for s in (-1, 1) for k in range(3)}
    assert len(design) == 15
    assert rows(design, "fab") == corners | faces | {(0.0, 0.0, 0.0)}


def test_axial_composites_are_rotatable_by_default(refuses):
    alpha = 8**0.25
    outer = make_design("circumscribed", three())[["f", "a", "b"]].to_numpy()
    inner = make_design("inscribed", three())[["f", "a", "b"]].to_numpy()
    assert np.abs(outer[:8]).max() == 1
    assert np.abs(outer).max() == pytest.approx(alpha)
    np.testing.assert_allclose(inner, outer * 2 / alpha)
    refuses(make_design, "circumscribed", PAPER_FACTORS, PAPER)


def test_full_factorial_has_every_combination_once(refuses):
    design = make_design("full_factorial", three(), {"levels": 3})
    assert len(design) == 27
    assert rows(design, "fab") == set(itertools.product((-2.0, 0.0, 2.0), repeat=3))
    assert len(make_design("full_factorial", three())) == 5**3
    refuses(make_design, "full_factorial", PAPER_FACTORS, {"levels": 9})


def test_fractional_factorial_keeps_its_generators_and_their_sign():
    matrix = fractional_factorial(["f", "a", "b", "c"], ["b = -f a", "c = f"])
    assert matrix.shape == (4, 4)
    np.testing.assert_array_equal(matrix[:, 2], -matrix[:, 0] * matrix[:, 1])
    np.testing.assert_array_equal(matrix[:, 3], matrix[:, 0])
    design = make_design("fractional_factorial", PAPER_FACTORS, PAPER)
    assert np.all(np.abs(design[NAMES].to_numpy()) == 2)


def test_latin_hypercube_fills_each_stratum_once_and_follows_its_seed():
    design = make_design("latin_hypercube", PAPER_FACTORS, {"points": 20}, seed=0)
    strata = np.floor((design[NAMES].to_numpy() + 2) / 4 * 20)
    for column in strata.T:
        assert sorted(column) == list(range(20))
    assert design.equals(make_design("latin_hypercube", PAPER_FACTORS, {"points": 20}, seed=0))
    assert not design.equals(make_design("latin_hypercube", PAPER_FACTORS, {"points": 20}, seed=1))
    fresh = validation_design("latin_hypercube", PAPER_FACTORS, {"points": 20}, seed=0)
    shrunk = np.column_stack([f.validation_to_coded(design[f.name]) for f in PAPER_FACTORS])
    assert not np.allclose(fresh[NAMES].to_numpy(), shrunk)


def test_a_centred_hypercube_has_the_middles_of_its_strata():
    middles, drawn = (
        make_design("latin_hypercube", PAPER_FACTORS, {"points": 5, "centred": centred})[NAMES].to_numpy()
        for centred in (True, False)
    )
    for column in middles.T:
        np.testing.assert_allclose(sorted(column), [-1.6, -0.8, 0.0, 0.8, 1.6])
    assert np.abs(np.sort(drawn, axis=0) - np.sort(middles, axis=0)).min(axis=0).max() > 1e-3


def test_validation_design_is_the_same_matrix_with_other_natural_values():
    design = make_design("central_composite", PAPER_FACTORS, PAPER)
    validation = validation_design("central_composite", PAPER_FACTORS, PAPER)
    assert sorted(set(validation["w3_natural"])) == [35, 42, 49, 56, 63]
    np.testing.assert_allclose(validation["w3"], -0.1 + 0.7 * design["w3"])
    np.testing.assert_allclose(validation["w4"], 0.08 + 0.8 * design["w4"])
    np.testing.assert_allclose(validation["w5"], -0.6 + 0.6 * design["w5"])


def test_nominal_design_repeats_z0():
    design = nominal_design(PAPER_FACTORS, 3)
    np.testing.assert_array_equal(design[NAMES].to_numpy(), [[-2, -2, -2, 0, 0, 0]] * 3)
    assert list(design.iloc[0][["f_natural", "w3_natural", "w5_natural"]]) == [0, 50, 0]


def test_bad_designs_get_one_sentence(refuses):
    for kind, options in (
        ("composite", {}),
        ("latin_hypercube", {"alpha": 2}),
        ("central_composite", {"generators": ["w5 f w1"]}),
        ("central_composite", {"generators": {"w9": "f w1"}}),
        ("central_composite", {"generators": {"w5": "w4", "w4": "w3"}}),
        ("central_composite", {"generators": {"w5": "f w1 f"}}),
        ("central_composite", {"generators": {"w5": "-"}}),
        ("central_composite", {"star_level": 3}),
        ("inscribed", {"alpha": -1}),
        ("latin_hypercube", {"points": 1}),
    ):
        refuses(make_design, kind, PAPER_FACTORS, options)


def test_generators_are_read_in_every_notation():
    expected = {"w5": (1, ("f", "w1"))}
    for text in ("f w1", "f*w1", "f:w1", "+f w1"):
        assert read_generators({"w5": text}, NAMES) == expected
    assert read_generators(["w5 = -f w1"], NAMES) == {"w5": (-1, ("f", "w1"))}
