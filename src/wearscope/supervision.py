"""Work in a process of its own, which is ended where it does not go on within a time limit.

What runs in one process cannot be ended from within: an own detector, test-cycle or effect may loop in
compiled code, call ``sys.exit`` or crash the interpreter.
"""

import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any, TypeVar

from wearscope.errors import InputError
from wearscope.processes import end_with, identify_process

T = TypeVar("T")
#: Signals by which others end a process, such as the kernel where memory is short; a crash has other ones.
_FROM_OUTSIDE = (signal.SIGHUP, signal.SIGINT, signal.SIGKILL, signal.SIGTERM)


class ProcessLost(Exception):
    """A process died; the message says why, worded to follow the name of its work."""


class ProcessKilled(InputError):
    """A process was ended from outside, which says nothing about its work."""


def run_supervised(work: Callable[[], Iterator[T]], limit: float) -> Iterator[T]:
    """Run a generator in a child process.

    Parameters
    ----------
    work : callable
        Makes the generator, in the child; what it yields must be picklable. It is called again, for what was
        not yielded, where somebody else kills the child.
    limit : float
        Longest time to each next item, and to the end [s].

    Yields
    ------
    item
        As the generator yields it.

    Raises
    ------
    ProcessLost
        Where the next item takes longer, or the child ends without one.
    ProcessKilled
        Where it was killed twice.
    Exception
        What the generator raises.
    """
    try:
        yield from _run_once(work, limit)
    except ProcessKilled:
        yield from _run_once(work, limit)


def _run_once(work: Callable[[], Iterator[T]], limit: float) -> Iterator[T]:
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    child = context.Process(target=_serve, args=(work, sender, identify_process(os.getpid())), daemon=False)
    child.start()
    sender.close()
    try:
        while True:
            if not receiver.poll(limit):
                raise ProcessLost(f"took longer than {limit:g} s")
            try:
                kind, content = receiver.recv()
            except EOFError:
                child.join()
                raise _explain_end(child.exitcode) from None
            if kind == "end":
                return
            if kind == "error":
                raise content
            yield content
    finally:
        child.kill()
        child.join()
        receiver.close()


def call_supervised(function: Callable[[], T], limit: float, what: str) -> T:
    """Call a function in a child process.

    Parameters
    ----------
    function : callable
        Its result must be picklable.
    limit : float
        Longest time [s].
    what : str
        What messages call it.

    Raises
    ------
    InputError
        Where it takes longer or ends the process.
    Exception
        What the function raises.
    """

    def once() -> Iterator[T]:
        yield function()

    try:
        return next(run_supervised(once, limit))
    except ProcessLost as error:
        raise InputError(f"{what} {error}; correct it, or raise time_limit of the configuration.") from None


def _serve(work: Callable[[], Iterator[Any]], sender: Connection, parent: str) -> None:
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # an interrupt ends this process without a traceback
    try:
        for item in work():
            sender.send(("item", item))
    except Exception as error:
        error.add_note(traceback.format_exc())
        try:
            sender.send(("error", error))
        except Exception:  # what is raised cannot be sent
            with suppress(OSError):
                sender.send(("error", RuntimeError(traceback.format_exc())))
    else:
        sender.send(("end", None))


def _explain_end(code: int | None) -> ProcessLost | ProcessKilled:
    if code is None or code >= 0:
        return ProcessLost(f"ended its process (exit code {code})")
    name = signal.Signals(-code).name
    if -code in _FROM_OUTSIDE:
        return ProcessKilled(
            f"a process was killed twice ({name}), as the system does where memory is short; free memory or "
            "use fewer cores, and run the same command again."
        )
    return ProcessLost(f"crashed its process ({name})")
