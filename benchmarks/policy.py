"""What the rule's numbers are worth: each halved and doubled, on development cases of the attribution board.

    python benchmarks/policy.py [--cases 24] [--seed 71] [--seconds 12] [--jobs 2] [--out FILE]

A case is diagnosed once with the numbers as they are and twice for each of them; cases that then take longer
than `--seconds` are left out, and counted. Printed: for each number, of how many cases the names change, and
how many planted cases are exact, required effects are named, entries are extra. A number that may not be
doubled takes its largest value.
"""

import argparse
import json
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

from pydantic import ValidationError

from wearscope.attribution_board.generate import generate_dataset
from wearscope.attribution_board.regimes import list_cases
from wearscope.attribution_board.score import score_case
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.selection.policy import Policy

#: Not numbers of the rule.
_LEFT_OUT = ("seed",)
#: What a share takes where its double is none.
_LARGEST = 0.999


def list_policies():
    """Policies by number and factor; the present one under ``as it is``."""
    today = Policy()
    policies = {"as it is": today}
    for name, value in today.model_dump().items():
        if name in _LEFT_OUT:
            continue
        for word, factor in (("halved", 0.5), ("doubled", 2.0)):
            changed = round(value * factor) if isinstance(value, int) else value * factor
            try:
                policies[f"{name} {word}"] = Policy(**{name: changed})
            except ValidationError:
                policies[f"{name} {word}"] = Policy(**{name: _LARGEST})
    return policies


def try_case(limit, case):
    """Scores of one case by policy; None where it takes too long or cannot be made."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / case.name
        try:
            truth = generate_dataset(folder, case.machine, case.planted, case.seed, case.recipe)
        except Exception as problem:
            return None, f"not made: {problem}"
        scores = {}
        for name, policy in list_policies().items():
            started = time.process_time()
            verdict = diagnose(folder / "dataset.yaml", policy=policy).verdict
            row = score_case(truth, verdict)[0]
            names = sorted((e["joint"], e["effect"]) for e in verdict["verdict"])
            scores[name] = {
                "names": names, "null": row["null"], "exact": row["exact"], "extra": row["extra"],
                "required": row["required"], "named": row["named"],
            }  # fmt: skip
            if not scores.keys() - {"as it is"} and time.process_time() - started > limit:
                return None, "too long"
        return scores, ""


def print_table(results):
    """Markdown: a row a policy."""
    kept = [scores for scores, _ in results if scores]
    why = sorted({text for scores, text in results if not scores})
    print(f"{len(kept)} of {len(results)} cases ({'; '.join(why) or 'none left out'})\n")
    print("| number | names change in | exact, planted | required named | extra, planted | false, nulls |")
    print("|---|---|---|---|---|---|")
    for name in list_policies():
        planted = [s[name] for s in kept if not s[name]["null"]]
        nulls = [s[name] for s in kept if s[name]["null"]]
        changed = sum(s[name]["names"] != s["as it is"]["names"] for s in kept)
        print(
            f"| {name} | {changed} | {sum(s['exact'] for s in planted)}/{len(planted)} "
            f"| {sum(s['named'] for s in planted)}/{sum(s['required'] for s in planted)} "
            f"| {sum(s['extra'] > 0 for s in planted)} | {sum(s['extra'] > 0 for s in nulls)}/{len(nulls)} |"
        )


def main():
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=24)
    parser.add_argument("--seed", type=int, default=71)
    parser.add_argument("--seconds", type=float, default=12.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--out")
    args = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    cases = list_cases("development", args.cases, args.seed)
    results = []
    with ProcessPoolExecutor(args.jobs) as pool:
        for number, found in enumerate(pool.map(partial(try_case, args.seconds), cases), start=1):
            results.append(found)
            print(f"case {number} of {len(cases)} {found[1]}", flush=True)
    print_table(results)
    if args.out:
        Path(args.out).write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
