"""Processes that end with the one they work for, and obey nothing that lies in their working directory."""

import atexit
import os
import resource
import select
import shutil
import signal
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, suppress
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import NoReturn

from wearscope import limits
from wearscope.errors import InputError

#: Environment variable with the process that a job works for, see `identify_process`.
MAIN = "WEARSCOPE_MAIN"
#: Environment variable with the job that started a Snakemake of its own, on the same machine.
STARTER = "WEARSCOPE_STARTER"
#: Python as every child process is started: the working directory, which may be a data set, holds no modules.
PYTHON = (sys.executable, "-P")


def isolate(environment: Mapping[str, str]) -> dict[str, str]:
    """Environment of a child process that imports nothing from its working directory."""
    paths = [one for one in environment.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(one)]
    kept = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    return {
        **kept,
        **({"PYTHONPATH": os.pathsep.join(paths)} if paths else {}),
        "PYTHONSAFEPATH": "1",
    }


def open_standard() -> None:
    """Open standard streams that were closed, so that no file is taken for one of them."""
    for handle in range(3):
        try:
            os.fstat(handle)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest handle that is free
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


class _Elsewhere(PathFinder):
    """Imports modules that would read a settings file of the working directory in the root directory."""

    @classmethod
    def find_spec(
        cls, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find one of these modules; all others are left to Python's own finders."""
        if fullname not in ("matplotlib", "numba.core.config"):
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.loader is None:
            return None
        run = spec.loader.exec_module

        def run_elsewhere(module: ModuleType) -> None:
            with chdir("/"):
                run(module)
            if fullname == "numba.core.config":  # which looks again whenever it compiles
                vars(module)["_config_fname"] = os.devnull

        vars(spec.loader)["exec_module"] = run_elsewhere
        return spec


def ignore_settings_here() -> None:
    """Have no library obey a settings file of the working directory, which may be a data set.

    A ``.numba_config.yaml`` may name a cache, whose content runs; a ``matplotlibrc`` changes figures.
    """
    if _Elsewhere not in sys.meta_path:
        sys.meta_path.insert(0, _Elsewhere)


def keep_compiled() -> None:
    """Keep compiled functions for this process and its children alone where no lasting place can be written.

    Numba keeps them next to their module, else in the user's cache, and refuses to start without either.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    there = next((one for one in (cache, *cache.parents) if os.path.exists(one)), cache)
    lasting = any(os.access(one, os.W_OK | os.X_OK) for one in (Path(__file__).parent, there))
    if not lasting and "NUMBA_CACHE_DIR" not in os.environ:
        os.environ["NUMBA_CACHE_DIR"] = made = tempfile.mkdtemp(prefix="wearscope-compiled-")
        atexit.register(shutil.rmtree, made, ignore_errors=True)


@contextmanager
def bound_memory(path: str | Path) -> Iterator[None]:
    """Refuse a file that takes more memory while it is read than `wearscope.limits` says.

    What a file says of its own size need not be so. Only Linux tells what a process holds, and Arrow's own
    memory pool reserves a gigabyte at its first use, which would count.

    Raises
    ------
    InputError
    """
    import pyarrow as pa

    pool = pa.default_memory_pool()
    pa.set_memory_pool(pa.system_memory_pool())
    held = Path("/proc/self/statm")
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    most = limits.READING_BYTES
    if held.is_file():
        data = int(held.read_text(encoding="utf-8").split()[5]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_DATA, (data + most if hard < 0 else min(data + most, hard), hard))
    try:
        yield
    except MemoryError:
        raise InputError(
            f"{path}: takes more than {most / 1e9:g} GB of memory to read; give it in several files."
        ) from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))
        pa.set_memory_pool(pool)


_ended: list[int] = []


@atexit.register
def _leave() -> None:
    if _ended:
        code = _ended[-1]
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (AttributeError, BrokenPipeError, ValueError):
                pass  # nobody listens, or none was opened
            except OSError as error:
                code = code or 1
                with suppress(OSError):
                    os.write(2, f"The output is lost: {error.strerror}; write it elsewhere.\n".encode())
        os._exit(code)


def leave_with(code: int) -> None:
    """Have this process end with an exit code, without taking the interpreter down.

    Threads of the libraries may abort while the interpreter and their objects are taken down beneath them,
    after the work was done. What is registered with `atexit` still runs.
    """
    _ended.append(code)


def end_process(code: int) -> NoReturn:
    """End this process, see `leave_with`."""
    leave_with(code)
    sys.exit(code)


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
