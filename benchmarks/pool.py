"""Pools boards of several seeds: ``python -m benchmarks.pool DIR DIR --out DIR``."""

import argparse
import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.runner import write_results
from wearscope.errors import InputError


def read_results(folders: Iterable[Path]) -> list[dict[str, Any]]:
    """Results of all cases in the ``cases`` folders of several boards, in the order of the boards.

    Parameters
    ----------
    folders : iterable of Path
        What ``--out`` of a board named.

    Returns
    -------
    list of dict

    Raises
    ------
    InputError
        For a folder without cases, a file that is not a case's result, or a case that stands in two folders.
    """
    results: list[dict[str, Any]] = []
    where: dict[str, Path] = {}
    for folder in folders:
        paths = sorted(folder.glob("cases/*.json"))
        if not paths:
            raise InputError(f"{folder}: no cases/*.json; name the --out of a board that has run")
        for path in paths:
            try:
                result = json.loads(path.read_text(encoding="utf-8"))
                name = f"{result['case']['dataset']} of seed {result['case']['seed']}"
            except (ValueError, KeyError, TypeError):
                raise InputError(f"{path}: not the result of a case; run it anew with --case") from None
            if name in where:
                raise InputError(f"{path}: the case stands in {where[name]} too; pool each board once")
            where[name] = path
            results.append(result)
    return results


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of ``python -m benchmarks.pool``."""
    parser = argparse.ArgumentParser(description="Pool boards into the tables of one.")
    parser.add_argument("boards", nargs="+", type=Path, metavar="DIR", help="--out of a board")
    parser.add_argument("--out", type=Path, required=True, help="where the tables go")
    given = parser.parse_args(arguments)
    try:
        write_results(read_results(given.boards), given.out)
    except InputError as problem:
        sys.stderr.write(f"{problem}\n")
        return 2
    sys.stdout.write((given.out / "board.md").read_text(encoding="utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
