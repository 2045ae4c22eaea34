"""Builds a complete robot model from a URDF: numbers that neither it nor the user states are assumed."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wearscope.errors import InputError
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.friction import SOURCE, friction_from_efficiency, scale_friction_law
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array
from wearscope.robots.urdf import OPEN_LIMIT, Joint, free_joints, movable_joints, normalise_urdf, parse_urdf
from wearscope.starters.figures import (
    START_TIME,
    Figures,
    assume,
    choose,
    fit_to_cycles,
    round_figures,
    take_option,
)
from wearscope.starters.writing import fill_template
from wearscope.storage.files import copy_file

# Least range of a joint [rad or m]; least and largest speed limit [rad/s or m/s].
LEAST_RANGE, SLOWEST, FASTEST = 1e-4, 5e-3, 1e3
# Values that are assumed where nothing is stated. `_find_usual` defines the usual torque.
SPEED = {"rad": 2.0, "m": 0.5}  # speed limit [rad/s, m/s]
MOTOR_SPEED = 300.0  # motor speed at the joint's speed limit [rad/s]
COULOMB_SHARE, VISCOUS_SHARE = 0.04, 0.03  # shares of the usual torque; viscous friction at the speed limit
ROTOR_TIME = 0.02  # time in which the usual torque brings the rotor alone to the speed limit [s]
PAYLOAD_SHARE = 0.05  # payload over the moving mass
NOISE_SHARE = 0.0025  # torque noise over the usual torque
TURN = 2.0 * np.pi / 2**16  # encoder step at the motor shaft [rad]
STRENGTH = 2.5  # torque limit over the torque that holds and starts the arm
POSTURES = 200  # random postures in which the arm's weight and inertia are computed
USUAL = "the usual torque (between the torque limit and what the arm needs)"


@dataclass(frozen=True)
class Stated:
    """Numbers that the user states about a robot, by joint; a single value is for all joints.

    Attributes
    ----------
    joints : list of str
        Joints that move; empty for all movable joints of the URDF.
    coulomb, viscous : list of float
        Friction on the joint side [N m or N; N m s/rad or N s/m].
    efficiency, rated_torque : list of float
        Efficiency of the gear [-], and the torque on the joint side at which it holds [N m or N].
    gear_ratio, rotor_inertia : list of float
        Motor angle for a joint rad or m [rad]; inertia of the motor's rotor [kg m^2].
    torque_limit, speed_limit, acceleration_limit : list of float
        Limits on the joint side.
    payload : float or None
        Mass [kg]; None assumes one.
    payload_com : tuple of float
        Centre of mass in the frame of the last joint's link [m].
    gravity : tuple of float
        Gravity in the base frame [m/s^2].
    """

    joints: Sequence[str] = ()
    coulomb: Sequence[float] = ()
    viscous: Sequence[float] = ()
    efficiency: Sequence[float] = ()
    rated_torque: Sequence[float] = ()
    gear_ratio: Sequence[float] = ()
    rotor_inertia: Sequence[float] = ()
    torque_limit: Sequence[float] = ()
    speed_limit: Sequence[float] = ()
    acceleration_limit: Sequence[float] = ()
    payload: float | None = None
    payload_com: Sequence[float] = (0.0, 0.0, 0.05)
    gravity: Sequence[float] = (0.0, 0.0, -9.81)


def make_robot(
    urdf: str | Path, name: str, stated: Stated
) -> tuple[RobotModel, dict[str, Figures], list[str]]:
    """Build a model from a URDF.

    Parameters
    ----------
    urdf : path-like
    name : str
        Name of the model.
    stated : Stated

    Returns
    -------
    RobotModel
    dict of str to Figures
        Numbers by joint with their origins, by field.
    list of str
        Notes for the user, such as limits that had to be raised.

    Raises
    ------
    InputError
        Where the URDF cannot be used, or a stated number is not valid.
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            return _make(urdf, name, stated)
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise InputError(
            f"{urdf}: its numbers are too large or too small to compute with ({error}); correct its masses, "
            "inertias and limits."
        ) from None


