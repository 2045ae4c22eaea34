"""What to record where wear cannot be told from temperature: the plan, its promise, its files."""

import pytest

from wearscope.cycles.base import load_cycle
from wearscope.robots.model import load_model
from wearscope.tracking.next_session import measure_width
from wearscope.tracking.records import record_assessment
from wearscope.tracking.run import write_tracking
from wearscope.tracking.scatter import measure_friction
from wearscope.tracking.session import FALSE_ALARM_RATE
from wearscope.tracking.session_runs import prepare_runs
from wearscope.tracking.sessions import read_session


@pytest.fixture(scope="module")
def told(sessions, reference, assessments, tmp_path_factory):
    folder = tmp_path_factory.mktemp("told")
    records = [record_assessment(one, reference) for one in assessments.values()]
    return folder, write_tracking(sessions, reference, records, folder, FALSE_ALARM_RATE)


def test_far_warmer_session_is_to_be_repeated_at_a_temperature_of_the_reference(told):
    last = told[1]["sessions"][-1]
    assert {one["joint"] for one in last["next_measurement"]} == {"a", "b"}
    for one, text in zip(last["next_measurement"], last["cannot_tell"], strict=True):
        assert 25.0 <= one["start_temperature"] <= 47.0
        assert one["sees"] < 0.5 * one["sees_now"]
        assert f"next measurement, started at {one['start_temperature']:.0f} °C, would show" in text


def test_sessions_that_are_told_need_no_plan(told):
    assert not any(one["next_measurement"] for one in told[1]["sessions"][:-1])


def test_plan_is_a_test_cycle_that_the_tracked_machine_can_do(told):
    folder, outcome = told
    model = load_model(folder / "model_tracked.yaml")
    for one in outcome["sessions"][-1]["next_measurement"]:
        reference = load_cycle(str(folder / one["cycle_file"])).build(model, 0.1, 0.01)
        assert reference.t[-1] == pytest.approx(one["seconds"], abs=0.1)
        assert (folder / one["table"]).read_text().startswith("t,q_a,qd_a,qdd_a,q_b")


def test_promised_width_is_that_of_sessions_that_are_recorded(sessions, reference, assessments):
    frame = reference.structure.frame
    for session in ("s4", "s5"):
        runs, _ = prepare_runs(read_session(sessions, session), frame)
        expected = measure_width(reference, runs, 0)
        estimate = assessments[session].estimates["friction@0"]
        made = 2.0 * measure_friction(estimate, reference.scatter)[1]
        assert 0.5 < made / expected < 2.0
