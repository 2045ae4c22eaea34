"""A delay is one time wherever the joint moves, and at all frequencies: what is not is not called one."""

import numpy as np
import pytest

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection.answer import find_named
from wearscope.closed_loop.selection.delays import fit_below, lags_away_from_reversals, lags_slow_torque
from wearscope.closed_loop.selection.layout import Layout
from wearscope.closed_loop.selection.naming import name_terms
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
    assert not search.is_delay(assembly, e)


def test_what_lags_at_reversals_only_is_not_called_a_delay_for_being_simpler(record, pose):
    """What else explains it has a parameter more, and held-out runs do not tell the two apart."""
    search = Search(pose(record(extra_torque=lag(everywhere=False), seed=1)), Policy())
    found = find_named(search)
    named, others = name_terms(search, found)
    assert named[0].effect.name == "presliding_hysteresis"
    assert "time_delay" not in {name for names in others for name in names} | {f.effect.name for f in named}


def test_what_a_position_loop_answers_is_no_delay(record, pose):
    """The joint moves with the noise of its torque, most near the loop's own frequency."""
    problem = pose(record(disturbance=4.0, seed=2))
    search = Search(problem, Policy())
    assembly = search.assemble(())
    offered = [c for c in search.candidates(assembly, (), [0, 1]) if c.effect.name == "time_delay"]
    for candidate in offered:
        e = max(search.weigh_all(assembly, [candidate]), key=lambda e: e.gain)
        assert e.share > 0.4
        assert lags_away_from_reversals(assembly, e, problem.at_rows("v")[:, e.joint], search.policy)
        assert not lags_slow_torque(assembly, e, search.policy)
        assert search.is_delay(assembly, e)
        assert not search.is_delay(assembly, e, settled=True)
        assert not search.is_delay(assembly, e)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{"extra_torque": lag(everywhere=False), "seed": 4}, {"disturbance": 4.0, "seed": 2}]
)
def test_what_is_no_delay_is_not_named_one(record, pose, options):
    search = Search(pose(record(**options)), Policy())
    assert "time_delay" not in {f.effect.name for f in find_named(search)}


@pytest.mark.slow
def test_a_true_delay_is_one_in_a_position_loop_too(record, pose):
    problem = pose(record(planted=[(0, "time_delay", {"delay": DELAY})], disturbance=0.3, seed=2))
    search = Search(problem, Policy())
    assembly = search.assemble(())
    (offered,) = [c for c in search.candidates(assembly, (), [0]) if c.effect.name == "time_delay"]
    e = max(search.weigh_all(assembly, [offered]), key=lambda e: e.gain)
    beta, error = fit_below(assembly, e, Policy().slow * problem.prepared.band.torque)
    assert abs(beta - DELAY) < 3.0 * error
    assert error < 0.2 * DELAY
    assert search.is_delay(assembly, e, settled=True)
    assert ("time_delay", 0) in {(f.effect.name, f.joint) for f in find_named(search)}
