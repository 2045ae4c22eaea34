"""Design points whose simulation failed: read from the chunks, counted, refused where too many."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import pandas as pd

from wearscope.errors import InputError
from wearscope.storage.files import DamagedFile

#: Reason in one line by set and point.
Failures = dict[tuple[str, int], str]


def read_markers(markers: Iterable[str | Path]) -> tuple[dict[tuple[str, int], str], Failures]:
    """What some chunks say of their points, as `workflow/scripts/simulate_points.py` writes it.

    Parameters
    ----------
    markers : iterable of path-like
        ``<set>/_chunk-<number>.json``: by point the ``fingerprints``, and the reasons of what ``failed``.

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
    """Refuse a robot and test-cycle whose simulation failed too often.

    Parameters
    ----------
    failures : mapping
        See `read_markers`.
    points : mapping of str to sequence of int
        All points by set.
    where : str
        Robot and test-cycle.
    max_failed_share : float
        Largest share of a set's points whose simulation may fail.
    sizes : mapping of str to int, optional
        Points of a whole set, where only some are given: the share is of all.

    Raises
    ------
    InputError
        Above the share.
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
) -> pd.DataFrame:
    """Failed points of a robot and test-cycle.

    Returns
    -------
    DataFrame
        `robot`, `cycle`, `set`, `point`, `reason`, one row a failed point in the order of set and point;
        empty where none failed.
    """
    wanted = {(name, int(point)) for name in points for point in points[name]}
    rows = [(robot, cycle, *key, failures[key]) for key in sorted(wanted & failures.keys())]
    table = pd.DataFrame(rows, columns=["robot", "cycle", "set", "point", "reason"])
    # An empty table has its columns' types too.
    return table.astype({**dict.fromkeys(("robot", "cycle", "set", "reason"), "str"), "point": "int64"})
