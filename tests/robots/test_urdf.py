"""URDF intake: physics kept, engines agree, every refusal says what to correct."""

import itertools
from pathlib import Path

import numpy as np
import pinocchio as pin
import pybullet
import pytest
from pybullet_utils.bullet_client import BulletClient
from urdf_texts import Joint, describe_robot

from wearscope import limits
from wearscope.errors import InputError
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.spatial import (
    Inertia,
    diagonalise_tensor,
    matrix_to_rpy,
    pseudo_inertia,
    rpy_to_matrix,
)
from wearscope.robots.urdf import normalise_tree, normalise_urdf, parse_urdf

#: Of a robot as a maker publishes it.
RICH = Path(__file__).with_name("rich.urdf").read_text(encoding="utf-8")
JOINTS = ["turn", "lift", "swing"]


def pinocchio_torque(q, v, a):
    """Inverse dynamics of RICH as it is, in Pinocchio's own reading (q of a continuous joint is cos, sin)."""
    model = pin.buildModelFromXML(RICH)
    at = {name: model.joints[model.getJointId(name)] for name in model.names}
    torque = np.empty_like(q)
    for row in range(len(q)):
        full_q, full_v, full_a = pin.neutral(model), np.zeros(model.nv), np.zeros(model.nv)
        full_q[at["turn"].idx_q : at["turn"].idx_q + 2] = np.cos(q[row, 0]), np.sin(q[row, 0])
        for k, name in enumerate(JOINTS):
            if name != "turn":
                full_q[at[name].idx_q] = q[row, k]
            full_v[at[name].idx_v], full_a[at[name].idx_v] = v[row, k], a[row, k]
        tau = pin.rnea(model, model.createData(), full_q, full_v, full_a)
        torque[row] = [tau[at[name].idx_v] for name in JOINTS]
    return torque


@pytest.fixture(scope="module")
def motion():
    return np.random.default_rng(1).normal(size=(3, 20, 3)) * np.array([1.0, 0.2, 1.0])


def test_lumping_keeps_the_torque(motion):
    body = RigidBody(normalise_urdf(RICH, JOINTS), JOINTS)
    np.testing.assert_allclose(
        body.inverse_dynamics(*motion), pinocchio_torque(*motion), rtol=1e-12, atol=1e-10
    )


def test_lumping_keeps_mass_and_centre():
    tree, notes = normalise_tree(RICH, JOINTS)
    forearm = tree.links["forearm"].inertia()
    parts = [(6.0, None), (0.3, (0.45, 0.02, 0)), (0.3, (0.4, 0, 0))]
    assert forearm.mass == pytest.approx(sum(mass for mass, _ in parts), rel=1e-15)
    finger = np.array([0.45, 0.02, 0.0]) + rpy_to_matrix((0.2, 0.1, 0.0)) @ [0.02, 0, 0]
    centre = (6.0 * np.array([0.2, 0, 0.1]) + 0.3 * finger + 0.3 * np.array([0.4, 0, 0])) / 6.6
    np.testing.assert_allclose(forearm.com, centre, atol=1e-15)
    assert notes == []


def test_result_is_plain():
    text = normalise_urdf(RICH, JOINTS)
    tree = parse_urdf(text)
    assert [joint.name for joint in tree.joints] == JOINTS
    assert list(tree.links) == ["world", "tower", "carriage", "forearm"]
    assert "mesh" not in text and "mimic" not in text and "continuous" not in text
    for name in ("tower", "carriage", "forearm"):
        assert not np.any(tree.links[name].tensor - np.diag(np.diag(tree.links[name].tensor)))
    lift, swing = tree.joints[1:]
    assert (lift.lower, lift.upper, lift.effort, lift.velocity) == (-0.2, 0.6, 900.0, 0.8)
    assert (swing.lower, swing.upper) == (-2.0, 2.0)
    assert tree.joints[0].lower <= -1e6 and tree.joints[0].upper >= 1e6


def test_normalising_twice_changes_nothing():
    once = normalise_urdf(RICH, JOINTS)
    assert normalise_urdf(once, JOINTS) == once
    assert normalise_urdf(once) == once


