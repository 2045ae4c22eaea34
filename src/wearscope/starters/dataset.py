"""Writes converted recordings as the folder of a measured data set."""

from collections.abc import Mapping
from pathlib import Path

from wearscope.starters.conversion import Converted
from wearscope.starters.mapped import Mapped
from wearscope.starters.writing import fill_template, quote
from wearscope.storage import tables
from wearscope.storage.files import copy_file


def write_dataset(folder: Path, name: str, urdf: Path, converted: Converted, mapped: Mapped) -> None:
    """Write a converted data set into an existing folder.

    Parameters
    ----------
    folder : Path
    name : str
        Name of the data set.
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
    """Return the text of `dataset.yaml`."""
    n = len(converted.joints)
    common = mapped.readings.get("", "motor")
    readings = {joint: mapped.readings.get(joint, common) for joint in converted.joints}
    torque = next(iter(readings.values())) if len(set(readings.values())) == 1 else _flow_texts(readings)
    units = {}
    if any(converted.prismatic):
        for column, slides, turns in (("q", "m", "rad"), ("tau", "N", "N m")):
            own = [slides if one else turns for one in converted.prismatic]
            units[column] = slides if all(converted.prismatic) else f"[{', '.join(own)}]"
    return fill_template(
        "dataset.yaml",
        name=name,
        notes=converted.notes,
        joints=converted.joints,
        rate=converted.rate,
        runs=converted.runs,
        mapped=mapped,
        gear_ratio=list(mapped.gear_ratio) * (n if len(mapped.gear_ratio) == 1 else 1),
        units=units,
        torque=torque if mapped.readings else "",
        payload=None if mapped.payload is None else (mapped.payload, *mapped.payload_com),
    )


def _flow_texts(texts: Mapping[str, str]) -> str:
    """Return a mapping of names to plain texts in YAML on one line."""
    return f"{{{', '.join(f'{quote(name)}: {text}' for name, text in texts.items())}}}"
