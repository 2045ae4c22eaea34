"""Short pushes are found: run, joint, moment, length and size; noise and friction are none."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from folders import fit_problem, read_prepared
from recorded_chain import Bench, torque_of

from wearscope.closed_loop.diagnosis import diagnose, explains_as_well
from wearscope.closed_loop.intake.filtering import Band, low_pass, rows
from wearscope.closed_loop.model.blocks import Block
from wearscope.closed_loop.model.events import (
    _describe,
    _find_stretches,
    _may_be_form,
    find_events,
    leave_out,
    suggest_thresholds,
    take_out_common,
)
from wearscope.closed_loop.model.prediction import predict_runs
from wearscope.detection.recordings import bridge_events


def push(at, size, width):
    def torque(t, q, v, a, rng):
        out = np.zeros_like(q)
        out[:, 0] = size * np.exp(-(((t - at) / width) ** 4))
        return out

    return torque


@pytest.fixture
def look(record, pose):
    def found(named=None, start=0.0, **options):
        problem = pose(record(runs=3, duration=8.0, **options))
        model = fit_problem(problem)
        predicted = predict_runs(problem.prepared, model, model)
        runs = [replace(p.run, start=start) for p in predicted]
        left = [p.run.measured - p.after for p in predicted]
        p, joints = problem.prepared, problem.prepared.dataset.joints
        added = None
        if named is not None:
            added = [named(run.t, np.zeros_like(run.measured), None, None, None) for run in runs]
            left = [x - y for x, y in zip(left, added, strict=True)]
        events = find_events(runs, left, joints, p.moving, p.top_speed, added)
        calm = leave_out(runs, events, joints)
        fewer = {run.file for run, one in zip(runs, calm, strict=True) if run.keep.sum() > one.keep.sum()}
        assert fewer == {e["run"] for e in events}
        return events, suggest_thresholds(runs, left, events, joints)

    return found


@pytest.mark.parametrize(("at", "size", "width"), [(3.0, 25.0, 0.15), (5.2, -12.0, 0.25)])
def test_a_push_in_every_run_is_found_where_it_is(look, at, size, width):
    """On the clock of a recording that does not begin at zero."""
    events, thresholds = look(extra_torque=push(at, size, width), seed=21, start=40.0)
    at += 40.0
    assert {e["joint"] for e in events} == {"a"} and len({e["run"] for e in events}) == len(events) >= 2
    for e in events:
        assert e["t"] < at < e["t"] + e["seconds"] and e["seconds"] < 4 * width + 0.2
        assert e["seen"][0] <= e["t"] and e["t"] + e["seconds"] <= e["seen"][1]
        assert e["size"] == pytest.approx(size, rel=0.3)
    # A push of that size is seen by a detector with the threshold.
    assert thresholds["a"]["threshold"] < 0.7 * abs(size)


@pytest.mark.parametrize(
    ("bumps", "found"),
    [
        ([(3.0, 0.1), (3.8, 0.1)], [3.0, 3.8]),
        ([(3.0, 0.1)], [3.0]),
        ([(3.0, 0.1), (3.8, 0.1), (4.6, 0.1)], [3.0, 3.8, 4.6]),
        # What is loud for longer than an event is structure, also next to a push.
        ([(4.0, 0.9)], []),
        ([(2.0, 0.1), (4.0, 0.9)], []),
    ],
)
def test_pushes_that_a_filter_s_ringing_joins_are_told_apart(bumps, found):
    band = Band(rate=100.0, motion=25.0, torque=25.0)
    t = np.arange(8.0, step=0.01)
    at = t[rows(band, len(t))]
    size = sum(400.0 * np.exp(-(((at - middle) / width) ** 4)) for middle, width in bumps)
    size += 10.0 * (np.abs(at - 3.5) < 1.6)
    run = SimpleNamespace(band=band, t=at, signals=SimpleNamespace(t=t, v=np.ones((len(t), 1))))
    stretches = _find_stretches(run, size, 0, 1.0)
    assert len(stretches) == len(found)
    for part, middle in zip(stretches, found, strict=True):
        assert at[part.start] < middle < at[part.stop - 1]
    assert all(one.stop <= other.start for one, other in pairwise(stretches))


@pytest.mark.parametrize(("middle", "width"), [(4.0, 0.1), (4.0, 0.5), (0.25, 0.5), (7.75, 0.5)])
def test_an_event_lasts_as_long_as_its_torque_is_large_not_as_long_as_the_filter_rings(middle, width):
    t = np.arange(8.0, step=0.01)
    push = -9.0 * low_pass((np.abs(t - middle) < width / 2).astype(float), 4.0, 100.0)
    event = _describe(t, push)
    assert event["seen"] == [t[0], t[-1]] and event["size"] == pytest.approx(push.min())
    assert event["t"] == pytest.approx(max(middle - width / 2, 0.0), abs=0.1)
    assert event["t"] + event["seconds"] == pytest.approx(min(middle + width / 2, t[-1]), abs=0.1)


@pytest.mark.parametrize(("step", "hidden"), [(30.0, True), (3.0, False)])
def test_a_step_of_a_named_effect_at_another_moment_is_no_event(look, step, hidden):
    """As a lost motion that is crossed a little earlier; a smaller step hides no push."""
    made = push(3.0, 25.0, 0.15)
    events, _ = look(extra_torque=made, seed=21, named=push(3.2, step, 0.15))
    assert {e["joint"] for e in events} == (set() if hidden else {"a"})


def test_what_is_small_against_the_joint_s_torque_is_no_event(look):
    events, _ = look(extra_torque=push(3.0, 0.5, 0.15), seed=21, noise=0.01)
    assert events == []


@pytest.mark.parametrize(
    ("at", "torque", "size", "may_be"),
    [
        (4.0, 10.0, 0.2, True),
        (4.0, 10.0, 0.5, False),
        (4.0, 1.0, 0.2, False),
        (0.0, 1.0, 9.0, True),
        (8.0, 1.0, 9.0, True),
    ],
)
def test_what_a_model_may_miss_in_a_fast_move_or_at_an_end_is_no_event(at, torque, size, may_be):
    """A move of a quarter of a second has large torques, of which a small share stands out of all noise."""
    t = np.arange(8.0, step=0.05)
    left = size * np.exp(-(((t - at) / 0.1) ** 2))
    given = torque * np.exp(-(((t - at - 0.2) / 0.1) ** 2))
    run = SimpleNamespace(t=t, measured=(given + left)[:, None], band=SimpleNamespace(torque=5.0))
    part = np.flatnonzero(left > 0.3 * size)
    assert _may_be_form(run, left, slice(part[0], part[-1] + 1), 0) is may_be


@pytest.mark.parametrize(("grown", "better"), [(0.9, True), (1.0, True), (1.1, False)])
def test_rows_are_left_out_only_where_the_rest_is_explained_as_well(grown, better):
    """Rows of an event count for neither, test runs neither; a joint that does not move has no error."""
    rng = np.random.default_rng(3)
    left = rng.normal(size=(50, 3)) * [1.0, 20.0, 0.0]
    keep = np.ones(left.shape, dtype=bool)
    keep[:5] = False
    run = SimpleNamespace(measured=0.0 * left, keep=keep, use="train")
    test = SimpleNamespace(measured=0.0 * left, keep=keep, use="test")
    blocks = [Block(0, k, k + 5) for k in range(0, 50, 5)]
    more = np.where(keep, left * [grown, 1.0, 1.0], 100.0)
    first, again = (
        SimpleNamespace(
            problem=SimpleNamespace(layout=SimpleNamespace(blocks=blocks)),
            predicted=[SimpleNamespace(run=test, after=5.0 * left), SimpleNamespace(run=run, after=after)],
        )
        for after in (left, more)
    )
    assert explains_as_well(first, again) is better


def test_what_runs_of_one_motion_have_in_common_hides_no_push():
    """Two runs of a motion say nothing of each other; a row that does not count says nothing to others."""
    common = np.sin(np.arange(40.0))[:, None]
    pushed = np.zeros((40, 1))
    pushed[20:23] = 5.0
    left = [common, common[:38] + pushed[:38], common.copy(), common + pushed, common.copy()]
    left[2][7] = 99.0
    keep = [np.ones(x.shape, dtype=bool) for x in left]
    keep[2][7] = False
    runs = [SimpleNamespace(keep=k) for k in keep]
    out = take_out_common(runs, left, [(0, 1), (0, 2), (1, 2), (3, 4)])
    assert out[0][7] == common[7]
    np.testing.assert_allclose(np.delete(out[0][:38], 7, axis=0), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.delete(out[1], 7, axis=0), np.delete(pushed[:38], 7, axis=0), atol=1e-12)
    np.testing.assert_array_equal(out[3], left[3])
    np.testing.assert_array_equal(out[0][38:], common[38:])


def test_noise_and_friction_are_no_events(look):
    events, thresholds = look(seed=22)
    assert events == []
    assert 0.0 < thresholds["b"]["threshold"] < 3.0
    assert thresholds["b"]["false_alarms_per_hour_at_most"] > 3.0


def test_pushes_leave_the_answer_as_it_is(tmp_path):
    """From CSV to the verdict: friction as planted, no name, and the pushes listed."""
    calls, planted = iter(range(4)), []
    friction = torque_of(0.8, 0.22, 0.05, noise=0.03)

    def torque(q, v, a, rng, t):
        tau = friction(q, v, a, rng, t)
        if (k := next(calls)) in (1, 3):
            at = t[np.argmax(np.where((t > 1) & (t < 7), np.abs(v[:, 0]), 0.0))]
            planted.append((f"runs/run{k}.parquet", at))
            tau[:, 0] += 0.9 * np.exp(-(((t - at) / 0.15) ** 4))
        return tau

    bench = Bench(tmp_path, 1, 0.8, size=0.8, rate=200.0, seconds=8.0, runs=4, frequencies=(0.2, 0.5, 0.9))
    bench.record(torque).accept()
    found = diagnose(tmp_path / "d")
    verdict = found.verdict
    assert verdict["verdict"] == [] and verdict["joints"]["j1"]["state"] == "explained"
    assert [e["run"] for e in verdict["events"]] == [run for run, _ in planted]
    for e, (_, at) in zip(verdict["events"], planted, strict=True):
        assert e["t"] < at < e["t"] + e["seconds"] < at + 0.5
        assert e["size"] == pytest.approx(0.9, rel=0.15)
    for name, truth in (("coulomb", 0.22), ("viscous", 0.05)):
        (one,) = [e for e in found.estimates["after"] if e.entry.effect.name == name]
        ((low, high),) = one.intervals.values()
        assert low < truth < high
    # Detectors see the recordings without them.
    prepared = read_prepared(tmp_path / "d")
    calm, events = bridge_events(prepared)
    assert {e["run"] for e in events} == {run for run, _ in planted}
    for e in events:
        before, after = (next(r for r in p.runs if r.file == e["run"]) for p in (prepared, calm))
        assert np.ptp(before.tau - after.tau) == pytest.approx(0.9, rel=0.25)


@pytest.mark.parametrize(("every", "width"), [(True, 0.02), (True, 0.05), (False, 0.05)])
def test_what_comes_back_at_the_same_place_is_no_event(look, every, width):
    """A torque in all passes of a place, as of a damaged tooth; in one of a run's it is an event."""

    def tooth(t, q, v, a, rng):
        near = np.abs(q[:, 0] - 0.2) < width
        number = np.cumsum(np.diff(near.astype(int), prepend=0) == 1)
        return np.column_stack([25.0 * near * (every | (number == 2)), 0.0 * t])

    found, _ = look(extra_torque=tooth, seed=23)
    assert bool(found) != every
