"""Blocks that remember each other turn their signs together."""

import numpy as np

from wearscope.closed_loop.selection.evidence import adjust_p_values, find_memory, flip_blocks, join_blocks

RUN = np.repeat(np.arange(4), 24)


def test_white_blocks_turn_alone_and_a_walk_turns_whole_runs():
    rng = np.random.default_rng(1)
    white = [find_memory(rng.standard_normal(96), RUN) for _ in range(50)]
    walks = [find_memory(np.cumsum(rng.standard_normal((4, 24)), axis=1).ravel(), RUN) for _ in range(50)]
    assert np.mean(np.array(white) == 1) > 0.9
    assert np.mean(np.array(walks) == 24) > 0.9


def test_groups_stay_within_their_run():
    groups = join_blocks(RUN, 5)
    assert (RUN[groups] == RUN).all()
    assert np.bincount(groups).max() == 5
    assert len(np.unique(join_blocks(RUN, 24))) == 4


def test_four_groups_never_look_significant():
    rng = np.random.default_rng(2)
    scores = 1.0 + 0.01 * rng.standard_normal((96, 1, 1))
    flips = rng.choice([-1.0, 1.0], (999, 96))
    gain, turned = flip_blocks(scores, np.ones((1, 1, 1)), flips[:, join_blocks(RUN, 24)])
    assert np.mean(turned >= (1 - 1e-6) * gain) > 0.08
    alone, loose = flip_blocks(scores, np.ones((1, 1, 1)), flips)
    assert alone == gain
    assert not (loose >= (1 - 1e-6) * alone).any()


def test_the_observed_signs_count_among_the_random_ones():
    class One:
        odds = 5.0 / 3.0
        flips = np.where(np.arange(999) % 8 == 0, (1 - 1e-12) * 5.0 / 3.0, 0.1)
        p_block = np.nan

    one = One()
    adjust_p_values([one])
    assert 0.12 < one.p_block < 0.13
