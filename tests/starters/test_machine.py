"""The data set that ships with the package: made by its command, small, and named right by the loop."""

import numpy as np
import pandas as pd
import pytest
import yaml

import wearscope
from wearscope.checking.dataset import check_dataset
from wearscope.starters.machine import DECLARED, PLANTED, write_machine

SHIPPED = wearscope.example_dataset()


def test_it_is_what_its_command_makes(tmp_path):
    write_machine(tmp_path / "made")
    files = sorted(path.relative_to(SHIPPED) for path in SHIPPED.rglob("*.*"))
    assert files == sorted(path.relative_to(tmp_path / "made") for path in (tmp_path / "made").rglob("*.*"))
    for file in files:
        made = tmp_path / "made" / file
        if file.suffix == ".parquet":
            shipped, again = pd.read_parquet(SHIPPED / file), pd.read_parquet(made)
            assert list(shipped.columns) == list(again.columns)
            np.testing.assert_allclose(shipped, again, rtol=1e-6, atol=1e-4)
        else:
            assert (SHIPPED / file).read_text() == made.read_text()


def test_it_is_small_and_passes_its_check():
    assert sum(path.stat().st_size for path in SHIPPED.rglob("*.*")) < 1_000_000
    assert check_dataset(SHIPPED).problems == []


def test_what_is_planted_is_not_declared():
    text = (SHIPPED / "dataset.yaml").read_text()
    assert yaml.safe_load(text)["declared_effects"] == list(DECLARED)
    assert not any(one.effect in text for one in PLANTED)


@pytest.mark.slow
def test_the_loop_names_what_was_planted():
    diagnosis = wearscope.diagnose(SHIPPED)
    summary = diagnosis.summary()
    assert set(zip(summary["joint"], summary["effect"], strict=True)) == {
        (one.joint, one.effect) for one in PLANTED
    }
    assert set(summary["status"]) == {"confirmed"}
    joints = diagnosis.verdict["joints"]
    assert joints["axis_1"]["state"] == "explained"
    assert {joints[one.joint]["state"] for one in PLANTED} == {"corrected"}
    (balancer,) = (one for one in diagnosis.verdict["verdict"] if one["joint"] == "axis_2")
    low, high = balancer["parameters"]["sine1"]["ci95"]
    assert low <= PLANTED[0].parameters["sine1"] <= high
