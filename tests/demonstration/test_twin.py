"""The twin: its URDF, its forward run against inverse dynamics, its undeclared effect, its folder."""

import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
import yaml

from benchmarks.board.machines import Body
from benchmarks.board.motions import make_motion
from wearscope.demonstration.twin import STEP, TWIN, record_twin, simulate_run


def test_urdf_has_the_published_masses_and_reach():
    model = pin.buildModelFromXML(TWIN.urdf)
    assert [inertia.mass for inertia in model.inertias][1:] == [30.0, 56.5, 26.4, 28.7, 5.2, 0.5]
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(6))
    # upright: all offsets along y of the published frames add up to the height, the z offsets to -y
    height = 0.351 + 0.324 + 0.65 + 0.414 + 0.186 + 0.125
    assert np.allclose(data.oMi[6].translation, [0.0, -(0.3 - 0.155), height])


@pytest.fixture(scope="module")
def run():
    motion = make_motion(TWIN, "fourier", 1, 4.5, 1.0 / STEP)
    return motion, simulate_run(TWIN, motion, 40.0, "load_dependent_friction", 0.0)


def test_recorded_torque_is_inverse_dynamics_plus_friction(run):
    _, record = run
    body = Body(TWIN.urdf, TWIN.gravity, TWIN.payload_mass, TWIN.payload_com)
    v = record["v"]
    a = np.gradient(v, 1 / 250.0, axis=0)
    rigid = body.torque(record["q"], v, a) + np.asarray(TWIN.rotor_inertia) * a
    moving = np.abs(v) > 0.05 * np.asarray(TWIN.speed)
    warm = 0.7 + 0.3 * np.exp(-(record["temperature"] - 40.0) / 30.0)
    friction = np.asarray(TWIN.coulomb) * np.sign(v) + np.asarray(TWIN.viscous) * warm * v
    miss = np.where(moving, record["tau"] - rigid - friction, 0.0)
    assert np.all(np.sqrt(np.mean(miss**2, axis=0)) < 0.03 * np.sqrt(np.mean(record["tau"] ** 2, axis=0)))
    assert np.all(record["secret"] == 0)


def test_the_controller_follows_its_reference(run):
    motion, record = run
    assert np.abs(record["q"] - motion.q[::16]).max() < 0.08


def test_the_undeclared_effect_changes_axis_2_alone():
    motion = make_motion(TWIN, "fourier", 1, 4.5, 1.0 / STEP)
    record = simulate_run(TWIN, motion, 40.0, "gravity_counterbalance", 1.0)
    assert np.all(np.delete(record["secret"], 1, axis=1) == 0)
    assert np.abs(record["secret"][:, 1]).max() > 50.0


def test_folder_declares_less_than_it_holds(tmp_path):
    truth = record_twin(tmp_path / "twin", 0, duration=2.0, truth_path=tmp_path / "truth.json")
    document = yaml.safe_load((tmp_path / "twin" / "dataset.yaml").read_text())
    assert truth["planted"][0]["effect"] == "gravity_counterbalance"
    assert truth["planted"][0]["effect"] not in (tmp_path / "twin" / "dataset.yaml").read_text()
    starts = []
    for entry in document["runs"]:
        table = pd.read_parquet(tmp_path / "twin" / entry["file"])
        assert np.isfinite(table.to_numpy()).all()
        starts.append(table["temp_axis_1"].iloc[0])
    assert np.ptp(starts) > 15
    assert np.abs(table["tau_axis_2"]).max() < 2194.5
