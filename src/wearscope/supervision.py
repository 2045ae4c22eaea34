"""Runs work in a child process, which is killed if it does not progress within a time limit.

A user's detector, test-cycle or effect may loop in compiled code, call ``sys.exit`` or crash the interpreter.
The process that runs it cannot prevent this; its parent can report it.
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
#: Signals that a user or the kernel sends to end a process, e.g. when memory is short; crashes cause others.
_FROM_OUTSIDE = (signal.SIGHUP, signal.SIGINT, signal.SIGKILL, signal.SIGTERM)


class ProcessLost(Exception):
    """A child process has ended because of its work; the message continues a sentence about that work."""


class ProcessKilled(InputError):
    """A child process was killed by a user or the system, so its work is not to blame."""


def run_supervised(work: Callable[[], Iterator[T]], limit: float) -> Iterator[T]:
    """Run a generator in a child process.

    Parameters
    ----------
    work : callable
        Returns the generator, whose items must be picklable. It is called in the child. If a user or the
        system kills the child, it is called once more and must then continue after the last item received.
    limit : float
        Longest time between two items, and from the last item to the end [s].

    Yields
    ------
    item
        The items of the generator.

    Raises
    ------
    ProcessLost
        If the next item takes longer, or the child ends too early.
    ProcessKilled
        If the child is killed twice.
    Exception
        Any error that the generator raises.
    """
    try:
        yield from _run_once(work, limit)
    except ProcessKilled:
        yield from _run_once(work, limit)


def _run_once(work: Callable[[], Iterator[T]], limit: float) -> Iterator[T]:
    """Run a generator in a child process, see `run_supervised`; raise ProcessKilled at the first kill."""
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
        Name of the work in messages.

    Raises
    ------
    InputError
        If the function takes longer or ends the process.
    Exception
        Any error that the function raises.
    """

    def once() -> Iterator[T]:
        yield function()

    try:
        return next(run_supervised(once, limit))
    except ProcessLost as error:
        raise InputError(f"{what} {error}; correct it, or raise time_limit of the configuration.") from None


def _serve(work: Callable[[], Iterator[Any]], sender: Connection, parent: str) -> None:
    """Send the items of a generator, its error or its end to the parent; runs in the child process."""
    end_with(parent)
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C ends this process without a traceback
    try:
        for item in work():
            sender.send(("item", item))
    except Exception as error:
        error.add_note(traceback.format_exc())
        try:
            sender.send(("error", error))
        except Exception:  # the error cannot be pickled
            with suppress(OSError):
                sender.send(("error", RuntimeError(traceback.format_exc())))
    else:
        sender.send(("end", None))


def _explain_end(code: int | None) -> ProcessLost | ProcessKilled:
    """Return the error for a child process that ended with an exit code (negative: signal) too early."""
    if code is None or code >= 0:
        return ProcessLost(f"ended its process (exit code {code})")
    name = signal.Signals(-code).name
    if -code in _FROM_OUTSIDE:
        return ProcessKilled(
            f"a process was killed twice ({name}), as the system does where memory is short; free memory or "
            "use fewer cores, and run the same command again."
        )
    return ProcessLost(f"crashed its process ({name})")
