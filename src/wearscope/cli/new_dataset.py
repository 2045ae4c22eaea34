"""`wearscope new dataset`."""

import re
from collections.abc import Callable
from pathlib import Path

import click
import yaml

from wearscope import limits
from wearscope.cli.new_robot import Numbers, name_after
from wearscope.cli.progress import say
from wearscope.errors import InputError

READINGS = ("motor", "link", "without_gravity", "none")


def _pattern(kind: str):  # type: ignore[no-untyped-def]
    left_out = ", or 'none'" if kind in ("velocity", "temperature") else ""
    text = f"Columns of the {kind}: with '*' for the joint's name or number, or one for each joint{left_out}."
    return click.option(f"--{kind}", metavar="'NAME_*'|A,B", help=text)


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--urdf", required=True, type=click.Path(path_type=Path), help="Of the robot, as its maker published it."
)
@click.option("--name", help="Of the data set and its folder; made of the URDF's name if left out.")
@click.option(
    "--in", "folder", type=click.Path(path_type=Path), default=Path(), help="Where the folder is made."
)
@click.option("--joints", default="", metavar="A,B,...", help="Joints, in order; all that move if left out.")
@click.option(
    "--test", multiple=True, metavar="FILE", help="Recording that is only scored; the last one if left out."
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
              help="Servo, or its constants: its torque is that of the drive's law.")  # fmt: skip
@click.option("--time", metavar="NAME", help="Column of the time.")
@click.option(
    "--time-unit", type=click.Choice(["s", "ms", "us", "ns", "d"]), help="Told by the step if left out."
)
@click.option(
    "--rate", type=click.FloatRange(min=0.0, min_open=True), help="Samples a second, where there is no clock."
)
@click.option(
    "--position-unit",
    "position_units",
    multiple=True,
    type=click.Choice(["rad", "deg", "m", "mm"]),
    help="Told by name or size if left out; twice where joints turn and slide.",
)
@click.option(
    "--counts-per-turn",
    type=Numbers(),
    default=(),
    metavar="X,X,...",
    help="Positions are counts: in a turn, or in a metre where a joint slides.",
)
@click.option(
    "--side", type=click.Choice(["joint", "motor"]), default="joint", show_default=True, help="Of positions."
)
@click.option(
    "--torque-side",
    type=click.Choice(["joint", "motor"]),
    default="joint",
    show_default=True,
    help="Of torques.",
)
@click.option(
    "--gear-ratio", type=Numbers(), default=(), metavar="X,X,...", help="Motor turns per joint turn."
)
@click.option(
    "--torque-constant",
    type=Numbers(),
    default=(),
    metavar="X,X,...",
    help="N m/A of currents, or N m by unit of the torque columns.",
)
@click.option("--turn", "turned", default="", metavar="A,B,...",
              help="Columns of the data set (q_JOINT, tau_JOINT) that are turned round.")  # fmt: skip
@click.option("--shift", "shifted", multiple=True, metavar="q_JOINT=X",
              help="Added to a position of the data set [rad or m].")  # fmt: skip
@click.option("--scale", "scaled", multiple=True, metavar="q_JOINT=X",
              help="A position of the data set, and its speed, times this.")  # fmt: skip
@click.option("--torque-gain", "torque_gain", multiple=True, metavar="JOINT=X",
              help="A torque of the data set times this.")  # fmt: skip
@click.option("--time-scale", type=click.FloatRange(min=0.0, min_open=True),
              help="True time over the recorded one, of a clock that is wrong.")  # fmt: skip
@click.option(
    "--columns", default="", metavar="A,B,...", help="Names of the columns, of files that have none."
)
@click.option("--reading", "readings", multiple=True, metavar="[JOINT=]READING",
              help="What the torques are: motor, link, without_gravity or none.")  # fmt: skip
@click.option("--gravity", type=Numbers(), default=(), metavar="X,Y,Z",
              help="In the base frame [m/s^2]; 0,0,-9.81 if left out.")  # fmt: skip
