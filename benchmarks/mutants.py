"""Do the tests notice a changed operator? Mutants of cosmic-ray, drawn at random, by room.

    make mutants                                          every room, 25 mutants each
    .venv/bin/python -m benchmarks.mutants effects --mutants 40 --seed 1

A room's mutants are tried on the room's fast tests alone, in a copy of the tree. One place of the code gives
one mutant, whatever the number of ways to change it: an operator in another's place, a comparison turned, a
condition negated; with `--values` also a number one up or down, a truth value turned, a loop without rounds.
Annotations, decorators and what only makes a message are left alone. So are bounds: whether the value at a
bound is just enough is no fact about a robot.
A mutant that takes four times as long as the tests do is killed. Cosmic-ray comes by `make mutants`.
"""

import ast
import os
import random
import re
import shlex
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from clones import copy_tree
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import TestOutcome, WorkerOutcome, WorkResult

from benchmarks.command import start_parser, write_heads, write_row

INFERENCE = "src/wearscope/closed_loop/inference"
#: Modules and tests by room; tests in the order in which they are asked.
ROOMS = {
    **{
        room: ([f"src/wearscope/{room}"], [f"tests/{room}"])
        for room in ("detectors", "designs", "effects", "surrogates", "evaluation", "simulation")
    },
    "naming": (
        [f"{INFERENCE}/{name}.py" for name in "gram score moves extensions answer".split()],
        [f"tests/closed_loop/inference/test_{name}.py" for name in "gram planted score".split()]
        + ["tests/closed_loop/test_recovery.py"],
    ),
}
#: Of cosmic-ray's, what makes another value of an operator, not another type.
OPERATORS = (
    "ReplaceBinaryOperator_(?:Add|Sub|Mul|Div|Mod|FloorDiv|Pow)_(?:Add|Sub|Mul|Div)"
    "|ReplaceComparisonOperator_(?:Lt|LtE)_(?:Gt|GtE)|ReplaceComparisonOperator_(?:Gt|GtE)_(?:Lt|LtE)"
    "|ReplaceComparisonOperator_(?:Eq_NotEq|NotEq_Eq|Is_IsNot|IsNot_Is)"
    "|ReplaceUnaryOperator_(?:Delete_USub|Delete_Not|USub_UAdd)|ReplaceAndWithOr|ReplaceOrWithAnd|AddNot"
)
#: Numbers, truth values and loops: half of them are placeholders and chosen constants, which no answer fixes.
VALUES = (
    "NumberReplacer|ReplaceTrueWithFalse|ReplaceFalseWithTrue|ReplaceBreakWithContinue"
    "|ReplaceContinueWithBreak|ZeroIterationForLoop"
)


@dataclass(frozen=True)
class Score:
    """What became of a room's mutants.

    Attributes
    ----------
    places : int
        That could be changed.
    killed : int
        Of the mutants tried.
    survivors : tuple of str
        Where and how, as a diff.
    seconds : float
        [s]
    """

    places: int
    killed: int
    survivors: tuple[str, ...]
    seconds: float


def find_left_alone(file: Path) -> list[tuple[tuple[int, int], tuple[int, int]]]:
    """First and last line and column of annotations, decorators, what is raised and what makes a message."""
    parts: list[Any] = []
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            parts += node.decorator_list
        if isinstance(node, ast.FunctionDef):
            parts.append(node.returns)
        if isinstance(node, ast.arg | ast.AnnAssign):
            parts.append(node.annotation)
        if isinstance(node, ast.Raise | ast.JoinedStr):
            parts.append(node)
    return [
        ((part.lineno, part.col_offset), (part.end_lineno, part.end_col_offset)) for part in parts if part
    ]


def draw_mutants(session: Path, tree: Path, kinds: str, mutants: int, seed: int) -> int:
    """Leave in a session one mutant each at places drawn at random; return how many places there are."""
    with use_db(session, WorkDB.Mode.open) as database:
        wanted = re.compile(f"core/(?:{kinds})")
        alone = {path: find_left_alone(path) for path in tree.glob("src/**/*.py")}
        items = database.work_items
        places: dict[tuple[str, tuple[int, int]], list[tuple[str, int, str]]] = {}
        for item in items:
            (one,) = item.mutations
            left = alone[tree / one.module_path]
            if wanted.fullmatch(one.operator_name) and not any(a <= one.start_pos < b for a, b in left):
                place = places.setdefault((str(one.module_path), one.start_pos), [])
                # Cosmic-ray names its jobs anew each time.
                place.append((one.operator_name, one.occurrence, item.job_id))
        chance = random.Random(seed)
        drawn = chance.sample(sorted(places), min(mutants, len(places)))
        chosen = {chance.choice(sorted(places[place]))[-1] for place in drawn}
        skipped = [item.job_id for item in items if item.job_id not in chosen]
        database.set_multiple_results(skipped, WorkResult(worker_outcome=WorkerOutcome.SKIPPED))
    return len(places)


