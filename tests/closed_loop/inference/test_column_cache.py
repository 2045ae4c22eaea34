"""Columns of the generic term that find no memory are made again, the same bits; memory is given back."""

import gc

import numpy as np

from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.score import Score
from wearscope.closed_loop.inference.splines import Splines
from wearscope.closed_loop.model.column_cache import CachedColumns, ColumnCache


def test_what_comes_first_stays_and_gives_its_room_back():
    made = []

    def make(k):
        made.append(k)
        return np.full((10, 1), float(k))

    cache = ColumnCache(100)
    one, two, three = (CachedColumns(cache, lambda k=k: make(k)) for k in range(3))
    assert one[0][0, 0] == 0.0
    assert cache.left == 20
    for rows in (two, two, three, two, one):
        assert len(rows) == 1
        rows[0]
    # The first stays; of the others the last one does.
    assert made == [0, 1, 2, 1]
    del one, rows
    gc.collect()
    assert cache.left == 100


def test_another_owner_never_gets_the_rows_of_one_that_is_gone():
    cache = ColumnCache(0)
    for k in range(200):
        assert CachedColumns(cache, lambda k=k: np.full((3, 1), float(k)))[0][0, 0] == k


def test_splines_do_not_depend_on_the_room(record, pose, declared_model):
    def bend(t, q, v, a, rng):
        return 6.0 * np.sin(3.0 * q)

    model = declared_model(pose(record(extra_torque=bend, seed=5, runs=4, duration=4.0)))
    problem = model.problem
    score = Score(Policy(), problem.gram.layout)
    found = []
    for size in (0, 2**20, 2**30):
        splines = Splines(problem.prepared, problem.joined, cache=size)
        found.append([list(splines.list_terms(model, 0, score)) for _ in range(2)][-1])
    assert len(found[0]) > 5
    for other in found[1:]:
        for a, b in zip(found[0], other, strict=True):
            assert a.key == b.key
            np.testing.assert_array_equal(a.candidate.rows[0], b.candidate.rows[0])
