"""Calls Snakemake: its output goes to a log file, the reason of a failure into one sentence."""

import fcntl
import json
import os
import re
import shlex
import signal
import subprocess
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from wearscope import limits
from wearscope.errors import InputError, explain_yaml
from wearscope.home import find_home
from wearscope.processes import PYTHON, STARTER, identify_process, isolate
from wearscope.storage.files import FULL, LOCK, check_plain, explain_unwritten, open_new, write_text
from wearscope.storage.plain_yaml import load_plain_yaml, take_label

_STEPS = re.compile(r"^(\d+) of (\d+) steps \(.+%\) done")
_PLANNED = re.compile(r"^total\s+(\d+)$")
_BEGUN = re.compile(r"^(?:local)?rule (\w+):$|^Job \d+: (.+)$")
_FAILED = re.compile(r"^Error in rule (\w+):$")
_LOG = re.compile(r"^    log: (.+?)(?:, .*)? \(check log file\(s\) for error details\)$")
#: A job's line on its own progress: parts done, or the present step of a diagnosis.
_PART = re.compile(r"^(\w[^:]*): (\d+)/(\d+) (.+)$")
_SAID = re.compile(r"^(?:close_loop|close_demonstration|identify_healthy|assess_session)\b[^:]*: (.+)$")
_DIED = re.compile(r"^Command '.+' died with <Signals\.(\w+): \d+>\.$")
_NO_TARGET = re.compile(r"^(?:MissingRuleException|No rule to produce \S+)")
#: Time that Snakemake has, once interrupted, to end its jobs elsewhere by itself [s].
_GRACE = 2.0
#: Lines of Snakemake's that do not say what went wrong.
_CHATTER = re.compile(
    r"^(Shutting down|Exiting because|Complete log|At least one job|Using workflow specific profile|"
    r"Removing |\[\w{3} \w{3} +\d+|  File \"|Building DAG|None$|host: |WorkflowError:$|Trying to restart)"
)


@dataclass
class Progress:
    """What Snakemake has told so far.

    Attributes
    ----------
    done, total : int
        Jobs.
    message : str
        Of the job begun last.
    part : tuple of (int, int, str)
        Done, total and name of the parts of the job that spoke last; nothing once they are done.
    begun : dict of str to (float, int)
        Seconds since the start, and parts done, where a job first spoke of its parts.
    part_seconds_left : float or None
        Time that those parts still take at their own speed.
    rule, log : str
        Of the first job that failed.
    ended_by : str
        Signal that ended it, if one did.
    last : deque of str
        Last lines that are not empty.
    """

    done: int = 0
    total: int = 0
    message: str = ""
    part: tuple[int, int, str] | None = None
    part_seconds_left: float | None = None
    begun: dict[str, tuple[float, int]] = field(default_factory=dict)
    rule: str = ""
    log: str = ""
    ended_by: str = ""
    last: deque[str] = field(default_factory=lambda: deque(maxlen=60))

    def read(self, line: str, elapsed: float = 0.0) -> None:
        """Take a line of the output, so many seconds after the start."""
        line = line.rstrip()
        if line:
            self.last.append(line)
        if found := _STEPS.match(line):
            self.done, self.total, self.part = int(found[1]), int(found[2]), None
        elif found := _PLANNED.match(line):
            self.total = int(found[1])
        elif found := _PART.match(line):
            self._take_part(found[1] + found[4], int(found[2]), int(found[3]), found[4], elapsed)
        elif found := _SAID.match(line):
            self.message = found[1]
        elif found := _BEGUN.match(line):
            self.message = found[2] or found[1].replace("_", " ")
        elif (found := _DIED.match(line)) and not self.rule:
            self.ended_by = found[1]
        elif (found := _FAILED.match(line)) and not self.rule:
            self.rule = found[1]
        elif (found := _LOG.match(line)) and self.rule and not self.log:
            self.log = found[1]

    def _take_part(self, job: str, done: int, total: int, what: str, elapsed: float) -> None:
        start, first = self.begun.setdefault(job, (elapsed, done))
        left, speed = total - done, (done - first) / (elapsed - start) if elapsed > start else 0.0
        self.part = (done, total, what) if left > 0 else None
        self.part_seconds_left = left / speed if speed > 0.0 and left > 0 else None

    def seconds_left(self, elapsed: float) -> float | None:
        """Time that the jobs left take if they take as long as those done; None before the first is done."""
        return elapsed * (self.total - self.done) / self.done if self.done else None