def test_reads_a_file(tmp_path):
    path = tmp_path / "robot.urdf"
    path.write_text(RICH)
    assert normalise_urdf(path, JOINTS) == normalise_urdf(RICH, JOINTS)


def test_pybullet_moves_as_pinocchio_says(tmp_path, motion):
    body = RigidBody(normalise_urdf(RICH, JOINTS), JOINTS)
    path = tmp_path / "robot.urdf"
    path.write_text(body.urdf_text())
    client = BulletClient(pybullet.DIRECT)
    robot = client.loadURDF(str(path), flags=pybullet.URDF_USE_INERTIA_FROM_FILE)
    client.setGravity(0, 0, -9.81)
    client.setTimeStep(1e-3)
    q, v, a = (x[0] for x in motion)
    for k in range(3):
        client.changeDynamics(robot, k, linearDamping=0, angularDamping=0, maxJointVelocity=1e6)
        client.resetJointState(robot, k, q[k], v[k])
        client.setJointMotorControl2(robot, k, pybullet.VELOCITY_CONTROL, force=0)
    forces = body.inverse_dynamics(q, v, a)
    client.setJointMotorControlArray(robot, range(3), pybullet.TORQUE_CONTROL, forces=forces)
    client.stepSimulation()
    after = [client.getJointState(robot, k)[1] for k in range(3)]
    np.testing.assert_allclose((np.array(after) - v) / 1e-3, a, atol=1e-9)


def test_branches_follow_the_callers_order():
    text = describe_robot(
        *(
            Joint(name, "0 1 0", k + 1, f"0.1 0.2 0.{k}", at="0 0 0.5", limits="-1 1 1 1", parent=parent)
            for k, (name, parent) in enumerate((("trunk", "base"), ("zeta", "l1"), ("alpha", "l1")))
        )
    )
    q, v, a = np.random.default_rng(2).normal(size=(3, 4, 3))
    names = ["trunk", "zeta", "alpha"]
    torque = RigidBody(normalise_urdf(text, names), names).inverse_dynamics(q, v, a)
    for order in itertools.permutations(range(3)):
        renamed = [names[k] for k in order]
        body = RigidBody(normalise_urdf(text, renamed), renamed)
        index = list(order)
        moved = [x[:, index] for x in (q, v, a)]
        np.testing.assert_allclose(body.inverse_dynamics(*moved), torque[:, index], rtol=1e-12, atol=1e-12)
        regressor = body.inertial_regressor(*moved)
        np.testing.assert_allclose(
            regressor @ body.inertial_parameters, torque[:, index], rtol=1e-10, atol=1e-10
        )
        np.testing.assert_allclose(
            body.mass_matrix(moved[0][0]) @ moved[2][0] + body.bias(moved[0][0], moved[1][0]),
            torque[0, index],
            rtol=1e-10,
            atol=1e-10,
        )


@pytest.mark.parametrize("pitch", [0.0, 0.4, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9])
def test_rpy_round_trip(pitch):
    rotation = rpy_to_matrix((0.7, pitch, -2.1))
    np.testing.assert_allclose(rpy_to_matrix(matrix_to_rpy(rotation)), rotation, atol=1e-15)


def test_principal_frame_is_the_nearest():
    rng = np.random.default_rng(3)
    for _ in range(20):
        factor = rng.normal(size=(3, 3))
        tensor = factor @ factor.T
        moments, axes = diagonalise_tensor(tensor)
        np.testing.assert_allclose(axes @ np.diag(moments) @ axes.T, tensor, atol=1e-13)
        assert np.linalg.det(axes) == pytest.approx(1.0)
        assert abs(matrix_to_rpy(axes)[1]) < 1.4
        # Of the 24 ways to name the axes so that they stay right-handed, none is nearer to the identity.
        for order in itertools.permutations(range(3)):
            for signs in itertools.product((1.0, -1.0), repeat=3):
                other = axes[:, order] * signs
                if np.linalg.det(other) > 0.0:
                    assert np.trace(other) <= np.trace(axes) + 1e-12


def test_parameters_round_trip():
    inertia = Inertia(3.0, np.array([0.1, -0.2, 0.3]), np.diag([1.0, 2.0, 1.5]) + 0.1)
    back = Inertia.from_parameters(inertia.to_parameters())
    assert back.mass == 3.0
    np.testing.assert_allclose(back.com, inertia.com, atol=1e-15)
    np.testing.assert_allclose(back.tensor, inertia.tensor, atol=1e-14)


