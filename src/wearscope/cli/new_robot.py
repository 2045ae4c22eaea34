"""`wearscope new robot`."""

import re
from pathlib import Path

import click

from wearscope.cli.progress import say
from wearscope.errors import InputError


class Numbers(click.ParamType):
    """Numbers between commas or blanks: one for all joints, or one a joint."""

    name = "numbers"

    def convert(self, value, param, ctx):  # type: ignore[no-untyped-def]
        """Parse."""
        if not isinstance(value, str):
            return value
        try:
            return [float(word) for word in re.split(r"[,;\s]+", value.strip()) if word]
        except ValueError:
            self.fail(f"{value!r} holds other than numbers; write e.g. 8,12,5", param, ctx)


def _numbers(name: str, text: str):  # type: ignore[no-untyped-def]
    return click.option(name, type=Numbers(), default=(), metavar="X,X,...", help=text)


@click.command()
@click.argument("urdf", type=click.Path(path_type=Path))
@click.option("--name", help="Of the model and its folder; that of the file if left out.")
@click.option(
    "--in",
    "folder",
    type=click.Path(path_type=Path),
    default=Path(),
    help="Where the folder is made; here if left out.",
)
@click.option(
    "--joints", default="", metavar="A,B,...", help="Joints that move, in order; all that can if left out."
)
@_numbers("--coulomb", "Coulomb friction at each joint [N m or N].")
@_numbers("--viscous", "Viscous friction at each joint [N m s/rad or N s/m].")
@_numbers("--efficiency", "Instead: efficiency of each gear by its data sheet, e.g. 0.85.")
@_numbers(
    "--rated-torque", "Torque at the joint at which the efficiency holds; the torque limit if left out."
)
@_numbers("--gear-ratio", "Motor turns per joint turn.")
@_numbers("--rotor-inertia", "Of each motor [kg m^2], with --gear-ratio.")
@_numbers("--torque-limit", "Instead of the URDF's effort.")
@_numbers("--speed-limit", "Instead of the URDF's velocity.")
@_numbers("--acceleration-limit", "Of test-cycles; found from the torque limit if left out.")
@click.option("--payload", type=float, help="Mass at the flange [kg]; 0 for none.")
@click.option(
    "--payload-com",
    nargs=3,
    type=float,
    default=(0.0, 0.0, 0.05),
    show_default=True,
    help="In the last link [m].",
)
@click.option("--gravity", nargs=3, type=float, help="In the base frame; 0 0 -9.81 if left out.")
def robot(urdf, name, folder, joints, gravity, **stated):  # type: ignore[no-untyped-def]
    """Make a complete model of a robot from its URDF file.

    What the file or the options state is marked given, all else assumed, in the model file itself.
    Friction is the paper's eq. (17), with temperature and wear, scaled from the figures of each joint.

    \b
    Examples:
      wearscope new robot ur5.urdf
      wearscope new robot arm.urdf --coulomb 8,12,6,2,2,1 --viscous 12,15,8,2,2,1 --payload 5
      wearscope new robot arm.urdf --efficiency 0.8 --gear-ratio 101 --joints j1,j2,j3,j4,j5,j6
    """
    from wearscope.robots.model import RobotModel
    from wearscope.starters.robot import Stated, copy_urdf, make_robot, write_model_text
    from wearscope.starters.writing import check_folder_name, new_folder, refuse_existing, write_schema

    name = check_folder_name(name or name_after(urdf), "robot")
    target = folder / name
    refuse_existing(target)
    given = [part.strip() for part in joints.split(",") if part.strip()]
    if gravity is not None:
        stated["gravity"] = gravity
    model, figures, notes = make_robot(urdf, name, Stated(joints=given, **stated))
    text = write_model_text(model, figures, urdf.name, stated["payload"] is not None, gravity is not None)
    with new_folder(target) as made:
        (made / "model.yaml").write_text(write_schema(made, RobotModel) + text, encoding="utf-8")
        copy_urdf(urdf, made)
    say(*notes)
    _report(target, figures)


def name_after(urdf: Path) -> str:
    """A name made from the URDF's file name, or from its folder's where the file name says nothing."""
    stem = urdf.stem if urdf.stem != "robot" else urdf.resolve().parent.name
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", stem).strip("-._") or "robot"


def _report(target: Path, figures) -> None:  # type: ignore[no-untyped-def]
    from wearscope.checking.robot import check_robot_folder

    assumed = [name for name, one in figures.items() if not one.given.all()]
    if assumed:
        say(f"Assumed, in whole or in part: {', '.join(name.replace('_', ' ') for name in assumed)}.")
    found = check_robot_folder(target)
    say(*found.notes, *found.problems)
    say(f"Written: {target}. Next: edit {target}/model.yaml, then wearscope new study NAME --robot {target}")
    if found.problems:
        raise InputError(
            f"{target}: does not pass its own check; correct its model.yaml, or remove the folder and state "
            "the figures above by options."
        )
