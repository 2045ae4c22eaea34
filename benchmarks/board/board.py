"""Runs the board: makes each case, closes the loop on it in a process of its own, and scores the verdict."""

import copy
import json
import multiprocessing
import shutil
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import pandas as pd
import yaml

from benchmarks.board.generate import generate_dataset
from benchmarks.board.regimes import Case, list_cases
from benchmarks.board.score import read_verdict, score_case
from benchmarks.board.summary import summarise_board, write_markdown
from wearscope.tables import write_table, write_text

Closer = Callable[[Path, Path], Any]
STANDARD = ("rigid_body", "rotor_inertia", "coulomb", "viscous")
"""What the reference of `compare_declared` declares."""
TIME_LIMIT = 300.0
"""Wall time that closing the loop on one case may take [s]."""


def close_light(dataset: Path, out_dir: Path) -> Any:
    """Close the loop without forward simulation and diagnostics."""
    from wearscope.closed_loop.run import close_loop

    return close_loop(dataset, out_dir, light=True)


@dataclass(frozen=True)
class Extras:
    """What a case is asked in addition: the tracer's error where friction is declared."""

    reference: bool = False


def run_case(
    case: Case, closer: Closer, place: Path, say: Callable[[Any], None] | None = None,
    extras: Extras = Extras(),
) -> dict[str, Any]:  # fmt: skip
    """Make one case in a folder, close the loop on it and score it.

    The tracer gets the folder alone; the truth stays in this process's memory.

    Parameters
    ----------
    case : Case
    closer : callable
        ``closer(dataset_yaml, out_dir)`` writes ``verdict.json`` into `out_dir`.
    place : Path
        Gets the data set's folder and ``out/``.
    extras : Extras
    say : callable, optional
        Told the truth as soon as the data set stands, so that it is known of a case that is stopped; then
        None as soon as the verdict is scored.

    Returns
    -------
    dict
        `case` (its row) and `entries` (their rows).
    """
    started = time.perf_counter()
    folder, out_dir = place / case.name, place / "out"
    out_dir.mkdir(parents=True, exist_ok=True)
    try:
        truth = generate_dataset(folder, case.machine, case.planted, case.seed, case.recipe)
    except Exception as problem:
        return failed_result(case, None, f"generator: {_tell_error(problem)}", 0.0)
    made = time.perf_counter()
    kept = {key: value for key, value in truth.items() if key != "signals"}
    if say is not None:
        say(kept)
    axes, verdict = _axes_row(case, truth), None
    try:
        closer(folder / "dataset.yaml", out_dir)
        seconds = time.perf_counter() - made
        verdict = read_verdict(out_dir / "verdict.json")
        row, entries = score_case(truth, verdict)
        said = " + ".join(f"{entry['effect']}@{entry['joint']}" for entry in verdict["verdict"]) or "[]"
        row |= {"error": "", "seconds": seconds, "making_seconds": made - started, "verdict": said}
        result: dict[str, Any] = {"case": axes | row, "entries": [axes | entry for entry in entries]}
    except Exception as problem:
        verdict = None
        result = failed_result(case, kept, _tell_error(problem), time.perf_counter() - made)
    if say is not None:
        say(None)
    undeclared = not set(STANDARD) <= set(truth["declared"])
    if extras.reference and undeclared and case.planted and verdict is not None:
        result["case"]["beyond_declared"] = compare_declared(folder, verdict, closer, place / "reference")
    return result


def compare_declared(folder: Path, verdict: dict[str, Any], closer: Closer, place: Path) -> float | None:
    """Largest ratio over the joints of the held-out error to that with rotor, Coulomb and viscous declared.

    Parameters
    ----------
    folder : Path
        The data set.
    verdict : dict
        The verdict on it as it is.
    closer : callable
    place : Path
        Gets the reference data set and its verdict.

    Returns
    -------
    float or None
        None where the reference fails.
    """
    shutil.copytree(folder, place / folder.name)
    document = yaml.safe_load((folder / "dataset.yaml").read_text(encoding="utf-8"))
    changed = copy.deepcopy(document)
    own = [name for name in document["declared_effects"] if name not in STANDARD]
    changed["declared_effects"] = [*STANDARD, *own]
    path = place / folder.name / "dataset.yaml"
    write_text(path, yaml.safe_dump(changed, sort_keys=False))
    out_dir = place / "out"
    out_dir.mkdir()
    try:
        closer(path, out_dir)
        reference = read_verdict(out_dir / "verdict.json")["joints"]
    except Exception:
        return None
    ratios = [
        joint["rms_after"] / reference[name]["rms_after"]
        for name, joint in verdict["joints"].items()
        if reference.get(name, {}).get("rms_after")
    ]
    return max(ratios, default=None)


