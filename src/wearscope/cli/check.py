"""The command `wearscope check`: all errors of a robot, data set, study or .py file in one list."""

import sys
from pathlib import Path

import click

from wearscope import limits
from wearscope.cli.progress import say
from wearscope.errors import InputError


@click.command()
@click.argument("things", nargs=-1, metavar="[THING]...")
@click.option("--allow-code", is_flag=True, help="Allow code that a study, model or data set names.")
@click.option("--robot", "robots", multiple=True, help="Robot that a test-cycle is for; may be repeated.")
def check(things: tuple[str, ...], allow_code: bool, robots: tuple[str, ...]) -> None:
    """List everything that is wrong with each THING, in seconds.

    A THING is a robot, a data set, a study (folder or configuration), or a .py file with a detector,
    test-cycle or effect, whose code then runs. The default is the study in this folder.

    \b
    Examples:
      wearscope check arm
      wearscope check arm-data my-study
      wearscope check my_detector.py
      wearscope check my_cycle.py --robot arm
    """
    wrong = 0
    for thing in things or (None,):
        found = inspect(thing, allow_code, robots)
        count, told = len(found.problems), found.problems[: limits.PROBLEMS]
        say(*(f"  {note}" for note in found.notes[: limits.PROBLEMS]))
        say(*(f"  wrong: {problem}" for problem in told))
        if count > len(told):
            say(f"  and {count - len(told)} more; correct these first.")
        wrong += count
        outcome = (
            "all well" if not count else "1 thing is wrong" if count == 1 else f"{count} things are wrong"
        )
        say(f"{found.what}: {outcome}")
    if wrong:
        sys.exit(1)


def inspect(thing: str | None, allow_code: bool = False, robots: tuple[str, ...] = ()):  # type: ignore[no-untyped-def]
    """Check a thing after finding out what it is.

    Parameters
    ----------
    thing : str
        Path, or the name of a robot or study of the platform; None for the working directory.
    allow_code : bool
        Whether code that the thing names may run.
    robots : tuple of str
        Robots on which a test-cycle is tried.

    Returns
    -------
    wearscope.errors.Findings

    Raises
    ------
    InputError
        Where it cannot be checked.
    """
    path = Path(thing or ".")
    if path.suffix == ".py":
        from wearscope.checking.own_code import check_file

        return check_file(path, robots)
    kind = _tell_kind(path)
    if kind == "dataset":
        from wearscope.checking.dataset import check_dataset

        return check_dataset(path, allow_code)
    if kind == "robot" or (kind == "" and _is_robot(str(path))):
        from wearscope.checking.robot import check_robot_folder

        return check_robot_folder(str(path), allow_code)
    from wearscope.checking.study import check_study
    from wearscope.cli.study import check_code_named, find_study, read_yaml

    place = find_study(thing)
    settings = read_yaml(place.config)
    check_code_named(place, settings, allow_code)
    return check_study(settings, f"study {place.config}", place.folder)


def _tell_kind(path: Path) -> str:
    """Return the kind of a thing: ``dataset``, ``robot`` or ``study``; "" if its path does not show it."""
    if path.is_dir():
        for name, kind in (
            ("dataset.yaml", "dataset"),
            ("model.yaml", "robot"),
            ("config/config.yaml", "study"),
        ):
            if (path / name).is_file():
                return kind
            if (other := (path / name).with_suffix(".yml")).is_file():
                raise InputError(f"{other}: is to be called {Path(name).name}; rename it.")
        return ""
    if not path.is_file():
        return ""
    if path.name == "dataset.yaml":
        return "dataset"
    if path.suffix not in (".yaml", ".yml"):
        raise InputError(f"{path}: is no robot, data set, study or .py file; name one of them.")
    from wearscope.cli.study import read_yaml

    content = read_yaml(path)
    if "declared_effects" in content or "runs" in content:
        return "dataset"
    return "robot" if "urdf" in content or "joints" in content else "study"


def _is_robot(thing: str) -> bool:
    """Return whether there is a robot of this name."""
    from wearscope.robots.model_file import find_model

    try:
        find_model(thing)
    except InputError:
        return False
    return True
