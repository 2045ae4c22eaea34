"""Makes processes safe: none outlives the process it works for, or obeys files in its working directory."""

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

#: Environment variable with the identity (see `identify_process`) of the process that a job works for.
MAIN = "WEARSCOPE_MAIN"
#: Environment variable with the identity of the job that has started another Snakemake on this machine.
STARTER = "WEARSCOPE_STARTER"
#: Command that starts Python without importing from the working directory, which may be an unknown data set.
PYTHON = (sys.executable, "-P")


def isolate(environment: Mapping[str, str]) -> dict[str, str]:
    """Return environment variables for a child process that imports nothing from its working directory."""
    paths = [one for one in environment.get("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(one)]
    kept = {name: value for name, value in environment.items() if name != "PYTHONPATH"}
    return {
        **kept,
        **({"PYTHONPATH": os.pathsep.join(paths)} if paths else {}),
        "PYTHONSAFEPATH": "1",
    }


def open_standard() -> None:
    """Open closed standard streams; otherwise the next opened file would get the number of one of them."""
    for handle in range(3):
        try:
            os.fstat(handle)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest handle that is free
    sys.stdout = sys.stdout or os.fdopen(1, "w", closefd=False)
    sys.stderr = sys.stderr or os.fdopen(2, "w", closefd=False)


class _Elsewhere(PathFinder):
    """Importer that runs two modules in the root directory, since they read settings in the working one."""

    @classmethod
    def find_spec(
        cls, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Find one of the two modules; return None for all others, which Python's own finders then find."""
        if fullname not in ("matplotlib", "numba.core.config"):
            return None
        spec = PathFinder.find_spec(fullname, path, target)
        if spec is None or spec.loader is None:
            return None
        run = spec.loader.exec_module

        def run_elsewhere(module: ModuleType) -> None:
            with chdir("/"):
                run(module)
            if fullname == "numba.core.config":  # Numba reads its settings file again at each compilation
                vars(module)["_config_fname"] = os.devnull

        vars(spec.loader)["exec_module"] = run_elsewhere
        return spec


def ignore_settings_here() -> None:
    """Make libraries ignore settings files in the working directory, which may be an unknown data set.

    A ``.numba_config.yaml`` there could name a folder of compiled code that Numba would run; a
    ``matplotlibrc`` could change figures.
    """
    if _Elsewhere not in sys.meta_path:
        sys.meta_path.insert(0, _Elsewhere)


def keep_compiled() -> None:
    """If Numba cannot write its cache, give it a temporary folder that is deleted when this process ends.

    Numba writes its cache next to the module, or else into the user's cache folder. It raises an error if
    neither can be written.
    """
    cache = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))
    there = next((one for one in (cache, *cache.parents) if os.path.exists(one)), cache)
    lasting = any(os.access(one, os.W_OK | os.X_OK) for one in (Path(__file__).parent, there))
    if not lasting and "NUMBA_CACHE_DIR" not in os.environ:
        os.environ["NUMBA_CACHE_DIR"] = made = tempfile.mkdtemp(prefix="wearscope-compiled-")
        atexit.register(shutil.rmtree, made, ignore_errors=True)


def stay_apart() -> None:
    """Make this process and its children independent of files in the working directory.

    That directory may be an unknown data set; see `isolate`, `ignore_settings_here` and `keep_compiled`.
    """
    os.environ.update(isolate(os.environ))
    ignore_settings_here()
    keep_compiled()


@contextmanager
def bound_memory(path: str | Path) -> Iterator[None]:
    """Limit the memory for reading a file to `limits.READING_BYTES`, for a ``with`` block.

    The limit is needed because a file's stated size may be false. It works only on Linux, which reports how
    much memory a process has. Arrow's memory pool would reserve a gigabyte at its first use and so reach the
    limit; the block uses the system's allocator instead.

    Raises
    ------
    InputError
        If the block takes more memory.
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


#: Exit codes given to `leave_with`; the last one counts.
_ended: list[int] = []


@atexit.register
def _leave() -> None:
    """End this process with the code of `leave_with`, if it was called, once its output is written."""
    if _ended:
        code = _ended[-1]
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (AttributeError, BrokenPipeError, ValueError):
                pass  # the reader has closed the pipe, or the stream is closed
            except OSError as error:
                code = code or 1
                with suppress(OSError):
                    os.write(2, f"The output is lost: {error.strerror}; write it elsewhere.\n".encode())
        os._exit(code)


def leave_with(code: int) -> None:
    """Set the exit code of this process, and make it end without shutting down the interpreter.

    During the shutdown, threads of libraries may use deleted objects and crash the process after its work is
    done. Functions registered with `atexit` still run.
    """
    _ended.append(code)


def end_process(code: int) -> NoReturn:
    """End this process with an exit code, see `leave_with`."""
    leave_with(code)
    sys.exit(code)


def identify_process(pid: int) -> str:
    """Return number and start time of a process, which identify it; "" if the system does not report them."""
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    # The start time is the 22nd field. The second, the name in brackets, may contain anything, so fields are
    # counted from the last closing bracket on.
    return f"{pid}:{stat.rpartition(')')[2].split()[19]}"


def end_with(identity: str) -> None:
    """Kill this process as soon as another process ends.

    A main process that is killed cannot stop its jobs, which would continue to write files.

    Parameters
    ----------
    identity : str
        Identity of the other process, see `identify_process`; "" for none.
    """
    if not identity or not hasattr(os, "pidfd_open"):
        return
    pid = int(identity.partition(":")[0])
    try:
        handle = os.pidfd_open(pid)
    except ProcessLookupError:
        os.kill(os.getpid(), signal.SIGKILL)
        return
    except OSError:  # the system does not permit it
        return
    if identify_process(pid) != identity:
        os.kill(os.getpid(), signal.SIGKILL)

    def wait() -> None:
        poll = select.poll()
        poll.register(handle, select.POLLIN)
        poll.poll()
        os.kill(os.getpid(), signal.SIGKILL)

    threading.Thread(target=wait, name="end with the main process", daemon=True).start()
