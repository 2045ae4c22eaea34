"""Numbers of a robot's model that a factor can set, by a path such as ``sensors.torque_noise.axis_2``."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from wearscope.effects.base import load_effect
from wearscope.errors import InputError
from wearscope.robots.fields import Controller, DeclaredPayload, Drive, Section, Sensors
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Inertia
from wearscope.robots.urdf import parse_urdf, replace_inertias

#: Sections of a model whose numbers have a path.
SECTIONS: dict[str, type[Section]] = {
    "drive": Drive,
    "sensors": Sensors,
    "payload": DeclaredPayload,
    "controller": Controller,
}
#: Lists by joint that are all zeros where a model does not state them.
ZERO_WHERE_UNKNOWN = ("rotor_inertia", "encoder_resolution", "torque_noise")
#: Lists by joint that set the range of a test-cycle: its first and last posture, and the position limits.
RANGE = ("home", "lower", "upper")
#: Numbers that a reference motion is planned with.
MOTION_LIMITS = ("drive.speed_limit", "drive.acceleration_limit", "drive.jerk_limit", *RANGE)
#: Numbers whose changed value the controller knows. Any other number changes only the machine: controller and
#: detectors keep using the model's value.
KNOWN = ("controller", "drive.torque_limit", *MOTION_LIMITS)
#: Sample rate of the recorder, which affects nothing else.
SAMPLE_RATE = "sensors.sample_rate"
#: Fields of a link that have a path. A changed mass scales the moments of inertia, so that the distribution
#: of the mass stays the same.
LINK = ("mass", "com", "inertia")
#: End of a kind of factor whose levels are changes in per cent.
_RELATIVE = " %"
_DETECTORS = "detectors"


@dataclass(frozen=True)
class Number:
    """A number of a robot's model.

    Attributes
    ----------
    path : str
        ``<section>.<field>``, ``<section>.<field>.<joint>``, ``home.<joint>``, ``links.<joint>.<field>`` for
        the link that a joint moves, or ``effects.<effect>.<joint>.<parameter>``. A joint is given by its name
        or its number in a study; ``all`` means all links, or all joints that have the effect.
    relative : bool
        Whether a level is a change in per cent of the model's number; otherwise it is the number itself.
    """

    path: str
    relative: bool = False

    @property
    def sets_motion(self) -> bool:
        """Whether reference motions are planned with the number."""
        return self._is_in(MOTION_LIMITS)

    @property
    def is_known(self) -> bool:
        """Whether the controller knows the changed value."""
        return self._is_in(KNOWN)

    def _is_in(self, paths: Sequence[str]) -> bool:
        """Return whether the path is one of `paths` or lies below one."""
        return any(self.path == one or self.path.startswith(f"{one}.") for one in paths)


def find_number(kind: str) -> Number | None:
    """Return the number of a robot that a kind of factor names; None for every other kind.

    Examples
    --------
    >>> find_number("sensors.torque_noise %")
    Number(path='sensors.torque_noise', relative=True)
    >>> find_number("temperature") is None, find_number("detectors.A.bins") is None
    (True, True)
    """
    path = kind.removesuffix(_RELATIVE)
    if "." not in path or is_detectors(kind):
        return None
    return Number(path, kind.endswith(_RELATIVE))


def is_detectors(kind: str) -> bool:
    """Return whether a kind of factor names an option of a detector: ``detectors.<name>.<option>``."""
    return kind.startswith(f"{_DETECTORS}.")


def set_numbers(model: RobotModel, numbers: Sequence[tuple[Number, float]]) -> RobotModel:
    """Return a model with changed numbers, checked as a model file is.

    Parameters
    ----------
    model : RobotModel
    numbers : sequence of (Number, level)
        A level is the number itself, in the model's unit, or a change in per cent.

    Raises
    ------
    InputError
        Where the model has no such number, or does not allow the value.
    """
    if not numbers:
        return model
    fields = copy.deepcopy(model.to_mapping())
    inertias: dict[str, Inertia] = {}
    for number, level in numbers:
        section, *rest = number.path.split(".")
        try:
            if section == "effects":
                fields["effects"] = _set_effect(model, fields.get("effects", []), rest, number, level)
            elif section == "gravity":
                fields["gravity"] = _change_list(model.gravity, rest, number, level, _index)
            elif section in RANGE:
                fields[section] = _set_range(model, fields, section, rest, number, level)
            elif section == "links":
                _set_links(model, inertias, rest, number, level)
            elif section in SECTIONS:
                fields[section] = _set_field(model, fields.get(section) or {}, section, rest, number, level)
            else:
                raise InputError(
                    f"the sections are {', '.join([*SECTIONS, *RANGE, 'gravity', 'links', 'effects'])}"
                )
        except InputError as error:
            raise InputError(
                f"'{number.path}' is no number of robot '{model.name}': {str(error).rstrip('.')}; correct "
                "the path."
            ) from None
    for joint, inertia in inertias.items():
        if not inertia.mass > 0.0:
            raise InputError(
                f"links.{joint}.mass: {inertia.mass:g} kg is no mass of a link of robot '{model.name}'; use "
                "levels that leave one above 0."
            )
    return model.replace(replace_inertias(model.urdf_text, inertias) if inertias else None, **fields)


def _set_field(
    model: RobotModel, given: dict[str, Any], section: str, rest: Sequence[str], number: Number, level: float
) -> dict[str, Any]:
    """Return a section's content with one field, or one joint's entry of it, changed."""
    known = SECTIONS[section].model_fields
    if not rest or rest[0] not in known:
        raise InputError(f"{section} has {', '.join(known)}")
    key, *place = rest
    stated = getattr(model, section)
    if stated is None and section == "controller":
        stated = Controller()
    old = None if stated is None else getattr(stated, key)
    if old is None:
        old = _assume(model, section, key, place, number)
    if isinstance(old, list):
        index = _index if section == "payload" else _joint
        new: Any = _change_list(old, place, number, level, lambda one: index(one, model))
    elif place and key == "bandwidth_hz":
        new = _change_list([old] * model.n, place, number, level, lambda one: _joint(one, model))
    elif place:
        raise InputError(f"{section}.{key} is one number; end the path there")
    else:
        new = _change(old, number, level)
    return {**given, key: new}


def _assume(model: RobotModel, section: str, key: str, place: Sequence[str], number: Number) -> Any:
    """Return the value of a field that the model does not state; refuse a field without a neutral value.

    A limit that is set for all joints gets a placeholder, as its old value does not count.
    """
    if key in ZERO_WHERE_UNKNOWN and not number.relative:
        return [0.0] * model.n
    if section == "drive" and not place and not number.relative:
        return [1.0] * model.n
    raise InputError(f"its model states no {section}.{key}; add it there")


def _set_range(
    model: RobotModel, given: dict[str, Any], section: str, rest: Sequence[str], number: Number, level: float
) -> list[float]:
    """Return `home`, `lower` or `upper` by joint with one entry, or all, changed."""
    lower, upper = model.position_limits
    stated = (
        given.get(section) or {"home": model.home_posture, "lower": lower, "upper": upper}[section].tolist()
    )
    changed = _change_list(stated, rest, number, level, lambda one: _joint(one, model))
    if not np.isfinite(changed).all():
        raise InputError(f"not every joint has a {section} limit; state them in its model")
    return changed


def _set_links(
    model: RobotModel, inertias: dict[str, Inertia], rest: Sequence[str], number: Number, level: float
) -> None:
    """Change a number of one link, or of all links, in the inertias by joint."""
    if len(rest) < 2 or rest[1] not in LINK:
        raise InputError(f"a link's is links.<joint>.<field>, and it has {', '.join(LINK)}")
    where, field, *place = rest
    tree = parse_urdf(model.urdf_text)
    own = {joint.name: tree.links[joint.child].inertia() for joint in tree.joints}
    for joint in model.joints if where == "all" else [model.joints[_joint(where, model)]]:
        inertias[joint] = _change_inertia(inertias.get(joint, own[joint]), field, place, number, level)


def _change_inertia(old: Inertia, field: str, place: Sequence[str], number: Number, level: float) -> Inertia:
    """Return an inertia with another mass (which scales the moments), centre of mass, or moments."""
    if field == "mass":
        if place:
            raise InputError("links.<joint>.mass is one number; end the path there")
        mass = _change(old.mass, number, level)
        return Inertia(mass, old.com, mass / old.mass * old.tensor)
    if field == "com":
        return replace(old, com=np.array(_change_list([*old.com], place, number, level, _index)))
    rows, columns = np.triu_indices(3)
    moments = _change_list([*old.tensor[rows, columns]], place, number, level, _index)
    tensor = np.zeros((3, 3))
    tensor[rows, columns] = tensor[columns, rows] = moments
    return replace(old, tensor=tensor)


def _set_effect(
    model: RobotModel, entries: Sequence[dict[str, Any]], rest: Sequence[str], number: Number, level: float
) -> list[dict[str, Any]]:
    """Return the effects with a parameter set at one joint or all; a missing effect is added at one joint."""
    if len(rest) != 3:
        raise InputError("an effect's is effects.<effect>.<joint>.<parameter>")
    name, where, parameter = rest
    effect = load_effect(name)
    known = {one.name: one for one in effect.parameters}
    if parameter not in known:
        raise InputError(f"{name} has {', '.join(known) or 'no parameters'}")
    joint = None if where == "all" else model.joints[_joint(where, model)]
    changed, found = [], False
    for entry in entries:
        if entry["effect"] == name and joint in (None, entry["joint"]):
            found = True
            values = dict(entry.get("parameters", {}))
            old = values.get(parameter, known[parameter].default)
            entry = {**entry, "parameters": {**values, parameter: _change(old, number, level)}}
        changed.append(entry)
    if found:
        return changed
    if joint is None or number.relative:
        raise InputError(f"its model has no {name} there, which a change in percent or 'all' needs")
    return [*changed, {"joint": joint, "effect": name, "parameters": {parameter: level}, "source": "factor"}]


def _change_list(
    old: Sequence[float], place: Sequence[str], number: Number, level: float, find: Any
) -> list[float]:
    """Return a list with one entry changed, or all; `find` turns the entry's name into its index."""
    chosen = range(len(old)) if not place else [find(place[0])]
    if len(place) > 1:
        raise InputError("it goes on after the entry of a list")
    if chosen[-1] >= len(old):
        raise InputError(f"the list has {len(old)} entries")
    return [_change(one, number, level) if k in chosen else one for k, one in enumerate(old)]


def _change(old: float, number: Number, level: float) -> float:
    """Return a number at a level, which is its value or a change in per cent."""
    return float(old * (1.0 + level / 100.0) if number.relative else level)


def _joint(name: str, model: RobotModel) -> int:
    """Return the index of a joint, given by its name or by its axis number in a study."""
    if name in model.joints:
        return model.joints.index(name)
    if name.isdecimal() and 1 <= int(name) <= model.n:
        return model.joints.index(model.axes[int(name) - 1])
    raise InputError(f"its joints are {', '.join(model.joints)}")


def _index(name: str, model: RobotModel | None = None) -> int:
    """Return the index of an entry that is counted from 1."""
    if name.isdecimal() and int(name) >= 1:
        return int(name) - 1
    raise InputError("count the entries of the list from 1")
