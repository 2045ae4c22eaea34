"""Files that someone careless, or with ill will, could hand over, and the commands that read them.

`make_case` makes the n-th input of a subject: a sound folder of which a file is spoiled, and the command line
that reads it. `Runner` runs command lines, each in a process of its own with bounds on time and memory:

    with Runner() as run:
        folder.mkdir()
        case = make_case("check dataset", 7, folder)
        print(case.told, run(case.arguments, folder))
"""

from hostile.runner import RAN, Outcome, Runner, judge
from hostile.subjects import FILELESS, STARTING, SUBJECTS, Case, make_case

__all__ = ["FILELESS", "RAN", "STARTING", "SUBJECTS", "Case", "Outcome", "Runner", "judge", "make_case"]
