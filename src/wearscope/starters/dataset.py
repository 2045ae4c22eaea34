"""A measured-data folder of converted recordings."""

from collections.abc import Sequence
from pathlib import Path

from wearscope.errors import escape_text
from wearscope.starters.conversion import Converted
from wearscope.starters.mapped import Mapped
from wearscope.starters.uses import Recorded
from wearscope.starters.writing import quote
from wearscope.storage import tables
from wearscope.storage.files import copy_file


def write_dataset(folder: Path, name: str, urdf: Path, converted: Converted, mapped: Mapped) -> None:
    """Write a converted data set into a folder that is there.

    Parameters
    ----------
    folder : Path
    name : str
        Of the data set.
    urdf : Path
    converted : Converted
    mapped : Mapped
    """
    (folder / "runs").mkdir()
    copy_file(urdf, folder / "robot.urdf")
    units = {"t": "s"}
    for joint, slides in zip(converted.joints, converted.prismatic, strict=True):
        position, torque = ("m", "N") if slides else ("rad", "N m")
        units |= {
            f"q_{joint}": position,
            f"qd_{joint}": f"{position}/s",
            f"tau_{joint}": torque,
            f"temp_{joint}": "degC",
            f"goal_{joint}": position,
            f"duty_{joint}": "-",
            f"current_{joint}": "A",
            f"volts_{joint}": "V",
            f"gain_{joint}": f"1/{position}",
            f"on_{joint}": "-",
        }
    for run in converted.runs:
        own = {column: units[column] for column in run.frame.columns}
        frame = run.frame.assign(t=run.frame["t"] - run.frame["t"].iloc[0])
        tables.write_table(folder / "runs" / f"{run.name}.parquet", frame.reset_index(drop=True), own)
    (folder / "dataset.yaml").write_text(_describe_dataset(name, converted, mapped), encoding="utf-8")


def _describe_dataset(name: str, converted: Converted, mapped: Mapped) -> str:
    n = len(converted.joints)
    lines = ["# Made by 'wearscope new dataset'. What was guessed:"]
    lines += [f"#   {note}" for note in converted.notes]
    lines += [f"name: {quote(name)}", "robot:", "  urdf: robot.urdf", f"  joints: {_list(converted.joints)}"]
    told = "assumed: refitted where the runs determine them; trusted keeps the URDF's"
    lines.append(
        f"  inertials: {mapped.inertials} # {told if mapped.inertials == 'approximate' else 'given'}"
    )
    if mapped.gear_ratio:
        values = list(mapped.gear_ratio) * (n if len(mapped.gear_ratio) == 1 else 1)
        lines.append(f"  gear_ratio: [{', '.join(f'{one:g}' for one in values)}]")
    if mapped.gravity:
        lines.append(f"  gravity: [{', '.join(f'{one:g}' for one in mapped.gravity)}]")
    lines.append(f"sample_rate: {converted.rate:g}")
    if mapped.servo is not None:
        constants = mapped.servo.model_dump(exclude_none=True, exclude_defaults=True)
        lines += ["servo:", *(f"  {name}: {value}" for name, value in constants.items())]
    if any(converted.prismatic):
        mixed = not all(converted.prismatic)
        kinds = (
            ["m" if one else "rad" for one in converted.prismatic],
            ["N" if one else "N m" for one in converted.prismatic],
        )
        q, tau = (f"[{', '.join(one)}]" for one in kinds) if mixed else ("m", "N")
        lines.append(f"units: {{q: {q}, tau: {tau}}}")
    lines.append(f"declared_effects: {_list(mapped.declared)} # what the model has to begin with")
    if mapped.readings:
        common = mapped.readings.get("", "motor")
        every = {joint: mapped.readings.get(joint, common) for joint in converted.joints}
        parts = ", ".join(f"{quote(joint)}: {reading}" for joint, reading in every.items())
        told = next(iter(every.values())) if len(set(every.values())) == 1 else f"{{{parts}}}"
        lines.append(f"torque: {told}")
    if mapped.turned:
        lines.append(f"turned: {_list(mapped.turned)}")
    for field, stated in (("shifted", mapped.shifted), ("scaled", mapped.scaled)):
        parts = ", ".join(f"{quote(column)}: {by:.6g}" for column, by in stated.items())
        lines += [f"{field}: {{{parts}}}"] if stated else []
    if mapped.torque_gain:
        parts = ", ".join(f"{quote(joint)}: {by:.6g}" for joint, by in mapped.torque_gain.items())
        lines.append(f"torque_gain: {{{parts}}}")
    if mapped.time_scale is not None:
        lines.append(f"time_scale: {mapped.time_scale:.9g}")
    if mapped.reference:
        lines.append(f"reference: {_list(mapped.reference)}")
    if mapped.accept:
        lines.append("accept:")
        lines += [f"- {quote(one)}" for one in mapped.accept]
    lines.append("runs:")
    payload = None if mapped.payload is None else (mapped.payload, *mapped.payload_com)
    lines += [_describe_run(run, mapped, payload) for run in converted.runs]
    return "\n".join(map(escape_text, lines)) + "\n"


def _list(names: Sequence[str]) -> str:
    return f"[{', '.join(map(quote, names))}]"


def _describe_run(run: Recorded, mapped: Mapped, common: Sequence[float] | None) -> str:
    line = f"file: runs/{run.name}.parquet, use: {run.use}"
    carried = mapped.payloads.get(run.file, common)
    if carried is not None:
        mass, *com = carried
        line += f", payload: {{mass: {mass:g}, com: [{', '.join(f'{one:g}' for one in com or (0, 0, 0))}]}}"
    if session := mapped.sessions.get(run.file, run.name if mapped.reference else ""):
        line += f", session: {quote(session)}"
    return f"- {{{line}}}"
