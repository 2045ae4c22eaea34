"""Frame of every workflow script: writes the log, prints progress, ends on bad input with one line."""

import gc
import os
import resource
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from wearscope.errors import InputError
from wearscope.processes import MAIN, end_with, ignore_settings_here, leave_with
from wearscope.storage.files import (
    CHECKSUMS,
    FULL,
    RECORDING,
    DamagedFile,
    check_file,
    explain_unwritten,
    open_new,
    record_checksums,
    withdraw,
    written,
)

# Imported objects live until the end of the script. Without this, garbage collection would search them for
# cycles during the imports and at the end, which takes a fifth of a short job's time.
gc.disable()
ignore_settings_here()

Say = Callable[[str], None]


@contextmanager
def run_job(snakemake: Any) -> Iterator[Say]:
    """Run a job: write its log, check its inputs, and record checksums of its outputs and its costs.

    Yields a function that writes one line to the log and, under the rule's name, to the terminal. An
    `InputError` or a full disk ends the job with one sentence. Any other error is a defect; its traceback is
    in the log too. Inputs that other jobs have written are checked first; if one is missing or damaged, it is
    renamed, so that the next run makes it again. The job ends if the workflow's main process ends.
    """
    gc.freeze()
    gc.enable()
    end_with(os.environ.get(MAIN, ""))
    name = " ".join([snakemake.rule, *map(str, snakemake.wildcards)])
    start = time.monotonic()

    def note(text: str) -> None:
        with suppress(OSError), open(snakemake.log[0], "a", encoding="utf-8") as log:
            print(text, file=log)

    def say(text: str) -> None:
        print(f"{name}: {text}", file=sys.stderr, flush=True)
        note(f"[{time.monotonic() - start:6.1f} s] {text}")

    with refuse_once(Path(snakemake.log[0])):
        try:
            open_new(snakemake.log[0]).close()
            for file in map(str, getattr(snakemake, "input", [])):
                if folder := study_folder(file):
                    check_file(folder, file)
            yield say
            outputs = list(map(str, getattr(snakemake, "output", [])))
            for file in outputs:
                if folder := study_folder(file):
                    record_checksums(folder, [file])
            for path in sorted(written - {Path(file) for file in outputs}) if outputs else []:
                folder = study_folder(path)
                kept_elsewhere = CHECKSUMS in path.parts or path.name == RECORDING
                if folder and folder == study_folder(outputs[0]) and not kept_elsewhere and path.is_file():
                    record_checksums(folder, [path], outputs[0])
        except DamagedFile as error:
            if study_folder(error.path):
                withdraw(error.path)
                what = str(error).rpartition(";")[0]
                say(f"{what}; it was set aside, run the same command again to make it anew.")
            else:
                say(str(error))
            sys.exit(1)
        except InputError as error:
            say(str(error))
            sys.exit(1)
        except OSError as error:
            if error.errno not in FULL:
                note(traceback.format_exc())
                raise
            place = error.filename or [*getattr(snakemake, "output", []), snakemake.log[0]][0]
            say(str(explain_unwritten(place, error)))
            sys.exit(1)
        except Exception:
            note(traceback.format_exc())
            raise
    note(f"[{time.monotonic() - start:6.1f} s] done")
    if getattr(snakemake, "output", True):  # a job without output starts other jobs, which record their costs
        record_costs(Path(snakemake.log[0]), time.monotonic() - start)
    gc.freeze()
    if type(snakemake).__name__ == "Snakemake":
        leave_with(0)


@contextmanager
def refuse_once(log: Path) -> Iterator[None]:
    """Keep the log of a job that fails; if it is tried again in the same run, print that and fail at once.

    Snakemake tries every failed job again, which is useful only for a job that was killed.
    """
    kept, main = log.with_name(f".{log.name}.refused"), os.environ.get(MAIN, "")
    by, _, told = kept.read_text(encoding="utf-8").partition("\n") if kept.is_file() else ("", "", "")
    kept.unlink(missing_ok=True)
    if main and by == main:
        with open_new(log) as file:
            file.write(told)
        print(told.rstrip().rpartition("\n")[2], file=sys.stderr, flush=True)
        sys.exit(1)
    try:
        yield
    except (Exception, SystemExit):
        with suppress(OSError):
            kept.write_text(f"{main}\n{log.read_text(encoding='utf-8')}", encoding="utf-8")
        raise


def record_costs(log: Path, seconds: float) -> Path:
    """Write time and memory of this process and its children to a table with one row; return its path.

    They are read once, at the end; Snakemake's own `benchmark:` would read the memory maps of all processes
    twice a second. Columns have Snakemake's names: ``s``, time since the script's first line [s];
    ``cpu_time`` [s], including start and imports; ``max_rss`` [MiB], of the largest process.
    """
    parts = list(log.with_suffix(".tsv").parts)
    if "logs" in parts[2:]:
        parts[parts.index("logs", 2)] = "benchmarks"
    path = Path(*parts)
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    cpu = sum(one.ru_utime + one.ru_stime for one in used)
    memory = max(one.ru_maxrss for one in used) / 1024
    with suppress(OSError):  # if the disk is full, the next job reports it
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"s\tcpu_time\tmax_rss\n{seconds:.3f}\t{cpu:.2f}\t{memory:.1f}\n", encoding="utf-8")
    return path


def clear_answer(folder: Path) -> None:
    """Remove the files of an earlier answer that a job may not write again, so that none of them remains."""
    for old in (folder / "report.html", *folder.glob("*.parquet"), *folder.glob("next_measurement_*")):
        old.unlink(missing_ok=True)


def study_folder(file: str | Path) -> Path | None:
    """Return the study's folder that contains a file, e.g. ``results/paper``; None for other files."""
    parts = Path(file).parts
    return Path(*parts[:2]) if len(parts) > 2 and parts[0] == "results" else None


def count_progress(say: Say, total: int, what: str, every: float = 5.0) -> Callable[[int], None]:
    """Return a function to call with the number done; it reports the number at most every `every` seconds."""
    last = time.monotonic()

    def report(done: int) -> None:
        nonlocal last
        if done == total or time.monotonic() - last >= every:
            last = time.monotonic()
            say(f"{done}/{total} {what}")

    return report
