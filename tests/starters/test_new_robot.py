"""Models made from a URDF: what is stated is taken, all else marked, and the robot can do its cycles."""

import json
import re
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from urdf_texts import Joint, describe_robot

from wearscope.checking.robot import check_robot_folder
from wearscope.closed_loop.intake.dataset_fields import DatasetFields
from wearscope.cycles.base import check_reference, list_cycles, load_cycle
from wearscope.robots.friction import friction_from_efficiency, scale_friction_law
from wearscope.robots.model import RobotModel, load_model
from wearscope.starters import figures as limits
from wearscope.starters.robot import Stated, copy_urdf, make_robot, write_model_text
from wearscope.starters.writing import write_schema

ROOT = Path(__file__).parents[2]
AXES = ("0 0 1", "0 1 0")


def write_arm(path, links=3, effort=(60.0, 50.0, 20.0), velocity=3.0, dynamics="", mass=2.0, kind="revolute"):
    """A chain that stands upright, its axes turning in a plane."""
    body = {"mass": mass, "com": "0 0 0.15", "moments": "0.02 0.02 0.004", "kind": kind}
    joints = [
        Joint(f"j{k}", AXES[k > 0], at=f"0 0 {0.3 if k else 0}", limits=f"-2.5 2.5 {most} {velocity}", **body)
        for k, most in enumerate(effort[:links])
    ]
    path.write_text(describe_robot(*joints).replace("<parent", dynamics + "<parent"))
    return path


def save(folder, urdf, stated):
    """A robot's folder, as the command writes it."""
    folder.mkdir()
    model, figures, notes = make_robot(urdf, folder.name, stated)
    (folder / "model.yaml").write_text(write_model_text(model, figures, "x.urdf", False, False))
    copy_urdf(urdf, folder)
    return load_model(folder), figures, notes


def test_friction_law_of_the_study_s_robot_comes_out_of_its_published_figures():
    published = ((42.0, 0.13 / 160 * 105**2, -105.0), (105.0, 0.1 / 130 * 210**2, 210.0))
    entries = {one.joint: one.parameters for one in load_model("medium").effects}
    for joint, figures in zip(("axis_1", "axis_2"), published, strict=True):
        assert scale_friction_law(*figures) == pytest.approx(entries[joint], rel=1e-5)


def test_efficiency_is_the_output_over_the_input_at_the_rated_point(refuses):
    coulomb, viscous = friction_from_efficiency(0.8, 100.0, 2.0)
    assert 100.0 / (100.0 + coulomb + 2.0 * viscous) == pytest.approx(0.8)
    for wrong in (0.0, 1.0, 85.0, float("nan")):
        refuses(friction_from_efficiency, wrong, 100.0, 2.0)


def test_limits_are_the_urdf_s_and_marked_given(tmp_path):
    model, figures, _ = save(tmp_path / "arm", write_arm(tmp_path / "a.urdf"), Stated(payload=0.5))
    np.testing.assert_allclose(model.torque_limit, [60.0, 50.0, 20.0])
    np.testing.assert_allclose(model.motion_limits()[0], 3.0)
    assert figures["torque_limit"].given.all() and figures["speed_limit"].given.all()
    assert not figures["coulomb"].given.any() and not figures["gear_ratio"].given.any()


def test_stated_friction_stands_in_the_law_and_is_marked(tmp_path):
    stated = Stated(coulomb=[3.0, 2.0, 1.0], viscous=[2.0], gear_ratio=[100.0], payload=0.5)
    model, figures, _ = save(tmp_path / "arm", write_arm(tmp_path / "a.urdf"), stated)
    laws = [one.parameters for one in model.effects]
    assert [law["eta0"] for law in laws] == [3.0, 2.0, 1.0]
    np.testing.assert_allclose([law["eta5"] + 40.0 * law["eta6"] for law in laws], 2.0, rtol=1e-4)
    np.testing.assert_allclose([law["eta8"] for law in laws], 0.004)
    assert figures["coulomb"].given.all()
    assert all("given: --coulomb" in one.source and "wear assumed" in one.source for one in model.effects)


def test_friction_of_the_urdf_is_taken_where_no_option_says_other(tmp_path):
    urdf = write_arm(tmp_path / "a.urdf", dynamics='<dynamics friction="1.5" damping="0.7"/>')
    _, figures, _ = save(tmp_path / "arm", urdf, Stated(viscous=[0.9]))
    np.testing.assert_allclose(figures["coulomb"].values, 1.5)
    np.testing.assert_allclose(figures["viscous"].values, 0.9)
    assert set(figures["coulomb"].origins) == {"given: URDF, dynamics friction"}


