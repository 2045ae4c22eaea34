"""Splines of fewer hat functions from the products of the finest one."""

import numpy as np

from wearscope.closed_loop.selection.generic import GenericTerms, _coarsen, _evaluate, _scale, list_levels
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search


def test_products_of_a_coarser_spline_are_those_of_its_own_columns(record, pose):
    search = Search(pose(record(seed=5, runs=2, duration=8.0)), Policy())
    terms, assembly = GenericTerms(search.problem.prepared, search.problem.joined), search.assemble([])
    finest = next(c for c in terms.roughly(0) if len(list_levels(c.shapes[0])) > 1)
    sums = assembly.sum_products(finest)
    for level in list_levels(finest.shapes[0]):
        shape = np.array([*finest.shapes[0][:-1], level])
        own = terms._wrap(0, shape, [_evaluate(terms.effect, terms.thinned, 0, shape)])
        made, expected = _coarsen(sums, finest, level, 0.5), assembly.sum_products(_scale(own, 0.5))
        for name in ("cross", "gram", "score", "penalty"):
            np.testing.assert_allclose(
                getattr(made, name), getattr(expected, name), rtol=1e-6, atol=1e-6, err_msg=name
            )