@click.option("--session", "sessions", multiple=True, metavar="FILE=LABEL", help="Session of a recording.")
@click.option("--reference", multiple=True, metavar="LABEL",
              help="Healthy session; each recording is one, by its file's name.")  # fmt: skip
@click.option("--payload-of", "payloads", multiple=True, metavar="FILE=KG[,X,Y,Z]",
              help="Payload of one recording, and its centre.")  # fmt: skip
@click.option("--topic", help="Of the joint states in a ROS 2 bag.")
@click.option("--payload", type=float, help="Mass at the flange in all recordings [kg].")
@click.option(
    "--payload-com", nargs=3, type=float, default=(0.0, 0.0, 0.0), help="Its centre in the last link [m]."
)
@click.option("--inertials", type=click.Choice(["approximate", "trusted"]), default="approximate",
              help="Whether the URDF's masses are refitted, or trusted.")  # fmt: skip
@click.option("--declare", default="rigid_body,rotor_inertia,coulomb,viscous", show_default=True,
              help="Effects that the model has to begin with.")  # fmt: skip
@click.option("--accept", multiple=True, help="Check to ignore; paste the text that its sentence names.")
def dataset(recordings, urdf, name, folder, joints, declare, servo, turned, **stated):  # type: ignore[no-untyped-def]
    """Make a data set from RECORDINGS: CSV of any separator, Parquet, ROS 2 bags, MCAP or LeRobot.

    What is guessed (columns, units, clock, rate, which recording is the test) is said, and stands in
    dataset.yaml. The data set is checked before it is kept.

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
        found.problems = [
            _name_given(one, made, target, urdf, recordings, converted.runs) for one in found.problems
        ]
        if found.problems:
            say(*(f"  wrong: {problem}" for problem in found.problems[:-1]))
            raise InputError(_name_option(found.problems[-1]))
    say(*(f"  {note.replace(str(made), str(target))}" for note in found.notes[: limits.PROBLEMS]))
    following = "track" if mapped.reference else "diagnose"
    say(f"Written: {target}, which passes its check. Next: wearscope {following} {target}")


def _name_given(problem, made, target, urdf, recordings, runs):  # type: ignore[no-untyped-def]
    """A problem of the copy, told by the names of the given files."""
    given = {file.name: file for file in recordings}
    for run in runs:
        if run.file in given:
            part = run.name.removeprefix(given[run.file].stem)
            told = {"_first": " (its first part)", "_last": " (its last part)"}.get(part, "")
            problem = problem.replace(str(made / "runs" / f"{run.name}.parquet"), f"{given[run.file]}{told}")
    return problem.replace(str(made / "robot.urdf"), str(urdf)).replace(str(made), str(target))


def _split(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _read_readings(entries: tuple[str, ...]) -> dict[str, str]:
    """Readings by joint; a reading for all joints has an empty name."""
    found = {}
    for entry in entries:
        joint, _, reading = entry.rpartition("=")
        if reading not in READINGS:
            raise InputError(f"--reading {entry}: is no reading; give one of {', '.join(READINGS)}.")
        found[joint] = reading
    return found


def _read_columns(option: str, entries: tuple[str, ...]) -> dict[str, float]:
    found = {}
    for entry in ",".join(entries).split(",") if entries else ():
        column, _, size = entry.rpartition("=")
        try:
            found[column.strip()] = float(size)
        except ValueError:
            raise InputError(f"--{option} {entry}: is no COLUMN=NUMBER; write e.g. q_j2=1.5708.") from None
    return found


def _by_file(option: str, entries: tuple[str, ...], recordings: tuple[Path, ...]) -> dict[str, str]:
    """Values of an option that is given as FILE=VALUE, by the file's name."""
    found = {}
    for entry in entries:
        file, equals, value = entry.partition("=")
        if not equals or Path(file).name not in {one.name for one in recordings}:
            raise InputError(f"--{option} {entry}: is no FILE=VALUE of one of the recordings; correct it.")
        found[Path(file).name] = value
    return found


def _name_option(problem: str) -> str:
    """A refusal that names command-line options instead of lines of a dataset.yaml that is not kept."""
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
        "or leave the column out": "or leave it out with --velocity none",
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
    return values.replace(" ", "")
