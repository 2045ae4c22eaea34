"""One small loop closed once and read by many tests: what it names, how sure it is, what it writes."""

import json

import numpy as np
import pandas as pd
import pytest

from wearscope.closed_loop.run import close_loop
from wearscope.robots.model import load_model


@pytest.fixture(scope="module")
def closed(record_at, tmp_path_factory):
    """Verdict and folder of a loop closed on an arm whose first joint has an undeclared asymmetry."""
    place = tmp_path_factory.mktemp("one-loop")
    planted = (0, "viscous_asymmetry", {"half_difference": 3.0})
    folder = record_at(place / "duo", [planted], seed=3, runs=4, duration=8.0, rate=100.0)
    return close_loop(folder, place / "out", light=True), place / "out"


def test_the_planted_effect_is_named_and_nothing_else(closed):
    verdict, _ = closed
    assert [(entry["joint"], entry["effect"]) for entry in verdict["verdict"]] == [("a", "viscous_asymmetry")]
    assert verdict["verdict"][0]["status"] == "confirmed"


def test_the_planted_value_is_within_three_times_its_interval(closed):
    found = closed[0]["verdict"][0]["parameters"]["half_difference"]
    low, high = found["ci95"]
    assert abs(found["value"] - 3.0) < 1.5 * (high - low)
    assert 0.0 < high - low < 2.0


def test_the_error_falls_where_the_effect_is_and_not_where_it_is_not(closed):
    joints = closed[0]["joints"]
    assert joints["a"]["rms_after"] < 0.7 * joints["a"]["rms_before"]
    assert joints["b"]["rms_after"] == pytest.approx(joints["b"]["rms_before"], rel=0.05)
    assert all(joint["state"] != "unexplained" for joint in joints.values())


def test_the_files_hold_what_the_verdict_says(closed):
    verdict, out = closed
    assert json.loads((out / "verdict.json").read_text()) == verdict
    before, after = (load_model(str(out / f"model_{side}.yaml")) for side in ("before", "after"))
    gained = [entry.effect for entry in after.effects if entry.joint == "a"]
    assert "viscous_asymmetry" in gained
    assert "viscous_asymmetry" not in [entry.effect for entry in before.effects]
    residual = pd.read_parquet(out / "residual.parquet")
    assert len(residual) and np.isfinite(residual.select_dtypes("number").to_numpy()).any()
