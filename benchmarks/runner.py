"""Runs cases of a generator: each is made, asked of the closed loop in its own process, and scored.

A case is a data set of which the truth is known. It has a `name` (the same for the same case), a `seed`,
`axes` (value of every axis of the regime by name), `tell()` (regime and plants in a few words) and
`make(folder)`, which writes the data set and returns its truth, as `scoring.score_case` takes it.
"""

import argparse
import json
import multiprocessing
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import pandas as pd

from benchmarks.command import start_parser
from benchmarks.scoring import score_case
from benchmarks.summary import summarise, write_markdown
from wearscope.storage.tables import write_table, write_text
from wearscope.storage.verdicts import read_verdict

Case = Any
Closer = Callable[[Path, Path], Any]
TIME_LIMIT = 300.0
"""Wall time that closing the loop on one case may take [s]."""


def close_light(dataset: Path, out_dir: Path) -> Any:
    """Close the loop without forward simulation and diagnostics."""
    from wearscope.closed_loop.run import close_loop

    return close_loop(dataset, out_dir, light=True)


def run_case(
    case: Case, closer: Closer, place: Path, say: Callable[[dict[str, Any]], None] = lambda truth: None
) -> dict[str, Any]:
    """Make one case in a folder, close the loop on it and score it.

    The closer gets the folder alone; the truth stays in this process's memory.

    Parameters
    ----------
    case : Case
    closer : callable
        ``closer(dataset_yaml, out_dir)`` writes ``verdict.json`` into `out_dir`.
    place : Path
        Gets the data set's folder and ``out/``.
    say : callable
        Told the truth as soon as the data set is written, so that it is known of a case that is stopped.

    Returns
    -------
    dict
        `case` (its row; `seconds` are of processor) and `entries` (their rows).
    """
    folder, out_dir = place / case.name, place / "out"
    out_dir.mkdir(parents=True, exist_ok=True)
    try:
        truth = case.make(folder)
    except Exception as problem:
        return failed_result(case, None, f"generator: {_tell_error(problem)}", 0.0)
    say(truth)
    begun = time.process_time()
    try:
        closer(folder / "dataset.yaml", out_dir)
        seconds = time.process_time() - begun
        verdict = read_verdict(out_dir / "verdict.json")
        row, entries = score_case(truth, verdict)
    except Exception as problem:
        return failed_result(case, truth, _tell_error(problem), time.process_time() - begun)
    said = " + ".join(f"{entry['effect']}@{entry['joint']}" for entry in verdict["verdict"]) or "[]"
    return _join(case, row | {"error": "", "seconds": seconds, "verdict": said}, entries)


def failed_result(case: Case, truth: dict[str, Any] | None, error: str, seconds: float) -> dict[str, Any]:
    """Result of a case that ended in an error or at its time limit: nothing in it is found."""
    entries: list[dict[str, Any]] = []
    row: dict[str, Any] = {"exact": False, "null": None}
    if truth is not None:
        row, entries = score_case(truth, {"verdict": [], "joints": {}})
        # a failure names nothing: it is no false name, nor an effect found
        row |= {"exact": False, "false_in_null": None, "worse": None, "extra": None, "unknowns": None}
        row |= {"false_unexplained": None}
        if row["outside_answered"] is not None:
            row["outside_answered"] = False
        entries = [entry | {"found": False, "grade": "failed"} for entry in entries]
    return _join(
        case, row | {"error": error, "seconds": seconds, "outcome": "failed", "verdict": ""}, entries
    )


def _join(case: Case, row: dict[str, Any], entries: list[dict[str, Any]]) -> dict[str, Any]:
    axes = {f"axis_{name}": value for name, value in case.axes.items()} | {
        "dataset": case.name, "seed": case.seed, "told": case.tell(),
    }  # fmt: skip
    return {"case": axes | row, "entries": [axes | entry for entry in entries]}


def _tell_error(problem: Exception) -> str:
    where = traceback.extract_tb(problem.__traceback__)[-1]
    return f"{type(problem).__name__}: {problem} ({Path(where.filename).name}:{where.lineno})"


def _work(case: Case, closer: Closer, place: str, channel: Connection) -> None:
    result = run_case(case, closer, Path(place), lambda truth: channel.send(("truth", truth)))
    channel.send(("result", result))
    channel.close()


