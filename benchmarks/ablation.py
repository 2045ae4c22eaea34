"""What each mechanism of the search is worth: switched off on cases of both generators, and scored.

    python -m benchmarks.ablation [--cases 60] [--seed 7] [--drawn FIRST LAST] [--seconds 30]
        [--most ROWS] [--only NAME ...] [--out FILE]
    python -m benchmarks.ablation --table FILE

A case is diagnosed once as it is, and the mechanisms that change anything there are noted. Each of those is
switched off alone; the others cannot change the case's answer. What the searches of a case have in common is
worked out once (`benchmarks/remembering.py`). A line a case goes to `--out` as it comes, and cases that stand
there are not run again. Printed: in how many cases each mechanism acted, and the cases that are won and lost
without it.
"""

import argparse
import gc
import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from statsmodels.stats.contingency_tables import mcnemar

from benchmarks.board.regimes import list_cases
from benchmarks.outside.drawn import draw_case
from benchmarks.policy import TakesTooLong, read_lines, tell_answer
from benchmarks.remembering import remember
from benchmarks.scoring import score_case
from wearscope.closed_loop import diagnosis
from wearscope.closed_loop.selection import answer, generic, naming, revision, rule, search, stepwise
from wearscope.closed_loop.selection.policy import Policy
from wearscope.errors import InputError


def _give(value: Any) -> Callable[..., Any]:
    """A function that gives a value, whatever it is asked."""
    return lambda *args, **kwargs: value


def _keep(position: int) -> Callable[..., Any]:
    """A function that gives back one of its arguments."""
    return lambda *args, **kwargs: args[position]


def _fit_reversals_by_width(prepared: Any, assembly: Any, forms: bool = True) -> Any:
    return REFINE(prepared, assembly, False)


def _separated_only(evidence: Any, policy: Policy) -> list:
    best = max(evidence, key=lambda e: e.gain)
    return [e for e in evidence if not rule.separates_names(best, e, policy)]


def _leave_rests(problem: Any, after: Any, first: int, names: Any) -> tuple[Any, list[list[str]]]:
    return after, [list(own) for own in names]


REFINE = search.refine_reversals
Place = tuple[Any, str, Callable[..., Any]]
MECHANISMS: dict[str, list[Place]] = {
    "laws": [(answer, "suit_laws", _keep(1))],
    "single_joints": [(answer, "prefer_single_joints", _keep(1))],
    "past": [(generic, "doubt_for_past", lambda own, found: (found, {}))],
    "pairs": [(stepwise, "find_pair", _give([]))],
    "forms": [(search.Search, "passes_given_forms", _give(False))],
    "bodies": [(search.Search, "find_losses_given_bodies", lambda own, beside: own.standard_losses)],
    "drifts": [(search, "does_drift_explain", _give(False))],
    "delays": [(search.Search, "is_delay", _give(True))],
    "slow delays": [(search, "lags_slow_torque", _give(True))],
    "generic doubts names": [(generic, "doubt", _keep(2))],
    "generic stage": [(answer, "explain_rest", lambda own, terms, found: (found, {}, {}))],
    "restore_standard": [(stepwise, "restore_standard", _keep(1)), (generic, "restore_standard", _keep(1))],
    "is_much": [(revision, "is_much", _give(False))],
    "is_refined": [(revision, "is_refined", _give(False))],
    "absorb": [(revision, "absorb", _keep(2))],
    "offsets first": [(revision, "_represents_weight", _give(False))],
    "unbelievable": [(answer, "find_unbelievable", _give({}))],
    "dependence": [(answer, "find_dependence", _give({}))],
    "relieves": [(rule, "relieves", _give(False))],
    "wears_off": [(rule, "wears_off", _give(False))],
    "is_local": [(rule, "is_local", _give(False))],
    "cancels": [(rule, "cancels", _give(False))],
    "is_own": [(rule, "is_own", _give(True))],
    "beyond_chance": [(rule, "is_beyond_chance", _give(False))],
    "is_driven_alone": [(rule, "is_driven_alone", _give(False))],
    "may_coincide": [(rule, "may_coincide", _give(False))],
    "fit_alike": [(rule, "fit_alike", lambda tied, policy: list(tied))],
    "gravity": [(naming, "opposes_gravity", _give(False))],
    "confidence set": [(naming, "find_confidence_set", _separated_only)],
    "name_terms": [(answer, "name_terms", lambda own, found: (found, [[] for _ in found]))],
    "form of reversals": [(search, "refine_reversals", _fit_reversals_by_width)],
    "undetermined": [(diagnosis, "drop_undetermined", diagnosis.drop_undetermined)],
    "rests": [(diagnosis, "settle_rests", _leave_rests)],
}  # fmt: skip
"""Functions by mechanism, with what takes their place where it is switched off."""
#: Not seen while the case is diagnosed as it is: always switched off.
_ALWAYS = ("forms", "bodies", "form of reversals")


def _tell(value: Any) -> Any:
    """What of an outcome can be compared: names of terms, or the value itself."""
    if isinstance(value, tuple):
        return tuple(_tell(part) for part in value)
    if isinstance(value, list | dict):
        return [id(x) for x in value] if isinstance(value, list) else list(value)
    if isinstance(value, np.ndarray):
        return value.tobytes()
    return value if isinstance(value, bool | int | float | str | type(None)) else id(value)


