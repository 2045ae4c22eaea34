"""Whether a known torque that is added to a recording is found, at sizes about the stated detection limit.

    python -m benchmarks.added FOLDER [FOLDER ...] [--joint J ...] [--times 0.5 1 2] [--kind K ...]

FOLDER is a data set, or a `--keep` folder of `benchmarks.board` with many. Each data set is diagnosed as it
is. Then each kind of torque is added at each joint, in all runs, at multiples of the verdict's
`detection_limit_percent` there. Printed: a line each, then by multiple

- found: the effect is named there, or is in the set of a name there,
- hinted: it is not, and the joint is `unexplained`, or its reason says what could explain the rest,
- missed: neither,
- changed: names at other joints are not those of the recording as it was.
"""

import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy import signal

from benchmarks.command import start_parser
from benchmarks.recorded import Recorded, find_datasets
from benchmarks.stability import list_changes
from benchmarks.summary import tell_counts
from wearscope.closed_loop.diagnosis import diagnose

#: Speed of a Stribeck's fall, and width of a reversal, over the largest speed.
FALL, WIDTH = 0.08, 0.01
#: Periods of a ripple over the visited range.
PERIODS = 6.0

Kind = Callable[[np.ndarray, np.ndarray], np.ndarray]
#: Torque by position (-1 to 1 over the visited range) and speed (over the largest).
KINDS: dict[str, Kind] = {
    "joint_spring": lambda q, v: q,
    "torque_ripple": lambda q, v: np.sin(np.pi * PERIODS * q),
    "stribeck": lambda q, v: np.tanh(v / WIDTH) * np.exp(-((v / FALL) ** 2)),
    "quadratic_viscous": lambda q, v: v * np.abs(v),
    "viscous_asymmetry": lambda q, v: np.abs(v),
    "coulomb_asymmetry": lambda q, v: np.maximum(np.tanh(v / WIDTH), 0.0),
}


def add_torque(data: Recorded, joint: str, kind: str, size: float) -> Recorded:
    """The data set with a further torque at a joint, of a size (RMS) over all runs where it moves."""
    q, rate = data.pool(f"q_{joint}"), data.fields["sample_rate"]
    middle, half = (q.max() + q.min()) / 2, max(np.ptp(q) / 2, 1e-12)

    def find_speed(table: pd.DataFrame) -> np.ndarray:
        return signal.savgol_filter(table[f"q_{joint}"], 21, 3, deriv=1, delta=1.0 / rate)

    speed = np.concatenate([find_speed(table) for table in data.tables.values()])
    top = np.quantile(np.abs(speed), 0.95)

    def find_torque(table: pd.DataFrame) -> np.ndarray:
        return KINDS[kind]((table[f"q_{joint}"] - middle) / half, find_speed(table) / top)

    torque = np.concatenate([find_torque(table) for table in data.tables.values()])
    scale = size / np.sqrt(np.mean(torque[np.abs(speed) > WIDTH * top] ** 2))

    def add(table: pd.DataFrame) -> None:
        table[f"tau_{joint}"] += scale * find_torque(table)

    return data.change(add)


def grade(verdict: dict[str, Any], joint: str, kind: str) -> str:
    """Whether an effect is `found` at a joint, `hinted` or `missed`."""
    entries = [one for one in verdict["verdict"] if one["joint"] == joint]
    if any(kind in (one["effect"], *one["equivalent"]) for one in entries):
        return "found"
    return "hinted" if verdict["joints"][joint]["reason"] else "missed"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what became of each torque, and the shares."""
    parser = start_parser(__doc__)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--joint", nargs="+", help="default: every joint")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--times", nargs="+", type=float, default=[0.5, 1.0, 2.0])
    given = parser.parse_args(arguments)
    results: list[tuple[float, str, bool]] = []
    for folder in find_datasets(given.folders):
        data, plain = Recorded(folder), diagnose(folder).verdict
        for joint in [j for j in plain["joints"] if not given.joint or j in given.joint]:
            own = plain["joints"][joint]
            for kind in given.kind:
                limit = own["detection_limit_percent"].get(kind)
                if limit is None or grade(plain, joint, kind) == "found":
                    continue
                for times in given.times:
                    size = times * limit / 100.0 * own["torque_rms"]
                    with tempfile.TemporaryDirectory() as place:
                        copy = add_torque(data, joint, kind, size).write(Path(place) / "added")
                        verdict = diagnose(copy).verdict
                    told = grade(verdict, joint, kind)
                    _, changed = list_changes(plain, verdict, joint)
                    results.append((times, told, bool(changed)))
                    print(
                        f"{folder.name}, {joint}, {kind}: {times:g} times the limit of {limit:.1f} %: "
                        f"{told}; other names: {', '.join(changed) or 'unchanged'}",
                        flush=True,
                    )
    for times in given.times:
        at = [(told, changed) for t, told, changed in results if t == times]
        counts = Counter(told for told, _ in at) | {"other names changed": sum(changed for _, changed in at)}
        for what in ("found", "hinted", "missed", "other names changed"):
            print(f"{times:g} times the limit, {what}: {tell_counts(counts[what], len(at))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
