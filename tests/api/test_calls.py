"""Calls of a notebook: recordings in, results with tables, plots and a short text out."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import wearscope
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.posing import find_prismatic
from wearscope.errors import InputError
from wearscope.notebook.calls import (
    DetectionResult,
    DiagnosisResult,
    EvaluationResult,
    TrackingResult,
    take_recordings,
)
from wearscope.notebook.model_errors import ModelErrors
from wearscope.storage.tables import read_table

URDF = wearscope.example_dataset() / "robot.urdf"
JOINTS = ["axis_1", "axis_2", "axis_3"]
VERDICT = {
    "verdict": [
        {"joint": "axis_2", "effect": "stribeck", "equivalent": [], "status": "confirmed",
         "error_reduction": 0.6,
         "parameters": {"level": {"value": 25.0, "ci95": [24.0, 26.0], "unit": "N m"}}}
    ],
    "joints": {
        "axis_1": {"unit": "N m", "rms_before": 2.0, "rms_after": 2.0, "noise_floor": 1.9,
                   "state": "explained", "error": "same"},
        "axis_2": {"unit": "N m", "rms_before": 9.0, "rms_after": 3.0, "noise_floor": 2.9,
                   "state": "corrected", "error": "smaller"},
    },
}  # fmt: skip


def frames(*names):
    """Recordings of the example as a user has them."""
    folder = wearscope.example_dataset() / "runs"
    return {name: read_table(folder / f"{name}.parquet") for name in names}


@pytest.fixture
def diagnosed():
    rows = {"joint": ["axis_2"], "effect": ["stribeck"], "error_reduction": [0.6]}
    residuals = pd.DataFrame({"joint": ["axis_2"] * 3, "residual_before": 1.0, "residual_after": 0.5})
    result = DiagnosisResult(SimpleNamespace(verdict=VERDICT, summary=lambda: pd.DataFrame(rows), other=7))
    result.__dict__["residuals"] = residuals
    return result


def test_data_frames_are_a_data_set_as_their_files_are():
    with take_recordings(frames("transfer", "sweeps"), URDF, joints=JOINTS) as made:
        taken = read_dataset(made, find_prismatic)
        assert list(taken.joints) == JOINTS
        assert [(run.file, run.use) for run in taken.runs] == [
            ("runs/transfer.parquet", "train"), ("runs/sweeps.parquet", "test"),
        ]  # fmt: skip
    assert not made.exists()


def test_sessions_and_the_healthy_ones_are_those_that_are_named():
    with take_recordings(frames("transfer", "sweeps"), URDF, ["transfer"], joints=JOINTS) as made:
        text = (made / "dataset.yaml").read_text()
    assert "reference: [transfer]" in text and "session: sweeps" in text


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"recordings": pd.DataFrame()}, "data frames need the robot's URDF"),
        ({"recordings": 7, "urdf": URDF}, "a int is none; give a folder"),
        ({"recordings": [], "urdf": URDF}, "there is none"),
        ({"recordings": ["run.csv"], "urdf": URDF}, "'run1' is a str; give a data frame"),
        ({"recordings": "folder", "urdf": URDF}, "a folder says all of that itself"),
        (
            {"recordings": pd.DataFrame(), "urdf": URDF, "units": "deg"},
            "no option 'units'; it has",
        ),
    ],
)
@pytest.mark.parametrize("call", [wearscope.diagnose, wearscope.track])
def test_what_cannot_be_taken_is_one_sentence(call, given, told):
    with pytest.raises(InputError, match=told):
        call(**given)


def test_a_result_is_short_in_a_terminal_and_a_table_in_a_notebook(diagnosed):
    assert repr(diagnosed) == "DiagnosisResult: the model lacks Stribeck friction at axis_2"
    html = diagnosed._repr_html_()
    assert "Stribeck friction at axis_2</strong>" in html and "<table" in html
    assert diagnosed.other == 7 and diagnosed.summary().attrs["units"] == {"error_reduction": "1"}
    with pytest.raises(AttributeError):
        _ = diagnosed.nothing
    found = diagnosed.parameters().iloc[0]
    assert (found["value"], found["low"], found["high"], found["unit"]) == (25.0, 24.0, 26.0, "N m")
    assert diagnosed.errors()["rms_after"].tolist() == [2.0, 3.0]


def test_plots_take_and_return_axes(diagnosed, refuses):
    ax = Figure().subplots()
    for kind in ("errors", "residual"):
        assert diagnosed.plot(kind, ax=ax) is ax
        assert diagnosed.plot(kind) is not ax
    assert "residual at axis_2 [N m]" in ax.get_ylabel()
    refuses(diagnosed.plot, "bars")
    refuses(diagnosed.plot, "residual", joint="axis_9")


def test_a_tracking_has_its_changes_and_their_course(refuses):
    change = {"joint": "j1", "effect": "wear", "parameter": "level", "change": 2.0, "ci95": [1.5, 2.5],
              "unit": "N m", "since": "may", "equivalent": []}  # fmt: skip
    content = {"sessions": [{"session": "april", "changes": []}, {"session": "may", "changes": [change]}]}
    changes = pd.DataFrame(
        {"session": ["april", "may"], "joint": "j1", "effect": "wear", "parameter": "level", "unit": "N m",
         "change": [0.1, 2.0], "change_low": [-0.4, 1.5], "change_high": [0.6, 2.5]}
    )  # fmt: skip
    result = TrackingResult(content, changes)
    assert "session may" in repr(result) and "+2 N m" in repr(result)
    assert result.summary()["since"].tolist() == ["may"] and len(result.plot().lines) >= 2
    quiet = TrackingResult({"sessions": [{"session": "april", "changes": []}]}, changes)
    assert repr(quiet) == "TrackingResult: no change in april"
    refuses(result.plot, "j2")


def test_a_detection_has_its_verdicts_and_an_evaluation_its_errors(refuses):
    rows = {"kind": ["judged", "nominal"], "run": "r1", "session": "s", "joint": "j1", "fda": "C", "y": 4.0,
            "threshold": 2.0, "unit": "N m", "verdict": ["alarm", "no alarm"], "wear": 20.0, "wear_low": 10.0,
            "wear_high": 30.0}  # fmt: skip
    found = DetectionResult(SimpleNamespace(detection=pd.DataFrame(rows)))
    assert "alarm: 1" in repr(found) and found.summary()["verdict"].tolist() == ["alarm"]
    assert found.plot().lines[0].get_ydata().tolist() == [2.0]
    refuses(found.plot, "Z")
    # A run that was not judged counts for neither the torque nor the error.
    # Others count by their length.
    torque = {"joint": ["j1", "j1", "j1", "j2"], "unit": "N m", "seconds": [30.0, 10.0, 9.0, 9.0],
              "torque_rms": [10.0, 10.0, 100.0, 5.0], "error_rms": [1.0, 3.0, np.nan, np.nan]}  # fmt: skip
    judged = {"joints": 1, "of": 2, "seconds": 8.0, "refused": ["runs/b.csv: no torque"]}
    errors = EvaluationResult(ModelErrors(pd.DataFrame(torque), pd.DataFrame(), judged))
    assert errors.summary()["error_percent"].iloc[0] == pytest.approx(100 * np.sqrt(3) / 10)
    assert errors.summary()["error_percent"].isna().tolist() == [False, True]
    assert "most at j1; judged at 1 of 2 joints over 8 s" in repr(errors) and errors.plot().patches


@pytest.mark.slow
def test_data_frames_are_diagnosed_as_their_folder_is():
    given = frames("excitation", "reversals", "transfer", "sweeps")
    result = wearscope.diagnose(given, URDF, joints=JOINTS)
    assert {one["joint"] for one in result.verdict["verdict"]} == {"axis_2", "axis_3"}
    assert len(repr(result)) < 200
