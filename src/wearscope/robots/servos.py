"""The field `servo` of `dataset.yaml`: constants from which a servo's recorded columns give its torque."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from wearscope.errors import InputError, explain_breach

#: Columns that each law needs in addition to the position.
COLUMNS = {"voltage": ("goal",), "duty": ("duty",), "current": ("current",)}
#: Constants that each law needs.
CONSTANTS = {
    "voltage": ("kt", "resistance"),
    "duty": ("kt", "resistance"),
    "current": ("kt",),
}


def refuse_bool(value: Any) -> Any:
    """Refuse a truth value, which pydantic would otherwise read as 1 or 0."""
    if isinstance(value, bool):
        raise ValueError("should be a number")
    return value


_Positive = Annotated[float, BeforeValidator(refuse_bool), Field(gt=0.0, allow_inf_nan=False)]


class ServoFields(BaseModel):
    """Constants of a servo.

    Attributes
    ----------
    law : str
        How the torque is found. ``voltage``: the duty is the gain times the position error, up to
        `duty_limit`; ``duty``: the duty is recorded; ``current``: the current is recorded.
    kt : float
        Torque constant of the motor [N m/A].
    resistance : float or None
        Resistance of the winding [ohm].
    gain : float or None
        Duty (1 at full voltage) for each rad or m of position error; a column ``gain_<joint>`` replaces it.
    volts : float or None
        Supply voltage [V]; a column ``volts_<joint>`` replaces it.
    gear_ratio : float
        Motor turns for each turn of the joint; 1 where `kt` is that of the output shaft.
    duty_full : float
        Value of the duty column at full voltage.
    duty_limit : float
        Largest duty that the drive sets; 1 is full voltage.
    """

    model_config = ConfigDict(extra="forbid")

    law: Literal["voltage", "duty", "current"]
    kt: _Positive
    resistance: _Positive | None = None
    gain: _Positive | None = None
    volts: _Positive | None = None
    gear_ratio: _Positive = 1.0
    duty_full: _Positive = 1.0
    duty_limit: Annotated[float, BeforeValidator(refuse_bool), Field(gt=0.0, le=1.0)] = 1.0

    @property
    def constant(self) -> float:
        """Torque constant at the joint [N m/A]."""
        return self.kt * self.gear_ratio

    @property
    def back_emf(self) -> float:
        """Torque lost to the motor's back-EMF for each rad/s of the joint [N m s/rad]."""
        return 0.0 if self.law == "current" or self.resistance is None else self.constant**2 / self.resistance


def read_servos(where: str, stated: Any, joints: list[str]) -> dict[str, ServoFields]:
    """Read the field `servo`; return the servo of each joint that has one.

    Parameters
    ----------
    where : str
        File, for messages.
    stated : mapping or None
        One servo for all joints, or one for each joint's name.
    joints : list of str

    Raises
    ------
    InputError
        Where a constant is missing, unknown or not a positive number, or a joint is not in the data set.
    """
    if stated is None:
        return {}
    if not isinstance(stated, dict):
        raise InputError(f"{where}: servo should hold fields of its own, such as 'law: duty'; write them.")
    by_joint = bool(stated) and all(isinstance(one, dict) for one in stated.values())
    if not by_joint:
        stated = dict.fromkeys(joints, stated)
    servos = {}
    for joint, one in stated.items():
        if joint not in joints:
            raise InputError(
                f"{where}: servo: there is no joint '{joint}'; the joints are {', '.join(joints)}."
            )
        servos[joint] = read_servo(f"{where}: servo" + (f".{joint}" if by_joint else ""), one)
    return servos


def read_servo(where: str, stated: dict[str, Any]) -> ServoFields:
    """Read one servo from its constants; `InputError` names a constant that is missing or impossible."""
    try:
        servo = ServoFields.model_validate(stated)
    except ValidationError as error:
        first = error.errors()[0]
        name = str(first["loc"][0])
        if first["type"] == "missing":
            raise InputError(
                f"{where}: {name} is missing; state it as docs/measured-data.md says."
            ) from error
        if first["type"] == "extra_forbidden":
            known = ", ".join(ServoFields.model_fields)
            raise InputError(f"{where}: there is no field '{name}'; choose from {known}.") from error
        told = f"{explain_breach(error)}, but is {str(first['input'])[:40]}"
        raise InputError(f"{where}: {told}; correct it.") from error
    for name in CONSTANTS[servo.law]:
        if getattr(servo, name) is None:
            raise InputError(f"{where}: law {servo.law} needs {name}, which is missing; state it.")
    return servo
