"""Simulation of a chunk of design points, one recording a point; recordings that exist are kept.

The chunks' markers list the points whose simulation failed; a study with too many of them is refused.
"""

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wearscope.cycles.base import Cycle, Reference
from wearscope.errors import InputError, SelfTestError, SimulationError
from wearscope.robots.model import RobotModel
from wearscope.robots.numbers import set_numbers
from wearscope.simulation.recording import point_path, read_fingerprint, write_recording
from wearscope.simulation.sensors import seed_of
from wearscope.simulation.study import KEPT, Numbers, make_conditions, simulate_points
from wearscope.storage.files import DamagedFile
from wearscope.supervision import ProcessLost, run_supervised

if TYPE_CHECKING:
    import pandas as pd

#: Delay before each next move [s] where no factor varies it: the middle of the paper's range.
DEFAULT_DWELL = 0.05


@dataclass(frozen=True)
class Plan:
    """What all points of a study, robot and test-cycle share.

    Attributes
    ----------
    robot, cycle : str
        Names of robot and test-cycle in tables and folders; every seed depends on them.
    kinds : mapping of str to str
        Kind by factor, in the design's order; for a number of the robot its path is the kind.
    seed : int
        The study's root seed.
    step : float
        Step of the simulation [s].
    sample_rate : float or None
        [Hz]; None takes that of the robot's sensors.
    """

    robot: str
    cycle: str
    kinds: Mapping[str, str]
    seed: int
    step: float
    sample_rate: float | None = None


@dataclass(frozen=True)
class ChunkOutcome:
    """Outcome of a chunk's points.

    Attributes
    ----------
    fingerprints : dict
        Fingerprint by point, for every point of the chunk.
    failed : dict
        Reason in one line, by failed point; a failed point has no recording.
    """

    fingerprints: dict[int, str]
    failed: dict[int, str]


def natural_levels(row: Mapping[str, Any], kinds: Mapping[str, str]) -> dict[str, float]:
    """Return the natural level of each factor in a design row."""
    return {name: float(row[f"{name}_natural"]) for name in kinds}


def dwell_of(levels: Mapping[str, float], kinds: Mapping[str, str]) -> float:
    """Return the delay before each next move [s]; the factor's natural level is in ms."""
    for name, kind in kinds.items():
        if kind == "dwell":
            return levels[name] / 1000.0
    return DEFAULT_DWELL


def fingerprint_point(common: str, plan: Plan, set_name: str, row: Mapping[str, Any]) -> str:
    """Digest of everything that a point's recording depends on.

    Parameters
    ----------
    common : str
        Digest of the code and of the robot's files.
    plan : Plan
    set_name : str
    row : mapping
        Design row.
    """
    parts = {
        "common": common,
        "identity": [plan.robot, plan.cycle, set_name, int(row["point"])],
        "levels": natural_levels(row, plan.kinds),
        "kinds": dict(plan.kinds),
        "settings": [plan.seed, plan.step, plan.sample_rate],
    }
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()


def simulate_chunk(
    folder: str | Path,
    set_name: str,
    rows: Sequence[Mapping[str, Any]],
    model: RobotModel,
    cycle: Cycle,
    plan: Plan,
    common: str,
    report: Callable[[int], None] | None = None,
    time_limit: float | None = None,
) -> ChunkOutcome:
    """Simulate the points of a chunk that have no current recording.

    Each recording is written whole as soon as it is made, so that a chunk that was killed continues where it
    stopped. Its bytes depend on the point alone. A point whose run fails has no recording afterwards: an
    older one is deleted, and the outcome gives the reason. Such a point fails the same way each time.

    Parameters
    ----------
    folder : path-like
        Folder of the recordings of this robot and test-cycle.
    set_name : str
    rows : sequence of mapping
        Design rows: `point` and the natural levels.
    model : RobotModel
    cycle : Cycle
    plan : Plan
    common : str
        See `fingerprint_point`.
    report : callable, optional
        Called with the number of points done.
    time_limit : float, optional
        Longest time that a point may take [s]. The points are then simulated in a process of their own; a
        point that takes longer, or crashes that process, has failed.

    Returns
    -------
    ChunkOutcome

    Raises
    ------
    InputError
        Where a point does not fit the robot, PyBullet cannot be trusted with it, the disk refuses a file, or
        somebody else kills its process twice.
    """
    fingerprints = {int(row["point"]): fingerprint_point(common, plan, set_name, row) for row in rows}
    paths = {point: point_path(folder, set_name, point) for point in fingerprints}
    missing = [
        row for row in rows if read_fingerprint(paths[int(row["point"])]) != fingerprints[int(row["point"])]
    ]
    failed: dict[int, str] = {}

    def work() -> Iterator[str | None]:
        return _simulate_rows(list(missing), fingerprints, paths, set_name, model, cycle, plan)

    while missing:
        try:
            for reason in work() if time_limit is None else run_supervised(work, time_limit):
                point = int(missing.pop(0)["point"])
                if reason is not None:
                    failed[point] = reason
                if report is not None:
                    report(len(rows) - len(missing))
        except ProcessLost as error:
            point = int(missing.pop(0)["point"])
            paths[point].unlink(missing_ok=True)
            failed[point] = f"the simulation {error}"
    return ChunkOutcome(fingerprints, failed)


