"""What the rule's numbers are worth: each halved, doubled and taken out, on development cases of the board.

    python -m benchmarks.policy [--cases 60] [--seed 81] [--seconds 30] [--case K ...] [--number NAME ...]
        [--out FILE]
    python -m benchmarks.policy --table FILE

A case is diagnosed once with the numbers as they are and two or three times for each of them; cases whose
search takes longer than `--seconds` of one core are left out, and counted. What the searches of one case
have in common is worked out once (`benchmarks/remembering.py`). A line a case goes to `--out` as it comes,
and cases that stand there are not run again. Printed: for each number, of how many cases the names change,
and how many planted cases are exact, required effects are named, entries are extra. A number that may not be
halved or doubled takes its least or largest value.
"""

import argparse
import gc
import json
import tempfile
import time
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from benchmarks.board.generate import generate_dataset
from benchmarks.board.regimes import list_cases
from benchmarks.remembering import remember
from benchmarks.scoring import score_case
from wearscope.closed_loop import diagnosis
from wearscope.closed_loop.selection import answer, evidence, search
from wearscope.closed_loop.selection.policy import Policy
from wearscope.errors import InputError

#: Not numbers of the rule.
_LEFT_OUT = ("seed",)
#: Numbers that are read after the search: which names are nothing, and what is left.
_CONCLUDING = ("zero_level", "unexpected", "structure_share", "family_level", "alike")
#: What a share takes where its double is none, and a factor where its half is none.
_LARGEST, _LEAST = 0.999, 1.0
#: Values of numbers at which they decide nothing any more, or another one decides for them.
_WITHOUT = {
    "agreeing": 0.0, "alike": float("inf"), "beyond_chance": float("inf"),
    "beyond_doubt": Policy().beyond_chance, "fewest_blocks": 0.0, "large_share": Policy().material_share,
    "material_alone": Policy().material_whole, "material_apart": 0.0, "material_torque": 0.0,
    "material_whole": 0.0,
    "unexpected": Policy().told_apart, "unknown_level": Policy().family_level, "zero_level": 1.0,
}  # fmt: skip


class TakesTooLong(Exception):
    """A search with the numbers as they are goes on beyond the time that it may take."""


def list_variants(numbers: Collection[str] = ()) -> dict[str, Policy]:
    """The rule's numbers as they are, then with one changed, by its name and what is done to it.

    Parameters
    ----------
    numbers : collection of str
        Those to change; all where none is given.
    """
    variants = {"as it is": Policy()}
    for name, today in Policy().model_dump(exclude=set(_LEFT_OUT)).items():
        if numbers and name not in numbers:
            continue
        for word, value in _change(name, today):
            try:
                policy = Policy(**{name: value})
            except ValidationError:
                policy = Policy(**{name: _LARGEST if value > today else _LEAST})
            variants[f"{name} {word}"] = policy
    return variants


def _change(name: str, value: float) -> list[tuple[str, float]]:
    """Values of a number halved, doubled, and taken out where it can be."""
    whole = isinstance(value, int)
    changed = [(word, value * factor) for word, factor in (("halved", 0.5), ("doubled", 2.0))]
    without = [("taken out", _WITHOUT[name])] if name in _WITHOUT else []
    return [(word, max(1, round(x)) if whole else x) for word, x in changed] + without


def diagnose_variants(
    path: Path, variants: dict[str, Policy], score: Callable[[dict], dict], limit: float = float("inf")
) -> Iterator[tuple[str, dict, float]]:
    """Name, score and seconds of one core of each variant on a data set.

    Parameters
    ----------
    path : Path
        Of its ``dataset.yaml``.
    variants : dict of str to Policy
    score : callable
        What is kept of a verdict.
    limit : float
        Seconds of one core that the first one's search may take.

    Raises
    ------
    TakesTooLong
    """
    problem = diagnosis.pose_problem(path)
    started = time.process_time()

    def stop(_: str) -> None:
        if first and time.process_time() - started > limit:
            raise TakesTooLong

    scores: dict[tuple, dict] = {}
    first = True
    with remember() as memory:
        for name, policy in variants.items():
            begun = time.process_time()
            tried = search.Search(problem, policy, stop)
            found = answer.find_terms(tried)
            stop("")
            key = tell_answer(tried, found)
            if key not in scores:
                scores[key] = score(diagnosis.conclude(tried, found).verdict)
            yield name, scores[key], time.process_time() - begun
            first = False
            memory.limit()


