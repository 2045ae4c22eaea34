"""A model's errors on recordings whose truth is known."""

import json
import shutil

import numpy as np
import pandas as pd
import pytest

from wearscope.errors import InputError
from wearscope.notebook.model_errors import evaluate_model
from wearscope.robots.model import make_model

INERTIA, COULOMB, VISCOUS = [1.5, 0.6], [6.0, 3.0], [4.0, 2.0]
NOISE = np.array([1.0, 0.5])


def make_duo(folder, coulomb=COULOMB, joints=("a", "b")):
    """The arm that the recordings are of, with its own friction unless told otherwise."""
    effects = [
        {"joint": joint, "effect": effect, "parameters": {name: value[k]}, "source": "planted"}
        for k, joint in enumerate(joints)
        for effect, name, value in (("coulomb", "level", coulomb), ("viscous", "slope", VISCOUS))
    ]
    fields = {
        "name": "duo",
        "source": "planted",
        "urdf": "robot.urdf",
        "joints": list(joints),
        "drive": {"rotor_inertia": INERTIA, "torque_limit": [500.0, 300.0]},
        "effects": effects,
    }
    return make_model(fields, folder / "robot.urdf", "duo")


@pytest.fixture(scope="module")
def recorded(record_at, tmp_path_factory):
    """Two recordings of it."""
    return record_at(tmp_path_factory.mktemp("errors") / "duo", runs=2, duration=8.0, noise=0.1)


@pytest.fixture(scope="module")
def right(recorded):
    return evaluate_model(make_duo(recorded), recorded)


@pytest.fixture(scope="module")
def wrong(recorded):
    """At joint `a` a third of the Coulomb friction is missing."""
    return evaluate_model(make_duo(recorded, [4.0, 3.0]), recorded)


def test_true_model_leaves_the_noise(right):
    assert set(right.torque["outcome"]) == {"ok"}
    for k, joint in enumerate("ab"):
        left = right.torque.loc[right.torque["joint"] == joint, "error_rms"]
        # The white noise is 0.1 NOISE before the common filter; the rest is the simulator's own.
        assert (left < 0.1 * NOISE[k] + 0.01 * COULOMB[k]).all()


def test_missing_friction_is_the_torque_error(right, wrong):
    """A Coulomb level that is 2 N m too low leaves 2 N m wherever the joint moves."""
    left = wrong.torque.loc[wrong.torque["joint"] == "a", "error_rms"]
    assert np.allclose(left, 2.0, rtol=0.05)
    same = wrong.torque["joint"] == "b"
    assert np.allclose(wrong.torque.loc[same, "error_rms"], right.torque.loc[same, "error_rms"], atol=0.02)


def test_percent_is_of_the_measured_torque(wrong):
    table = wrong.torque
    assert np.allclose(table["error_percent"], 100 * table["error_rms"] / table["torque_rms"])


def test_rollouts_of_the_true_model_stay_on_the_measured_motion(right, wrong):
    """After 0.1 s a torque error e moves a joint of inertia M by e t^2 / 2 M: some 6 mrad for 2 N m."""
    # Without `query`, in which Python 3.13.0 crashes: it looks through the frames of its callers.
    both = (right.rollouts, wrong.rollouts)
    at = [rows[(rows["joint"] == "a") & (rows["seconds"] == 0.1)] for rows in both]
    assert (at[0]["error_median"] < 1e-3).all() and (at[0]["failed"] == 0).all()
    assert (at[1]["error_median"] > 3 * at[0]["error_median"]).all()
    assert ((1e-3 < at[1]["error_median"]) & (at[1]["error_median"] < 10e-3)).all()
    for table in both:
        low, mid, high = (table[f"error_median{end}"] for end in ("_low", "", "_high"))
        assert ((low <= mid) & (mid <= high)).all() and (table["count"] > 0).all()


def test_model_of_other_joints_is_refused(recorded):
    with pytest.raises(InputError, match="records the joints a, b, and model 'duo' has b, a"):
        evaluate_model(make_duo(recorded, joints=("b", "a")), recorded)


def test_tables_keep_their_units(right, tmp_path):
    from wearscope.storage import tables

    right.write(tmp_path)
    assert tables.read_units(tmp_path / "torque_errors.parquet")["error_percent"] == "%"
    assert len(tables.read_table(tmp_path / "rollout_errors.parquet")) == 2 * 2 * 3


@pytest.mark.parametrize("noise", [1e-7, 0.0])
@pytest.mark.parametrize(("joints", "still"), [(("a",), "b"), (("b",), "a")])
def test_what_was_judged_is_said_first(recorded, joints, still, noise, tmp_path):
    """One joint stands still: its torque is not judged, and the sentence speaks of the other one alone."""
    from wearscope.cli.evaluate import list_worst, tell_errors

    folder = tmp_path / "few"
    shutil.copytree(recorded, folder)
    for path in sorted((folder / "runs").glob("*.parquet")):
        table = pd.read_parquet(path)
        table[f"q_{still}"] = 0.3 + noise * np.random.default_rng(0).standard_normal(len(table))
        table.to_parquet(path)
    found = evaluate_model(make_duo(recorded), folder)
    seconds = sum(np.ptp(pd.read_parquet(path)["t"]) for path in (folder / "runs").glob("*.parquet"))
    assert (found.judged["joints"], found.judged["of"], found.judged["names"]) == (1, 2, list(joints))
    assert 0.8 * seconds < found.judged["seconds"] <= seconds and found.judged["refused"] == []
    said = tell_errors(found)
    assert said.startswith(f"Judged at 1 of 2 joints ({joints[0]}), for ") and f"at {still}" not in said
    rows = {joint: rest for joint, *rest in list_worst(found)}
    assert list(rows) == ["a", "b"] and rows[still][1] == "n/a" and rows[joints[0]][3].endswith("after 2 s")
    worst = found.torque.set_index("joint").loc[[joints[0]], "error_percent"].max()
    assert float(rows[joints[0]][1].split()[0]) == pytest.approx(worst, rel=0.06)
    found.write(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "evaluation.json").read_text())["judged"] == found.judged
