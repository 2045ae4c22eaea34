"""Recordings of a robot and test-cycle, read point by point."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from wearscope.robots.model import RobotModel
from wearscope.simulation.packed import PackedRecordings, point_path
from wearscope.simulation.recording import Recording, read_recording


def read_points(
    folder: str | Path,
    set_name: str,
    points: Sequence[int],
    model: RobotModel,
    fingerprints: Mapping[tuple[str, int], str] | None = None,
    packed: PackedRecordings | None = None,
) -> Iterator[tuple[int, Recording]]:
    """Recordings of some points of a set, one at a time.

    Parameters
    ----------
    folder : path-like
        Traces of this robot and test-cycle.
    set_name : str
    points : sequence of int
    model : RobotModel
    fingerprints : mapping of (set, point) to str, optional
        What the recordings must have been made from, see `wearscope.simulation.chunk.fingerprint_point`.
    packed : PackedRecordings, optional
        Where they are, if not a file a point in the folder.

    Raises
    ------
    DamagedFile
        Where a recording is missing, damaged or another one.
    """
    for point in map(int, points):
        wanted = None if fingerprints is None else fingerprints[set_name, point]
        if packed is not None and packed.holds(set_name):
            path, content = packed.read(set_name, point)
            yield point, read_recording(path, model.joints, wanted, content)
        else:
            yield point, read_recording(point_path(folder, set_name, point), model.joints, wanted)
