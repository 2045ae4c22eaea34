"""New inputs, other than those of the tests: ``cd tests; python -m hostile 20 --first 70000``."""

import argparse
import tempfile
from pathlib import Path

from hostile import STARTING, SUBJECTS, Runner, judge, make_case

parser = argparse.ArgumentParser(prog="python -m hostile", description=__doc__)
parser.add_argument("inputs", type=int, help="for each command; a quarter of it where the workflow starts")
parser.add_argument("--first", type=int, default=70_000, help="number of the first input")
parser.add_argument("--commands", nargs="+", choices=SUBJECTS, metavar="NAME", help="all where left out")
given = parser.parse_args()

tried = wrong = 0
most = (0.0, 0)
with Runner() as run:
    for name in given.commands or SUBJECTS:
        for number in range(given.first, given.first + given.inputs // (4 if name in STARTING else 1)):
            with tempfile.TemporaryDirectory(prefix="hostile-") as made:
                folder = Path(made) / "here"
                folder.mkdir()
                case = make_case(name, number, folder)
                outcome = run(case.arguments, folder, case.around)
                told = judge(case.made, outcome, folder, case.around)
            most = max(most[0], outcome.seconds), max(most[1], outcome.memory)
            tried, wrong = tried + 1, wrong + bool(told)
            if told:
                print(f"{name} {number}: {case.told}: {told}", flush=True)
print(f"{tried} inputs, {wrong} wrong; at most {most[0]:.1f} s and {most[1] / 2**30:.2f} GiB")
