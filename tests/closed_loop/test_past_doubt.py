"""Where a joint last turned round has no name, and no name stands for it."""

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection import answer, generic


def turning(t, q, v, a, rng):
    """Six times the position at which the joint last turned round, which is much of the position."""
    turned = np.concatenate([[False], (v[1:, 0] > 0.0) != (v[:-1, 0] > 0.0)])
    last = np.maximum.accumulate(np.where(turned, np.arange(len(t)), 0))
    return np.column_stack([6.0 * q[last, 0], 0.0 * t])


@pytest.mark.parametrize(("runs", "seed"), [(4, 72), (3, 73)])
def test_what_follows_the_last_turn_is_given_no_name(record, monkeypatch, runs, seed):
    folder = record(extra_torque=turning, seed=seed, runs=runs, duration=12.0)
    # The doubt alone tells it.
    monkeypatch.setattr(answer, "find_dependence", lambda *_: {})
    verdict = diagnose(folder).verdict
    assert verdict["verdict"] == []
    assert verdict["joints"]["a"]["state"] == "unexplained"
    assert "q_a" in verdict["joints"]["a"]["unexplained_depends_on"]
    monkeypatch.setattr(generic, "doubt_for_past", lambda search, found: found)
    assert {e["joint"] for e in diagnose(folder).verdict["verdict"]} == {"a"}


def test_a_name_that_is_there_beside_it_stays(record):
    """A spring that is larger; a balancer is as much like it."""
    planted = [(0, "joint_spring", {"stiffness": 20.0, "preload": 0.0})]
    folder = record(planted, extra_torque=turning, seed=72, runs=4, duration=12.0)
    verdict = diagnose(folder).verdict
    (named,) = verdict["verdict"]
    assert named["joint"] == "a"
    assert named["effect"] in ("joint_spring", "gravity_counterbalance")
    assert verdict["joints"]["a"]["state"] == "unexplained"