def explain_failure(progress: Progress, targets: Sequence[str], folder: Path) -> str:
    """One sentence on why Snakemake failed, from the failed job's log or Snakemake's last words.

    Parameters
    ----------
    progress : Progress
    targets : sequence of str
        What was asked for.
    folder : Path
        Working directory of Snakemake.
    """
    if progress.rule and progress.ended_by:
        return (
            f"{progress.rule}: its process was ended by {progress.ended_by}, as by the system where memory "
            "is short; free memory or use fewer cores, and run the same command again."
        )
    if progress.log:
        told = _last_line(folder / progress.log)
        plain = re.sub(r"^\[ *[\d.]+ s\] ", "", told)
        if plain != told:  # the job told its own sentence, with a time before it
            return plain
        return f"{progress.rule}: a defect of the program or of own code ({told}); its log is {progress.log}."
    if any(_NO_TARGET.match(line) for line in progress.last):
        return f"the workflow has no target {' or '.join(targets)}; update wearscope, or correct the name."
    words = [line.strip() for line in progress.last if not _CHATTER.match(line)]
    return words[-1] if words else "Snakemake ended without a word; look at the log."


def _last_line(path: Path) -> str:
    try:
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except OSError:
        lines = []
    return lines[-1].strip() if lines else "the job said nothing"


def read_setting(setting: str) -> dict[str, Any]:
    """``snr.runs=100`` as a part of a configuration: ``{"snr": {"runs": 100}}``.

    A value is a number, truth value or null, or a list or mapping in brackets; all else is text as it is
    written, whatever YAML would make of it.

    Raises
    ------
    InputError
        Where it is no ``name=value``, or the brackets hold no YAML.
    """
    path, equals, text = setting.partition("=")
    names = path.split(".")
    if not equals or not all(re.fullmatch(r"[A-Za-z_][\w-]*", name) for name in names):
        raise InputError(f"--set {setting}: is no setting; write --set name=value, or section.name=value.")
    value: Any = text
    try:
        read = load_plain_yaml(text)
    except yaml.YAMLError as error:
        if text[:1] in ("[", "{"):
            raise InputError(f"--set {setting}: {explain_yaml(error)}; correct the brackets.") from None
        read = None
    if text[:1] in ("[", "{", '"', "'") or isinstance(read, bool | int | float) or text in ("", "null", "~"):
        value = read
    for name in reversed(names):
        value = {name: value}
    return dict(value)


def merge(settings: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """A configuration with changes, which leave the rest of a section as it is."""
    merged = dict(settings)
    for name, value in changes.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(name), Mapping)
        merged[name] = merge(merged[name], value) if both else value
    return merged


@contextmanager
def keep_settings(folder: Path, settings: Mapping[str, Any]) -> Iterator[Path]:
    """Hand a configuration to Snakemake as data: a JSON file, in which nothing is read as YAML or code.

    Snakemake would read ``--config`` with several parsers, and run Python that a YAML file may hold.
    """
    path = folder / "results" / f".wearscope-{os.getpid()}.json"
    for left in path.parent.glob(".wearscope-*.json"):  # left by commands that were killed
        if not identify_process(int("0" + "".join(filter(str.isdigit, left.stem)))):
            left.unlink(missing_ok=True)
    write_text(path, json.dumps(settings, default=take_label))
    try:
        yield path
    finally:
        path.unlink(missing_ok=True)