def failed_result(case: Case, truth: dict[str, Any] | None, error: str, seconds: float) -> dict[str, Any]:
    """Result of a case that ended in an error or at its time limit: nothing in it is found."""
    entries: list[dict[str, Any]] = []
    row: dict[str, Any] = {"planted": len(case.planted), "exact": False, "null": not case.planted}
    if truth is not None:
        row, entries = score_case(truth, {"verdict": [], "joints": {}})
        # a failure names nothing: it is no false name, nor an effect found
        row |= {"exact": False, "false_in_null": None, "worse": None, "extra": None, "unknowns": None}
        if row["outside_answered"] is not None:
            row["outside_answered"] = False
        entries = [entry | {"found": False, "grade": "failed"} for entry in entries]
    row |= {"error": error, "seconds": seconds, "outcome": "failed", "verdict": ""}
    axes = _axes_row(case, truth)
    return {"case": axes | row, "entries": [axes | entry for entry in entries]}


def _tell_error(problem: Exception) -> str:
    where = traceback.extract_tb(problem.__traceback__)[-1]
    return f"{type(problem).__name__}: {problem} ({Path(where.filename).name}:{where.lineno})"


def _axes_row(case: Case, truth: dict[str, Any] | None) -> dict[str, Any]:
    recipe = case.recipe
    return {f"axis_{name}": value for name, value in case.axes.items()} | {
        "number": case.number, "dataset": case.name, "part": case.part, "seed": case.seed,
        "duration": recipe.duration, "shortened": case.shortened, "told": case.tell(),
        "declared": ", ".join(truth["declared"]) if truth else "",
    }  # fmt: skip


def _work(case: Case, closer: Closer, place: str, channel: Connection, extras: Extras) -> None:
    result = run_case(case, closer, Path(place), lambda truth: channel.send(("truth", truth)), extras)
    channel.send(("result", result))
    channel.close()


class _Job:
    """One case in its own process, with its time limit."""

    def __init__(self, case: Case, closer: Closer, place: Path, keep: bool, limit: float, extras: Extras):
        self.case, self.place, self.keep, self.limit = case, place, keep, limit
        context = multiprocessing.get_context("spawn")
        self.channel, other = context.Pipe(duplex=False)
        self.process = context.Process(target=_work, args=(case, closer, str(place), other, extras))
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
                    # the clock starts with the data set, and anew for what is asked besides the tracer
                    self.truth, self.started = value or self.truth, time.perf_counter()
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


def run_cases(
    cases: Sequence[Case], closer: Closer, jobs: int, limit: float, keep: Path | None,
    report: Callable[[Case, dict[str, Any]], None], extras: Extras = Extras(),
) -> list[dict[str, Any]]:  # fmt: skip
    """Run cases, each in its own process, `jobs` at a time; results in the order of the cases."""
    waiting, running = list(cases), list[_Job]()
    results: dict[int, dict[str, Any]] = {}
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                case = waiting.pop(0)
                place = keep / case.name if keep else Path(tempfile.mkdtemp(prefix="board-"))
                running.append(_Job(case, closer, place, keep is not None, limit, extras))
            wait([job.channel for job in running], timeout=0.5)
            for job in list(running):
                result = job.look()
                if result is not None:
                    running.remove(job)
                    results[job.case.number] = result
                    report(job.case, result)
    finally:
        for job in running:
            job.process.terminate()
            shutil.rmtree(job.place, ignore_errors=True)
    return [results[case.number] for case in cases]