def _make(urdf: str | Path, name: str, stated: Stated) -> tuple[RobotModel, dict[str, Figures], list[str]]:
    """Build the model as `make_robot` does, without its handling of arithmetic errors."""
    tree = parse_urdf(urdf)
    joints, left = (list(stated.joints), []) if stated.joints else free_joints(tree)
    text = normalise_urdf(urdf, joints)
    chain = [joint for joint in movable_joints(tree) if joint in joints]
    if joints != chain:
        raise InputError(f"{urdf}: --joints: name each once, from the base on: {','.join(chain)}.")
    found = {joint.name: joint for joint in tree.joints}
    ordered = [found[joint] for joint in joints]
    n = len(joints)
    usual_speed = [SPEED["m" if joint.kind == "prismatic" else "rad"] for joint in ordered]
    limit = choose(
        take_option("speed-limit", stated.speed_limit, n, "above 0"),
        _from_urdf(ordered, "velocity"),
        assume(np.array(usual_speed), "the URDF states none"),
    )
    figures = {"speed_limit": limit}
    _refuse_odd(str(urdf), ordered, figures["speed_limit"])
    body = RigidBody(text, joints, list(stated.gravity))
    mass = float(sum(link.mass for link in parse_urdf(text).links.values()))
    payload = _choose_payload(stated, mass)
    loaded = (
        body.with_payload(Payload(payload["mass"], tuple(payload["com"]), (0.0,) * 6)) if payload else body
    )
    postures = _draw_postures(ordered)
    holding = np.max([np.abs(loaded.bias(q, np.zeros(n))) for q in postures], axis=0)
    inertia = np.max([np.diag(loaded.mass_matrix(q)) for q in postures], axis=0)
    speed = figures["speed_limit"].values
    swing = STRENGTH * (holding + 0.5 * inertia * speed / START_TIME)
    figures["torque_limit"] = choose(
        take_option("torque-limit", stated.torque_limit, n, "above 0"),
        _from_urdf(ordered, "effort"),
        assume(swing, f"{STRENGTH:g} times what holding and starting the arm takes"),
    )
    friction = _read_friction(stated, ordered, figures["torque_limit"].values, speed)
    usual = _find_usual(figures["torque_limit"].values, swing, friction, speed)
    figures |= _choose_drive(stated, n, speed, usual)
    figures |= _choose_friction(friction, usual, speed)
    fields = _make_fields(name, joints, stated, figures, payload, usual)
    model, notes = fit_to_cycles(fields, text, figures, stated.acceleration_limit, holding, inertia)
    return model, figures, [*left, *notes]


def _find_usual(limit: Array, needed: Array, friction: Mapping[str, Figures], speed: Array) -> Array:
    """Estimate the torque (n,) that a joint's drive typically gives; friction and noise are shares of it.

    The torque limit alone may be a placeholder far above what the joint needs. The torque that the arm needs
    may, at a light wrist, be far below what the drive can give. So the estimate is the geometric mean of the
    two. It is raised where stated friction implies a larger torque, and cut at the limit.
    """
    stated = [friction["coulomb"].values / COULOMB_SHARE, friction["viscous"].values * speed / VISCOUS_SHARE]
    return np.minimum(limit, np.nanmax([*stated, np.sqrt(limit * needed)], axis=0))


def _refuse_odd(urdf: str, ordered: Sequence[Joint], speed: Figures) -> None:
    """Refuse joints without range or with an impossible speed limit: no test-cycle could be planned."""
    for joint, value in zip(ordered, speed.values.tolist(), strict=True):
        if joint.upper - joint.lower < LEAST_RANGE:
            raise InputError(f"{urdf}: joint '{joint.name}' has no room between its limits; correct them.")
        if not SLOWEST <= value <= FASTEST:
            raise InputError(
                f"{urdf}: joint '{joint.name}' has the speed limit {value:g}, which is no robot's; state "
                "--speed-limit in rad/s, or m/s where it slides."
            )


def _from_urdf(ordered: Sequence[Joint], key: str, element: str = "limit") -> Figures:
    """Return a number that the URDF states for each joint; NaN where it states none."""
    values = np.array([getattr(joint, key) for joint in ordered])
    return Figures(
        np.where(values < OPEN_LIMIT, values, np.nan), (f"given: URDF, {element} {key}",) * len(ordered)
    )


def _choose_payload(stated: Stated, mass: float) -> dict[str, Any] | None:
    """Return the payload that the user states, or a share of the moving mass [kg]; None where it is 0."""
    chosen = float(f"{PAYLOAD_SHARE * mass:.2g}") if stated.payload is None else float(stated.payload)
    if not np.isfinite(chosen) or chosen < 0.0:
        raise InputError(f"--payload {chosen:g}: give a mass in kg, 0 for none.")
    return {"mass": chosen, "com": [float(x) for x in stated.payload_com]} if chosen > 0.0 else None


def _draw_postures(ordered: Sequence[Joint]) -> Array:
    """Draw postures (P, n) over the range of motion; the first is the posture nearest to zero."""
    low = np.array([max(joint.lower, -np.pi) for joint in ordered])
    high = np.array([min(joint.upper, np.pi) for joint in ordered])
    drawn = np.random.default_rng(0).uniform(low, high, (POSTURES, len(ordered)))
    return np.vstack([np.clip(0.0, low, high), drawn])


