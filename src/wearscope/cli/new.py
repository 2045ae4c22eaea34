"""The command `wearscope new`: writes first versions of studies, robots, data sets and code."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import click
import yaml

from wearscope import limits
from wearscope.cli.main import LazyGroup
from wearscope.cli.progress import say
from wearscope.errors import InputError

KINDS = {
    "study": "new:study",
    "robot": "new:robot",
    "dataset": "new:dataset",
    "cycle": "new:cycle",
    "detector": "new:detector",
    "effect": "new:effect",
    "example": "new:example",
}


@click.group(cls=LazyGroup, places=KINDS)
def new() -> None:
    """Make a robot, data set, test-cycle, detector, effect or study to start from.

    The result passes its own check ('wearscope check') unchanged; existing files are never overwritten.
    """


_folder = click.option(
    "--in",
    "folder",
    type=click.Path(path_type=Path),
    default=Path(),
    help="Folder to write to; the working folder by default.",
)


@click.command()
@click.argument("name", type=click.Path(path_type=Path))
@click.option(
    "--robot", "robots", multiple=True, help="Robot by name or path, may be repeated; default: 'medium'."
)
@click.option("--cycle", "cycles", multiple=True, help="Test-cycle by name or path, may be repeated.")
@click.option("--detector", "detectors", multiple=True, metavar="NAME=USE", help="Detector by name or path.")
@click.option(
    "--large", is_flag=True, help="Study as large as the paper's; otherwise it takes a minute or two."
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
    "--via", "-p", "texts", multiple=True, metavar="'A B C'", help="Via point, a number per joint; repeated."
)
@click.option(
    "--points", type=click.Path(path_type=Path), help="Instead of --via: file with a via point per row."
)
@click.option("--unit", type=click.Choice(["share", "rad", "deg"]), default="share", show_default=True,
              help="Unit of via points; shares, -1 to 1, of the way from home to the limit.")  # fmt: skip
@click.option(
    "--speed", type=float, default=0.6, show_default=True, help="Share of the robot's speed limits."
)
@click.option("--robot", default="medium", show_default=True, help="Robot that its test uses.")
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
    """Make a folder NAME with a robot's URDF and recordings, for trying the other commands.

    NAME/machine is a complete data set: 'wearscope diagnose NAME/machine'.

    \b
    Example:
      wearscope new example
    """
    from wearscope.starters.machine import write_example

    write_example(name)
    _tell([name], f"wearscope new dataset {name}/*.csv --urdf {name}/arm.urdf")


def _tell(paths, following: str) -> None:  # type: ignore[no-untyped-def]
    """Print what was written, and the command to run next."""
    say(f"Written: {', '.join(map(str, paths))}. Next: {following}")


class Numbers(click.ParamType):
    """Type of an option with numbers between commas or blanks: one for all joints, or one for each."""

    name = "numbers"

    def convert(self, value, param, ctx):  # type: ignore[no-untyped-def]
        """Return the numbers in a text."""
        if not isinstance(value, str):
            return value
        try:
            return [float(word) for word in re.split(r"[,;\s]+", value.strip()) if word]
        except ValueError:
            self.fail(f"{value!r} holds other than numbers; write e.g. 8,12,5", param, ctx)


def _numbers(name: str, text: str):  # type: ignore[no-untyped-def]
    """Return an option that takes numbers."""
    return click.option(name, type=Numbers(), default=(), metavar="X,X,...", help=text)


@click.command()
@click.argument("urdf", type=click.Path(path_type=Path))
@click.option("--name", help="Name of the model and its folder; by default the URDF's name.")
@click.option(
    "--in",
    "folder",
    type=click.Path(path_type=Path),
    default=Path(),
    help="Where the folder is made; the working folder by default.",
)
@click.option(
    "--joints", default="", metavar="A,B,...", help="Joints that move, in order; by default all movable ones."
)
@_numbers("--coulomb", "Coulomb friction at each joint [N m or N].")
@_numbers("--viscous", "Viscous friction at each joint [N m s/rad or N s/m].")
@_numbers("--efficiency", "Instead of friction: efficiency of each gear by its data sheet, e.g. 0.85.")
@_numbers(
    "--rated-torque", "Joint torque at which the gear has this efficiency; by default the torque limit."
)
@_numbers("--gear-ratio", "Motor turns per joint turn.")
@_numbers("--rotor-inertia", "Inertia of each motor's rotor [kg m^2], with --gear-ratio.")
@_numbers("--torque-limit", "Torque limit of each joint, instead of the URDF's effort.")
@_numbers("--speed-limit", "Speed limit of each joint, instead of the URDF's velocity.")
@_numbers("--acceleration-limit", "Acceleration limit for test-cycles; by default from the torque limit.")
@click.option("--payload", type=float, help="Mass at the flange [kg]; 0 for none.")
@click.option(
    "--payload-com",
    nargs=3,
    type=float,
    default=(0.0, 0.0, 0.05),
    show_default=True,
    help="Centre of mass of the payload in the last link [m].",
)
@click.option("--gravity", nargs=3, type=float, help="Gravity in the base frame; default: 0 0 -9.81.")
def robot(urdf, name, folder, joints, gravity, **stated):  # type: ignore[no-untyped-def]
    """Make a complete model of a robot from its URDF file.

    The model file marks numbers from the URDF or the options as given, all others as assumed.
    Friction is the paper's eq. (17), with temperature and wear, scaled to the friction of each joint.

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
    """Return a name made from the URDF's file name; from its folder's where the file is `robot.urdf`."""
    stem = urdf.stem if urdf.stem != "robot" else urdf.resolve().parent.name
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", stem).strip("-._") or "robot"


