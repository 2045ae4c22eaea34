"""Threads that work on several runs at once; they run in parallel during arithmetic on arrays."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from wearscope.closed_loop.intake.prepared import PreparedRun

#: Largest number of threads; number of samples of a joint in all runs from which several threads pay off.
_THREADS, _WORTH = 2, 500_000

_Out = TypeVar("_Out")
_Given = ParamSpec("_Given")


def keep_to_one_thread(function: Callable[_Given, _Out]) -> Callable[_Given, _Out]:
    """Wrap a function so that linear algebra uses one thread: for small matrices more threads only wait."""

    @wraps(function)
    def limited(*args: _Given.args, **kwargs: _Given.kwargs) -> _Out:
        with threadpool_limits(1):
            return function(*args, **kwargs)

    return limited


def map_runs(function: Callable[..., _Out], runs: Sequence[PreparedRun], *more: Sequence[Any]) -> list[_Out]:
    """Results of a function for each run, in the order of the runs.

    Parameters
    ----------
    function : callable
        ``function(run, ...)``; its result for one run must not depend on what it changes in another.
    runs : sequence of PreparedRun
    more : sequence
        Further arguments, one a run.
    """
    threads = min(_THREADS, len(os.sched_getaffinity(0)), len(runs))
    if threads < 2 or sum(run.tau.size for run in runs) < _WORTH:
        return [function(*one) for one in zip(runs, *more, strict=True)]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, runs, *more))
