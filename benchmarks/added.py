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

import argparse
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from scipy import signal
from statsmodels.stats.proportion import proportion_confint

from benchmarks.stability import list_changes
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.storage.tables import read_table

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


def add_torque(folder: Path, place: Path, joint: str, kind: str, size: float) -> Path:
    """A copy in which a joint's torque has a further one of a size (RMS), over all runs where it moves."""
    shutil.copytree(folder, place, copy_function=shutil.copyfile)
    fields = yaml.safe_load((place / "dataset.yaml").read_text(encoding="utf-8"))
    tables = {run["file"]: read_table(folder / run["file"]) for run in fields["runs"]}
    q = np.concatenate([table[f"q_{joint}"] for table in tables.values()])
    middle, half = (q.max() + q.min()) / 2, max(np.ptp(q) / 2, 1e-12)
    smooth = {"window_length": 21, "polyorder": 3, "deriv": 1, "delta": 1.0 / fields["sample_rate"]}
    speed = {f: signal.savgol_filter(table[f"q_{joint}"], **smooth) for f, table in tables.items()}
    top = np.quantile(np.abs(np.concatenate([*speed.values()])), 0.95)
    place_of = {f: (table[f"q_{joint}"] - middle) / half for f, table in tables.items()}
    extra = {f: KINDS[kind](place_of[f], speed[f] / top) for f in tables}
    moves = np.concatenate([np.abs(v) > WIDTH * top for v in speed.values()])
    scale = size / np.sqrt(np.mean(np.concatenate([*extra.values()])[moves] ** 2))
    for file, table in tables.items():
        table[f"tau_{joint}"] += scale * extra[file]
        (place / file).with_suffix(".parquet").unlink(missing_ok=True)
        table.to_parquet((place / file).with_suffix(".parquet"))
    for run in fields["runs"]:
        run["file"] = str(Path(run["file"]).with_suffix(".parquet"))
    (place / "dataset.yaml").write_text(yaml.safe_dump(fields, sort_keys=False), encoding="utf-8")
    return place


def grade(verdict: dict[str, Any], joint: str, kind: str) -> str:
    """Whether an effect is `found` at a joint, `hinted` or `missed`."""
    entries = [one for one in verdict["verdict"] if one["joint"] == joint]
    if any(kind in (one["effect"], *one["equivalent"]) for one in entries):
        return "found"
    return "hinted" if verdict["joints"][joint]["reason"] else "missed"


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what became of each torque, and the shares."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--joint", nargs="+", help="default: every joint")
    parser.add_argument("--kind", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--times", nargs="+", type=float, default=[0.5, 1.0, 2.0])
    given = parser.parse_args(arguments)
    results: list[tuple[float, str, bool]] = []
    for folder in (file.parent for one in given.folders for file in sorted(one.rglob("dataset.yaml"))):
        plain = diagnose(folder).verdict
        for joint in [j for j in plain["joints"] if not given.joint or j in given.joint]:
            own = plain["joints"][joint]
            for kind in given.kind:
                limit = own["detection_limit_percent"].get(kind)
                if limit is None or grade(plain, joint, kind) == "found":
                    continue
                for times in given.times:
                    size = times * limit / 100.0 * own["torque_rms"]
                    with tempfile.TemporaryDirectory() as place:
                        copy = add_torque(folder, Path(place) / "added", joint, kind, size)
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
        for what in ("found", "hinted", "missed"):
            _tell(times, what, sum(told == what for told, _ in at), len(at))
        _tell(times, "other names changed", sum(changed for _, changed in at), len(at))
    return 0


def _tell(times: float, what: str, hits: int, cases: int) -> None:
    low, high = proportion_confint(hits, cases, method="beta") if cases else (0.0, 1.0)
    print(f"{times:g} times the limit, {what}: {hits} of {cases} ({100 * low:.0f} to {100 * high:.0f} %)")


if __name__ == "__main__":
    sys.exit(main())
