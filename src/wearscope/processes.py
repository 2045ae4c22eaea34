"""Processes that end with the one they work for."""

import os
import select
import signal
import sys
import threading
from collections.abc import Mapping
from pathlib import Path

#: Environment variable with the process that a job works for, see `identify_process`.
MAIN = "WEARSCOPE_MAIN"
#: Environment variable with the job that started a Snakemake of its own, on the same machine.
STARTER = "WEARSCOPE_STARTER"
#: Python as every child process is started: the working directory, which may be a data set, holds no modules.
PYTHON = (sys.executable, "-P")


def isolate(environment: Mapping[str, str]) -> dict[str, str]:
    """Environment of a child process in which nothing that lies in the working directory is run or obeyed.

    Python, and what it starts in turn, imports nothing from there, and numba reads its settings from the
    environment alone: a ``.numba_config.yaml`` could name a cache, whose content runs.
    """
    paths = [one for one in environment.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(one)]
    kept = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    return {
        "NUMBA_CACHE_DIR": "",
        **kept,
        **({"PYTHONPATH": os.pathsep.join(paths)} if paths else {}),
        "PYTHONSAFEPATH": "1",
    }


def identify_process(pid: int) -> str:
    """Process number and start time, which no later process shares; empty where the system does not tell."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    # Fields are counted after the name, which may hold anything; the 22nd of all is the start time.
    return f"{pid}:{stat.rpartition(')')[2].split()[19]}"


def end_with(identity: str) -> None:
    """Kill this process when another one is no more.

    A main process that is killed alone cannot stop its jobs; without this they write on.

    Parameters
    ----------
    identity : str
        See `identify_process`; empty for none.
    """
    if not identity or not hasattr(os, "pidfd_open"):
        return
    pid = int(identity.partition(":")[0])
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        os.kill(os.getpid(), signal.SIGKILL)
        return
    except OSError:  # not permitted here
        return
    if identify_process(pid) != identity:
        os.kill(os.getpid(), signal.SIGKILL)

    def wait() -> None:
        poll = select.poll()
        poll.register(handle, select.POLLIN)
        poll.poll()
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=wait, name="end with the main process", daemon=True).start()
