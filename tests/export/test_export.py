"""Exported models against MuJoCo and Pinocchio, which share no code with ours."""

import json
import sys

import mujoco
import numpy as np
import pandas as pd
import pinocchio as pin
import pytest
from urdf_texts import Joint, describe_robot

from wearscope.cycles.base import required_torque
from wearscope.cycles.planned import PlannedMotion
from wearscope.errors import InputError
from wearscope.export.comparison import inverse_dynamics
from wearscope.export.formats import make_spec, write_mjcf, write_urdf
from wearscope.export.holdings import make_possible, take_holdings
from wearscope.export.run import FILES, export_model, list_parameters, tell_export
from wearscope.robots.model import load_model, make_model
from wearscope.robots.spatial import Inertia

TURNS, SLIDES = "-2 2 900 2", "-0.5 0.5 900 2"
FRAMES = {"turned": "0.1 0.4 -0.7", "principal": "0.3 0.2 0.1"}, {"turned": "0 0 0.2", "principal": "0 0.4 0"}
URDF = describe_robot(
    Joint("turn", "0 0 1", 40, "0.02 0 0.2", "1.5 1.4 1.0", "0 0 0.1", limits=TURNS, **FRAMES[0]),
    Joint("lift", "0 1 0.2", 20, "0.35 0.02 0", "0.2 1.3 1.2", "0.1 0 0.4", limits=TURNS, **FRAMES[1]),
    Joint("slide", "0 0 1", 8, "0 0 -0.2", "0.1 0.1 0.03", "0.7 0 0", "prismatic", SLIDES, "0 0.3 0"),
)
JOINTS = ["turn", "lift", "slide"]
HELD = [
    ("turn", "coulomb", {"level": 12.0}),
    ("lift", "coulomb", {"level": 7.0}),
    ("turn", "viscous", {"slope": 9.0}),
    ("slide", "viscous", {"slope": 30.0}),
    ("lift", "quadratic_viscous", {"curvature": 4.0}),
    ("lift", "joint_spring", {"stiffness": 60.0, "preload": -9.0}),
    ("turn", "rotor_inertia_error", {"inertia": 0.7}),
]


def make_arm(effects=HELD, **fields):
    entries = [{"joint": j, "effect": e, "parameters": p} for j, e, p in effects]
    base = {
        "name": "arm",
        "urdf": "arm.urdf",
        "joints": JOINTS,
        "gravity": [0.5, 0.0, -9.7],
        "payload": {"mass": 5.0, "com": [0.1, 0.05, 0.2], "inertia": [0.05, 0.0, 0.0, 0.06, 0.0, 0.04]},
        "drive": {
            "rotor_inertia": [6.0, 8.0, 5.0],
            "speed_limit": [1.5, 1.5, 0.5],
            "acceleration_limit": [6.0, 6.0, 3.0],
            "jerk_limit": [60.0, 60.0, 30.0],
        },
        "effects": entries,
    }
    return make_model({**base, **fields}, URDF)


@pytest.fixture(scope="module")
def motion():
    return PlannedMotion("points", seed=3, pace=0.7, size=0.8, seconds=8.0).build(make_arm(), 0.05, 0.004)


def test_mujoco_needs_the_same_torque(motion):
    model = make_arm()
    held = take_holdings(model, 50.0)
    ours = required_torque(motion, model, 50.0, 0.0, 1.0)
    # The rotor inertia beyond the declared one stands among the effects that required_torque adds.
    spec = make_spec(model, held)
    smooth = inverse_dynamics(spec, JOINTS, motion, friction=False)
    np.testing.assert_allclose(smooth, ours - held.friction * np.sign(motion.v), atol=1e-7)
    moving = np.abs(motion.v) > 0.05 * np.abs(motion.v).max(axis=0)
    theirs = inverse_dynamics(spec, JOINTS, motion)
    difference = np.where(moving, theirs - ours, 0.0)
    # Its friction is a soft constraint: at its level wherever the joint moves and does not brake hard.
    assert np.mean(np.abs(difference) < 1e-6) > 0.97
    assert [one for one in held.left if one.format == "MJCF"] == []


def test_the_mjcf_text_is_the_same_robot(motion):
    model = make_arm()
    held = take_holdings(model, 50.0)
    text = mujoco.MjSpec.from_string(write_mjcf(model, held))
    np.testing.assert_allclose(
        inverse_dynamics(text, JOINTS, motion), inverse_dynamics(make_spec(model, held), JOINTS, motion),
        rtol=1e-4, atol=0.05,
    )  # fmt: skip


def test_the_urdf_has_friction_damping_and_payload():
    model = make_arm()
    text = write_urdf(model, take_holdings(model, 50.0))
    built = pin.buildModelFromXML(text)
    assert built.damping.tolist() == pytest.approx([9.0, 0.0, 30.0])
    friction = getattr(built, "friction", None)
    if friction is not None:
        assert friction.tolist() == pytest.approx([12.0, 7.0, 0.0])
    assert sum(inertia.mass for inertia in built.inertias) == pytest.approx(40 + 20 + 8 + 5)
    q, v, a = np.array([0.3, -0.4, 0.1]), np.array([0.5, 0.2, -0.1]), np.array([1.0, -2.0, 0.5])
    built.gravity.linear = np.array(model.gravity)
    ours = model.rigid_body(model.declared_payload).inverse_dynamics(q[None], v[None], a[None])[0]
    np.testing.assert_allclose(pin.rnea(built, built.createData(), q, v, a), ours, rtol=1e-9)


