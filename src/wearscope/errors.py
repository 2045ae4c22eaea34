"""Defines the error that users read, lists of problems, and functions that word the errors of libraries."""

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any, TypeVar


class SimulationError(RuntimeError):
    """A simulated run diverged, left its limits or disagreed with PyBullet; the message is one sentence."""


class SelfTestError(SimulationError):
    """PyBullet's torques differ from the model's, so that no simulated run of this robot can be trusted."""


#: Longest message [characters].
LONGEST = 1000


class InputError(ValueError):
    """Bad input. The message is one sentence with the file, field or row, what is wrong, and the remedy.

    Control characters that a message quotes from the input are escaped, and a long message is shortened.
    """

    def __init__(self, message: object = "") -> None:
        text = str(message)
        if len(text) > LONGEST:
            text = f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"
        super().__init__(escape_text(text))


def escape_text(text: str) -> str:
    """Escape all characters that could break a line or control a terminal."""
    text = text.replace("\xa0", " ")
    return text if text.isprintable() else "".join(one if one.isprintable() else escape(one) for one in text)


def escape(character: str) -> str:
    r"""Return Python's escape sequence of a character, e.g. ``\n``."""
    return character.encode("unicode_escape").decode("ascii")


def describe(error: BaseException, most: int = 200) -> str:
    """Return an error's message as one line of at most `most` characters, without its full stop.

    An error raised by a user's code may itself fail to give its message; this is then stated instead.
    """
    try:
        return " ".join(str(error).split())[:most].rstrip(".")
    except Exception:
        return "it has no text"


def tell_error(error: BaseException) -> str:
    """Return the type and the message of an error in one line."""
    return f"{type(error).__name__}: {describe(error, LONGEST)}".rstrip()


def explain_breach(error: Any) -> str:
    """Return the first field that a `pydantic.ValidationError` refuses, and the reason."""
    first = error.errors()[0]
    told = re.sub(r"^Value error, |^\w+ (?=should)", "", first["msg"])
    told = told.replace("Field required", "is missing").replace("Unexpected keyword argument", "is not known")
    told = told.replace("Extra inputs are", "is")
    return f"{'.'.join(map(str, first['loc']))} {told}"


def explain_yaml(error: Exception) -> str:
    """Return line, column and reason of an error in a YAML text, in a few words."""
    mark, context = getattr(error, "problem_mark", None), getattr(error, "context_mark", None)
    if mark is None:
        return describe(error)
    reason = f"line {mark.line + 1}, column {mark.column + 1}: {getattr(error, 'problem', None)}"
    if context is not None and context.line != mark.line:
        reason += f", {getattr(error, 'context', None)} that begins in line {context.line + 1}"
    return reason


#: For each optional module: the extra of pyproject.toml that installs it, and what needs it.
EXTRAS = {"mujoco": ("export", "an export"), "rosbags": ("ros", "a recording of ROS 2")}


def need(module: str) -> None:
    """Raise an InputError, with the command that installs it, if an optional module is missing."""
    if find_spec(module) is None:
        extra, what = EXTRAS[module]
        raise InputError(
            f"{what} needs {module}, which is not installed; install it with "
            f"{sys.executable} -m pip install 'wearscope[{extra}]'"
        )


T = TypeVar("T")


@dataclass
class Findings:
    """Result of a check.

    Attributes
    ----------
    what : str
        Name of the object that was checked.
    problems : list of str
        Problems, a sentence each; empty if all is well.
    notes : list of str
        Other facts that a user should know, a sentence each.
    """

    what: str
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def attempt(self, action: Callable[[], T]) -> T | None:
        """Call an action and return its result; if it raises an InputError, add a problem and return None."""
        try:
            return action()
        except InputError as error:
            self.add(str(error))
            return None

    def add(self, *sentences: str) -> None:
        """Add problems that are not in the list yet."""
        told = (str(InputError(one)) for one in sentences)  # escapes control characters in them
        self.problems += [one for one in dict.fromkeys(told) if one not in self.problems]