def test_every_number_is_marked_given_or_assumed(tmp_path):
    urdf = write_arm(tmp_path / "a.urdf")
    model, figures, _ = make_robot(urdf, "arm", Stated())
    text = write_model_text(model, figures, "a.urdf", False, False)
    fields = yaml.safe_load(text)
    assert fields["drive"].keys() == {
        "gear_ratio", "rotor_inertia", "torque_limit", "speed_limit", "acceleration_limit", "jerk_limit",
    }  # fmt: skip
    start, end = text.index("drive:"), text.index("effects:")
    numbers = [line for line in text[start:end].splitlines() if re.search(r": [\[{\d]", line)]
    assert len(numbers) > 12
    assert all(
        "given" in line or "assumed" in line
        for line in numbers
        if "  mass" not in line and "  com" not in line
    )


@pytest.mark.parametrize(
    "arm",
    [
        {},
        {"effort": (0.0, 0.0, 0.0), "velocity": 0.0},
        {"effort": (1e4, 1e4, 1e4)},
        {"links": 1, "effort": (30.0,)},
        {"links": 2, "kind": "prismatic", "effort": (200.0, 100.0), "velocity": 0.4},
    ],
    ids=["plain", "no limits", "placeholders", "one joint", "slides"],
)
def test_it_passes_its_own_check_as_it_is(arm, tmp_path):
    save(tmp_path / "arm", write_arm(tmp_path / "a.urdf", **arm), Stated())
    assert check_robot_folder(tmp_path / "arm").problems == []


def test_a_gripper_of_coupled_joints_is_left_out(tmp_path, refuses):
    """A finger that another joint follows is not simulated; a joint that is named is refused as before."""
    urdf = write_arm(tmp_path / "a.urdf", 4, (60.0, 50.0, 20.0, 5.0))
    thumb = (
        '<link name="thumb"/><joint name="thumb" type="revolute"><parent link="l3"/><child link="thumb"/>'
        '<limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="j3"/></joint></robot>'
    )
    urdf.write_text(urdf.read_text().replace("</robot>", thumb))
    model, _, notes = make_robot(urdf, "arm", Stated())
    assert list(model.joints) == ["j0", "j1", "j2"]
    assert "j3: left out and locked at 0, as other joints follow it." in notes
    refuses(make_robot, urdf, "arm", Stated(joints=["j0", "j1", "j2", "j3"]))


def test_an_arm_of_many_joints_is_planned_in_few_rounds(tmp_path, monkeypatch):
    made, make_model = [], limits.make_model
    monkeypatch.setattr(limits, "make_model", lambda *given: made.append(1) or make_model(*given))
    links = 8
    urdf = write_arm(tmp_path / "arm.urdf", links, np.linspace(40.0, 8.0, links), mass=0.4)
    model, _, _ = make_robot(urdf, "arm", Stated())
    assert 2 < len(made) <= 5, "the last one is what is returned"
    for name in list_cycles():
        check_reference(load_cycle(name).build(model, 0.05, 0.02), model, name)


def test_motors_that_cannot_hold_the_arm_are_said_and_replaced(tmp_path):
    urdf = write_arm(tmp_path / "a.urdf", effort=(60.0, 2.0, 20.0), mass=10.0)
    model, figures, notes = save(tmp_path / "arm", urdf, Stated())
    assert len(notes) >= 1 and "joint 'j1': the torque limit 2 (given: URDF" in notes[0]
    assert model.torque_limit[1] > 2.0 and not figures["torque_limit"].given[1]


def test_a_stated_number_that_is_none_gets_one_sentence(tmp_path, refuses):
    for stated in (
        {"coulomb": [1.0, 2.0]},
        {"coulomb": [-1.0]},
        {"efficiency": [85.0]},
        {"gear_ratio": [0.0]},
        {"rotor_inertia": [1e-4]},
        {"payload": -1.0},
        {"joints": ["elbow"]},
        {"joints": ["j2", "j1"]},
        {"speed_limit": [float("nan")]},
        {"speed_limit": [0.0]},
        {"torque_limit": [0.0]},
    ):
        refuses(make_robot, write_arm(tmp_path / "a.urdf"), "arm", Stated(**stated))


def test_what_is_written_names_its_schema_and_keeps_it(tmp_path):
    model, figures, _ = save(tmp_path / "arm", write_arm(tmp_path / "a.urdf"), Stated(payload=0.5))
    text = write_schema(tmp_path, RobotModel) + write_model_text(model, figures, "x.urdf", True, False)
    assert text.startswith("# yaml-language-server: $schema=schema.json\n")
    schema, fields = json.loads((tmp_path / "schema.json").read_text()), yaml.safe_load(text)
    jsonschema.validate(fields, schema)
    with pytest.raises(jsonschema.ValidationError, match="wear_axis"):
        jsonschema.validate(fields | {"wear_axis": ["j1"]}, schema)
    assert {"name", "robot", "runs"} <= set(DatasetFields.model_json_schema()["required"])
