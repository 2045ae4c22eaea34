"""Runs the attribution board: makes each case, has the loop closed on it, scores, and writes the tables."""

import json
import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from wearscope.attribution_board.baselines import BASELINES, run_baselines
from wearscope.attribution_board.cases import Case, list_cases
from wearscope.attribution_board.generate import generate_dataset
from wearscope.attribution_board.score import score_case, score_folder, smoothed_floor
from wearscope.attribution_board.summary import (
    find_smallest_sizes,
    summarise,
    tabulate_confusion,
    write_markdown,
)
from wearscope.processes import end_with, identify_process
from wearscope.tables import write_table, write_text

Closer = Callable[[Path, Path], Any]


def _close_light(dataset: Path, out_dir: Path) -> Any:
    from wearscope.closed_loop.run import close_loop

    return close_loop(dataset, out_dir, light=True)


def run_case(case: Case, closer: Closer, baselines: bool = True) -> dict[str, Any]:
    """Make one case in a temporary folder, close the loop on it and score it.

    The tracer gets the folder alone; the truth stays in this process's memory.

    Returns
    -------
    dict
        `case` (its words), `rows`, `seconds` (of the tracer) and `error` (None, or what it raised).
    """
    with tempfile.TemporaryDirectory(prefix="board-") as place:
        folder, out_dir = Path(place) / case.name, Path(place) / "out"
        out_dir.mkdir()
        truth = generate_dataset(folder, case.robot, case.planted, case.seed, case.recipe)
        started, error = time.perf_counter(), None
        try:
            closer(folder / "dataset.yaml", out_dir)
            seconds = time.perf_counter() - started
            rows = score_folder(truth, out_dir)
        except Exception as problem:
            seconds = time.perf_counter() - started
            where = traceback.extract_tb(problem.__traceback__)[-1]
            error = f"{type(problem).__name__}: {problem} ({Path(where.filename).name}:{where.lineno})"
            empty = {"dataset": case.name, "verdict": [], "joints": {}}
            rows = [row | {"outcome": "error", "named": "error", "correct": False, "first": False}
                    for row in score_case(truth, empty)]  # fmt: skip
        if baselines:
            verdicts = run_baselines(folder)
            for method in BASELINES:
                rows += score_case(truth, verdicts[method], method, partial(smoothed_floor, truth))
    return {"case": case.tell(), "rows": rows, "seconds": seconds, "error": error}


def _keep_case(case: Case, out_dir: Path, closer: Closer, baselines: bool) -> dict[str, Any]:
    result = run_case(case, closer, baselines)
    write_text(out_dir / "cases" / f"{case.name}.json", json.dumps(result, indent=1))
    return result


def _read_kept(path: Path) -> dict[str, Any] | None:
    try:
        return dict(json.loads(path.read_text(encoding="utf-8")))
    except (FileNotFoundError, json.JSONDecodeError):
        return None


def run_board(
    size: str, out_dir: str | Path, close_loop: Closer | None = None, jobs: int = 2, seed: int = 0,
    nulls: int | None = None, baselines: bool = True, cases: Iterable[Case] | None = None,
    progress: Callable[[str], None] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Run a board and write its tables; cases that are already there are not run again.

    Parameters
    ----------
    size : str
        ``small`` (for tests), ``medium`` or ``full``.
    out_dir : path-like
        Gets ``cases/<name>.json`` (one by case, so that a stopped board goes on where it was;
        delete them after a change of the tracer), ``board.parquet``, ``confusion.parquet``,
        ``smallest_sizes.parquet``, ``summary.json`` and ``board.md``.
    close_loop : callable, optional
        ``close_loop(dataset_yaml, out_dir)`` writes ``verdict.json`` (and ``residual.parquet``) into
        `out_dir`. By default `wearscope.closed_loop.run.close_loop` with ``light=True``. For
        ``jobs > 1`` it must be importable.
    jobs : int
        Processes.
    seed : int
    nulls : int, optional
        Another number of nulls.
    baselines : bool
        Whether the three baselines run too.
    cases : iterable of Case, optional
        Instead of those of `size`.
    progress : callable, optional
        Gets a line by finished case; by default it goes to the standard error.

    Returns
    -------
    dict
        The summary, as in ``summary.json``.
    """
    out_dir = Path(out_dir)
    closer = close_loop or _close_light
    tell = progress or (lambda line: print(line, file=sys.stderr, flush=True))
    todo = list(cases) if cases is not None else list_cases(size, seed, nulls)
    results: dict[str, dict[str, Any]] = {}
    for case in todo:
        kept = _read_kept(out_dir / "cases" / f"{case.name}.json")
        if kept is not None:
            results[case.name] = kept
    open_cases = [case for case in todo if case.name not in results]
    if results:
        tell(f"attribution board: {len(results)} of {len(todo)} cases are already there")
    started = time.perf_counter()

    def report(case: Case, result: dict[str, Any], done: int) -> None:
        results[case.name] = result
        outcomes = ", ".join(r["outcome"] for r in result["rows"] if r["method"] == "tracer")
        ahead = (time.perf_counter() - started) / done * (len(open_cases) - done)
        said = f"{outcomes} ({result['error']})" if result["error"] else outcomes
        tell(
            f"[{len(results)}/{len(todo)}] {case.tell()}: {said}, {result['seconds']:.1f} s, "
            f"{ahead / 60:.0f} min to go"
        )

    if jobs == 1:
        for done, case in enumerate(open_cases, start=1):
            report(case, _keep_case(case, out_dir, closer, baselines), done)
    elif open_cases:
        me = identify_process(os.getpid())
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(jobs, mp_context=context, initializer=end_with, initargs=(me,)) as pool:
            futures = {pool.submit(_keep_case, c, out_dir, closer, baselines): c for c in open_cases}
            for done, future in enumerate(as_completed(futures), start=1):
                report(futures[future], future.result(), done)
    rows = pd.DataFrame([row for case in todo for row in results[case.name]["rows"]])
    rows["unabsorbed_size"] = rows["unabsorbed_size"].astype(float)
    summary = write_tables(rows, out_dir)
    errors = sorted({r["error"] for r in results.values() if r["error"]})
    if errors:
        tell(f"attribution board: {len(errors)} kinds of error, the first: {errors[0]}")
    return summary


def write_tables(rows: pd.DataFrame, out_dir: Path) -> dict[str, Any]:
    """Write the board's tables and its summary from its rows."""
    write_table(out_dir / "board.parquet", rows, {"size": "1", "unabsorbed_size": "1", "gap_closure": "1"})
    write_table(out_dir / "confusion.parquet", tabulate_confusion(rows))
    sizes = find_smallest_sizes(rows)
    write_table(out_dir / "smallest_sizes.parquet", sizes, {"smallest_size": "1"})
    summary = summarise(rows)
    write_text(out_dir / "summary.json", json.dumps(summary, indent=1))
    write_text(out_dir / "board.md", write_markdown(summary, sizes))
    return summary