def _simulate_rows(
    rows: Sequence[Mapping[str, Any]],
    fingerprints: Mapping[int, str],
    paths: Mapping[int, Path],
    set_name: str,
    model: RobotModel,
    cycle: Cycle,
    plan: Plan,
) -> Iterator[str | None]:
    """Simulate and write points; yield for each the reason why it failed, None where it did not."""
    inputs = _prepare_points(rows, set_name, model, cycle, plan)
    try:
        for row, result in zip(rows, simulate_points(model, inputs, plan.sample_rate), strict=True):
            point = int(row["point"])
            if isinstance(result, SimulationError):
                paths[point].unlink(missing_ok=True)
                yield str(result).rstrip(".")
            else:
                write_recording(
                    paths[point],
                    result,
                    model.joints,
                    model.position_units,
                    model.torque_units,
                    fingerprints[point],
                )
                yield None
    except SelfTestError as error:
        raise InputError(
            f"robot {plan.robot}, cycle {plan.cycle}: {str(error).rstrip('.')}; correct the robot's URDF."
        ) from error


def _prepare_points(
    rows: Sequence[Mapping[str, Any]], set_name: str, model: RobotModel, cycle: Cycle, plan: Plan
) -> Iterator[tuple]:
    """Yield reference motion, conditions and noise seed of each design row."""

    @lru_cache(maxsize=KEPT)
    def build(dwell: float, limits: Numbers) -> Reference:
        return cycle.build(set_numbers(model, limits), dwell, plan.step)

    for row in rows:
        levels = natural_levels(row, plan.kinds)
        seed = seed_of(plan.seed, plan.robot, plan.cycle, set_name, int(row["point"]))
        conditions = make_conditions(levels, plan.kinds)
        limits = tuple(one for one in conditions.numbers if one[0].sets_motion)
        yield build(dwell_of(levels, plan.kinds), limits), conditions, seed


#: Reason of each failed point in one line, by set and point.
Failures = dict[tuple[str, int], str]


def read_markers(markers: Iterable[str | Path]) -> tuple[dict[tuple[str, int], str], Failures]:
    """Read the markers that `workflow/scripts/simulate_points.py` writes, one for each simulated chunk.

    Parameters
    ----------
    markers : iterable of path-like
        Files ``<set>/_chunk-<number>.json``. Each holds ``fingerprints`` by point, and ``failed``: the reason
        by failed point.

    Returns
    -------
    fingerprints, failures : dict
        By set and point.

    Raises
    ------
    DamagedFile
        Where a marker is not there or is no such file.
    """
    fingerprints: dict[tuple[str, int], str] = {}
    failures: Failures = {}
    for marker in map(Path, markers):
        try:
            content = json.loads(marker.read_text(encoding="utf-8"))
            for key, found in (("fingerprints", fingerprints), ("failed", failures)):
                found |= {(marker.parent.name, int(point)): str(one) for point, one in content[key].items()}
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise DamagedFile(
                marker,
                f"{marker}: not a marker of simulated points ({type(error).__name__}); delete it and "
                "simulate them again.",
            ) from error
    return fingerprints, failures


def check_failures(
    failures: Mapping[tuple[str, int], str],
    points: Mapping[str, Sequence[int]],
    where: str,
    max_failed_share: float,
    sizes: Mapping[str, int] | None = None,
) -> None:
    """Refuse a robot and test-cycle whose simulation failed at too many points.

    Parameters
    ----------
    failures : mapping
        See `read_markers`.
    points : mapping of str to sequence of int
        All points by set.
    where : str
        Robot and test-cycle, as the message names them.
    max_failed_share : float
        Largest share of a set's points whose simulation may fail.
    sizes : mapping of str to int, optional
        Number of points of each whole set, where `points` holds only some; the share refers to the whole set.

    Raises
    ------
    InputError
        Where the share of failed points exceeds `max_failed_share`.
    """
    for name, wanted in points.items():
        failed = [int(point) for point in wanted if (name, int(point)) in failures]
        size = (sizes or {}).get(name, len(wanted))
        if len(failed) > max_failed_share * size:
            raise InputError(
                f"{where}: the simulation failed at {len(failed)} of {size} {name} points, more than "
                f"the share {max_failed_share:g} allowed; first at point {failed[0]}: "
                f"{failures[name, failed[0]]}; correct the robot, slow the test-cycle down, narrow the "
                "factors' ranges or raise max_failed_share."
            )


def failure_table(
    failures: Mapping[tuple[str, int], str], points: Mapping[str, Sequence[int]], robot: str, cycle: str
) -> "pd.DataFrame":
    """List the failed points of a robot and test-cycle.

    Returns
    -------
    DataFrame
        `robot`, `cycle`, `set`, `point`, `reason`: one row for each failed point, sorted by set and point;
        empty where none failed.
    """
    import pandas as pd  # imported here: simulating jobs need no pandas

    wanted = {(name, int(point)) for name in points for point in points[name]}
    rows = [(robot, cycle, *key, failures[key]) for key in sorted(wanted & failures.keys())]
    table = pd.DataFrame(rows, columns=["robot", "cycle", "set", "point", "reason"])
    # Without this an empty table would lack the columns' types.
    return table.astype({**dict.fromkeys(("robot", "cycle", "set", "reason"), "str"), "point": "int64"})
