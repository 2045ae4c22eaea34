"""Two large effects of a joint of which each hides the other are found together; a drift is no pair."""

import numpy as np
import pytest

from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search


@pytest.mark.parametrize(("slope", "weight"), [(8.0, 6.0), (40.0, 30.0)])
def test_two_effects_that_hide_each_other_are_found_at_any_size(record, pose, slope, weight):
    """Along two recordings each alone looks like a drift, or like what they disagree on."""
    planted = [
        (0, "viscous_asymmetry", {"half_difference": slope}),
        (0, "gravity_counterbalance", {"sine1": weight, "cosine1": 0.6 * weight}),
    ]
    search = Search(pose(record(planted, seed=1, runs=3)), Policy())
    found = {(f.effect.name, f.joint) for f in find_named(search)}
    assert found == {("viscous_asymmetry", 0), ("gravity_counterbalance", 0)}


@pytest.mark.parametrize("seed", [4, 5])
def test_a_drift_is_no_pair_of_effects(record, pose, seed):
    """A random walk, in which any two slow terms find something."""

    def walk(t, q, v, a, rng):
        steps = rng.standard_normal(q.shape) * np.sqrt(t[1] - t[0])
        return 12.0 * np.cumsum(steps, axis=0)

    search = Search(pose(record(seed=seed, runs=3, extra_torque=walk)), Policy())
    assert find_named(search) == []