SIMPLE = """<robot name="simple">
  <link name="base"/>
  <link name="arm">{inertial}</link>
  <joint name="hinge" type="{kind}"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
    <limit lower="{lower}" upper="1" effort="1" velocity="1"/></joint>
</robot>"""
INERTIAL = '<inertial><mass value="{mass}"/><inertia ixx="{ixx}" iyy="1" izz="1"/></inertial>'


def simple(inertial=None, kind="revolute", lower="-1", mass="2", ixx="1"):
    text = INERTIAL.format(mass=mass, ixx=ixx) if inertial is None else inertial
    return SIMPLE.format(inertial=text, kind=kind, lower=lower)


def test_refusals_say_what_to_mend(refuses):
    for text in (
        simple(inertial=""),
        simple(mass="0"),
        simple(mass="-1"),
        simple(mass="1e29"),
        simple(mass="nan"),
        simple(mass="a lot"),
        simple(ixx="3"),
        simple(ixx="-1"),
        simple(inertial='<inertial><mass value="2"/></inertial>'),
        simple(kind="planar"),
        simple(kind="floating"),
        simple(kind="wobbly"),
        simple(lower="2"),
        simple().replace("0 1 0", "0 0 0"),
        simple().replace('parent link="base"', 'parent link="floor"'),
        simple().replace('"arm"', '"base"'),
        simple().replace("</robot>", '<link name="stray"/></robot>'),
        simple().replace("</joint>", '<axis xyz="1 0 0"/></joint>'),
        simple().replace("</robot>", ""),
        simple().replace("robot", "model"),
        simple().replace("</robot>", '<x:macro xmlns:x="http://ros.org/wiki/xacro"/></robot>'),
    ):
        refuses(normalise_urdf, text, ["hinge"])
    for text, joints in (
        (simple(kind="floating"), None),
        (simple().replace('"hinge"', '"a&#x202e;b"'), None),
        (simple(), ["elbow"]),
        (simple(), ["hinge", "hinge"]),
        (simple(), []),
        ('<robot name="bare"/>', None),
        (RICH, ["thumb_joint"]),
        (RICH, ["finger_joint"]),
        ("/no/such/robot.urdf", None),
    ):
        refuses(normalise_urdf, text, joints)


def test_refusal_names_the_lumped_links(refuses):
    text = RICH.replace('<mass value="6"/>', '<mass value="0.001"/>').replace(
        'ixx="0.05" iyy', 'ixx="50" iyy'
    )
    refuses(normalise_urdf, text, JOINTS)


@pytest.mark.parametrize(
    ("text", "note"),
    [
        (simple(inertial=""), "link 'arm' has no mass"),
        (simple(ixx="3"), "the nearest one was taken"),
        (simple(inertial='<inertial><mass value="2"/></inertial>'), "the nearest one was taken"),
    ],
)
def test_leniency_mends_and_says_so(text, note):
    _, notes = normalise_tree(text, ["hinge"], strict=False)
    assert len(notes) == 1 and note in notes[0]
    body = RigidBody(normalise_urdf(text, ["hinge"], strict=False), ["hinge"])
    assert np.linalg.eigvalsh(pseudo_inertia(body.inertial_parameters))[0] > 0.0
    # What was corrected is accepted, and left alone, by the strict reading.
    assert normalise_urdf(body.urdf_text()) == body.urdf_text()


def test_rounding_of_the_triangle_inequality_is_mended_silently():
    tree, notes = normalise_tree(simple(ixx="2.0005"), ["hinge"])
    moments = np.diag(tree.links["arm"].tensor)
    assert notes == [] and moments.max() < moments.sum() - moments.max()
    np.testing.assert_allclose(moments, [2.0005, 1, 1], atol=1e-3)


def test_more_joints_than_a_robot_has_are_refused():
    n = limits.JOINTS + 1
    text = describe_robot(*(Joint(f"j{k}", kind="continuous") for k in range(n)))
    with pytest.raises(InputError, match=f"{n} joints move, more than {limits.JOINTS}; name those"):
        normalise_urdf(text)