@contextmanager
def wait_turn(folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Wait until no other command computes in a folder: two at once would miss each other's files."""
    path = folder / "results" / LOCK
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise InputError(f"{path}: is no plain file ({error.strerror}); remove it.") from None
    with open(handle) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say(f"Another command works in {folder}; this one waits for its end.")
            fcntl.flock(file, fcntl.LOCK_EX)
        except OSError:  # a file system without locks
            pass
        yield


def build_command(
    targets: Sequence[str],
    folder: Path,
    cores: int,
    settings: Path,
    options: Sequence[str] = (),
    snakefile: Path | None = None,
) -> list[str]:
    """Command line of Snakemake.

    Parameters
    ----------
    targets : sequence of str
    folder : Path
        Working directory.
    cores : int
    settings : Path
        The whole configuration, see `keep_settings`.
    options : sequence of str
        Passed on as they are.
    snakefile : Path, optional
        The user's own, and ``profiles/default`` next to it; the platform's where left out.

    Raises
    ------
    InputError
        Where the working directory, which may be a data set, brings modules for Snakemake.
    """
    brought = folder / ".snakemake" / "pip-deployments"
    if os.path.lexists(brought):
        raise InputError(f"{brought}: holds code that Snakemake would run; remove it.")
    home = find_home()
    if snakefile is not None:
        check_plain(snakefile, limits.TEXT_BYTES, "name a Snakefile")
    own = snakefile.resolve() if snakefile is not None else home / "Snakefile"
    profile = own.parent / "profiles" / "default"
    return [
        *(*PYTHON, "-m", "snakemake", "--cores", str(cores)),
        *("--snakefile", str(own), "--directory", str(folder)),
        *("--workflow-profile", str(profile if profile.is_dir() else home / "profiles" / "default")),
        *("--configfile", str(settings), *options, "--", *targets),
    ]


def call_snakemake(
    command: Sequence[str], folder: Path, log: Path, watch: Callable[[Progress, float, str], None]
) -> tuple[int, Progress]:
    """Run Snakemake with its output in a file; it and all its jobs end with this process, also interrupted.

    Parameters
    ----------
    command : sequence of str
    folder : Path
        Working directory.
    log : Path
        Written anew.
    watch : callable
        Called with the progress, the seconds since the start and the line, after each line.

    Returns
    -------
    int
        Exit code.
    Progress

    Raises
    ------
    InputError
        Where the log cannot be written.
    """
    progress, start = Progress(), time.monotonic()
    try:
        file = open_new(log)
    except OSError as error:
        raise InputError(f"{log}: cannot be written ({error.strerror}); choose another folder.") from None
    try:
        with (
            file,
            subprocess.Popen(
                command,
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                env={
                    **isolate(os.environ),
                    "PYTHONUNBUFFERED": "1",
                    STARTER: identify_process(os.getpid()),
                },
                stdin=subprocess.DEVNULL,
                process_group=0,  # an interrupt from the terminal is passed on once, by this process
            ) as process,
        ):
            assert process.stdout is not None
            try:
                print(shlex.join(command), file=file, flush=True)
                for line in process.stdout:
                    print(line, end="", file=file, flush=True)
                    elapsed = time.monotonic() - start
                    progress.read(line, elapsed)
                    watch(progress, elapsed, line)
            except BaseException:
                _end_group(process)
                raise
    except OSError as error:
        if error.errno in FULL and not error.filename:  # an open file does not name itself: the log
            raise explain_unwritten(log, error) from error
        raise
    return process.returncode, progress


def _end_group(process: subprocess.Popen[str]) -> None:
    """Interrupt Snakemake and its jobs, and kill what has not ended after a while; no result is lost."""
    try:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(_GRACE)
    except (ProcessLookupError, subprocess.TimeoutExpired):
        pass
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
