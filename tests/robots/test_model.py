"""Model files: read, written, refused."""

import math
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from urdf_texts import Joint, describe_robot

from wearscope.errors import InputError
from wearscope.robots.model import (
    check_effects,
    check_temperature,
    load_model,
    make_model,
    save_model,
)

ROBOTS = Path(__file__).parents[2] / "config" / "robots"
URDF = describe_robot(
    Joint("x", "1 0 0", 50, kind="prismatic", limits="0.2 0.8 400 1"),
    Joint("c", "0 0 1", 5, moments="0.1 0.1 0.1", kind="continuous"),
)
FIELDS = {"name": "gantry", "urdf": "gantry.urdf", "joints": ["x", "c"]}


@pytest.mark.parametrize("name", ["medium", "large"])
def test_round_trip_is_exact(name, tmp_path):
    model = load_model(name, ROBOTS)
    urdf = save_model(model, tmp_path / "model_after.yaml")
    assert urdf == tmp_path / "model_after.urdf"
    again = load_model(tmp_path / "model_after.yaml")
    assert again.urdf_text == model.urdf_text
    assert {**again.to_mapping(), "urdf": ""} == {**model.to_mapping(), "urdf": ""}
    save_model(again, tmp_path / "twice" / "model_after.yaml")
    for file in ("model_after.yaml", "model_after.urdf"):
        assert (tmp_path / file).read_bytes() == (tmp_path / "twice" / file).read_bytes()


def test_a_changed_model_round_trips_to_the_last_bit(tmp_path):
    model = make_model(FIELDS, URDF)
    effects = [
        {"joint": "x", "effect": "coulomb", "parameters": {"level": 1.0 / 3.0}, "source": "fitted: 1e-06 ± x"}
    ]
    changed = model.replace(effects=effects, payload={"mass": 0.1 + 0.2, "com": [1e-17, 0.0, -1e300]})
    save_model(changed, tmp_path / "m.yaml")
    again = load_model(tmp_path / "m.yaml")
    assert again.effects == changed.effects
    assert again.payload == changed.payload
    assert model.effects == []


def test_found_by_file_folder_or_name(tmp_path):
    shutil.copytree(ROBOTS / "medium", tmp_path / "mine")
    for reference, folder in (
        (tmp_path / "mine" / "model.yaml", None),
        (tmp_path / "mine", None),
        (str(tmp_path / "mine"), ROBOTS),
        ("mine", tmp_path),
    ):
        assert load_model(reference, folder).name == "medium"


def test_defaults_of_a_bare_robot(refuses):
    model = make_model(FIELDS, URDF)
    assert model.position_units == ["m", "rad"] and model.torque_units == ["N", "N m"]
    np.testing.assert_array_equal(model.gear_ratio, [1, 1])
    np.testing.assert_array_equal(model.rotor_inertia, [0, 0])
    assert np.all(np.isinf(model.torque_limit))
    lower, upper = model.position_limits
    np.testing.assert_array_equal(lower, [0.2, -np.inf])
    np.testing.assert_array_equal(upper, [0.8, np.inf])
    np.testing.assert_allclose(model.home_posture, [0.5, 0.0])
    assert model.wear_joints == ["x", "c"]
    assert model.declared_payload is None and model.rigid_body().n == 2
    refuses(model.motion_limits)


def test_pickles():
    model = load_model("medium", ROBOTS)
    copy = pickle.loads(pickle.dumps(model))
    assert copy.urdf_text == model.urdf_text and copy.drive == model.drive
    np.testing.assert_array_equal(copy.position_limits, model.position_limits)


@pytest.mark.parametrize(
    "changes",
    [
        {"gear": 3},
        {"drive": {"gear_ration": [1, 1]}},
        {"drive": {"gear_ratio": [1]}},
        {"drive": {"gear_ratio": [1, 0]}},
        {"drive": {"torque_limit": [1, -1]}},
        {"drive": {"rotor_inertia": [0, math.nan]}},
        {"sensors": {"torque_noise": [1, 2, 3]}},
        {"sensors": {"sample_rate": 0}},
        {"controller": {"bandwidth_hz": [1.0]}},
        {"payload": {"mass": math.nan}},
        {"payload": {"mass": 1, "com": [0, 0]}},
        {"payload": {"com": [0, 0, 0]}},
        {"gravity": [0, -9.81]},
        {"home": [0.9, 0]},
        {"lower": [0.9, 0]},
        {"home": [math.inf, 0]},
        {"wear_axes": ["y"]},
        {"effects": [{"joint": "y", "effect": "coulomb"}]},
        {"effects": [{"joint": "x"}]},
        {"effects": [{"joint": "x", "effect": "coulomb", "parameters": {"level": math.nan}}]},
        {"joints": ["x", "z"]},
        {"joints": ["x", "x"]},
        {"joints": []},
        {"joints": None},
        {"name": "a/b"},
    ],
    ids=str,
)
def test_breaches_are_named(changes, refuses):
    refuses(make_model, {**FIELDS, **changes}, URDF, "file.yaml")


def test_unusable_files_are_named(tmp_path, refuses):
    refuses(load_model, "tiny", ROBOTS)
    (tmp_path / "model.yaml").write_text(yaml.safe_dump(FIELDS))
    refuses(load_model, tmp_path / "model.yaml")


def test_a_urdf_without_inertia_is_refused(tmp_path, refuses):
    shutil.copytree(ROBOTS / "medium", tmp_path / "mine")
    path = tmp_path / "mine" / "robot.urdf"
    text = path.read_text()
    before, found, after = text.partition("link_3")
    path.write_text(before + found + re.sub(r"(?s)<inertial>.*?</inertial>", "", after, count=1))
    refuses(load_model, tmp_path / "mine")


def test_effects_are_checked_against_the_vocabulary():
    model = make_model(FIELDS, URDF)
    good = {"joint": "x", "effect": "coulomb", "parameters": {"level": 3.0}}
    check_effects(model.replace(effects=[good]))
    for wrong, said in (
        ({**good, "effect": "columb"}, "there is no 'columb'"),
        ({**good, "parameters": {"lvl": 3.0}}, r"gantry: effects\[1\] at joint 'x'.*no parameter 'lvl'"),
    ):
        with pytest.raises(InputError, match=said):
            check_effects(model.replace(effects=[good, wrong]))


def test_temperatures_outside_the_friction_law_are_refused(refuses):
    model = load_model("medium", ROBOTS)
    check_temperature(model, 26.0)
    refuses(check_temperature, model, 25.0)