def _report(target: Path, figures) -> None:  # type: ignore[no-untyped-def]
    """Print what was assumed about a new robot, check it, and print the command to run next."""
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


#: What a torque column may be, as `torque` in dataset.yaml states it.
READINGS = ("motor", "link", "without_gravity", "none")


def _pattern(kind: str):  # type: ignore[no-untyped-def]
    """Return the option that names the columns of a kind of signal."""
    left_out = ", or 'none'" if kind in ("velocity", "temperature") else ""
    text = f"Columns of the {kind}: with '*' for the joint's name or number, or one for each joint{left_out}."
    return click.option(f"--{kind}", metavar="'NAME_*'|A,B", help=text)


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--urdf", required=True, type=click.Path(path_type=Path), help="URDF, as the robot's maker published it."
)
@click.option("--name", help="Name of the data set and its folder; by default from the URDF's name.")
@click.option(
    "--in", "folder", type=click.Path(path_type=Path), default=Path(), help="Where the folder is made."
)
@click.option("--joints", default="", metavar="A,B,...", help="Joints, in order; by default all that move.")
@click.option(
    "--test", multiple=True, metavar="FILE", help="Recording for the test only; by default the last one."
)
@_pattern("position")
@_pattern("velocity")
@_pattern("torque")
@_pattern("current")
@_pattern("temperature")
@_pattern("goal")
@_pattern("duty")
@_pattern("gain")
@_pattern("volts")
@_pattern("on")
@click.option("--servo", metavar="NAME[,X=...]",
              help="Servo, or its constants; its torque is computed by the drive's law.")  # fmt: skip
