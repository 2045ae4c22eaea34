"""p-values under known nulls: uniform, of the stated family-wise rate; blocks that are autocorrelated."""

import numpy as np
import pytest
from scipy import stats

from wearscope.closed_loop.selection.significance import (
    adjust,
    find_memory,
    flip_scores,
    join_blocks,
    make_flips,
    score_chance,
)

RUN = np.repeat(np.arange(4), 24)
BLOCKS = 60


def family_of(rng, flips, candidates=6, shapes=3, blocks=BLOCKS):
    """Family-wise p-values of candidates on a residual that none of them has made."""
    observed, chance = [], []
    for k in range(candidates):
        m = 1 + k % 2
        x = rng.standard_normal((blocks, 12, shapes, m))
        y = rng.standard_normal((blocks, 12))
        scores = np.einsum("brsm,br->bsm", x, y)
        inner = np.einsum("brsm,brsn->smn", x, x)
        found, flipped = flip_scores(scores, inner, flips)
        observed.append(float(score_chance(np.asarray(found), flipped)))
        chance.append(score_chance(flipped, flipped))
    return adjust(observed, chance, [1.0] * candidates)


@pytest.fixture(scope="module")
def smallest():
    """Smallest family-wise p-value of each of 200 simulated nulls."""
    flips = make_flips(199, BLOCKS, 0)
    return np.array([family_of(np.random.default_rng([5, k]), flips).min() for k in range(200)])


def test_the_smallest_of_a_family_is_uniform_where_nothing_is_there(smallest):
    assert stats.kstest(smallest, "uniform").pvalue > 0.01


@pytest.mark.parametrize("level", [0.01, 0.05, 0.2])
def test_the_rate_of_false_names_is_the_stated_one(smallest, level):
    hits = int(np.sum(smallest <= level))
    low, high = stats.binom.interval(0.998, len(smallest), level)
    assert low <= hits <= high


def test_one_candidate_alone_has_a_uniform_p_value():
    flips = make_flips(199, BLOCKS, 1)
    p = [family_of(np.random.default_rng([6, k]), flips, candidates=1, shapes=1)[0] for k in range(200)]
    assert stats.kstest(p, "uniform").pvalue > 0.01


def test_shapes_searched_elsewhere_count_too():
    """Bonferroni for what random signs did not go through."""
    rng = np.random.default_rng(2)
    chance = [rng.standard_normal(999)]
    alone, searched = adjust([3.0], chance, [1.0])[0], adjust([3.0], chance, [100.0])[0]
    assert alone < 0.01 < 0.05 < searched <= 100.0 * alone
    assert adjust([], [], []).shape == (0,)


def test_a_planted_effect_is_significant_and_more_candidates_make_it_less_so():
    rng = np.random.default_rng(3)
    chance = [rng.standard_normal(999) for _ in range(50)]
    p = adjust([2.5] * 50, chance, [1.0] * 50)
    assert np.ptp(p) == 0.0
    assert adjust([2.5], chance[:1], [1.0])[0] < 0.05 < p[0]
    assert adjust([9.0], chance[:1], [1.0])[0] == 1.0 / 1000.0


def test_the_statistic_is_the_largest_reduction_of_the_loss():
    """Against least squares: the loss removed by one column and by two, the better shape counting."""
    rng = np.random.default_rng(4)
    x, y = rng.standard_normal((40, 5, 2, 2)), rng.standard_normal((40, 5))
    removed = []
    for s in range(2):
        a = x[:, :, s].reshape(-1, 2)
        left = y.ravel() - a @ np.linalg.lstsq(a, y.ravel(), rcond=None)[0]
        removed.append(np.sum(y**2) - np.sum(left**2))
    flips = make_flips(5, 40, 2)
    scores, inner = np.einsum("brsm,br->bsm", x, y), np.einsum("brsm,brsn->smn", x, x)
    observed, chance = flip_scores(scores, inner, flips)
    assert observed == pytest.approx(max(removed))
    turned = np.einsum("brsm,br->bsm", x, y * flips[3][:, None])
    assert chance[3] == pytest.approx(flip_scores(turned, inner, flips)[0])


def test_normal_scores_of_a_gamma_law_are_normal():
    chance = stats.gamma(1.7, scale=3.0).rvs(20000, random_state=5)
    scores = score_chance(chance, chance)
    assert np.mean(scores) == pytest.approx(0.0, abs=0.03)
    assert np.std(scores) == pytest.approx(1.0, abs=0.03)
    assert np.mean(scores > 1.645) == pytest.approx(0.05, abs=0.007)
    assert (np.diff(score_chance(np.sort(chance), chance)) >= 0.0).all()


def test_signs_depend_on_the_seed_alone():
    one = make_flips(99, 30, 0)
    np.testing.assert_array_equal(one, make_flips(99, 30, 0))
    assert (one != make_flips(99, 30, 1)).any()
    assert set(np.unique(one)) == {-1.0, 1.0} and abs(one.mean()) < 0.1


