"""Where a joint last turned round has no name, and no name represents it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection import answer, generic
from wearscope.closed_loop.selection.evidence import Found, weigh
from wearscope.closed_loop.selection.past_doubt import doubt_for_past
from wearscope.closed_loop.selection.policy import Policy
from wearscope.closed_loop.selection.search import Search
from wearscope.effects.base import load_effect


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
    assert "q_a" in verdict["joints"]["a"]["depends_on"]
    monkeypatch.setattr(generic, "doubt_for_past", lambda search, found: (found, {}))
    assert diagnose(folder).verdict["verdict"]


def test_a_name_that_is_there_beside_it_stays(record):
    """A spring that is larger; a balancer is as much like it."""
    planted = [(0, "joint_spring", {"stiffness": 20.0, "preload": 0.0})]
    folder = record(planted, extra_torque=turning, seed=72, runs=4, duration=12.0)
    verdict = diagnose(folder).verdict
    (named,) = verdict["verdict"]
    assert named["joint"] == "a"
    assert named["effect"] in ("joint_spring", "gravity_counterbalance")
    assert verdict["joints"]["a"]["state"] == "unexplained"


def remembered(t, q, v, a, rng):
    """A fine wave of the direction of motion of the last three tenths of a second."""
    keep = np.exp(-(t[1] - t[0]) / 0.3)
    past = lfilter([1.0 - keep], [1.0, -keep], np.sign(v[:, 0]))
    return np.column_stack([3.0 * np.cos(4.0 * np.pi * past), 0.0 * t])


@pytest.mark.parametrize(
    ("name", "subset", "fine"), [("torque_ripple", (0, 1), True), ("stribeck", (0,), False)]
)
def test_names_of_the_position_alone_are_asked_beside_a_fine_past(record, pose, name, subset, fine):
    """A fine one of a short memory would be any law of friction, and take its name away."""
    folder = record(extra_torque=remembered, noise=0.3, seed=70, runs=4, duration=12.0)
    search = Search(pose(folder), Policy())
    search.sigma = search.scale([])
    beside = search.assemble([])
    offered = search.candidates(beside, [], [0])
    candidate = next(c for c in offered if c.effect is load_effect(name))
    own = weigh(beside, candidate, subset, search.policy)
    assert own.share < 0.1
    kept, depends = doubt_for_past(search, [Found(own.chosen, own)])
    assert kept == []
    assert (depends[0].share > 0.8) == fine
    assert (depends[0].share < 0.5) == (not fine)
