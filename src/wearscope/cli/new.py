"""`wearscope new`: things to start from."""

from pathlib import Path

import click

from wearscope.cli.main import LazyGroup
from wearscope.cli.progress import say
from wearscope.errors import InputError

KINDS = {
    "study": "new:study",
    "robot": "new_robot:robot",
    "dataset": "new_dataset:dataset",
    "cycle": "new:cycle",
    "detector": "new:detector",
    "effect": "new:effect",
    "example": "new:example",
}


@click.group(cls=LazyGroup, places=KINDS)
def new() -> None:
    """Make a robot, data set, test-cycle, detector, effect or study to start from.

    What is made passes its own check ('wearscope check') as it is; nothing that is there is written over.
    """


_folder = click.option(
    "--in",
    "folder",
    type=click.Path(path_type=Path),
    default=Path(),
    help="Folder to write to; here if left out.",
)


@click.command()
@click.argument("name", type=click.Path(path_type=Path))
@click.option(
    "--robot", "robots", multiple=True, help="Robot by name or path, may be repeated; 'medium' if left out."
)
@click.option("--cycle", "cycles", multiple=True, help="Test-cycle by name or path, may be repeated.")
@click.option("--detector", "detectors", multiple=True, metavar="NAME=USE", help="Detector by name or path.")
@click.option(
    "--large", is_flag=True, help="As large as the paper's study; otherwise one of a minute or two."
)
def study(name, robots, cycles, detectors, large):  # type: ignore[no-untyped-def]
    """Make a folder NAME with a study in it, which runs without a clone.

    \b
    Examples:
      wearscope new study my-study
      wearscope new study my-study --robot arm --detector C=friction_fit --detector P=my_detector.py
      wearscope new study my-study --robot results/closed_loop/arm/model_after.yaml --large
    """
    from wearscope.starters.study import write_study

    used = {}
    for one in detectors:
        key, equals, use = one.partition("=")
        if not equals:
            key, use = Path(one).stem, one
        if not (key and use):
            raise InputError(f"--detector {one}: names none; write --detector NAME=USE.")
        used[key] = use
    say(*write_study(name, robots or ("medium",), cycles, used, large))
    _tell([name], f"wearscope run {name}")


@click.command()
@click.argument("name")
@click.option(
    "--via", "-p", "texts", multiple=True, metavar="'A B C'", help="A via point, a number a joint; repeated."
)
@click.option("--points", type=click.Path(path_type=Path), help="File with a via point a row, instead.")
@click.option("--unit", type=click.Choice(["share", "rad", "deg"]), default="share", show_default=True,
              help="Of the via points; shares, -1 to 1: of the way from home to the limit.")  # fmt: skip
@click.option(
    "--speed", type=float, default=0.6, show_default=True, help="Share of the robot's speed limits."
)
@click.option("--robot", default="medium", show_default=True, help="Robot that its test tries it on.")
@_folder
def cycle(name, texts, points, unit, speed, robot, folder):  # type: ignore[no-untyped-def]
    """Make a test-cycle NAME.py through via points, and its test.

    \b
    Examples:
      wearscope new cycle pick_and_place
      wearscope new cycle press_tending --via "0.5 0.3 -0.2" --via "-0.5 0.1 0.4"
      wearscope new cycle taught --points points.csv --unit deg --robot arm
    """
    from wearscope.starters.code import VIA, parse_points, read_points, write_cycle

    if texts and points:
        raise InputError("--via and --points: give one of them.")
    taken = read_points(points) if points else parse_points(texts) if texts else VIA
    place = str(Path(robot).resolve()) if Path(robot).exists() else robot
    following = f"wearscope check {folder / name}.py --robot {robot}"
    _tell(write_cycle(name, folder, taken, unit, speed, place), following)


@click.command()
@click.argument("name")
@_folder
def detector(name, folder):  # type: ignore[no-untyped-def]
    """Make a detector NAME.py and its test.

    \b
    Example:
      wearscope new detector peak_torque
    """
    from wearscope.starters.code import write_detector

    _tell(write_detector(name, folder), f"wearscope check {folder / name}.py")


@click.command()
@click.argument("name")
@_folder
def effect(name, folder):  # type: ignore[no-untyped-def]
    """Make an effect NAME.py (one formula for identification and simulation) and its test.

    \b
    Example:
      wearscope new effect cable_drag
    """
    from wearscope.starters.code import write_effect

    _tell(write_effect(name, folder), f"wearscope check {folder / name}.py")


@click.command()
@click.argument("name", type=click.Path(path_type=Path), default=Path("example"))
def example(name):  # type: ignore[no-untyped-def]
    """Make a folder NAME with a robot's URDF and recordings, to try the other commands on.

    NAME/machine is a data set as it is: 'wearscope diagnose NAME/machine'.

    \b
    Example:
      wearscope new example
    """
    from wearscope.starters.machine import write_example

    write_example(name)
    _tell([name], f"wearscope new dataset {name}/*.csv --urdf {name}/arm.urdf")


def _tell(paths, following: str) -> None:  # type: ignore[no-untyped-def]
    """Say what was written, and what to do next."""
    say(f"Written: {', '.join(map(str, paths))}. Next: {following}")
