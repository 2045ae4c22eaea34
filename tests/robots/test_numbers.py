"""Numbers of a robot by their path: set as told, in the model's own checks, refused in one sentence."""

import numpy as np
import pytest
from urdf_texts import Joint, describe_robot

from wearscope.errors import InputError
from wearscope.robots.model import load_model, make_model
from wearscope.robots.numbers import Number, find_number, set_numbers


@pytest.fixture(scope="module")
def medium():
    return load_model("medium")


def put(model, path, level, relative=False):
    return set_numbers(model, [(Number(path, relative), level)])


def test_a_list_is_set_whole_at_a_joint_or_in_percent(medium):
    assert set(put(medium, "sensors.torque_noise", 2.0).torque_noise) == {2.0}
    one = put(medium, "sensors.torque_noise.axis_5", 2.0).torque_noise
    assert one[4] == 2.0 and (one[[0, 1, 2, 3, 5]] == medium.torque_noise[[0, 1, 2, 3, 5]]).all()
    assert (put(medium, "sensors.torque_noise.5", 2.0).torque_noise == one).all()
    twice = put(medium, "sensors.torque_noise", 100.0, relative=True).torque_noise
    assert twice == pytest.approx(2.0 * medium.torque_noise)


def test_single_numbers_and_short_lists(medium):
    assert put(medium, "controller.damping", 0.7).controller.damping == 0.7
    assert put(medium, "payload.mass", 20.0).payload.mass == 20.0
    assert put(medium, "payload.com.3", 0.1).payload.com == [*medium.payload.com[:2], 0.1]
    assert put(medium, "gravity.2", 0.5).gravity == [0.0, 0.5, -9.81]
    one = put(medium, "controller.bandwidth_hz.axis_2", 9.0).controller.bandwidth_hz
    assert one == [6.0, 9.0, 6.0, 6.0, 6.0, 6.0]


def test_where_the_cycles_go(medium, refuses):
    assert put(medium, "home.axis_2", 0.1).home_posture[1] == 0.1
    low, high = put(medium, "upper.3", -10.0, relative=True).position_limits
    assert high[2] == pytest.approx(0.9 * medium.position_limits[1][2])
    assert (low == medium.position_limits[0]).all() and find_number("upper.3 %").sets_motion
    refuses(put, medium, "home.axis_2", 9.0)


def test_an_effect_s_parameter_is_set_or_the_effect_added(medium):
    changed = put(medium, "effects.friction_wear_temperature.axis_2.eta0", 10.0, relative=True)
    for old, new in zip(medium.effects, changed.effects, strict=True):
        factor = 1.1 if old.joint == "axis_2" else 1.0
        assert new.parameters["eta0"] == pytest.approx(factor * old.parameters["eta0"])
    everywhere = put(medium, "effects.friction_wear_temperature.all.eta0", 50.0)
    assert {entry.parameters["eta0"] for entry in everywhere.effects} == {50.0}
    soft = put(medium, "effects.joint_elasticity.axis_5.compliance", 1e-5)
    assert soft.effects[-1].effect == "joint_elasticity" and soft.effects[-1].joint == "axis_5"
    assert len(soft.effects) == len(medium.effects) + 1


def gravity_torque(model, posture):
    still = np.zeros(model.n)
    return model.rigid_body().inverse_dynamics(np.array(posture), still, still)


