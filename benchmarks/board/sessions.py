"""``python -m benchmarks.board.sessions``: machines over their sessions, tracked and scored."""

import argparse
import json
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.board.session_cases import KINDS, draw_case
from benchmarks.board.session_folder import write_sessions
from benchmarks.board.session_score import score_sessions, summarise_sessions
from wearscope.storage.tables import read_table, write_table, write_text


def run_session_case(
    number: int, seed: int, kind: str | None = None, keep: str | Path | None = None
) -> dict[str, Any]:
    """Make one case, track it and score it.

    Parameters
    ----------
    number, seed : int
    kind : str, optional
        One of `KINDS`.
    keep : path-like, optional
        Where its folder and what was told of it stay.

    Returns
    -------
    dict
        `rows` (a later session each), `error` (empty where there is none), `seconds` of tracking, `told` of
        the case.
    """
    from wearscope.tracking.run import track

    case = draw_case(number, seed, kind)
    place = Path(keep) / f"{number:04d}" if keep else Path(tempfile.mkdtemp(prefix="sessions-"))
    result: dict[str, Any] = {"number": number, "told": case.tell(), "rows": [], "error": "", "seconds": 0.0}
    try:
        truth = write_sessions(place / case.name, case)
        started = time.perf_counter()
        told = track(place / case.name, place / "out")
        result["seconds"] = time.perf_counter() - started
        result["rows"] = score_sessions(case, truth, told, read_table(place / "out" / "changes.parquet"))
        if keep:
            write_text(place / "truth.json", json.dumps(truth, indent=1))
    except Exception as problem:
        where = traceback.extract_tb(problem.__traceback__)[-1]
        result["error"] = f"{type(problem).__name__}: {problem} ({Path(where.filename).name}:{where.lineno})"
    finally:
        if not keep:
            shutil.rmtree(place, ignore_errors=True)
    return result


def keep_result(
    number: int, out_dir: Path, seed: int, kind: str | None = None, keep: str | Path | None = None
) -> dict[str, Any]:
    """Result of a case, from its file where it was finished before."""
    path = out_dir / "cases" / f"{seed}-{kind or 'any'}-{number:04d}.json"
    if path.is_file():
        kept: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return kept
    result = run_session_case(number, seed, kind, keep)
    write_text(path, json.dumps(result))
    return result


def run_sessions(
    cases: Sequence[int], seed: int, out_dir: str | Path, jobs: int = 1, kind: str | None = None,
    keep: str | Path | None = None,
) -> pd.DataFrame:  # fmt: skip
    """Run cases and write ``sessions.parquet`` (a row a session), ``sessions.json`` and ``sessions.md``.

    Finished cases stay in ``cases/``, so that a run that was stopped goes on where it was; delete them after
    a change of what is scored.

    Returns
    -------
    DataFrame
        As `benchmarks.board.session_score.summarise_sessions`.
    """
    out = Path(out_dir)
    results = []
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        ask = partial(keep_result, out_dir=out, seed=seed, kind=kind, keep=keep)
        for result in pool.map(ask, cases):
            results.append(result)
            said = result["error"] or " | ".join(
                f"{row['changed']}: {row['said'] or '-'}{' ?' if row['cannot_tell'] else ''}"
                for row in result["rows"]
            )
            print(f"#{result['number']} {result['told']}, {result['seconds']:.0f} s -> {said}", flush=True)
    rows = pd.DataFrame([row for result in results for row in result["rows"]])
    failed = [result for result in results if result["error"]]
    summary = summarise_sessions(rows)
    write_table(out / "sessions.parquet", rows)
    write_text(
        out / "sessions.json",
        json.dumps({"seed": seed, "cases": len(results), "failed": [r["error"] for r in failed],
                    "questions": summary.to_dict("records")}, indent=1),
    )  # fmt: skip
    write_text(out / "sessions.md", tell_summary(summary, len(results), len(failed)))
    return summary


def tell_summary(summary: pd.DataFrame, cases: int, failed: int) -> str:
    """Summary as a Markdown table."""
    lines = [f"{cases} cases, {failed} failed", "", "| question | share | 95 % | n |", "|---|---|---|---|"]
    for row in summary.itertuples(index=False):
        share, low, high = (f"{100 * x:.1f}" for x in (row.share, row.low, row.high))
        lines.append(f"| {row.question} | {share} % | {low} to {high} | {row.n} |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="Track machines over sessions of which the truth is known.")
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--kind", choices=tuple(KINDS), help="only this kind of case")
    parser.add_argument("--case", type=int, action="append", help="this case alone; may be repeated")
    parser.add_argument("--keep", type=Path, help="where the folders stay")
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args(arguments)
    run_sessions(given.case or range(given.cases), given.seed, given.out, given.jobs, given.kind, given.keep)
    sys.stdout.write((given.out / "sessions.md").read_text(encoding="utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