@click.option("--time", metavar="NAME", help="Column of the time.")
@click.option(
    "--time-unit", type=click.Choice(["s", "ms", "us", "ns", "d"]), help="By default guessed from the step."
)
@click.option(
    "--rate", type=click.FloatRange(min=0.0, min_open=True), help="Sample rate [Hz], if there is no clock."
)
@click.option(
    "--position-unit",
    "position_units",
    multiple=True,
    type=click.Choice(["rad", "deg", "m", "mm"]),
    help="By default guessed; give one for revolute and one for prismatic joints.",
)
@click.option(
    "--counts-per-turn",
    type=Numbers(),
    default=(),
    metavar="X,X,...",
    help="Positions are counts: number per turn, or per metre of a prismatic joint.",
)
@click.option(
    "--side", type=click.Choice(["joint", "motor"]), default="joint", show_default=True,
    help="Side of the gear on which positions are measured.",
)  # fmt: skip
@click.option(
    "--torque-side",
    type=click.Choice(["joint", "motor"]),
    default="joint",
    show_default=True,
    help="Side of the gear to which torques relate.",
)
@click.option(
    "--gear-ratio", type=Numbers(), default=(), metavar="X,X,...", help="Motor turns per joint turn."
)
@click.option(
    "--torque-constant",
    type=Numbers(),
    default=(),
    metavar="X,X,...",
    help="N m/A for currents, or N m per unit of the torque columns.",
)
@click.option("--turn", "turned", default="", metavar="A,B,...",
              help="Columns of the data set (q_JOINT, tau_JOINT) with the opposite sign.")  # fmt: skip
@click.option("--shift", "shifted", multiple=True, metavar="q_JOINT=X",
              help="Offset that is added to a position of the data set [rad or m].")  # fmt: skip
@click.option("--scale", "scaled", multiple=True, metavar="q_JOINT=X",
              help="Factor on a position of the data set and on its speed.")  # fmt: skip
@click.option("--torque-gain", "torque_gain", multiple=True, metavar="JOINT=X",
              help="Factor on a torque of the data set.")  # fmt: skip
@click.option("--time-scale", type=click.FloatRange(min=0.0, min_open=True),
              help="True time divided by the recorded time, if the clock is wrong.")  # fmt: skip
@click.option(
    "--columns", default="", metavar="A,B,...", help="Names of the columns, for files without names."
)
@click.option("--reading", "readings", multiple=True, metavar="[JOINT=]READING",
              help="What the torque columns hold: motor, link, without_gravity or none.")  # fmt: skip
@click.option("--gravity", type=Numbers(), default=(), metavar="X,Y,Z",
              help="Gravity in the base frame [m/s^2]; default: 0,0,-9.81.")  # fmt: skip
@click.option("--session", "sessions", multiple=True, metavar="FILE=LABEL", help="Session of a recording.")
@click.option("--reference", multiple=True, metavar="LABEL",
              help="Healthy session; by default each recording is a session with its name.")  # fmt: skip
@click.option("--payload-of", "payloads", multiple=True, metavar="FILE=KG[,X,Y,Z]",
              help="Payload of one recording, and its centre of mass.")  # fmt: skip
@click.option("--topic", help="Topic of the joint states in a ROS 2 bag.")
@click.option("--payload", type=float, help="Mass at the flange in all recordings [kg].")
@click.option(
    "--payload-com", nargs=3, type=float, default=(0.0, 0.0, 0.0),
    help="Centre of mass of the payload in the last link [m].",
)  # fmt: skip
@click.option("--inertials", type=click.Choice(["approximate", "trusted"]), default="approximate",
              help="Whether the URDF's masses are refitted or trusted.")  # fmt: skip
@click.option("--declare", default="rigid_body,rotor_inertia,coulomb,viscous", show_default=True,
              help="Effects of the declared model.")  # fmt: skip
