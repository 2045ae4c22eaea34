"""Work on several runs at once: the arithmetic on arrays lets other threads work."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from wearscope.closed_loop.intake.prepared import PreparedRun

#: Most threads; samples of a joint in all from which they are worth it.
_THREADS, _WORTH = 2, 500_000

_Out = TypeVar("_Out")


def map_runs(function: Callable[..., _Out], runs: Sequence[PreparedRun], *more: Sequence[Any]) -> list[_Out]:
    """What a function gives of each run, in their order.

    Parameters
    ----------
    function : callable
        ``function(run, ...)``; of one run it must depend on nothing that it changes of another.
    runs : sequence of PreparedRun
    more : sequence
        Further arguments, one a run.
    """
    threads = min(_THREADS, len(os.sched_getaffinity(0)), len(runs))
    if threads < 2 or sum(run.tau.size for run in runs) < _WORTH:
        return [function(*one) for one in zip(runs, *more, strict=True)]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, runs, *more))
