"""A model file as text, each value with where it is from."""

from collections.abc import Mapping

from wearscope.robots.model import RobotModel
from wearscope.starters.figures import Figures
from wearscope.starters.robot import USUAL
from wearscope.starters.writing import fill_template

_UNITS = {
    "gear_ratio": "motor rad per joint unit",
    "rotor_inertia": "at the joint, kg m^2 (kg)",
    "torque_limit": "N m (N)",
    "speed_limit": "rad/s (m/s)",
    "acceleration_limit": "rad/s^2 (m/s^2)",
}


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
    drive = {key: (unit, figures[key].describe(model.joints)) for key, unit in _UNITS.items()}
    jerk = ("rad/s^3 (m/s^3)", "assumed: 10 1/s times the acceleration limit")
    return fill_template(
        "model.yaml",
        model=model,
        drive=drive | {"jerk_limit": jerk},
        urdf=urdf,
        usual=USUAL,
        payload_given=payload_given,
        gravity_given=gravity_given,
    )