@contextmanager
def watch() -> Iterator[set[str]]:
    """See which mechanisms give something else than they would if they were switched off."""
    acted: set[str] = set(_ALWAYS)
    with ExitStack() as stack:
        for name, places in MECHANISMS.items():
            if name in (*_ALWAYS, "undetermined", "rests"):
                continue
            for module, function, off in places:
                real = getattr(module, function)

                def ask(*args: Any, real: Any = real, off: Any = off, name: str = name, **kwargs: Any) -> Any:
                    own = real(*args, **kwargs)
                    if name not in acted and _tell(own) != _tell(off(*args, **kwargs)):
                        acted.add(name)
                    return own

                stack.enter_context(patch.object(module, function, ask))
        yield acted


@contextmanager
def switch_off(name: str) -> Iterator[None]:
    """Without one mechanism."""
    with ExitStack() as stack:
        for module, function, off in MECHANISMS[name]:
            stack.enter_context(patch.object(module, function, off))
        yield


def try_case(case: Any, limit: float, most: int, only: list[str]) -> dict[str, Any]:
    """Scores of one case as it is and without each mechanism that acted."""
    line: dict[str, Any] = {
        "case": case.name, "told": case.tell(), "acted": [], "scores": {}, "seconds": {}, "why": "",
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / case.name
        try:
            truth = case.make(folder)
            problem = diagnosis.pose_problem(folder / "dataset.yaml")
        except InputError as problem:
            return line | {"why": f"refused: {problem}"}
        except Exception as problem:
            return line | {"why": f"not made: {problem}"}
        if problem.prepared.moving.sum() * len(problem.target) > most:
            return line | {"why": "too large"}
        scores: dict[tuple, dict] = {}
        begun = time.process_time()

        def stop(_: str) -> None:
            if not line["scores"] and time.process_time() - begun > limit:
                raise TakesTooLong

        def run(name: str) -> None:
            started = time.process_time()
            policy = Policy(zero_level=1.0) if name == "undetermined" else Policy()
            tried = search.Search(problem, policy, stop)
            found = answer.find_terms(tried)
            stop("")
            key = (*tell_answer(tried, found), name == "rests", tuple(sorted(found.dependence)))
            if key not in scores:
                verdict = diagnosis.conclude(tried, found).verdict
                row = score_case(truth, verdict)[0]
                kept = ("null", "exact", "extra", "missed", "required", "named", "false_unexplained", "worse")
                names = sorted([e["joint"], e["effect"]] for e in verdict["verdict"])
                scores[key] = {"names": names} | {key: row[key] for key in kept}
            line["scores"][name], line["seconds"][name] = scores[key], round(time.process_time() - started, 2)

        with remember() as memory:
            try:
                with watch() as acted:
                    run("as it is")
                line["acted"] = sorted(acted | {"undetermined", "rests"})
                for name in line["acted"]:
                    if not only or name in only:
                        with switch_off(name):
                            run(name)
                        memory.limit()
            except TakesTooLong:
                return line | {"why": "took too long"}
    return line


def print_table(lines: list[dict]) -> None:
    """Markdown: a row a mechanism with the cases in which it acted, and what is won and lost without it."""
    kept = [line for line in lines if line["scores"]]
    right: dict[str, Callable[[dict], bool]] = {
        "exact": lambda s: bool(s["exact"]),
        "no extra": lambda s: not s["extra"],
        "no false unexplained": lambda s: not s["false_unexplained"],
        "no joint worse": lambda s: not s["worse"],
    }
    told = ", ".join(
        f"{name} {sum(is_right(line['scores']['as it is']) for line in kept)}"
        for name, is_right in right.items()
    )
    print(f"{len(kept)} of {len(lines)} cases; as it is: {told}\n")
    print(
        "| without | acted | names change | " + " | ".join(f"{name}: won, lost (p)" for name in right) + " |"
    )
    print("|---|---|---|" + "---|" * len(right))
    for name in MECHANISMS:
        tried = [line for line in kept if name in line["scores"]]
        changed = sum(line["scores"][name]["names"] != line["scores"]["as it is"]["names"] for line in tried)
        cells = []
        for is_right in right.values():
            pairs = [(is_right(line["scores"]["as it is"]), is_right(line["scores"][name])) for line in tried]
            won, lost = pairs.count((False, True)), pairs.count((True, False))
            p = float(mcnemar([[0, lost], [won, 0]], exact=True).pvalue) if won + lost else 1.0
            cells.append(f"{won}, {lost} ({p:.2g})" if won + lost else "-")
        print(f"| {name} | {len(tried)} | {changed} | " + " | ".join(cells) + " |")


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=7)
    parser.add_argument("--drawn", nargs=2, type=int, metavar=("FIRST", "LAST"))
    parser.add_argument("--seconds", type=float, default=30.0, help="of processor, for the case as it is")
    parser.add_argument("--most", type=int, default=60_000, help="rows of the fit times joints")
    parser.add_argument("--only", nargs="*", default=[], choices=sorted(MECHANISMS), metavar="NAME")
    parser.add_argument("--out", type=Path, default=Path("ablation.jsonl"))
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    if args.table is None:
        there = {line["case"] for line in read_lines(args.out)}
        cases = list_cases("development", args.cases, args.seed) if args.cases else []
        if args.drawn:
            cases = [*cases, *(draw_case(k) for k in range(args.drawn[0], args.drawn[1] + 1))]
        for case in cases:
            if case.name in there:
                continue
            line = try_case(case, args.seconds, args.most, args.only)
            gc.collect()
            with args.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
            print(f"{case.tell()}: {line['why'] or sum(line['seconds'].values())}", flush=True)
    print_table(read_lines(args.table or args.out))


if __name__ == "__main__":
    main()