def tell_answer(tried: search.Search, found: answer.Answer) -> tuple:
    """All that a verdict depends on but the rule's numbers that it is not concluded by."""

    def tell(e: evidence.Evidence) -> tuple:
        return (e.chosen.candidate, e.chosen.subset, e.joint, e.gain, e.share, e.fitted, e.refusal)

    return (
        tried.problem, tried.sigma.tobytes(), tuple(sorted(tried.full)),
        *(getattr(tried.policy, name) for name in _CONCLUDING),
        tuple((f.chosen.candidate, f.chosen.subset, tell(f.evidence)) for f in found.found),
        tuple(map(tuple, found.equivalent)),
        tuple((joint, tell(e)) for joint, e in sorted(found.left.items())),
    )  # fmt: skip


def try_case(case: Any, limit: float, variants: dict[str, Policy]) -> dict[str, Any]:
    """Scores of one case by variant; why there are none where it takes too long or cannot be made."""
    line: dict[str, Any] = {"case": case.number, "told": case.tell(), "scores": {}, "seconds": {}, "why": ""}
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / case.name
        try:
            truth = generate_dataset(folder, case.machine, case.planted, case.seed, case.recipe)
        except Exception as problem:
            return line | {"why": f"not made: {problem}"}

        def score(verdict: dict) -> dict:
            row = score_case(truth, verdict)[0]
            names = sorted([e["joint"], e["effect"]] for e in verdict["verdict"])
            kept = ("null", "exact", "extra", "required", "named")
            return {"names": names} | {key: row[key] for key in kept}

        try:
            for name, found, seconds in diagnose_variants(folder / "dataset.yaml", variants, score, limit):
                line["scores"][name], line["seconds"][name] = found, round(seconds, 2)
        except TakesTooLong:
            return line | {"why": "took too long"}
        except InputError as problem:
            return line | {"why": f"refused: {problem}"}
    return line


def print_table(lines: list[dict]) -> None:
    """Markdown: a row a number that changes names, with what comes of it halved / doubled / taken out."""
    kept = [line["scores"] for line in lines if line["scores"]]
    why = [line["why"].split(":")[0] for line in lines if line["why"]]
    left = ", ".join(f"{why.count(text)} {text}" for text in sorted(set(why)))
    print(f"{len(kept)} of {len(lines)} cases ({left or 'none left out'})\n")
    first = [scores["as it is"] for scores in kept]
    nulls = sum(s["null"] for s in first)
    required = sum(s["required"] for s in first if not s["null"])
    print(
        f"| number | names change in, of {len(kept)} | exact, of {len(kept) - nulls} | required named, of "
        f"{required} | extra, of {len(kept) - nulls} | false, of {nulls} nulls |"
    )
    print("|---|---|---|---|---|---|")
    numbers: dict[str, list[str]] = {}
    for name in kept[0] if kept else ():
        numbers.setdefault(name.rsplit(" ", 2 if name.endswith("out") else 1)[0], []).append(name)
    idle = []
    for number, names in numbers.items():
        columns = list(zip(*(_count(kept, name) for name in names), strict=True))
        if number != "as it" and not any(map(int, columns[0])):
            idle.append(number)
            continue
        shown = " | ".join(" / ".join(map(str, column)) for column in columns)
        print(f"| {'as it is' if number == 'as it' else f'`{number}`'} | {shown} |")
    print(f"\nNo name changes with {', '.join(f'`{number}`' for number in idle)}.")


def _count(kept: list[dict], name: str) -> tuple[str, ...]:
    """Cells of a variant: names change, exact, required named, extra, false in nulls."""
    planted = [s[name] for s in kept if not s[name]["null"]]
    nulls = [s[name] for s in kept if s[name]["null"]]
    changed = sum(s[name]["names"] != s["as it is"]["names"] for s in kept)
    counts = (
        changed,
        sum(bool(s["exact"]) for s in planted),
        sum(s["named"] for s in planted),
        sum(s["extra"] > 0 for s in planted),
        sum(s["extra"] > 0 for s in nulls),
    )
    return tuple(map(str, counts))


def read_lines(path: Path) -> list[dict]:
    """Cases that stand in a file."""
    return (
        [json.loads(text) for text in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []
    )


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=60)
    parser.add_argument("--seed", type=int, default=81)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--out", type=Path, default=Path("policy.jsonl"))
    parser.add_argument(
        "--case", type=int, nargs="*", help="numbers of those to run; all where none is given"
    )
    numbers = sorted(Policy().model_dump(exclude=set(_LEFT_OUT)))
    parser.add_argument(
        "--number", choices=numbers, nargs="*", default=[], metavar="NAME", help="numbers to change; all"
    )
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    if args.table is None:
        there = {line["case"] for line in read_lines(args.out)}
        for case in list_cases("development", args.cases, args.seed):
            if case.number in there or (args.case and case.number not in args.case):
                continue
            line = try_case(case, args.seconds, list_variants(args.number))
            gc.collect()
            with args.out.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
            print(f"case {case.number}: {line['why'] or sum(line['seconds'].values())}", flush=True)
    print_table(read_lines(args.table or args.out))


if __name__ == "__main__":
    main()
