"""Each kind of damage really changes the folder, and in the way its name says."""

import shutil

import numpy as np
import pandas as pd
import pinocchio as pin
import pyarrow as pa
import pytest
import yaml
from folder_damage import DAMAGES, MISLEADING, REFUSED, copy_damaged, damage

from benchmarks.board.generate import generate_dataset
from benchmarks.board.recipe import Recipe, RunPlan
from wearscope.errors import InputError

PLANS = (
    RunPlan("train", "fourier", 0, 24.0),
    RunPlan("test", "points", 2, 40.0),
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "d1"
    generate_dataset(folder, "arm3", [], 1, Recipe(duration=4.0, plans=PLANS))
    return folder


def content(folder):
    return {str(f.relative_to(folder)): f.read_bytes() for f in folder.rglob("*") if f.is_file()}


@pytest.mark.parametrize("kind", DAMAGES)
def test_every_kind_changes_the_copy_and_spares_the_original(kind, whole, tmp_path):
    before = content(whole)
    copy = copy_damaged(whole, tmp_path / "d1", kind)
    assert content(copy) != before
    assert content(whole) == before


def test_there_are_more_than_twenty_kinds():
    assert len(set(DAMAGES)) == len(REFUSED) + len(MISLEADING) > 20


def first_run(folder):
    return pd.read_parquet(folder / "runs" / "r1.parquet")


def test_some_damages_do_what_they_say(whole, tmp_path):
    made = {kind: copy_damaged(whole, tmp_path / kind, kind) for kind in DAMAGES}
    with pytest.raises(pa.ArrowInvalid):
        first_run(made["truncated_parquet"])
    assert int(first_run(made["one_nan"]).isna().sum().sum()) == 1
    assert np.diff(first_run(made["time_backwards"])["t"]).min() < 0
    assert np.diff(first_run(made["time_jump"])["t"]).max() == pytest.approx(3.004)
    assert len(first_run(made["empty_run"])) == 0
    massless = pin.buildModelFromXML((made["massless_urdf"] / "robot.urdf").read_text())
    assert sum(inertia.mass for inertia in massless.inertias) == 0
    heavy = pin.buildModelFromXML((made["masses_in_grams"] / "robot.urdf").read_text())
    assert heavy.inertias[1].mass == pytest.approx(18000.0)
    uses = {r["use"] for r in yaml.safe_load((made["no_train_run"] / "dataset.yaml").read_text())["runs"]}
    assert uses == {"test"}
    with pytest.raises(yaml.YAMLError):
        yaml.safe_load((made["broken_yaml"] / "dataset.yaml").read_text())


def test_unknown_kind_is_refused(whole, tmp_path):
    shutil.copytree(whole, tmp_path / "d1")
    with pytest.raises(InputError, match="no kind 'moths'"):
        damage(tmp_path / "d1", "moths")
