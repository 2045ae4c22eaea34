"""Makes the true model of the twin, for comparison with the models that a closed loop gives."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from wearscope.demonstration.twin import SECRETS, TWIN, write_urdf
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel

#: Files of the twin's torques that no built-in effect describes exactly.
OWN_EFFECTS = {
    name: str(Path(__file__).with_name(f"{name}.py")) for name in ("gas_spring_torque", "thinning_oil")
}
#: Force of the relaxed gas spring [N].
FORCE = 1300.0
#: Coulomb friction per transmitted torque [-].
LOAD_SHARE = 0.045


def make_true_model(model: RobotModel, truth: Mapping[str, Any]) -> RobotModel:
    """Replace the effects in a model of the twin by the twin's true ones.

    Parameters
    ----------
    model : RobotModel
        Model that a closed loop made for the twin. Limits, home position, sensors and payload are kept, so
        that both models perform the same motions.
    truth : mapping
        What `wearscope.demonstration.twin.record_twin` returned.

    Raises
    ------
    InputError
        If the truth belongs to another robot.
    """
    planted = [one["effect"] for one in truth["planted"]]
    if truth["robot"] != TWIN.name or not set(planted) <= set(SECRETS):
        raise InputError(
            f"truth.json: it is of robot '{truth['robot']}' with {', '.join(planted) or 'nothing'} planted, "
            "not of the demonstration's twin; record the demonstration again."
        )
    spring = {"effect": OWN_EFFECTS["gas_spring_torque"], "parameters": {"force": FORCE}}
    load = {"effect": "load_dependent_friction", "parameters": {"coefficient": LOAD_SHARE}}
    own: list[dict[str, Any]] = [
        *({"joint": joint, "effect": "rigid_body"} for joint in TWIN.joints),
        *(
            {"joint": joint, "effect": effect, "parameters": {name: value}}
            for effect, name, values in (
                ("coulomb", "level", TWIN.coulomb),
                (OWN_EFFECTS["thinning_oil"], "slope", TWIN.viscous),
            )
            for joint, value in zip(TWIN.joints, values, strict=True)
        ),
        *(
            {"joint": one["joint"], **(spring if one["effect"] == SECRETS[0] else load)}
            for one in truth["planted"]
        ),
    ]
    noise = [truth["noise_rms"][joint] for joint in TWIN.joints]
    return model.replace(
        urdf_text=write_urdf(),
        name="twin-truth",
        description="The twin as it truly is.",
        sensors={**model.sensors.model_dump(mode="json", exclude_unset=True), "torque_noise": noise},
        effects=[one | {"source": "planted"} for one in own],
    )
