"""`RobotModel`: all that the platform knows about a robot, stored as a YAML file with a URDF next to it."""

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import yaml
from pydantic import Field, PrivateAttr, ValidationError

from wearscope import limits
from wearscope.effects.base import Effect, Signals, load_effect
from wearscope.errors import InputError
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.fields import (
    Controller,
    DeclaredPayload,
    Drive,
    EffectEntry,
    Finite,
    Section,
    Sensors,
)
from wearscope.robots.model_file import (
    Allowed,
    check_code,
    find_model,
    list_effects,
    locate_effects,
    read_model_file,
    relate_effects,
)
from wearscope.robots.spatial import Array
from wearscope.robots.urdf import OPEN_LIMIT, normalise_urdf, parse_urdf
from wearscope.storage import tables


class RobotModel(Section):
    """A robot: kinematics and inertias from its URDF, drive train, sensors, payload, effects.

    Every list has one value for each joint, in the order of `joints`.
    """

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.\-]*$", max_length=limits.NAME)]
    """Used in file names: letters, digits, ``_``, ``-``, ``.``"""
    description: str = ""
    source: str = ""
    urdf: str
    """Path of the URDF, relative to the model file."""
    joints: Annotated[list[str], Field(min_length=1)]
    """Joints that move; the other joints of the URDF are locked at 0."""
    gravity: list[Finite] = Field(default=[0.0, 0.0, -9.81], min_length=3, max_length=3)
    """Gravity in the base frame [m/s^2]."""
    drive: Drive = Drive()
    sensors: Sensors = Sensors()
    payload: DeclaredPayload | None = None
    controller: Controller | None = None
    home: list[Finite] | None = None
    """Posture at which the test-cycles start and end; by default 0, or the middle of the range without 0."""
    lower: list[Finite] | None = None
    """Lower position limits; by default those of the URDF."""
    upper: list[Finite] | None = None
    """Upper position limits; by default those of the URDF."""
    wear_axes: list[str] | None = None
    """Joints that wear; by default the first three."""
    effects: list[EffectEntry] = Field(default=[])

    _urdf_text: str = PrivateAttr(default="")
    _kinds: list[str] = PrivateAttr(default_factory=list)
    _urdf_limits: tuple[list[float], list[float]] = PrivateAttr(default=([], []))

    @property
    def urdf_text(self) -> str:
        """Normalised URDF."""
        return self._urdf_text

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def position_units(self) -> list[str]:
        """``rad`` or ``m`` by joint."""
        return ["m" if kind == "prismatic" else "rad" for kind in self._kinds]

    @property
    def torque_units(self) -> list[str]:
        """``N m`` or ``N`` by joint."""
        return ["N" if kind == "prismatic" else "N m" for kind in self._kinds]

    @property
    def gear_ratio(self) -> Array:
        """Motor angle [rad] for a joint rad or m (n,); 1 where unknown."""
        return np.ones(self.n) if self.drive.gear_ratio is None else np.array(self.drive.gear_ratio)

    @property
    def rotor_inertia(self) -> Array:
        """Rotor inertia reflected to the joint (n,) [kg m^2 or kg]; 0 where unknown."""
        return np.zeros(self.n) if self.drive.rotor_inertia is None else np.array(self.drive.rotor_inertia)

    @property
    def torque_limit(self) -> Array:
        """Largest motor torque, as torque at the joint (n,) [N m or N]; infinite where unknown."""
        limit = self.drive.torque_limit
        return np.full(self.n, np.inf) if limit is None else np.array(limit)

    @property
    def encoder_resolution(self) -> Array:
        """Step of the recorded position on the joint side (n,) [rad or m]; 0 where unknown."""
        steps = self.sensors.encoder_resolution
        return np.zeros(self.n) if steps is None else np.array(steps)

    @property
    def torque_noise(self) -> Array:
        """Standard deviation of the torque's noise (n,) [N m or N]; 0 where unknown."""
        noise = self.sensors.torque_noise
        return np.zeros(self.n) if noise is None else np.array(noise)

    @property
    def position_limits(self) -> tuple[Array, Array]:
        """Lower and upper position limits (n,), infinite where there are none."""
        low = np.array(self._urdf_limits[0] if self.lower is None else self.lower)
        high = np.array(self._urdf_limits[1] if self.upper is None else self.upper)
        return np.where(low <= -OPEN_LIMIT, -np.inf, low), np.where(high >= OPEN_LIMIT, np.inf, high)

    @property
    def home_posture(self) -> Array:
        """Home posture (n,): `home`, or 0 where the limits contain it, or the middle of the range."""
        if self.home is not None:
            return np.array(self.home)
        lower, upper = self.position_limits
        middle = 0.5 * (np.where(np.isfinite(lower), lower, 0.0) + np.where(np.isfinite(upper), upper, 0.0))
        return np.where((lower < 0.0) & (upper > 0.0), 0.0, middle)

    @property
    def wear_joints(self) -> list[str]:
        """Joints that wear: `wear_axes`, or the first three joints."""
        return self.joints[:3] if self.wear_axes is None else self.wear_axes

    @property
    def axes(self) -> list[str]:
        """Joints in the order in which a study counts its axes: `wear_joints` first, then the others."""
        return [*self.wear_joints, *(name for name in self.joints if name not in self.wear_joints)]

    def wearing(self, axes: Sequence[int]) -> "RobotModel":
        """Return a copy on which these axes wear, in this order; the copy counts its `axes` anew.

        Raises
        ------
        InputError
            Where the robot has no such axis.
        """
        if max(axes) > self.n:
            raise InputError(f"axes: robot '{self.name}' has {self.n} axes; drop axis {max(axes)}.")
        return self.model_copy(update={"wear_axes": [self.axes[axis - 1] for axis in axes]})

    @property
    def declared_payload(self) -> Payload | None:
        """The payload that the controller assumes; None where the model declares none."""
        return None if self.payload is None else self.payload.to_payload()

    def motion_limits(self) -> tuple[Array, Array, Array]:
        """Speed, acceleration and jerk limits (n,) of a reference motion.

        Raises
        ------
        InputError
            Where the model lacks one of them.
        """
        drive = self.drive
        for key in ("speed_limit", "acceleration_limit", "jerk_limit"):
            if getattr(drive, key) is None:
                raise InputError(
                    f"{self.name}: drive.{key} is missing; test-cycles are planned within it, so add it."
                )
        return np.array(drive.speed_limit), np.array(drive.acceleration_limit), np.array(drive.jerk_limit)

    def rigid_body(self, payload: Payload | None = None) -> RigidBody:
        """Return the rigid-body dynamics with a payload such as `declared_payload`, by default without."""
        return _make_body(self._urdf_text, tuple(self.joints), tuple(self.gravity)).with_payload(payload)

    def to_mapping(self) -> dict[str, Any]:
        """Return the content of the model file, with the fields that were given only."""
        return self.model_dump(mode="json", exclude_unset=True)

    def replace(self, urdf_text: str | None = None, **changes: Any) -> "RobotModel":
        """Return a checked copy with changed fields, in the form of the model file, or with another URDF."""
        text = self._urdf_text if urdf_text is None else urdf_text
        return make_model({**self.to_mapping(), **changes}, text, self.name)

    def add_effects(self, entries: Sequence[Mapping[str, Any]]) -> "RobotModel":
        """Return a checked copy with added effects, in the form of the model file."""
        own = [entry.model_dump(mode="json", exclude_unset=True) for entry in self.effects]
        return self.replace(effects=[*own, *entries])