def _choose_drive(stated: Stated, n: int, speed: Array, usual: Array) -> dict[str, Figures]:
    """Return gear ratios, and rotor inertias as seen at the joints [kg m^2 or kg]."""
    gear = take_option("gear-ratio", stated.gear_ratio, n, "other than 0")
    ratio = choose(
        gear, assume(MOTOR_SPEED / speed, f"{MOTOR_SPEED:g} rad/s of the motor at the speed limit")
    )
    rotor = take_option("rotor-inertia", stated.rotor_inertia, n)
    if rotor is not None:
        if gear is None:
            raise InputError("--rotor-inertia: is that of the motor; give --gear-ratio with it.")
        origin = ("given: --rotor-inertia times the gear ratio squared",) * n
        rotor = Figures(rotor.values * ratio.values**2, origin)
    why = f"the rotor alone reaches the speed limit in {1000 * ROTOR_TIME:g} ms with {USUAL}"
    own = assume(ROTOR_TIME * usual / speed, why)
    return {"gear_ratio": ratio, "rotor_inertia": choose(rotor, own)}


def _read_friction(
    stated: Stated, ordered: Sequence[Joint], torque: Array, speed: Array
) -> dict[str, Figures]:
    """Return the friction that options or the URDF state; NaN where neither does."""
    n = len(ordered)
    efficiency = take_option("efficiency", stated.efficiency, n)
    losses: list[Figures | None] = [None, None]
    if efficiency is not None:
        rated = take_option("rated-torque", stated.rated_torque, n, "above 0")
        at = torque if rated is None else rated.values
        pairs = [friction_from_efficiency(*one) for one in zip(efficiency.values, at, speed, strict=True)]
        told = "the torque limit" if rated is None else "--rated-torque"
        origin = (f"given: --efficiency at {told}; that half is Coulomb and half viscous is assumed",) * n
        losses = [Figures(one, origin) for one in np.array(pairs).T]
    return {
        "coulomb": choose(
            take_option("coulomb", stated.coulomb, n),
            losses[0],
            _from_urdf(ordered, "friction", "dynamics"),
        ),
        "viscous": choose(
            take_option("viscous", stated.viscous, n),
            losses[1],
            _from_urdf(ordered, "damping", "dynamics"),
        ),
    }


def _choose_friction(read: Mapping[str, Figures], usual: Array, speed: Array) -> dict[str, Figures]:
    """Return the stated friction; where there is none, a share of the usual torque."""
    coulomb = assume(COULOMB_SHARE * usual, f"{100 * COULOMB_SHARE:g} % of {USUAL}")
    viscous = assume(VISCOUS_SHARE * usual / speed, f"{100 * VISCOUS_SHARE:g} % of {USUAL} at the limit")
    return {"coulomb": choose(read["coulomb"], coulomb), "viscous": choose(read["viscous"], viscous)}


def _make_fields(
    name: str,
    joints: Sequence[str],
    stated: Stated,
    figures: Mapping[str, Figures],
    payload: dict[str, Any] | None,
    usual: Array,
) -> dict[str, Any]:
    """Return the content of the model file, without the acceleration limits, which are found later."""
    n = len(joints)
    ratio = figures["gear_ratio"].values
    effects = [
        {
            "joint": joint,
            "effect": "friction_wear_temperature",
            "parameters": {
                key: float(f"{value:.6g}")
                for key, value in scale_friction_law(coulomb, viscous, gear).items()
            },
            "source": f"Coulomb {coulomb:.6g} {first}, viscous {viscous:.6g} {second}; {SOURCE}",
        }
        for joint, coulomb, first, viscous, second, gear in zip(
            joints,
            figures["coulomb"].values.tolist(),
            figures["coulomb"].origins,
            figures["viscous"].values.tolist(),
            figures["viscous"].origins,
            ratio.tolist(),
            strict=True,
        )
    ]
    return {
        "name": name,
        "urdf": "robot.urdf",
        "joints": list(joints),
        "gravity": [float(x) for x in stated.gravity],
        "drive": {
            "gear_ratio": round_figures(ratio),
            "rotor_inertia": round_figures(figures["rotor_inertia"].values),
            "torque_limit": round_figures(figures["torque_limit"].values),
            "speed_limit": round_figures(figures["speed_limit"].values),
        },
        "sensors": {
            "encoder_resolution": round_figures(TURN / np.abs(ratio)),
            "torque_noise": round_figures(NOISE_SHARE * usual),
            "sample_rate": 250.0,
        },
        **({"payload": payload} if payload else {}),
        "controller": {"bandwidth_hz": 6.0, "damping": 1.0},
        "wear_axes": list(joints[: min(3, n)]),
        "effects": effects,
    }


def copy_urdf(urdf: str | Path, folder: Path) -> None:
    """Copy the maker's URDF into the model's folder."""
    target = folder / "robot.urdf"
    if Path(urdf).resolve() != target.resolve():
        copy_file(urdf, target)


#: Units of the drive's fields, as comments in the model file state them.
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
    """Return the text of ``model.yaml``, with comments on the origin of each number.

    Parameters
    ----------
    model : RobotModel
    figures : mapping of str to Figures
        Numbers with origins, by field of the drive.
    urdf : str
        Original path of the URDF.
    payload_given, gravity_given : bool
        Whether the user stated them.
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