def read_outcomes(session: Path) -> Iterator[tuple[bool, str]]:
    """Whether it was killed, and how it differs, of each mutant tried."""
    with use_db(session, WorkDB.Mode.open) as database:
        for _, result in database.completed_work_items:
            if result.worker_outcome is not WorkerOutcome.SKIPPED:
                yield result.test_outcome is not TestOutcome.SURVIVED, result.diff or ""


def try_room(room: str, kinds: str, mutants: int, seed: int, budget: float) -> Score:
    """Draw mutants of a room and run its tests on each; those not tried within `budget` seconds are left."""
    modules, tests = ROOMS[room]
    with tempfile.TemporaryDirectory(prefix=f"mutants-{room}-") as temporary:
        tree = Path(temporary) / "tree"
        copy_tree(tree, compiled=False)
        options = "-q -x -p no:cacheprovider -m 'not slow and not long'"
        command = f"{sys.executable} -m pytest {options} {' '.join(tests)}"
        environment = os.environ | {
            "PYTHONPATH": f"{tree / 'src'}",
            "PYTHONDONTWRITEBYTECODE": "1",
            "NUMBA_CACHE_DIR": f"{temporary}/compiled",
            "OMP_NUM_THREADS": "1",
        }

        def run(*words: str | Path, **given: Any) -> subprocess.CompletedProcess[str]:
            return subprocess.run(words, cwd=tree, env=environment, text=True, check=False, **given)

        start = time.monotonic()
        sound = run(*shlex.split(command), capture_output=True)
        if sound.returncode:
            sys.exit(f"{room}: its tests fail as they are:\n{sound.stdout[-3000:]}{sound.stderr[-1000:]}")
        longest = 4 * (time.monotonic() - start) + 20
        file, session = Path(temporary) / "mutants.toml", Path(temporary) / "mutants.sqlite"
        file.write_text(
            f"[cosmic-ray]\nmodule-path = {modules}\nexcluded-modules = []\ntimeout = {longest:.0f}\n"
            f'test-command = """{command}"""\n[cosmic-ray.distributor]\nname = "local"\n',
            encoding="utf-8",
        )
        tool = (sys.executable, "-m", "cosmic_ray.cli")
        run(*tool, "init", file, session).check_returncode()
        places = draw_mutants(session, tree, kinds, mutants, seed)
        start = time.monotonic()
        try:
            run(*tool, "exec", file, session, timeout=budget).check_returncode()
        except subprocess.TimeoutExpired:
            print(f"{room}: ended after {budget:.0f} s, with mutants left", file=sys.stderr)
        outcomes = list(read_outcomes(session))
    survivors = tuple(diff for killed, diff in outcomes if not killed)
    return Score(places, len(outcomes) - len(survivors), survivors, time.monotonic() - start)


def main() -> None:
    """Try the rooms asked for; print survivors, and a table of how many were killed."""
    parser = start_parser(__doc__)
    parser.add_argument("rooms", nargs="*", metavar="ROOM", help=f"of {', '.join(ROOMS)}; all unless given")
    parser.add_argument("--mutants", type=int, default=25, help="a room; default 25")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--values", action="store_true", help="change numbers, truth values and loops too")
    parser.add_argument("--least", type=float, default=0.0, help="share to be killed, or it fails; default 0")
    parser.add_argument("--budget", type=float, default=3600.0, help="seconds a room; default 3600")
    given = parser.parse_args()
    if unknown := set(given.rooms) - set(ROOMS):
        parser.error(f"no such room: {', '.join(sorted(unknown))}")
    kinds = f"{OPERATORS}|{VALUES}" if given.values else OPERATORS
    rows, lived, all_tried = [], 0, 0
    for room in given.rooms or ROOMS:
        score = try_room(room, kinds, given.mutants, given.seed, given.budget)
        for diff in score.survivors:
            print(f"{room}: survived\n{diff}\n")
        tried = score.killed + len(score.survivors)
        lived, all_tried = lived + len(score.survivors), all_tried + tried
        share = f"{score.killed / tried:.0%}" if tried else "-"
        print(f"{room}: {score.killed} of {tried} killed in {score.seconds:.0f} s\n", flush=True)
        rows.append(write_row(room, score.places, tried, score.killed, share))
    print(write_heads("room", "places", "mutants", "killed", "share"), *rows, sep="\n")
    if lived > (1.0 - given.least) * all_tried:
        sys.exit(f"{lived} of {all_tried} mutants live; at least {given.least:.0%} are to be killed")


if __name__ == "__main__":
    main()
