"""Runs commands of the platform, each in a process of its own with bounds on time and memory."""

import codecs
import importlib
import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import metadata
from pathlib import Path

#: Bounds of one command: processor and wall time [s], memory [bytes].
SECONDS, WAITED, MEMORY = 10, 120, 2 << 30
#: What spoiled files would make if anything in them ran.
RAN = "ran"
#: Modules whose `main` takes the arguments after the first word.
PROGRAMS = {"archive": "archive.__main__", "integrity": "integrity"}


def compile_elsewhere() -> None:
    """Choose the place of compiled functions again, which the process that was forked did as root."""
    from numba.core import config

    from wearscope.processes import keep_compiled

    keep_compiled()
    config.reload_config()


#: What is odd about the process that runs a command, and not about its files.
AROUND: dict[str, Callable[[], object]] = {
    "another user": lambda: (os.setuid(65534), compile_elsewhere()),
    "few open files": lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (10, 10)),
    "small files only": lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000)),
    "a full output": lambda: os.dup2(os.open("/dev/full", os.O_WRONLY), 1),
    "a closed output": lambda: (os.close(1), setattr(sys, "stdout", None)),  # as Python starts with one
    "no home": lambda: os.environ.update(HOME="/proc/none", XDG_STATE_HOME="/proc/none/state"),
    "no temporary folder": lambda: os.environ.update(TMPDIR="/proc/none"),
    "plain letters only": lambda: sys.stdout.reconfigure(encoding="ascii"),
    "an odd terminal": lambda: os.environ.update(COLUMNS="0", LINES="-1", TERM="\x1b", NO_COLOR="x"),
    "a folder without a name": lambda: (os.mkdir("gone"), os.chdir("gone"), os.rmdir("../gone")),
}  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """How a command ended: exit status (negative for a signal), processor seconds, largest memory [bytes]."""

    code: int
    output: str
    seconds: float
    memory: int


class Runner:
    """Runs commands of the platform, each in a process forked from one that has imported them."""

    def __enter__(self) -> "Runner":
        self.server = subprocess.Popen(
            [sys.executable, "-P", __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        return self

    def __call__(self, arguments: tuple[str, ...], folder: Path, around: str = "") -> Outcome:
        print(json.dumps([arguments, str(folder), around]), file=self.server.stdin, flush=True)
        return Outcome(**json.loads(self.server.stdout.readline()))

    def __exit__(self, *error: object) -> None:
        with self.server:  # closes both ends, and waits
            pass


def serve() -> None:
    """Run each command line of the standard input; tell how it ended."""
    from wearscope.cli.main import COMMANDS

    for place in {*COMMANDS.values()}:
        importlib.import_module(f"wearscope.cli.{place.split(':')[0]}")
    checks = [f"checking.{kind}" for kind in ("dataset", "robot", "study", "own_code")]
    for module in (
        *PROGRAMS.values(),
        "notebook.model_errors",
        "starters.conversion",
        "starters.robot",
        *checks,
    ):
        importlib.import_module(f"wearscope.{module}")
    importlib.import_module("wearscope.checking.robot").check_robot_folder("medium")  # compiles
    # Another user may not read the interpreter's library.
    codecs.lookup("unicode-escape")
    metadata("wearscope")
    importlib.import_module("altair")
    for line in sys.stdin:
        print(json.dumps(asdict(run_forked(*json.loads(line)))), flush=True)


def run_forked(arguments: list[str], folder: str, around: str = "") -> Outcome:
    """Run one command line in a child."""
    said = Path(f"{folder}.said")
    child = os.fork()
    if not child:
        try:
            act(arguments, folder, said, around)
        finally:
            os._exit(99)
    end = time.monotonic() + WAITED
    while not (ended := os.wait4(child, os.WNOHANG))[0]:
        if time.monotonic() > end or measure_memory(child) > MEMORY:
            os.killpg(child, signal.SIGKILL)
            ended = os.wait4(child, 0)
            break
        time.sleep(0.02)
    _, status, used = ended
    with said.open("rb") as file:
        text = file.read(1_000_000).decode("utf-8", "backslashreplace")
    said.unlink()
    return Outcome(
        os.waitstatus_to_exitcode(status), text, used.ru_utime + used.ru_stime, used.ru_maxrss * 1024
    )


def measure_memory(process: int) -> int:
    """Resident memory [bytes]; address space tells nothing, as JavaScript's engine reserves some of it."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * resource.getpagesize()


def act(arguments: list[str], folder: str, said: Path, around: str) -> None:
    os.setsid()
    os.chdir(folder)
    handle = os.open(said, os.O_CREAT | os.O_WRONLY | os.O_TRUNC)
    null = os.open(os.devnull, os.O_RDONLY)
    for old, new in ((null, 0), (handle, 1), (handle, 2)):
        os.dup2(old, new)
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS + 2, SECONDS + 3))
    code, compiled = 98, os.environ.get("NUMBA_CACHE_DIR")
    try:
        if around:
            AROUND[around]()
        if arguments[0] in PROGRAMS:
            code = importlib.import_module(f"wearscope.{PROGRAMS[arguments[0]]}").main(arguments[1:])
        else:
            from wearscope.cli import main

            sys.argv = ["wearscope", *arguments]
            main.main()
            code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        import traceback

        traceback.print_exc()
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, OSError, ValueError):
            stream.flush()
    if (made := os.environ.get("NUMBA_CACHE_DIR")) not in (None, compiled):
        shutil.rmtree(made, ignore_errors=True)  # as `atexit` would, which no process that was forked calls
    os._exit(code)


def judge(made: Sequence[str], outcome: Outcome, folder: Path, around: str = "") -> str:
    """What is wrong with how a command ended that makes some files; empty where nothing is."""
    text = outcome.output
    if (folder / RAN).exists() or (folder.parent / RAN).exists() or Path("/tmp", RAN).exists():
        return "code ran"
    if outcome.code not in (0, 1, 2) or "Traceback (most recent" in text:
        return f"exit status {outcome.code}: {text[-700:]}"
    if outcome.seconds > SECONDS or outcome.memory > MEMORY:
        return f"{outcome.seconds:.1f} s, {outcome.memory / 2**30:.2f} GiB"
    if not text.replace("\n", "").isprintable():
        return f"steers the terminal: {text[-300:]!r}"
    if outcome.code and not text.strip() and "output" not in around:
        return "ends without a word"
    if outcome.code == 1 and not any(line.rstrip().endswith((".", "?")) for line in text.splitlines()):
        return f"says no sentence: {text[-300:]!r}"
    left = [one for one in made if os.path.lexists(folder / one)] if outcome.code else []
    left += [str(one) for one in folder.glob("**/.*.part")]
    return f"leaves {', '.join(left)} and ends with {outcome.code}: {text[-300:]}" if left else ""


if __name__ == "__main__":
    serve()