#: Detectors ask for the bodies at each recording; the cache parses the URDF once for each robot.
_make_body = lru_cache(maxsize=16)(RigidBody)


def make_model(
    fields: Mapping[str, Any], urdf: str | Path, where: str = "model", strict: bool = True
) -> RobotModel:
    """Build and check a model.

    Parameters
    ----------
    fields : mapping
        Content of the model file.
    urdf : str or Path
        Text or path of the URDF, which is normalised here.
    where : str
        Name of the model in messages, e.g. the path of its file.
    strict : bool
        Whether to refuse moving links whose inertia is missing or not physical, see
        `wearscope.robots.urdf.normalise_urdf`.

    Raises
    ------
    InputError
        Where a field is wrong; the sentence tells the first one.
    """
    try:
        model = RobotModel.model_validate(dict(fields))
    except ValidationError as error:
        raise InputError(f"{where}: {_explain_breach(error.errors()[0])}") from None
    if len(set(model.joints)) != model.n:
        raise InputError(f"{where}: joints: a joint is named twice; name each once.")
    _check_lists(model, where)
    model._urdf_text = normalise_urdf(urdf, model.joints, strict)
    found = {joint.name: joint for joint in parse_urdf(model._urdf_text).joints}
    ordered = [found[name] for name in model.joints]
    model._kinds = [joint.kind for joint in ordered]
    model._urdf_limits = [joint.lower for joint in ordered], [joint.upper for joint in ordered]
    _check_references(model, where)
    return model


