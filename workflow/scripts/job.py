"""What every workflow script does around its one call: log, tell progress, end a bad input in one line."""

import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from wearscope.errors import InputError

Say = Callable[[str], None]


@contextmanager
def run_job(snakemake: Any) -> Iterator[Say]:
    """Log a job, and end it where its input is bad.

    Yields a function that writes one line to the log and, under the rule's name, to the terminal. An
    `InputError` is told as its one sentence; anything else is a defect, with its traceback in the log too.
    """
    name = " ".join([snakemake.rule, *map(str, snakemake.wildcards)])
    start = time.monotonic()
    with open(snakemake.log[0], "w", encoding="utf-8", buffering=1) as log:

        def say(text: str) -> None:
            print(f"[{time.monotonic() - start:6.1f} s] {text}", file=log)
            print(f"{name}: {text}", file=sys.stderr, flush=True)

        try:
            yield say
        except InputError as error:
            say(str(error))
            sys.exit(1)
        except Exception:
            traceback.print_exc(file=log)
            raise
        print(f"[{time.monotonic() - start:6.1f} s] done", file=log)


def count_progress(say: Say, total: int, what: str, every: float = 5.0) -> Callable[[int], None]:
    """Return a function to be called with the number done; it says so every few seconds and at the end."""
    last = time.monotonic()

    def report(done: int) -> None:
        nonlocal last
        if done == total or time.monotonic() - last >= every:
            last = time.monotonic()
            say(f"{done}/{total} {what}")

    return report
