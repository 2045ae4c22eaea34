"""Whether a verdict stands on the common cut-off: a data set diagnosed at others than the one that is chosen.

    python benchmarks/cutoffs.py FOLDER [HZ ...]

Without cut-offs: the chosen one, and 0.9, 1.1 and 1.4 times that. A line each: the names with their status,
and each joint's error on the test runs in per cent of its torque, after.
"""

import argparse
from pathlib import Path

from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.intake import preprocessing

FACTORS = (0.9, 1.1, 1.4)


def diagnose_at(folder, cutoff=None):
    """Verdict of a data set at a common cut-off [Hz], or the chosen one."""
    choose = preprocessing.choose_torque_cutoff
    try:
        if cutoff is not None:
            preprocessing.choose_torque_cutoff = lambda *_: cutoff
        return diagnose(folder).verdict
    finally:
        preprocessing.choose_torque_cutoff = choose


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("cutoffs", type=float, nargs="*", metavar="HZ")
    args = parser.parse_args()
    verdict = diagnose_at(args.folder)
    chosen = verdict["band"]["torque_hz"]
    show(verdict)
    for cutoff in args.cutoffs or [factor * chosen for factor in FACTORS]:
        show(diagnose_at(args.folder, cutoff))


def show(verdict):
    """Print one verdict's line."""
    named = [f"{one['effect']}@{one['joint']} {one['status']}" for one in verdict["verdict"]]
    errors = []
    for joint, one in verdict["joints"].items():
        worst = max((after for *_, after in one["relative_error_percent"].values()), default=None)
        errors.append(f"{joint} {'-' if worst is None else f'{worst:.1f}'}")
    print(
        f"{verdict['band']['torque_hz']:6.2f} Hz: {', '.join(named) or 'nothing'}; {', '.join(errors)} %",
        flush=True,
    )


if __name__ == "__main__":
    main()