def test_a_heavier_link_moves_the_gravity_torque_by_its_weight_times_its_lever():
    """A horizontal arm of one joint: m g l, for the mass and for the centre of mass."""
    arm = make_model(
        {"name": "one", "urdf": "one.urdf", "joints": ["lift"]},
        describe_robot(Joint("lift", "0 -1 0", 3, "0.5 0 0", "0.01 0.2 0.2", limits="-2 2 99 3")),
    )
    g = 9.81
    assert gravity_torque(arm, [0.0]) == pytest.approx([3.0 * g * 0.5])
    assert gravity_torque(put(arm, "links.lift.mass", 5.0), [0.0]) == pytest.approx([5.0 * g * 0.5])
    assert gravity_torque(put(arm, "links.1.mass", -10.0, relative=True), [0.0]) == pytest.approx(
        [2.7 * g * 0.5]
    )
    assert gravity_torque(put(arm, "links.lift.com.1", 0.7), [0.0]) == pytest.approx([3.0 * g * 0.7])
    both = [(Number("links.lift.mass"), 5.0), (Number("links.lift.com.1"), 0.7)]
    assert gravity_torque(set_numbers(arm, both), [0.0]) == pytest.approx([5.0 * g * 0.7])


def test_a_link_s_inertia_scales_with_its_mass_and_can_be_set_by_itself(medium):
    rest, spin = np.zeros(6), np.eye(6)[1]

    def moment(model):
        return model.rigid_body().inverse_dynamics(rest, rest, spin)[1] - gravity_torque(model, rest)[1]

    everything = put(medium, "links.all.mass", 20.0, relative=True)
    assert moment(everything) == pytest.approx(1.2 * moment(medium), rel=1e-9)
    assert gravity_torque(everything, rest) == pytest.approx(1.2 * gravity_torque(medium, rest), rel=1e-9)
    rounder = put(medium, "links.2.inertia", 10.0, relative=True)
    assert moment(rounder) > moment(medium)
    assert gravity_torque(rounder, rest) == pytest.approx(gravity_torque(medium, rest), rel=1e-9)


def test_the_model_itself_stays(medium):
    before = medium.to_mapping()
    put(medium, "drive.rotor_inertia", -20.0, relative=True)
    assert medium.to_mapping() == before and set_numbers(medium, []) is medium


def test_what_is_no_number_gets_one_sentence(medium, refuses):
    for path in (
        "sensors.noise", "sensors.torque_noise.axis_9", "sensors.torque_noise.7", "sensors.torque_noise.1.2",
        "parts.l1.mass", "links.l1.mass", "links.axis_2.weight", "links.mass", "links.axis_2.mass.1",
        "links.axis_2.com.4", "controller.damping.axis_1", "effects.backlash.axis_2",
        "effects.backlash.axis_2.width", "payload.com.x",
    ):  # fmt: skip
        refuses(put, medium, path, 1.0)
    refuses(put, medium, "effects.backlash.axis_2.lost_motion", 10.0, relative=True)
    with pytest.raises(InputError, match="is no number of robot 'medium': effects: there is no 'nothing'"):
        put(medium, "effects.nothing.axis_2.level", 1.0)


def test_what_a_model_cannot_have_is_refused(medium, refuses):
    refuses(put, medium, "sensors.torque_noise", -1.0)
    refuses(put, medium, "payload.mass", -200.0, relative=True)
    refuses(put, medium, "links.axis_2.mass", 0.0)
    refuses(put, medium, "links.axis_2.inertia.1", 1e3)
    refuses(put, medium, "sensors.sample_rate", 0.0)
    refuses(put, medium.replace(payload=None), "payload.mass", 1.0)


def test_a_kind_of_factor_that_is_a_path():
    assert find_number("payload.mass %") == Number("payload.mass", True)
    assert find_number("wear") is None and find_number("detectors.A.bins %") is None
    assert find_number("controller.damping").is_known and not find_number("payload.mass").is_known
    assert find_number("drive.speed_limit.axis_1").sets_motion
    assert not find_number("drive.torque_limit").sets_motion


def test_axes_count_the_wearing_joints_first(medium, refuses):
    assert medium.axes == medium.joints
    other = medium.replace(wear_axes=["axis_4", "axis_2"])
    assert other.axes == ["axis_4", "axis_2", "axis_1", "axis_3", "axis_5", "axis_6"]
    assert other.wearing([3, 1]).wear_joints == ["axis_1", "axis_4"]
    refuses(medium.wearing, [1, 7])