def test_what_is_not_held_is_listed_by_format():
    effects = [
        *HELD,
        ("turn", "time_delay", {"delay": 0.002}),
        ("slide", "torque_offset", {"offset": 3.0}),
        ("slide", "joint_spring", {"stiffness": -5.0, "preload": 0.0}),
    ]
    left = {
        (one.format, one.joint, one.effect): one.reason for one in take_holdings(make_arm(effects), 50.0).left
    }
    for format in ("URDF", "MJCF"):
        assert {(format, "turn", "time_delay"), (format, "slide", "torque_offset")} <= left.keys()
    assert ("URDF", "lift", "quadratic_viscous") in left and ("MJCF", "lift", "quadratic_viscous") not in left
    assert ("URDF", "turn", "rotor_inertia") in left and ("MJCF", "turn", "rotor_inertia") not in left
    assert "not positive" in left["MJCF", "slide", "joint_spring"]


def test_a_payload_error_changes_the_payload(motion):
    error = {"mass": 2.0, "moment_x": 0.3, "moment_y": -0.1, "moment_z": 0.5}
    model = make_arm([("slide", "payload_error", error)])
    held = take_holdings(model, 50.0)
    assert held.body.payload.mass == pytest.approx(7.0)
    assert np.array(held.body.payload.com) * 7.0 == pytest.approx(np.array([0.8, 0.15, 1.5]))
    added = model.rigid_body().inertial_regressor(motion.q, motion.v, motion.a) @ held.corrected.ravel()
    wanted = required_torque(motion, model, 50.0, 0.0, 1.0) + added
    theirs = inverse_dynamics(make_spec(model, held), JOINTS, motion)
    if held.left and any(one.format == "MJCF" for one in held.left):
        # Only moments of inertia were raised, which gravity does not feel.
        assert np.sqrt(np.mean((theirs - wanted) ** 2)) < 0.02 * np.sqrt(np.mean(wanted**2))
    else:
        np.testing.assert_allclose(theirs, wanted, atol=1e-7)


def test_a_body_that_cannot_exist_keeps_mass_and_centre():
    impossible = Inertia(2.0, np.array([0.3, 0.0, 0.1]), np.diag([0.5, 0.01, 0.01])).to_parameters()
    body, grown = make_possible(impossible)
    assert grown > 0.0
    assert body.mass == 2.0 and body.com == pytest.approx([0.3, 0.0, 0.1])
    a, b, c = np.linalg.eigvalsh(body.tensor)
    assert a > 0.0 and a + b >= c
    possible = Inertia(2.0, np.zeros(3), np.diag([0.5, 0.4, 0.3]))
    assert make_possible(possible.to_parameters())[1] == 0.0


def test_the_table_has_values_units_and_intervals():
    verdict = {
        "verdict": [
            {"joint": "lift", "effect": "joint_spring", "parameters": {"stiffness": {"ci95": [50.0, 70.0]}}}
        ],
        "estimates": [
            {"joint": "turn", "effect": "coulomb", "parameters": {"level": {"ci95": [11.0, 13.0]}}}
        ],
    }
    table = list_parameters(make_arm(), verdict).set_index(["joint", "effect", "parameter"])
    spring = table.loc[("lift", "joint_spring", "stiffness")]
    assert (spring["value"], spring["low"], spring["high"]) == (60.0, 50.0, 70.0)
    assert spring["unit"] == "N m/rad"
    assert table.loc[("turn", "coulomb", "level"), "high"] == 13.0
    assert np.isnan(table.loc[("slide", "viscous", "slope"), "low"])
    assert table.loc[("slide", "viscous", "slope"), "unit"] == "N s/m"


def test_all_files_are_written_and_the_difference_is_told(tmp_path):
    summary = export_model(load_model("config/robots/medium"), tmp_path)
    said = " ".join(tell_export(summary))
    assert "Not in MJCF: friction_wear_temperature of axis_1" in said
    assert said.count("run again without feedback: off by") == 3 and "rad after 2 s, at axis_" in said
    assert all((tmp_path / name).is_file() for name in FILES)
    assert json.loads((tmp_path / "export.json").read_text()) == summary
    for one in summary["mujoco"].values():
        assert one["difference_without_coulomb"] < 1e-6 * one["torque_rms"]
    assert len(pd.read_csv(tmp_path / "parameters.csv")) == 6 * 11 + 6
    # MuJoCo reads its own file, and the model file's limits are radians there.
    built = mujoco.MjModel.from_xml_path(str(tmp_path / "robot.xml"))
    low, high = load_model("config/robots/medium").position_limits
    np.testing.assert_allclose(built.jnt_range, np.column_stack([low, high]), rtol=1e-4)


def test_without_motion_limits_there_is_no_comparison(tmp_path):
    model = make_arm(drive={"rotor_inertia": [6.0, 8.0, 5.0]})
    assert export_model(model, tmp_path)["mujoco"] is None


def test_without_mujoco_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"wearscope\[export\]"):
        export_model(load_model("medium"), tmp_path)
    assert not list(tmp_path.iterdir())