def _explain_breach(breach: Any) -> str:
    """Describe an error of pydantic in one sentence that begins with the field."""
    place = ""
    for part in breach["loc"]:
        place += f"[{part}]" if isinstance(part, int) else f".{part}" if place else str(part)
    if breach["type"] == "extra_forbidden":
        return f"{place}: there is no such key; remove it or correct its spelling."
    if breach["type"] == "missing":
        return f"{place}: is missing; add it."
    given = "" if isinstance(breach["input"], dict) else f" (given: {breach['input']!r})"
    return f"{place}: {breach['msg'][0].lower() + breach['msg'][1:]}{given}; correct it."


def list_breaches(fields: Mapping[str, Any], where: str) -> list[str]:
    """Return one sentence for each field of a model file that is wrong by itself."""
    try:
        RobotModel.model_validate(dict(fields))
    except ValidationError as error:
        return [f"{where}: {_explain_breach(one)}" for one in error.errors()]
    return []


def _check_lists(model: RobotModel, where: str) -> None:
    """Refuse lists that do not have one value for each joint, and a gear ratio of 0."""
    lists = {
        **{f"drive.{key}": getattr(model.drive, key) for key in Drive.model_fields},
        "sensors.encoder_resolution": model.sensors.encoder_resolution,
        "sensors.torque_noise": model.sensors.torque_noise,
        "controller.bandwidth_hz": getattr(model.controller, "bandwidth_hz", None),
        "home": model.home,
        "lower": model.lower,
        "upper": model.upper,
    }
    for key, values in lists.items():
        if isinstance(values, list) and len(values) != model.n:
            raise InputError(
                f"{where}: {key} has {len(values)} values for {model.n} joints; give one value a joint."
            )
    if model.drive.gear_ratio is not None and 0.0 in model.drive.gear_ratio:
        raise InputError(f"{where}: drive.gear_ratio holds a 0; give motor turns per joint turn.")


def _check_references(model: RobotModel, where: str) -> None:
    """Refuse names of joints that do not exist, joints without range, and a home outside the limits."""
    for key, names in (
        ("wear_axes", model.wear_joints),
        *((f"effects[{k}].joint", [entry.joint]) for k, entry in enumerate(model.effects)),
    ):
        for name in names:
            if name not in model.joints:
                raise InputError(
                    f"{where}: {key}: there is no joint '{name}'; choose one of {', '.join(model.joints)}."
                )
    lower, upper = model.position_limits
    home = model.home_posture
    for k, name in enumerate(model.joints):
        if lower[k] >= upper[k]:
            raise InputError(
                f"{where}: joint '{name}' has no room between lower and upper limit; correct them."
            )
        if not lower[k] <= home[k] <= upper[k]:
            raise InputError(
                f"{where}: home of joint '{name}' is {home[k]:g}, outside its limits {lower[k]:g} to "
                f"{upper[k]:g}; move it inside."
            )