class _Job:
    """One case in its own process, with its time limit."""

    def __init__(self, case: Case, closer: Closer, place: Path, keep: bool, limit: float):
        self.case, self.place, self.keep, self.limit = case, place, keep, limit
        context = multiprocessing.get_context("spawn")
        self.channel, other = context.Pipe(duplex=False)
        self.process = context.Process(target=_work, args=(case, closer, str(place), other))
        self.process.start()
        other.close()
        self.truth: dict[str, Any] | None = None
        self.started: float | None = None
        self.result: dict[str, Any] | None = None

    def look(self) -> dict[str, Any] | None:
        """Result where there is one by now; a case beyond its limit is stopped and failed."""
        try:
            while self.result is None and self.channel.poll():
                kind, value = self.channel.recv()
                if kind == "truth":
                    # the clock starts with the data set
                    self.truth, self.started = value, time.perf_counter()
                else:
                    self.result = value
        except EOFError:
            self.process.join()
            error = f"the process ended with code {self.process.exitcode}"
            self.result = failed_result(self.case, self.truth, error, 0.0)
        if self.result is None and self.started is not None:
            spent = time.perf_counter() - self.started
            if spent > self.limit:
                self.process.terminate()
                self.result = failed_result(self.case, self.truth, f"time limit of {self.limit:g} s", spent)
        if self.result is not None:
            self.process.join()
            self.channel.close()
            if not self.keep:
                shutil.rmtree(self.place, ignore_errors=True)
        return self.result


def run_in_processes(
    cases: Sequence[Case], closer: Closer, jobs: int, limit: float, keep: Path | None,
    report: Callable[[Case, dict[str, Any]], None],
) -> None:  # fmt: skip
    """Run cases, each in its own process, `jobs` at a time; `report` is told each result as it comes."""
    waiting, running = list(cases), list[_Job]()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                case = waiting.pop(0)
                place = keep / case.name if keep else Path(tempfile.mkdtemp(prefix="board-"))
                running.append(_Job(case, closer, place, keep is not None, limit))
            wait([job.channel for job in running], timeout=0.5)
            for job in list(running):
                result = job.look()
                if result is not None:
                    running.remove(job)
                    report(job.case, result)
    finally:
        for job in running:
            job.process.terminate()
            shutil.rmtree(job.place, ignore_errors=True)


def run_cases(
    cases: Sequence[Case], out_dir: Path, jobs: int = 1, limit: float = TIME_LIMIT,
    closer: Closer = close_light, keep: Path | None = None, tell: Callable[[str], None] = print,
) -> dict[str, Any]:  # fmt: skip
    """Run cases and write their tables; cases that are already there are not run again.

    Parameters
    ----------
    cases : sequence of Case
    out_dir : Path
        Gets ``cases/<name>.json`` (one a case, so that a run that was stopped continues), ``cases.parquet``
        (a row a case: axes, seconds, error, scores), ``entries.parquet`` (a row a planted effect or false
        entry), ``summary.json`` and ``board.md``.
    jobs : int
        Cases at a time.
    limit : float
        Wall time of a case [s]; beyond it the case counts as failed.
    closer : callable
        ``closer(dataset_yaml, out_dir)``, importable.
    keep : Path, optional
        Where the data sets and verdicts stay.
    tell : callable
        Gets a line by finished case.

    Returns
    -------
    dict
        The summary, as in ``summary.json``.
    """
    paths = {case.name: out_dir / "cases" / f"{case.name}.json" for case in cases}
    done = {
        name: json.loads(path.read_text(encoding="utf-8")) for name, path in paths.items() if path.is_file()
    }
    if done:
        tell(f"{len(done)} of {len(cases)} cases are already there; another --out runs them anew")

    def report(case: Case, result: dict[str, Any]) -> None:
        done[case.name] = result
        write_text(paths[case.name], json.dumps(result, indent=1))
        row = result["case"]
        said = f"{row['error'] or row['verdict']}: {row['outcome']}, {row['seconds']:.0f} s"
        tell(f"[{len(done)}/{len(cases)}] {case.tell()} -> {said}")

    run_in_processes([case for case in cases if case.name not in done], closer, jobs, limit, keep, report)
    return write_results([done[case.name] for case in cases], out_dir)


def write_results(results: Sequence[dict[str, Any]], out_dir: Path) -> dict[str, Any]:
    """Write the tables and the summary from the results of cases."""
    table = pd.DataFrame([result["case"] for result in results])
    entries = pd.DataFrame([entry for result in results for entry in result["entries"]])
    write_table(out_dir / "cases.parquet", table, {"seconds": "s"})
    write_table(
        out_dir / "entries.parquet", entries, {"size": "1", "findable_size": "1"} if len(entries) else {}
    )
    summary = summarise(table, entries)
    write_text(out_dir / "summary.json", json.dumps(summary, indent=1))
    write_text(out_dir / "board.md", write_markdown(summary))
    return summary


def make_parser(words: str) -> argparse.ArgumentParser:
    """Options that the generators share."""
    parser = start_parser(words)
    parser.add_argument("--out", type=Path, required=True, help="where the tables go")
    parser.add_argument("--jobs", type=int, default=1, help="cases at a time")
    parser.add_argument("--limit", type=float, default=TIME_LIMIT, help="wall time of a case [s]")
    parser.add_argument("--keep", type=Path, help="where data sets and verdicts stay")
    return parser


def run_parsed(cases: Sequence[Case], given: argparse.Namespace) -> int:
    """Run cases as the options of `make_parser` say, and print the summary."""
    run_cases(cases, given.out, given.jobs, given.limit, keep=given.keep)
    sys.stdout.write((given.out / "board.md").read_text(encoding="utf-8"))
    return 0