@click.option("--accept", multiple=True, help="Check to ignore; paste the text that its sentence names.")
def dataset(recordings, urdf, name, folder, joints, declare, servo, turned, **stated):  # type: ignore[no-untyped-def]
    """Make a data set from RECORDINGS: CSV with any separator, Parquet, ROS 2 bags, MCAP or LeRobot.

    Guesses (columns, units, clock, rate, which recording is the test) are printed and written to
    dataset.yaml. A data set that does not pass its check is not written.

    \b
    Examples:
      wearscope new dataset log1.csv log2.csv log3.csv --urdf ur5.urdf
      wearscope new dataset *.csv --urdf arm.urdf --torque-constant 0.11 --gear-ratio 101
      wearscope new dataset servo*.csv --urdf arm.urdf --servo xl330
      wearscope new dataset monday.mcap tuesday.mcap --urdf arm.urdf --topic /joint_states
    """
    from wearscope.checking.dataset import check_dataset
    from wearscope.closed_loop.intake.dataset_fields import DatasetFields
    from wearscope.robots.model_file import read_text
    from wearscope.starters.columns import KINDS
    from wearscope.starters.conversion import convert_recordings
    from wearscope.starters.dataset import write_dataset
    from wearscope.starters.mapped import Mapped
    from wearscope.starters.servos import SERVO_KINDS, read_servo_option
    from wearscope.starters.writing import check_folder_name, new_folder, refuse_existing, write_schema

    read_text(urdf, "the robot's URDF")
    name = check_folder_name(name or f"{name_after(urdf)}-data", "data set")
    target = folder / name
    refuse_existing(target)
    patterns = {kind: stated.pop(kind) for kind in (*KINDS, *SERVO_KINDS)}
    mapped = Mapped(
        joints=_split(joints),
        patterns={kind: one for kind, one in patterns.items() if one},
        declared=_split(declare),
        turned=_split(turned),
        accept=[code for one in stated.pop("accept") for code in _split(one)],
        sessions=_by_file("session", stated.pop("sessions"), recordings),
        reference=[label for one in stated.pop("reference") for label in _split(one)],
        payloads={
            file: Numbers().convert(one, None, None)
            for file, one in _by_file("payload-of", stated.pop("payloads"), recordings).items()
        },
        shifted=_read_columns("shift", stated.pop("shifted")),
        scaled=_read_columns("scale", stated.pop("scaled")),
        torque_gain=_read_columns("torque-gain", stated.pop("torque_gain")),
        columns=_split(stated.pop("columns")),
        readings=_read_readings(stated.pop("readings")),
        servo=None if servo is None else read_servo_option(servo),
        **stated,
    )
    converted = convert_recordings(recordings, urdf, mapped)
    say(*(f"  {note}" for note in converted.notes))
    with new_folder(target) as made:
        write_dataset(made, name, urdf, converted, mapped)
        file = made / "dataset.yaml"
        file.write_text(
            write_schema(made, DatasetFields) + file.read_text(encoding="utf-8"), encoding="utf-8"
        )
        found = check_dataset(made)
        given = [_name_given(one, made, target, urdf, recordings, converted.runs) for one in found.problems]
        found.problems = [
            _name_columns(_name_option(one), converted.joints, converted.columns) for one in given
        ]
        if found.problems:
            say(*(f"  wrong: {problem}" for problem in found.problems[:-1]))
            raise InputError(found.problems[-1])
    say(*(f"  {note.replace(str(made), str(target))}" for note in found.notes[: limits.PROBLEMS]))
    following = "track" if mapped.reference else "diagnose"
    say(f"Written: {target}, which passes its check. Next: wearscope {following} {target}")


def _name_given(problem, made, target, urdf, recordings, runs):  # type: ignore[no-untyped-def]
    """Return a problem of the temporary data set with the names of the user's files in place of its own."""
    given = {file.name: file for file in recordings}
    for run in runs:
        if run.file in given:
            part = run.name.removeprefix(given[run.file].stem)
            told = {"_first": " (its first part)", "_last": " (its last part)"}.get(part, "")
            problem = problem.replace(str(made / "runs" / f"{run.name}.parquet"), f"{given[run.file]}{told}")
    return problem.replace(str(made / "robot.urdf"), str(urdf)).replace(str(made), str(target))


def _split(text: str) -> list[str]:
    """Return the parts of a text between commas."""
    return [part.strip() for part in text.split(",") if part.strip()]


def _read_readings(entries: tuple[str, ...]) -> dict[str, str]:
    """Return the meaning of the torque column by joint; the empty name is for all joints."""
    found = {}
    for entry in entries:
        joint, _, reading = entry.rpartition("=")
        if reading not in READINGS:
            raise InputError(f"--reading {entry}: is no reading; give one of {', '.join(READINGS)}.")
        found[joint] = reading
    return found