def check_effects(model: RobotModel) -> None:
    """Refuse effects and parameters that do not exist.

    Raises
    ------
    InputError
        Names the entry and what exists.
    """
    for k, entry in enumerate(model.effects):
        effect = load_effect(entry.effect).for_robot(model.n)
        effect.check_values(entry.parameters, f"{model.name}: effects[{k}] at joint '{entry.joint}'")


def add_torques(
    torque: Array, model: RobotModel, signals: Signals, counts: Callable[[Effect], bool]
) -> Array:
    """Add to torques (N, n) those of a robot's effects that count, each at its joint, along signals."""
    for entry in model.effects:
        effect = load_effect(entry.effect)
        if effect.row is not None and not effect.spread and counts(effect):
            joint = model.joints.index(entry.joint)
            torque[:, joint] += effect.torque(signals, joint, entry.parameters)
    return torque


def check_temperature(model: RobotModel, temperature: float) -> None:
    """Refuse a temperature [deg C] outside the range in which a joint's friction law is valid.

    Raises
    ------
    InputError
        Names the joint and the valid temperatures.
    """
    for entry in model.effects:
        low, high = load_effect(entry.effect).temperatures(entry.parameters)
        everywhere = low == -np.inf and high == np.inf
        if everywhere or low < temperature < high or temperature == high == np.inf:
            continue
        if low > high:
            remedy = "correct its parameters: it holds at no temperature"
        elif temperature <= low:
            remedy = f"choose a temperature above {low:.4g}"
        else:
            remedy = f"choose a temperature below {high:.4g}"
        raise InputError(
            f"{model.name}: temperature {temperature:g} deg C is outside the friction law of joint "
            f"'{entry.joint}' ({entry.effect}); {remedy}."
        )


def load_model(
    reference: str | Path,
    robots_dir: str | Path | None = None,
    strict: bool = True,
    allow_code: Allowed = False,
) -> RobotModel:
    """Load a model file.

    Parameters
    ----------
    reference : str or Path
        A model file, a folder that holds ``model.yaml``, or a name in `robots_dir`.
    robots_dir : str or Path, optional
        Folder of robots; ``config/robots`` by default.
    strict : bool
        Whether to refuse moving links whose inertia is missing or not physical.
    allow_code : bool or list of str
        Whether effects may be .py files, which run when the model is used: all, none, or those listed.

    Raises
    ------
    InputError
        Where the file cannot be read or breaks a rule; effects are checked by `check_effects`.
    """
    path = find_model(reference, robots_dir)
    fields = read_model_file(path)
    check_code(list_effects(fields, str(path)), allow_code, str(path))
    located = locate_effects(fields, path.parent)
    return make_model(located, path.parent / fields["urdf"], str(path), strict)


def save_model(model: RobotModel, path: str | Path) -> Path:
    """Write the model file, and next to it its normalised URDF; loading the file gives an equal model.

    Parameters
    ----------
    model : RobotModel
    path : str or Path
        E.g. ``model_after.yaml``; the URDF is then ``model_after.urdf``.

    Returns
    -------
    Path
        Path of the URDF.
    """
    path = Path(path)
    urdf = path.with_suffix(".urdf")
    fields = relate_effects({**model.to_mapping(), "urdf": urdf.name}, path.parent)
    text = yaml.safe_dump(fields, sort_keys=False, allow_unicode=True, width=100, default_flow_style=None)
    tables.write_text(urdf, model.urdf_text)
    tables.write_text(path, text)
    return urdf
