"""Ask the closed loop about the cases and score its answers.

python -m benchmarks.outside [NAME ...] [--drawn FIRST LAST] [--seed 0] [--out DIR]

Without names and `--drawn` all listed cases are asked; `--drawn` adds those drawn at random, by number. Each
case's data set, verdict and candidates stay in `DIR/NAME/`; `DIR/scores.jsonl` gets a line a case, and the
end of the output counts them.
"""

import argparse
import dataclasses
import json
import time
import traceback
from pathlib import Path

from benchmarks.outside.cases import CASES
from benchmarks.outside.drawn import draw_case
from benchmarks.outside.generator import make_case
from benchmarks.outside.scoring import score_verdict, summarise
from wearscope.closed_loop.diagnosis import diagnose


def ask(case, place):
    """Make a case, ask the loop, score; a row of `scores.jsonl`."""
    truth = make_case(case, place)
    row = {
        "case": case.name,
        "regime": dataclasses.asdict(case),
        "must": [f"{e}@{j + 1}" for j, e in sorted(truth.must)],
        "may": [f"{e}@{j + 1}" for j, e in sorted(truth.may)],
        "outside": [j + 1 for j in sorted(truth.outside)],
        "notes": truth.notes,
    }
    begin = time.process_time()
    try:
        diagnosis = diagnose(place)
        verdict = diagnosis.verdict
    except Exception as error:  # a crash is an answer too
        (place / "crash.txt").write_text(traceback.format_exc())
        row["crash"] = f"{type(error).__name__}: {error}"
    else:
        (place / "verdict.json").write_text(json.dumps(verdict, indent=2))
        diagnosis.candidates.to_parquet(place / "candidates.parquet")
        score = score_verdict(verdict, truth, diagnosis.prepared.dataset.joints)
        row |= dataclasses.asdict(score) | {"exact": score.exact}
        row["named"] = [_write_entry(entry) for entry in verdict["verdict"]]
    return row | {"seconds": time.process_time() - begin}


def _write_entry(entry):
    place = entry["joint"].removeprefix("joint_")
    return f"{entry['effect']}@{place} {entry['status']} {entry['error_reduction']:.3f} {entry['equivalent']}"


def main():
    """Run the cases asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*")
    parser.add_argument("--drawn", nargs=2, type=int, metavar=("FIRST", "LAST"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("results/outside"))
    options = parser.parse_args()
    cases = [CASES[name] for name in options.names]
    if options.drawn:
        cases += [draw_case(number) for number in range(options.drawn[0], options.drawn[1] + 1)]
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for case in cases or list(CASES.values()):
        rows.append(ask(dataclasses.replace(case, seed=options.seed), options.out / case.name))
        with open(options.out / "scores.jsonl", "a") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        print(json.dumps(rows[-1], indent=1), flush=True)
    print(summarise(rows))


if __name__ == "__main__":
    main()
