"""Entry point of the command. The modules of a subcommand are imported when it runs, so that help is fast."""

import errno
import importlib
import os
import sys
from collections.abc import Mapping
from typing import Any, NoReturn

import click

from wearscope.cli.progress import say
from wearscope.errors import InputError
from wearscope.processes import end_process, open_standard, stay_apart
from wearscope.storage.files import FULL, explain_unwritten

# Arrow's own memory pool reserves a gigabyte, which would hide how much memory reading a file takes from
# `processes.bound_memory`.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")

#: Remedy by the error of a system resource that ran out.
LIMITS = {
    errno.EMFILE: "raise the limit of open files (ulimit -n)",
    errno.ENFILE: "end other programs",
    errno.EAGAIN: "raise the limit of processes (ulimit -u), or end other programs",
    errno.ENOMEM: "free some memory, or raise its limit (ulimit -v)",
}
#: Place of each command: module of `wearscope.cli`, and name in it.
COMMANDS = {
    "new": "new:new",
    "check": "check:check",
    "run": "stages:run",
    "diagnose": "stages:diagnose",
    "track": "stages:track",
    "detect": "stages:detect",
    "reevaluate": "stages:reevaluate",
    "export": "stages:export",
    "evaluate": "evaluate:evaluate",
    "report": "stages:report",
    "show": "show:show",
    "compare": "compare:compare",
    "history": "show:history",
    "demo": "stages:demo",
}


class LazyGroup(click.Group):
    """A group of commands that imports a command when it is called.

    Parameters
    ----------
    places : mapping of str to str
        By command, in the order of the help, ``module:name`` in `wearscope.cli`.
    """

    def __init__(self, *args: Any, places: Mapping[str, str], **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.places = places

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of the help."""
        return list(self.places)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in self.places:
            return None
        module, name = self.places[cmd_name].split(":")
        command: click.Command = getattr(importlib.import_module(f"wearscope.cli.{module}"), name)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run the command; Ctrl-C, also during its import, ends it with the exit status 130."""
        try:
            return super().invoke(ctx)
        except KeyboardInterrupt:
            say("Interrupted.", err=True)
            raise SystemExit(130) from None


@click.group(
    cls=LazyGroup,
    places=COMMANDS,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="wearscope")
def wearscope() -> None:
    """Will a fault detector find wear in a robot joint, and can the simulator that says so be trusted?

    \b
    Examples:
      wearscope demo                             a verdict on recordings of the package
      wearscope new study my-study               a folder with a study in it
      wearscope run my-study                     run it
      wearscope report my-study --open           look at it
      wearscope new robot arm.urdf               a model of your robot
      wearscope check arm                        list all its faults, in seconds
      wearscope diagnose arm-data                effects of the machine that its model lacks

    Commands that compute something call Snakemake, which you can also call directly.
    """


def main() -> None:
    """Run the command; bad input, and errors of the operating system, end it with one sentence."""
    open_standard()
    stay_apart()
    try:
        _check_words()
        wearscope(prog_name="wearscope")
    except SystemExit as end:
        end_process(end.code if isinstance(end.code, int) else int(end.code is not None))
    except InputError as error:
        _end(str(error))
    except KeyboardInterrupt:
        end_process(130)
    except MemoryError:
        _end("memory ran out; free some, raise its limit (ulimit -v), or give less at once.")
    except OSError as error:
        place = error.filename2 or error.filename
        if error.errno in FULL:
            _end(str(explain_unwritten(place or os.getcwd(), error)))
        elif error.errno in LIMITS:
            _end(f"{error.strerror}; {LIMITS[error.errno]}.")
        elif place is None:
            raise
        _end(f"{place}: {error.strerror}; choose another place, or correct its rights.")


def _check_words() -> None:
    """Refuse a working directory that was deleted, and paths that are not UTF-8."""
    try:
        here = os.getcwd()
    except FileNotFoundError:
        raise InputError("the working directory is gone; change to another one.") from None
    for word in (*sys.argv[1:], here):
        if any("\ud800" <= one <= "\udfff" for one in word):
            raise InputError(f"{word}: is not UTF-8; rename the file or folder.")


def _end(sentence: str) -> NoReturn:
    """Print a sentence as an error and end with status 1."""
    say(InputError(sentence), err=True)
    end_process(1)
