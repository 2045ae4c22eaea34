"""What is left and a name would explain, were its parameters those of such a machine."""

from collections.abc import Iterable

from wearscope.closed_loop.selection import rule
from wearscope.closed_loop.selection.evidence import Evidence
from wearscope.closed_loop.selection.found import Found
from wearscope.closed_loop.selection.search import Search


def find_unbelievable(search: Search, found: list[Found], joints: Iterable[int]) -> dict[int, Evidence]:
    """By joint, the name that explains most of what is left, and is refused for its parameters alone.

    What has its form is there, whatever it is: it makes the joint `unexplained`.

    Parameters
    ----------
    search : Search
    found : list of Found
        All that was named.
    joints : iterable of int
        Those that are asked.
    """
    search.sigma = search.scale(found)
    assembly = search.assemble(found)
    offered = search.candidates(assembly, found, joints, every=True)
    by_run = search.problem.layout.folds.by_run
    left: dict[int, Evidence] = {}
    for e in sorted(search.weigh_all(assembly, offered, search.find_least(assembly)), key=lambda e: -e.gain):
        explains = rule.explains_unbelievably(e, search.policy, by_run)
        if e.joint not in left and explains and not search.drifts(assembly, e):
            left[e.joint] = e
    return left