def test_white_blocks_are_independent_and_a_walk_fills_whole_runs():
    rng = np.random.default_rng(1)
    white = [find_memory(rng.standard_normal(96), RUN) for _ in range(50)]
    walks = [find_memory(np.cumsum(rng.standard_normal((4, 24)), axis=1).ravel(), RUN) for _ in range(50)]
    assert np.mean(np.array(white) == 1) > 0.9
    assert np.mean(np.array(walks) == 24) > 0.9
    assert find_memory(np.zeros(96), RUN) == 1


@pytest.mark.parametrize(("persistence", "length"), [(0.4, 3), (0.6, 7)])
def test_the_memory_of_a_first_order_autoregression_is_where_it_falls_below_a_fifth(persistence, length):
    """0.4^2 < 0.2 <= 0.4: one lag; 0.6^3 > 0.2 >= 0.6^4: three lags, twice as many blocks but one."""
    run = np.repeat(np.arange(2), 4000)
    x = np.zeros((2, 4000))
    rng = np.random.default_rng(7)
    for i in range(4000):
        x[:, i] = persistence * x[:, i - 1] + rng.standard_normal(2)
    assert find_memory(x.ravel(), run) == length


def test_groups_stay_within_their_run():
    groups = join_blocks(RUN, 5)
    assert (RUN[groups] == RUN).all()
    assert np.bincount(groups).max() == 5
    assert len(np.unique(join_blocks(RUN, 24))) == 4
    assert join_blocks(RUN, 1).tolist() == list(range(96))


def test_four_groups_never_look_significant():
    scores = 1.0 + 0.01 * np.random.default_rng(2).standard_normal((96, 1, 1))
    flips = make_flips(999, 96, 2)
    gain, turned = flip_scores(scores, np.ones((1, 1, 1)), flips[:, join_blocks(RUN, 24)])
    assert np.mean(turned >= (1 - 1e-6) * gain) > 0.08
    alone, loose = flip_scores(scores, np.ones((1, 1, 1)), flips)
    assert alone == gain
    assert not (loose >= (1 - 1e-6) * alone).any()


def test_the_observed_signs_count_among_the_random_ones():
    """Few groups give the observed signs again, but for rounding: that is no evidence."""
    chance = np.where(np.arange(999) % 8 == 0, 2.0 - 1e-12, -1.0)
    assert 0.12 < adjust([2.0], [chance], [1.0])[0] < 0.13


def test_a_score_is_wilson_and_hilferty_s_by_hand():
    """Of mean 3 and variance 1 a ninth of the squared variation is 1/81, the score 9 (cbrt(x/3) - 80/81)."""
    chance = np.array([2.0, 4.0])
    scores = score_chance(np.array([3.0, 24.0, 0.0, -5.0]), chance)
    np.testing.assert_allclose(scores, [1.0 / 9.0, 9.0 + 1.0 / 9.0, -80.0 / 9.0, -80.0 / 9.0])


def test_what_was_tried_beyond_chance_is_paid_for_and_the_observed_signs_count():
    """Of 1 in 40 two tries make 1 in 20, a score of 1.645; the highest of the family's under each sign."""
    one, other = np.array([0.0, 1.64, 1.65, 3.0]), np.array([1.0, -2.0, 0.0, 1.0])
    z = stats.norm.isf(1.0 / 40.0)
    assert adjust([z, z], [one, other], [2.0, 1.0]).tolist() == [3.0 / 5.0, 2.0 / 5.0]
    # The highest of each pattern: 1, 1.64, 1.65, 3.
    assert adjust([1.1, 0.9, 3.1], [one, other], [1.0, 1.0, 1.0]).tolist() == [
        4.0 / 5.0,
        5.0 / 5.0,
        1.0 / 5.0,
    ]
    # More tries than a probability can hold leave none.
    assert adjust([z], [one], [1e6]).tolist() == [1.0]
    assert len(adjust([], [], [])) == 0


@pytest.mark.parametrize(
    ("counts", "width", "length"),
    [
        # Signs that turn after three blocks resemble the next one by a third and the one after by less than
        # nothing: three blocks, where six times as many are a run; else whole runs, the longest.
        ((18, 30), 3, 3),
        ((17, 30), 3, 30),
        # Five turns in 60 blocks leave (60 - 11 l)/(60 - l) at lag l, less than a fifth from five on: nine.
        ((60, 60), 10, 9),
        ((40, 60), 10, 60),
        # After two, or each on its own: nothing.
        ((24, 24), 2, 1),
        ((1, 1, 1), 1, 1),
        ((2, 2), 1, 1),
    ],
)
def test_the_memory_of_signs_that_turn_every_so_often_is_known(counts, width, length):
    run = np.repeat(np.arange(len(counts)), counts)
    left = np.concatenate([(-1.0) ** (np.arange(count) // width) for count in counts])
    for scale in (1.0, 1e-3, 1e3):
        assert find_memory(scale * left, run, 0.21) == length


def test_groups_are_counted_from_the_start_of_each_run():
    run = np.array([0, 0, 0, 0, 0, 1, 1, 1])
    assert join_blocks(run, 2).tolist() == [0, 0, 2, 2, 4, 5, 5, 7]
    assert join_blocks(run, 3).tolist() == [0, 0, 0, 3, 3, 5, 5, 5]
