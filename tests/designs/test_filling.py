import numpy as np
import pytest

from wearscope.designs.checks import view_for_axis
from wearscope.designs.factors import PAPER_FACTORS
from wearscope.designs.kinds import (
    checking_design,
    filling_design,
    local_design,
    make_design,
    question_lines,
)

NAMES = [factor.name for factor in PAPER_FACTORS]
Z0 = [-2, -2, -2, 0, 0, 0]


def levels(design):
    return design[NAMES].to_numpy(dtype=float)


def test_filling_has_the_points_asked_for_and_its_replicates_at_the_end():
    design = filling_design(PAPER_FACTORS, points=20, question_points=5, replicates=4, seed=3)
    assert design["point"].tolist() == list(range(1, 20 + 15 + 4 + 1))
    z = levels(design)
    np.testing.assert_array_equal(z[-4:], z[:4])
    assert len(np.unique(z[:-4], axis=0)) == 35
    assert np.abs(z).max() <= 2


def test_z0_is_among_both_sets_and_nothing_else_is_shared():
    filling, checking = levels(filling_design(PAPER_FACTORS)), levels(checking_design(PAPER_FACTORS))
    for z in (filling, checking):
        assert (z == Z0).all(axis=1).sum() == 1
    shared = {tuple(row) for row in filling} & {tuple(row) for row in checking}
    assert shared == {tuple(map(float, Z0))}
    assert not shared & {tuple(row) for row in levels(make_design("latin_hypercube", PAPER_FACTORS))}


def test_questions_wear_one_axis_and_vary_one_nuisance():
    z = question_lines(PAPER_FACTORS, 8, ["w3", "w5"], [1, 2, 3], "filling", 0)
    assert len(z) == 24
    assert ((z[:, :3] != -2).sum(axis=1) <= 1).all()
    assert ((z[:, 3:] != 0).sum(axis=1) <= 1).all()
    assert (z[:, 4] == 0).all()
    unworn = (z[:, :3] == -2).all(axis=1)
    assert 0.2 < unworn.mean() < 0.4


def test_every_axis_sees_its_own_questions():
    design = filling_design(PAPER_FACTORS)
    for axis in (1, 2, 3):
        view = levels(view_for_axis(design, axis))
        asked = view[(view[:, 1] == -2) & (view[:, 2] == -2) & (view[:, 0] > -2)]
        assert len(asked) >= 5


def test_half_of_the_hypercube_is_drawn_towards_nominal():
    z = levels(filling_design(PAPER_FACTORS, points=200, question_points=0, replicates=0))
    away = np.abs(z[:, 3])
    # Uniform on 0..2 has the mean 1; its square over 2 has 2/3.
    assert away[0::2].mean() == pytest.approx(1.0, abs=0.1)
    assert away[1::2].mean() == pytest.approx(2 / 3, abs=0.1)


def test_a_costly_factor_takes_the_nearest_of_its_levels():
    """Of a uniform distribution over five levels: an eighth at either end, a quarter at each between."""
    (costly,) = [k for k, factor in enumerate(PAPER_FACTORS) if factor.is_costly]
    z = levels(filling_design(PAPER_FACTORS, points=800, question_points=0, replicates=0))[0::2, costly]
    found, counts = np.unique(z, return_counts=True)
    assert found.tolist() == [-2.0, -1.0, 0.0, 1.0, 2.0]
    np.testing.assert_allclose(counts / len(z), [0.125, 0.25, 0.25, 0.25, 0.125], atol=0.03)


def test_designs_depend_on_the_seed_alone_and_zero_is_one():
    one, two = (levels(filling_design(PAPER_FACTORS, seed=seed)) for seed in (0, 1))
    np.testing.assert_array_equal(one, levels(filling_design(PAPER_FACTORS, seed=0)))
    assert (one[:36] != two[:36]).any()


def test_what_cannot_be_made_is_refused(refuses):
    refuses(filling_design, PAPER_FACTORS, points=5, replicates=7)
    refuses(checking_design, PAPER_FACTORS, questions=["f"])


def test_local_points_stay_about_the_centre_and_some_come_twice(refuses):
    z = levels(local_design(PAPER_FACTORS, 12, 4, 0.75, seed=1))
    assert len(z) == 16 and np.abs(z).max() <= 0.75
    np.testing.assert_array_equal(z[-4:], z[:4])
    assert len(np.unique(z, axis=0)) == 12
    for k in range(len(NAMES)):  # a Latin hypercube: one point in each twelfth of the range
        assert np.sort(np.floor((z[:12, k] + 0.75) / 0.125)).tolist() == list(range(12))
    refuses(local_design, PAPER_FACTORS, 12, 13, 0.75)


def test_each_point_may_be_made_once_more():
    for design in (
        filling_design(PAPER_FACTORS, points=5, question_points=0, replicates=5),
        local_design(PAPER_FACTORS, 5, 5, 1.0),
    ):
        np.testing.assert_array_equal(levels(design)[5:], levels(design)[:5])
