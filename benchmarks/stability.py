"""Whether names stay when what should not matter is changed.

    python -m benchmarks.stability FOLDER [FOLDER ...] [--seconds 60]

FOLDER is a data set, or a `--keep` folder of `benchmarks.board` with many. Each data set is diagnosed as it
is, then

- with the torque's cut-off 30 % lower and 30 % higher,
- with every other training run, where there are four or more.

A name is kept if the other verdict has it at the same joint, or an effect of its set of equivalents there, or
a name there whose set holds it. Printed: a line a change, then the share of names that changed, by kind. What
a torque that is added at one joint does to names at others, `benchmarks.added` says.
"""

import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np

from benchmarks.command import start_parser
from benchmarks.recorded import Recorded, find_datasets
from benchmarks.summary import tell_counts
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.intake import preprocessing

FACTORS = (0.7, 1.3)


def diagnose_at(folder: Path, cutoff: float) -> dict[str, Any]:
    """Verdict of a data set at a common cut-off [Hz]."""
    with patch.object(preprocessing, "choose_torque_cutoff", lambda *_: cutoff):
        return diagnose(folder).verdict


def halve(data: Recorded) -> Recorded | None:
    """The data set with every other training run; None where fewer than two would be left."""
    train = [run for run in data.fields["runs"] if run["use"] == "train"]
    if len(train) < 4:
        return None
    other = data.change(lambda table: None)
    kept = [run for run in data.fields["runs"] if run not in train[1::2]]
    other.fields = data.fields | {"runs": kept}
    return other


def list_changes(
    before: dict[str, Any], after: dict[str, Any], apart: str | None = None
) -> tuple[int, list[str]]:
    """Names of two verdicts that were compared, and those that changed; `apart` is a joint left out."""
    first, second = (
        {
            (one["effect"], one["joint"]): set(one["equivalent"])
            for one in verdict["verdict"]
            if one["joint"] != apart
        }
        for verdict in (before, after)
    )
    changed = []
    for here, there, word in ((first, second, "lost"), (second, first, "new")):
        for (effect, joint), alike in here.items():
            kept = any(
                at == joint and (other == effect or other in alike or effect in theirs)
                for (other, at), theirs in there.items()
            )
            if not kept:
                changed.append(f"{word} {effect}@{joint}")
    return len(first), changed


def vary(folder: Path, place: Path) -> Iterator[tuple[str, int, list[str]]]:
    """Kind of change, names compared and those that changed, of one data set."""
    plain = diagnose(folder).verdict
    for factor in FACTORS:
        other = diagnose_at(folder, factor * plain["band"]["torque_hz"])
        yield f"cut-off x {factor:g}", *list_changes(plain, other)
    half = halve(Recorded(folder))
    if half is not None:
        verdict = diagnose(half.write(place / "half")).verdict
        yield "half of the runs", *list_changes(plain, verdict)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the changes and their shares."""
    parser = start_parser(__doc__)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER")
    parser.add_argument("--seconds", type=float, default=np.inf, help="start no further data set after these")
    given = parser.parse_args(arguments)
    begun = time.process_time()
    counts: dict[str, list[tuple[int, int]]] = {}
    for folder in find_datasets(given.folders):
        if time.process_time() - begun > given.seconds:
            break
        with tempfile.TemporaryDirectory() as place:
            for kind, names, changed in vary(folder, Path(place)):
                counts.setdefault(kind, []).append((names, len(changed)))
                print(f"{folder.name}, {kind}: {', '.join(changed) or 'nothing'} of {names}", flush=True)
    for kind, pairs in counts.items():
        names, changed = np.sum(pairs, axis=0)
        unmoved = sum(not moved for _, moved in pairs)
        print(f"{kind}: {changed} changes to {names} names; unchanged: {tell_counts(unmoved, len(pairs))}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
