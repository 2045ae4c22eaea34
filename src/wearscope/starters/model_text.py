"""A model file as text, each value with where it is from."""

from collections.abc import Mapping, Sequence

from wearscope.errors import escape_text
from wearscope.robots.model import RobotModel
from wearscope.starters.figures import Figures
from wearscope.starters.robot import USUAL
from wearscope.starters.writing import quote

_UNITS = {
    "gear_ratio": "motor rad per joint unit",
    "rotor_inertia": "at the joint, kg m^2 (kg)",
    "torque_limit": "N m (N)",
    "speed_limit": "rad/s (m/s)",
    "acceleration_limit": "rad/s^2 (m/s^2)",
    "jerk_limit": "rad/s^3 (m/s^3)",
}


def _flow(values: Sequence[object]) -> str:
    return (
        "[" + ", ".join(f"{one:.6g}" if isinstance(one, float) else quote(str(one)) for one in values) + "]"
    )


def write_model_text(
    model: RobotModel, figures: Mapping[str, Figures], urdf: str, payload_given: bool, gravity_given: bool
) -> str:
    """Content of ``model.yaml``.

    Parameters
    ----------
    model : RobotModel
    figures : mapping of str to Figures
        By field of the drive.
    urdf : str
        Where the URDF came from.
    payload_given, gravity_given : bool
    """
    joints, drive, sensors = model.joints, model.drive, model.sensors
    assumed = "given" if gravity_given else "assumed: upright on the floor"
    made = f"made by 'wearscope new robot' from {urdf}"
    lines = [
        "# Each number is marked given or assumed: replace what is assumed by what you know.",
        f"name: {quote(model.name)}",
        f"description: {quote(made)}",
        "urdf: robot.urdf # given; position limits are its own",
        f"joints: {_flow(joints)}",
        f"gravity: {_flow(model.gravity)} # m/s^2 in the base frame; {assumed}",
        "drive: # a value a joint, on the joint side",
    ]
    for key, unit in _UNITS.items():
        if key == "jerk_limit":
            origin = "assumed: 10 1/s times the acceleration limit"
        else:
            origin = figures[key].describe(joints)
        lines.append(f"  {key}: {_flow(getattr(drive, key))} # {unit}; {origin}")
    lines += [
        "sensors:",
        f"  encoder_resolution: {_flow(sensors.encoder_resolution or [])} # rad (m); assumed: 16 bit a turn",
        f"  torque_noise: {_flow(sensors.torque_noise or [])} # N m (N); assumed: 0.25 % of {USUAL}",
        f"  sample_rate: {sensors.sample_rate:g} # Hz; assumed",
    ]
    if model.payload is not None:
        told = "given: --payload" if payload_given else "assumed: 5 % of the moving mass"
        lines.append(f"payload: # in the frame of the last joint's link; {told}")
        lines += [f"  mass: {model.payload.mass:g} # kg", f"  com: {_flow(model.payload.com)} # m"]
    lines += [
        "controller: {bandwidth_hz: 6.0, damping: 1.0} # assumed",
        f"home: {_flow(model.home_posture.tolist())} # assumed: 0, or the middle of the range",
        f"wear_axes: {_flow(model.wear_joints)} # assumed: the first three",
        "effects:",
    ]
    for entry in model.effects:
        parameters = ", ".join(f"{name}: {value:.6g}" for name, value in entry.parameters.items())
        lines += [
            f"- joint: {quote(entry.joint)}",
            f"  effect: {entry.effect}",
            f"  parameters: {{{parameters}}}",
            f"  source: {quote(entry.source)}",
        ]
    return "\n".join(map(escape_text, lines)) + "\n"