def _read_columns(option: str, entries: tuple[str, ...]) -> dict[str, float]:
    """Return the numbers of an option that is given as NAME=NUMBER, by name."""
    found = {}
    for entry in ",".join(entries).split(",") if entries else ():
        column, _, size = entry.rpartition("=")
        try:
            found[column.strip()] = float(size)
        except ValueError:
            raise InputError(f"--{option} {entry}: is no COLUMN=NUMBER; write e.g. q_j2=1.5708.") from None
    return found


def _by_file(option: str, entries: tuple[str, ...], recordings: tuple[Path, ...]) -> dict[str, str]:
    """Return the values of an option that is given as FILE=VALUE, by the file's name."""
    found = {}
    for entry in entries:
        file, equals, value = entry.partition("=")
        if not equals or Path(file).name not in {one.name for one in recordings}:
            raise InputError(f"--{option} {entry}: is no FILE=VALUE of one of the recordings; correct it.")
        found[Path(file).name] = value
    return found


def _name_columns(problem: str, joints: Sequence[str], columns: Mapping[str, Sequence[str]]) -> str:
    """Return a problem whose exchanges are options that name the recordings' columns in another order.

    Parameters
    ----------
    problem : str
    joints : sequence of str
    columns : mapping of str to sequence of str
        The recordings' columns by kind of signal, in the order of the joints.
    """
    told = re.search(r"exchange '(?:q|tau)_.*?(?=[;.])", problem)
    if told is None:
        return problem
    ordered = {kind: list(own) for kind, own in columns.items()}
    for kind, one, other in re.findall(r"'(q|tau)_(\S+)' with '(?:q|tau)_(\S+)'", told[0]):
        i, j = joints.index(one), joints.index(other)
        for role in ("position", "velocity") if kind == "q" else ("torque", "current"):
            if own := ordered.get(role):
                own[i], own[j] = own[j], own[i]
    options = [f"--{kind} '{','.join(own)}'" for kind, own in ordered.items() if own != list(columns[kind])]
    return problem.replace(told[0], f"give {' '.join(options)}")


def _name_option(problem: str) -> str:
    """Return a problem whose remedy names command-line options in place of lines of dataset.yaml.

    The dataset.yaml of a refused data set is deleted, so that the user cannot edit it.
    """
    from wearscope.starters.mapped import DECLARED

    every = ",".join((*DECLARED, "time_delay"))
    remedies: dict[str, str | Callable[[re.Match[str]], str]] = {
        r'write "turned: \[(.*?)\]" in dataset.yaml': lambda found: f"give --turn {_close_up(found[1])}",
        r'write "time_scale: (\S+)" in dataset.yaml': r"give --time-scale \1",
        r'write "torque: (\w+)" in dataset.yaml': r"give --reading \1",
        r'write "gravity: \[(.*?)\]" below robot in dataset.yaml': (
            lambda found: f"give --gravity {_close_up(found[1])}"
        ),
        r'write "(shift|scale)e?d: {(.*?)}" in dataset.yaml': lambda found: " ".join(
            ["give", *(f"--{found[1]} {one.replace(': ', '=')}" for one in found[2].split(", "))]
        ),
        r'(add|write) "accept: \[(.*)\]" (to|in) dataset.yaml': lambda found: " ".join(
            ["give", *(f"--accept '{code}'" for code in yaml.safe_load(f"[{found[2]}]"))]
        ),
        "or declare time_delay": rf"\g<0> with --declare {every}",
        "or leave the columns? out": r"\g<0> with --velocity none",
        r"convert it to the joint's (rad|m)\b": "give --position-unit, or --side motor",
        r"give torque on the joint side of the gear in N m \(or N\)": (
            r"\g<0>, by --torque-constant or --torque-side motor"
        ),
        "and not in turns": r"\g<0> (those need --counts-per-turn 1)",
        r"'tau_(\S+)'(.*)leave the joint out": r"'tau_\1'\2leave it out with --reading \1=none",
    }
    for told, remedy in remedies.items():
        problem = re.sub(told, remedy, problem)
    return problem


def _close_up(values: str) -> str:
    """Return a text without blanks."""
    return values.replace(" ", "")
