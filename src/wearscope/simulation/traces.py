"""Where the recordings of a robot and test-cycle lie: a folder a set, a partition a design point."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from wearscope.robots.model import RobotModel
from wearscope.simulation.recording import Recording, read_recording


def point_path(folder: str | Path, set_name: str, point: int) -> Path:
    """File of a design point's recording: one partition a point."""
    return Path(folder) / set_name / f"point={point}" / "recording.parquet"


def read_points(
    folder: str | Path, set_name: str, points: Sequence[int], model: RobotModel
) -> Iterator[tuple[int, Recording]]:
    """Recordings of some points of a set, one at a time."""
    for point in points:
        yield int(point), read_recording(point_path(folder, set_name, int(point)), model.joints)