def run_board(
    part: str, out_dir: str | Path, cases: int = 60, seed: int = 0, jobs: int = 1, limit: float = TIME_LIMIT,
    closer: Closer = close_light, only: Iterable[int] | None = None, keep: str | Path | None = None,
    progress: Callable[[str], None] | None = None, extras: Extras = Extras(),
) -> dict[str, Any]:  # fmt: skip
    """Run a part of the board and write its tables; cases that are already there are not run again.

    Parameters
    ----------
    part : str
        ``development`` or ``held_out``.
    out_dir : path-like
        Gets ``cases/<name>.json`` (one by case, so that a stopped board goes on where it was; delete them
        after a change of the tracer), ``cases.parquet`` (a row a case: axes, seconds, error, scores),
        ``entries.parquet`` (a row a planted effect or false entry), ``summary.json`` and ``board.md``.
    cases : int
        Size of the Latin hypercube.
    seed : int
    jobs : int
        Cases at a time.
    limit : float
        Wall time of a case [s]; beyond it the case counts as failed.
    closer : callable
        ``closer(dataset_yaml, out_dir)``, importable.
    only : iterable of int, optional
        Numbers of the cases to run; they are run anew.
    keep : path-like, optional
        Where the data sets and verdicts stay.
    progress : callable, optional
        Gets a line by finished case; by default it is printed.
    extras : Extras
        They have the time limit anew.

    Returns
    -------
    dict
        The summary, as in ``summary.json``.

    Raises
    ------
    InputError
        For an unknown part.
    """
    out_dir = Path(out_dir)
    tell = progress or (lambda line: print(line, flush=True))
    todo = list_cases(part, cases, seed)
    if only is not None:
        numbers = set(only)
        todo = [case for case in todo if case.number in numbers]
    done: dict[int, dict[str, Any]] = {}
    for case in todo if only is None else []:
        path = _result_path(out_dir, case)
        if path.is_file():
            done[case.number] = json.loads(path.read_text(encoding="utf-8"))
    if done:
        kept = f"{len(done)} of {len(todo)} cases are already there"
        tell(f"attribution board: {kept}; another --out runs them anew")

    def report(case: Case, result: dict[str, Any]) -> None:
        done[case.number] = result
        write_text(_result_path(out_dir, case), json.dumps(result, indent=1))
        row = result["case"]
        said = row["error"] or row["verdict"]
        tell(
            f"[{len(done)}/{len(todo)}] #{case.number} {case.tell()} -> {said}: {row['outcome']}, "
            f"{row['seconds']:.0f} s"
        )

    open_cases = [case for case in todo if case.number not in done]
    run_cases(open_cases, closer, jobs, limit, Path(keep) if keep else None, report, extras)
    results = [done[case.number] for case in todo]
    return write_results(results, out_dir)


def _result_path(out_dir: Path, case: Case) -> Path:
    return out_dir / "cases" / f"{case.number:04d}-{case.name}.json"


def write_results(results: Sequence[dict[str, Any]], out_dir: Path) -> dict[str, Any]:
    """Write the board's tables and its summary from the results of its cases."""
    table = pd.DataFrame([result["case"] for result in results])
    entries = pd.DataFrame([entry for result in results for entry in result["entries"]])
    write_table(out_dir / "cases.parquet", table, {"seconds": "s", "duration": "s"})
    write_table(
        out_dir / "entries.parquet", entries, {"size": "1", "findable_size": "1"} if len(entries) else {}
    )
    summary = summarise_board(table, entries)
    write_text(out_dir / "summary.json", json.dumps(summary, indent=1))
    write_text(out_dir / "board.md", write_markdown(summary))
    return summary


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of ``python -m benchmarks.board``."""
    import argparse

    parser = argparse.ArgumentParser(description="Run the attribution board with regimes.")
    parser.add_argument("--part", choices=("development", "held_out"), default="development")
    parser.add_argument("--cases", type=int, default=60, help="size of the Latin hypercube")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--limit", type=float, default=TIME_LIMIT, help="wall time of a case [s]")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument(
        "--case", type=int, action="append", help="run this case alone, anew; may be repeated"
    )
    parser.add_argument("--keep", type=Path, help="where data sets and verdicts stay")
    parser.add_argument(
        "--reference", action="store_true", help="also close the loop with the undeclared friction declared"
    )
    given = parser.parse_args(arguments)
    run_board(
        given.part, given.out, given.cases, given.seed, given.jobs, given.limit, only=given.case,
        keep=given.keep, extras=Extras(given.reference),
    )  # fmt: skip
    sys.stdout.write((given.out / "board.md").read_text(encoding="utf-8"))
    return 0
