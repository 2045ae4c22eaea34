"""Torques that are added to a recording: their size, their form, and how a verdict of them is graded."""

import numpy as np
import pandas as pd
import pytest
import yaml

from benchmarks.added import KINDS, add_torque, grade
from benchmarks.recorded import Recorded


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "made"
    (made / "runs").mkdir(parents=True)
    t = np.arange(600) / 100.0
    phase = 2.0 * np.maximum(t - 1.0, 0.0)
    files = []
    for r, size in enumerate((0.5, 1.5)):
        table = pd.DataFrame({"t": t, "q_a": size * np.sin(phase), "tau_a": np.cos(t), "tau_b": np.cos(t)})
        table.to_parquet(made / "runs" / f"{r}.parquet")
        files.append({"file": f"runs/{r}.parquet", "use": "train"})
    robot = {"urdf": "my.urdf", "joints": ["a", "b"]}
    (made / "my.urdf").write_text("<robot/>")
    (made / "dataset.yaml").write_text(yaml.safe_dump({"sample_rate": 100.0, "robot": robot, "runs": files}))
    return made


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_added_has_its_size_over_all_runs_and_nothing_else_changes(folder, tmp_path, kind):
    copy = add_torque(Recorded(folder), "a", kind, 0.25).write(tmp_path / "copy")
    pairs = [[pd.read_parquet(f / "runs" / f"{r}.parquet") for f in (folder, copy)] for r in range(2)]
    extra = np.concatenate([after["tau_a"] - before["tau_a"] for before, after in pairs])
    moves = np.tile(np.arange(600) > 100, 2)
    assert np.sqrt(np.mean(extra[moves] ** 2)) == pytest.approx(0.25, rel=0.1)
    for before, after in pairs:
        pd.testing.assert_frame_equal(before.drop(columns="tau_a"), after.drop(columns="tau_a"))
    if kind == "joint_spring":
        q = np.concatenate([before["q_a"] for before, _ in pairs])
        assert np.corrcoef(q, extra)[0, 1] == pytest.approx(1.0)


def test_a_verdict_is_found_hinted_or_missed():
    verdict = {
        "verdict": [{"joint": "a", "effect": "joint_spring", "equivalent": ["gravity_counterbalance"]}],
        "joints": {"a": {"reason": ""}, "b": {"reason": "stribeck would remove 30 % of the squared error"}},
    }
    assert grade(verdict, "a", "gravity_counterbalance") == "found"
    assert grade(verdict, "a", "stribeck") == "missed"
    assert grade(verdict, "b", "stribeck") == "hinted"
