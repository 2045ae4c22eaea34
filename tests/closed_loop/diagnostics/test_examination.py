"""What the page has in addition to the verdict, and forward simulation against known structures."""

import json

import pandas as pd
import pytest
from changed_fields import changed_fields
from folders import fit_problem

from wearscope.closed_loop.diagnostics import forward
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.model.correction import make_corrected_model
from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.run import close_loop
from wearscope.errors import SimulationError
from wearscope.simulation.study import simulate_forward


@pytest.fixture
def made(record, pose):
    """Prepared data of two runs, and the declared model fitted to them as a model of each stage."""
    problem = pose(record(runs=2, duration=6.0))
    model, prepared = fit_problem(problem), problem.prepared
    found = estimate(model)
    stages = ("before", "after")
    return prepared, {stage: make_corrected_model(prepared, model, found, stage) for stage in stages}


@pytest.mark.parametrize(("masses", "carried"), [((2.0, 2.0), 2.0), ((2.0, 3.0), None), ((None, 3.0), None)])
def test_a_corrected_model_carries_what_all_recordings_carry(record, pose, masses, carried):
    folder = record(runs=2, duration=6.0)
    with changed_fields(folder / "dataset.yaml") as fields:
        for run, mass in zip(fields["runs"], masses, strict=True):
            run["payload"] = {"mass": mass} if mass else None
    problem = pose(folder)
    model = fit_problem(problem)
    made = make_corrected_model(problem.prepared, model, estimate(model), "after").to_mapping()
    assert (made["payload"] and made["payload"]["mass"]) == carried
    assert ("it carries none" in made["description"]) == (carried is None)


def test_failed_simulation_is_said_and_leaves_no_numbers(made, monkeypatch):

    def fail(simulated, *args, **kwargs):
        raise SimulationError(f"{simulated.name} fell over.")

    monkeypatch.setattr("wearscope.simulation.study.simulate_forward", fail)
    summary = forward.compare_forward(*made)
    assert summary["outcome"].str.contains("fell over").all()
    assert summary[["torque_rms", "motion_rms", "torque_rms_low"]].isna().all(axis=None)


def test_the_effect_that_stops_a_simulation_is_named(made, monkeypatch):
    prepared, models = made

    def fail(simulated, *args, **kwargs):
        if any((one.effect, one.joint) == ("viscous", "b") for one in simulated.effects):
            raise SimulationError("it fell over.")
        return simulate_forward(simulated, *args, **kwargs)

    monkeypatch.setattr("wearscope.simulation.study.simulate_forward", fail)
    effects = models["before"].to_mapping()["effects"]
    bare = [one for one in effects if (one["effect"], one["joint"]) != ("viscous", "b")]
    said = forward.compare_forward(prepared, models | {"before": models["before"].replace(effects=bare)})
    after = said["stage"] == "after"
    assert (said.loc[~after, "outcome"] == "ok").all()
    assert (
        said.loc[after, "outcome"].str.endswith("failed: it fell over. Without viscous at b it runs.").all()
    )


def test_whole_examination_on_a_small_data_set(record, tmp_path):
    spring = [(1, "joint_spring", {"stiffness": 10.0, "preload": 2.0})]
    folder = record(planted=spring, runs=4, duration=10.0, rate=100.0)
    out = tmp_path / "out"
    said = []
    verdict = close_loop(folder, out, policy=Policy(flips=499), progress=said.append)
    tables = {path.stem for path in out.glob("*.parquet")}
    assert tables == {"signals", "forward", "profiles", "residual", "candidates"}
    assert json.loads((out / "verdict.json").read_text()) == verdict
    assert any("forward simulation" in line for line in said)
    residual, signals = (pd.read_parquet(out / f"{name}.parquet") for name in ("residual", "signals"))
    pd.testing.assert_frame_equal(residual[["t", "run", "joint"]], signals[["t", "run", "joint"]])

    # Simulated forward, the corrected model is closer in torque and in motion, where the spring is.
    b = verdict["forward"]["b"]
    assert b["before"]["outcome"] == b["after"]["outcome"] == "ok"
    assert b["after"]["torque_rms"] < 0.5 * b["before"]["torque_rms"]
    assert b["after"]["motion_rms"] < 0.6 * b["before"]["motion_rms"]
    # The simulator says what the regression says.
    joint = verdict["joints"]["b"]
    assert b["before"]["torque_rms"] == pytest.approx(joint["rms_before"], rel=0.1)
    assert b["after"]["torque_rms"] == pytest.approx(joint["rms_after"], abs=0.1 * joint["rms_before"])
