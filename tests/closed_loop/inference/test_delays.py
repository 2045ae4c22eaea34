"""A delay is one time wherever the joint moves, and at all frequencies: what is not is not called one."""

import numpy as np
import pytest

from benchmarks.board.regimes import list_cases
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.inference.answer import find_terms
from wearscope.closed_loop.inference.delays import fit_below, lags_away_from_reversals, lags_slow_torque
from wearscope.closed_loop.inference.extensions import list_extensions
from wearscope.closed_loop.inference.layout import Layout
from wearscope.closed_loop.inference.policy import Policy

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
    planted = [(0, "time_delay", {"delay": delay})]
    verdict = diagnose(record(planted, seed=4, runs=3, duration=8.0)).verdict["verdict"]
    assert [(e["joint"], e["effect"]) for e in verdict] == [("a", "time_delay")]
    low, high = verdict[0]["parameters"]["delay"]["ci95"]
    assert low <= delay <= high


def extend_by_delay(model, joint):
    """The delay of a joint's torque that a model may be extended by."""
    (extension,) = list_extensions(model, [joint], lambda effect, _: effect.name == "time_delay")
    return extension.term


def explain(model, term):
    """Share of a joint's held-out loss that a term removes."""
    made = model.extend(term)
    return 1.0 - made.fit.held_out[term.joint] / model.fit.held_out[term.joint]


def test_what_lags_at_reversals_only_is_no_delay(record, pose, declared_model):
    model = declared_model(pose(record(extra_torque=lag(everywhere=False), seed=4)))
    term = extend_by_delay(model, 0)
    assert explain(model, term) > 0.06
    assert not lags_away_from_reversals(model.fit, term, model.problem.at_rows("v")[:, 0])


def test_what_lags_at_reversals_only_is_not_called_a_delay_for_being_simpler(record, pose):
    """What else explains it has a parameter more, and held-out runs do not tell the two apart."""
    found = find_terms(pose(record(extra_torque=lag(everywhere=False), seed=1, runs=3)), Policy()).found
    assert found[0].term.effect.name == "presliding_hysteresis"
    names = {name for f in found for name in (f.term.effect.name, *f.equivalent)}
    assert "time_delay" not in names


def test_what_a_position_loop_answers_is_no_delay(record, pose, declared_model):
    """The joint moves with the noise of its torque, most near the loop's own frequency."""
    model = declared_model(pose(record(disturbance=4.0, seed=2)))
    for joint in (0, 1):
        term = extend_by_delay(model, joint)
        assert explain(model, term) > 0.4
        assert lags_away_from_reversals(model.fit, term, model.problem.at_rows("v")[:, joint])
        assert not lags_slow_torque(model.fit, term)


def test_what_a_position_loop_answers_is_not_named_a_delay(record, name_terms):
    assert "time_delay" not in {name for name, _ in name_terms(record(disturbance=4.0, seed=2, runs=3))}


@pytest.mark.slow
def test_a_true_delay_is_one_in_a_position_loop_too(record, pose, declared_model, name_terms):
    folder = record(planted=[(0, "time_delay", {"delay": DELAY})], disturbance=0.3, seed=2)
    model = declared_model(pose(folder))
    term = extend_by_delay(model, 0)
    beta, error = fit_below(model.fit, term, 0.25 * model.problem.prepared.band.torque)
    assert abs(beta - DELAY) < 3.0 * error
    assert error < 0.2 * DELAY
    assert lags_slow_torque(model.fit, term)
    assert ("time_delay", 0) in name_terms(folder)


def test_what_a_refused_name_would_remove_is_said(record, pose):
    answer = find_terms(pose(record([(0, "time_delay", {"delay": DELAY})], seed=1)), Policy())
    (term,) = answer.model.terms
    bare = answer.without([term], "it is refused")
    assert not bare.model.terms and "time delay would remove" in bare.suspected[0]
    rows = bare.candidates.query("effect == 'time_delay' and step == 1 and not taken")
    assert "it is refused" in set(rows["reason"])


@pytest.mark.slow
def test_a_delay_is_found_where_a_law_that_explains_more_may_have_no_level(tmp_path):
    """The joint hardly reverses: the law's level may be zero, and a delay of 4 ms is named instead."""
    list_cases("development", 200, 301)[79].make(tmp_path / "d")
    verdict = diagnose(tmp_path / "d").verdict
    (entry,) = (one for one in verdict["verdict"] if one["joint"] == "j5")
    low, high = entry["parameters"]["delay"]["ci95"]
    assert entry["effect"] == "time_delay" and low < 0.004 < high
