"""A delay is the same wherever the joint moves: what lags at reversals only is not called one."""

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection.layout import Layout
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search

DELAY = 0.012


def lag(everywhere):
    """What lags in the first joint's record, as a torque: everywhere, or in its slowest fifth alone."""

    def torque(t, q, v, a, rng):
        late = 8.0 * (np.sin(1.9 * (t - DELAY)) - np.sin(1.9 * t)) + 9.0 * (
            np.interp(t - DELAY, t, np.sign(v[:, 0])) - np.sign(v[:, 0])
        )
        slow = np.abs(v[:, 0]) < 0.2 * np.abs(v[:, 0]).max()
        return np.column_stack([late if everywhere else late * slow, 0.0 * t])

    return torque


def test_what_counts_is_restricted_at_one_joint_alone(record, pose):
    problem = pose(record())
    layout = Layout.of(problem.prepared)
    rows = np.arange(len(layout.keep)) % 2 == 0
    other = layout.restrict(0, rows)
    np.testing.assert_array_equal(other.keep[:, 0], layout.keep[:, 0] & rows)
    np.testing.assert_array_equal(other.keep[:, 1], layout.keep[:, 1])
    assert layout.keep[:, 0].sum() > other.keep[:, 0].sum()


@pytest.mark.parametrize("delay", [0.004, 0.012])
def test_a_true_delay_is_named(record, delay):
    verdict = diagnose(record(planted=[(0, "time_delay", {"delay": delay})], seed=4)).verdict["verdict"]
    assert [(e["joint"], e["effect"]) for e in verdict] == [("a", "time_delay")]
    low, high = verdict[0]["parameters"]["delay"]["ci95"]
    assert low <= delay <= high


def test_what_lags_at_reversals_only_is_no_delay(record, pose):
    problem = pose(record(extra_torque=lag(everywhere=False), seed=4))
    search = Search(problem, Policy())
    assembly = search.assemble(())
    (offered,) = [c for c in search.candidates(assembly, (), [0]) if c.effect.name == "time_delay"]
    e = max(search.weigh_all(assembly, [offered]), key=lambda e: e.gain)
    assert e.share > Policy().material_share
    assert search.is_of_reversals(assembly, e)
    assert "time_delay" not in {f.effect.name for f in search.run()}
