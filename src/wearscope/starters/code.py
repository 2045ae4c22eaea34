"""Writes the first version of a user's detector, effect or test-cycle, each with its test."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wearscope.effects.vocabulary import list_effects
from wearscope.errors import InputError
from wearscope.starters.writing import check_identifier, fill_template, write_files

#: Via points of a test-cycle where the user gives none, as shares of each joint's range.
VIA = ((0.4, -0.3, 0.4, 0.3, -0.4, 0.5), (-0.4, 0.2, -0.2, -0.4, 0.3, -0.4), (0.2, 0.3, -0.4, 0.1, -0.2, 0.3))
#: Units of via points, and how the written test-cycle describes them.
UNITS = {
    "share": "as shares of the way from home (0) to the lower (-1) or upper (1) end of the range",
    "rad": "in rad (m where a joint slides)",
    "deg": "in degrees",
}


def write_detector(name: str, folder: Path) -> list[Path]:
    """Write a detector and its test; returns their paths."""
    return _write_pair("detector", check_identifier(name, "detector"), folder)


def write_effect(name: str, folder: Path) -> list[Path]:
    """Write an effect and its test; returns their paths.

    Raises
    ------
    InputError
        Where the platform has an effect of that name.
    """
    if name in {one.name for one in list_effects()}:
        raise InputError(f"effect '{name}': is the platform's own; choose another name.")
    return _write_pair("effect", check_identifier(name, "effect"), folder)


def _write_pair(kind: str, name: str, folder: Path, **values: object) -> list[Path]:
    """Fill the templates of a kind of code and of its test; return the paths of both files."""
    title = "".join(part.capitalize() for part in name.split("_"))
    paths = folder / f"{name}.py", folder / f"test_{name}.py"
    texts = (fill_template(f"{part}.py", name=name, title=title, **values) for part in (kind, f"test_{kind}"))
    write_files(dict(zip(paths, texts, strict=True)))
    return list(paths)


def write_cycle(
    name: str, folder: Path, points: Sequence[Sequence[float]], unit: str, speed: float, robot: str
) -> list[Path]:
    """Write a test-cycle through via points, and its test.

    Parameters
    ----------
    name : str
    folder : Path
    points : sequence of sequence of float
        For each point one number for each joint; a joint without a number stays at its home position.
    unit : str
        A key of `UNITS`.
    speed : float
        Share of the robot's speed limits.
    robot : str
        Robot on which the written test runs the test-cycle.

    Returns
    -------
    list of Path

    Raises
    ------
    InputError
        Where a point or the speed is not valid.
    """
    check_identifier(name, "test-cycle")
    if not 0.0 < speed <= 1.0:
        raise InputError(f"speed {speed:g}: give a share of the speed limits, above 0 and at most 1.")
    for k, point in enumerate(points):
        values = np.asarray(point, dtype=float)
        if not len(values) or not np.all(np.isfinite(values)):
            raise InputError(f"via point {k + 1}: is empty or holds a number that is not finite; correct it.")
        if unit == "share" and np.any(np.abs(values) > 1.0):
            raise InputError(
                f"via point {k + 1}: holds {values[np.argmax(np.abs(values))]:g}, beyond the range, -1 to 1; "
                "correct it, or say --unit rad or deg."
            )
    if not points:
        raise InputError("a test-cycle needs at least one via point; give one.")
    texts = [[f"{value:.6g}" for value in point] for point in points]
    description = f"From home through {len(points)} via point{'s' if len(points) > 1 else ''} and back."
    return _write_pair(
        "cycle", name, folder, points=texts, unit=unit, unit_text=UNITS[unit], speed=speed, robot=repr(robot),
        description=description,
    )  # fmt: skip


def parse_points(texts: Sequence[str]) -> list[list[float]]:
    """Read via points, each a text of numbers separated by blanks or commas.

    Raises
    ------
    InputError
        Where a text holds anything but numbers.
    """
    points = []
    for text in texts:
        try:
            points.append([float(word) for word in text.replace(",", " ").replace(";", " ").split()])
        except ValueError:
            raise InputError(
                f"via point '{text}': holds other than numbers; write e.g. '0.5 -0.3 0.2'."
            ) from None
    return points


def read_points(path: Path) -> list[list[float]]:
    """Read the via points of a text file, one point a row; rows that begin with no number are left out.

    Raises
    ------
    InputError
        Where the file cannot be read, or a row holds anything but numbers.
    """
    from wearscope.robots.model_file import read_text

    rows = [row.strip() for row in read_text(path, "a file with a via point a row").splitlines()]
    return parse_points([row for row in rows if row and row[0] in "+-.0123456789"])
