"""Short pushes are found: run, joint, moment, length and size; noise and friction are none."""

import numpy as np
import pytest

from wearscope.closed_loop.diagnostics.events import find_events, suggest_thresholds
from wearscope.closed_loop.model.declared import fit_declared_model
from wearscope.closed_loop.model.prediction import predict_runs


def push(at, size, width):
    def torque(t, q, v, a, rng):
        out = np.zeros_like(q)
        out[:, 0] = size * np.exp(-(((t - at) / width) ** 4))
        return out

    return torque


@pytest.fixture
def look(record, pose):
    def found(**options):
        problem = pose(record(runs=3, duration=8.0, **options))
        model = fit_declared_model(
            problem.prepared, problem.declared_terms, problem.inertial, problem.layout.blocks
        )
        predicted = predict_runs(problem.prepared, model, model)
        events = find_events(problem.prepared, predicted)
        return events, suggest_thresholds(problem.prepared, predicted, events)

    return found


@pytest.mark.parametrize(("at", "size", "width"), [(3.0, 25.0, 0.15), (5.2, -12.0, 0.25)])
def test_a_push_in_every_run_is_found_where_it_is(look, at, size, width):
    events, thresholds = look(extra_torque=push(at, size, width), seed=21)
    assert {e["joint"] for e in events} == {"a"} and len({e["run"] for e in events}) == len(events) >= 2
    for e in events:
        assert e["t"] < at < e["t"] + e["seconds"] and e["seconds"] < 4 * width + 0.2
        assert e["size"] == pytest.approx(size, rel=0.3)
    # A push of that size is seen by a detector with the threshold.
    assert thresholds["a"]["threshold"] < 0.7 * abs(size)


def test_noise_and_friction_are_no_events(look):
    events, thresholds = look(seed=22)
    assert events == []
    assert 0.0 < thresholds["b"]["threshold"] < 3.0
    assert thresholds["b"]["false_alarms_per_hour_at_most"] > 3.0
