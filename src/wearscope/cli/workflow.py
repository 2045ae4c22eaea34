"""Calls Snakemake: writes its output to a log file, and states the reason of a failure in one sentence."""

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
#: Lines in which a job reports its progress: parts done; the current step of a diagnosis.
_PART = re.compile(r"^(\w[^:]*): (\d+)/(\d+) (.+)$")
_SAID = re.compile(r"^(?:close_loop|close_demonstration|identify_healthy|assess_session)\b[^:]*: (.+)$")
_DIED = re.compile(r"^Command '.+' died with <Signals\.(\w+): \d+>\.$")
_NO_TARGET = re.compile(r"^(?:MissingRuleException|No rule to produce \S+)")
#: Time that an interrupted Snakemake gets to cancel its jobs on other machines [s].
_GRACE = 2.0
#: Lines of Snakemake that do not contain the reason of a failure.
_CHATTER = re.compile(
    r"^(Shutting down|Exiting because|Complete log|At least one job|Using workflow specific profile|"
    r"Removing |\[\w{3} \w{3} +\d+|  File \"|Building DAG|None$|host: |WorkflowError:$|Trying to restart)"
)


@dataclass
class Progress:
    """Progress of a run, read from Snakemake's output.

    Attributes
    ----------
    done, total : int
        Number of finished jobs, and of all jobs.
    message : str
        Message of the job that started last.
    part : tuple of (int, int, str)
        Number of finished parts, of all parts, and name of the parts of the job that reported last; None once
        all are finished.
    begun : dict of str to (float, int)
        By job, seconds since the start and finished parts at its first report.
    part_seconds_left : float or None
        Estimated time for the remaining parts [s].
    rule, log : str
        Rule and log of the first job that failed.
    ended_by : str
        Signal that ended that job, if any.
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
        """Evaluate a line of the output that came `elapsed` seconds after the start."""
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
        """Store a job's report on its parts, and estimate the time for the rest."""
        start, first = self.begun.setdefault(job, (elapsed, done))
        left, speed = total - done, (done - first) / (elapsed - start) if elapsed > start else 0.0
        self.part = (done, total, what) if left > 0 else None
        self.part_seconds_left = left / speed if speed > 0.0 and left > 0 else None

    def seconds_left(self, elapsed: float) -> float | None:
        """Estimate the time for the remaining jobs [s] from the finished ones; None before the first."""
        return elapsed * (self.total - self.done) / self.done if self.done else None


def explain_failure(progress: Progress, targets: Sequence[str], folder: Path) -> str:
    """Return one sentence on why Snakemake failed, from the failed job's log or Snakemake's last lines.

    Parameters
    ----------
    progress : Progress
    targets : sequence of str
        Targets of the run.
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
        if plain != told:  # the job printed a sentence of its own, after a time in brackets
            return plain
        return f"{progress.rule}: a defect of the program or of own code ({told}); its log is {progress.log}."
    if any(_NO_TARGET.match(line) for line in progress.last):
        return f"the workflow has no target {' or '.join(targets)}; update wearscope, or correct the name."
    words = [line.strip() for line in progress.last if not _CHATTER.match(line)]
    return words[-1] if words else "Snakemake ended without a word; look at the log."


def _last_line(path: Path) -> str:
    """Return the last line of a file that is not empty."""
    try:
        lines = [line for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
    except OSError:
        lines = []
    return lines[-1].strip() if lines else "the job said nothing"


def read_setting(setting: str) -> dict[str, Any]:
    """Read a setting such as ``snr.runs=100`` as a part of a configuration: ``{"snr": {"runs": 100}}``.

    A value is a number, truth value or null, or a list or mapping in brackets. Anything else is taken as
    text, also where YAML would read it differently.

    Raises
    ------
    InputError
        Where it has not the form ``name=value``, or the text in brackets is not valid YAML.
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
    """Return a configuration with changes; settings of a section that a change does not name are kept."""
    merged = dict(settings)
    for name, value in changes.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(name), Mapping)
        merged[name] = merge(merged[name], value) if both else value
    return merged


@contextmanager
def keep_settings(folder: Path, settings: Mapping[str, Any]) -> Iterator[Path]:
    """Yield a temporary JSON file with a configuration for Snakemake.

    JSON is pure data. Snakemake would read ``--config`` with several parsers, and run Python code that a YAML
    file may contain.
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
    """Hold the lock of a folder, after waiting for a command that holds it.

    Two commands that compute in a folder at the same time would not notice each other's files.
    """
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
    """Return the command line of Snakemake.

    Parameters
    ----------
    targets : sequence of str
    folder : Path
        Working directory.
    cores : int
    settings : Path
        File with the whole configuration, see `keep_settings`.
    options : sequence of str
        Further options of Snakemake.
    snakefile : Path, optional
        The user's own workflow, with ``profiles/default`` next to it; by default the platform's.

    Raises
    ------
    InputError
        Where the working directory contains Python modules that Snakemake would import.
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
    """Run Snakemake and write its output to a file; it and its jobs end with this process in any case.

    Parameters
    ----------
    command : sequence of str
    folder : Path
        Working directory.
    log : Path
        Log file, which is overwritten.
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
                process_group=0,  # only this process gets an interrupt from the terminal, and passes it on
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
        if error.errno in FULL and not error.filename:  # an error without a file's name is about the open log
            raise explain_unwritten(log, error) from error
        raise
    return process.returncode, progress


def _end_group(process: subprocess.Popen[str]) -> None:
    """Interrupt Snakemake and its jobs, and kill those that have not ended after `_GRACE` seconds.

    No finished result is lost, as each is written as a whole.
    """
    try:
        os.killpg(process.pid, signal.SIGINT)
        process.wait(_GRACE)
    except (ProcessLookupError, subprocess.TimeoutExpired):
        pass
    finally:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
