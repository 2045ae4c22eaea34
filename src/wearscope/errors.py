"""The one exception meant to be read by users, lists of problems, and the error of a missing package."""

import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any, TypeVar


class SimulationError(RuntimeError):
    """A run that diverged, left its limits or disagreed with PyBullet, told in one sentence."""


class SelfTestError(SimulationError):
    """PyBullet adds something that the model has not: no run can be trusted, whatever its design point."""


LONGEST = 1000


class InputError(ValueError):
    """Bad input, told in one sentence: the file, field or row, what is wrong, and the remedy.

    What is quoted from the input can neither break the line nor steer a terminal; it is cut where long.
    """

    def __init__(self, message: object = "") -> None:
        text = str(message)
        if len(text) > LONGEST:
            text = f"{text[: LONGEST // 2]} ... {text[-LONGEST // 2 :]}"
        super().__init__(escape_text(text))


def escape_text(text: str) -> str:
    """Text of a file as it may be shown: no character of it can break a line or steer a terminal."""
    text = text.replace("\xa0", " ")
    return text if text.isprintable() else "".join(one if one.isprintable() else escape(one) for one in text)


def escape(character: str) -> str:
    r"""How Python writes a character that cannot be printed, e.g. ``\n``."""
    return character.encode("unicode_escape").decode("ascii")


def describe(error: BaseException, most: int = 200) -> str:
    """What an error says, in one line of at most so many characters without a full stop.

    Where an error of own code cannot even give its text, that is said.
    """
    try:
        return " ".join(str(error).split())[:most].rstrip(".")
    except Exception:
        return "it has no text"


def tell_error(error: BaseException) -> str:
    """Kind of an error, and what it says, in one line."""
    return f"{type(error).__name__}: {describe(error, LONGEST)}".rstrip()


def explain_breach(error: Any) -> str:
    """First field that a pydantic model refuses (`pydantic.ValidationError`), and why."""
    first = error.errors()[0]
    told = re.sub(r"^Value error, |^\w+ (?=should)", "", first["msg"])
    told = told.replace("Field required", "is missing").replace("Unexpected keyword argument", "is not known")
    told = told.replace("Extra inputs are", "is")
    return f"{'.'.join(map(str, first['loc']))} {told}"


def explain_yaml(error: Exception) -> str:
    """Where a text is no YAML, and why, in a few words."""
    mark, context = getattr(error, "problem_mark", None), getattr(error, "context_mark", None)
    if mark is None:
        return describe(error)
    reason = f"line {mark.line + 1}, column {mark.column + 1}: {getattr(error, 'problem', None)}"
    if context is not None and context.line != mark.line:
        reason += f", {getattr(error, 'context', None)} that begins in line {context.line + 1}"
    return reason


#: Extra of pyproject.toml and what needs it, by the module.
EXTRAS = {"mujoco": ("export", "an export"), "rosbags": ("ros", "a recording of ROS 2")}


def need(module: str) -> None:
    """Refuse, with the command that installs it, where a module of an extra is missing."""
    if find_spec(module) is None:
        extra, what = EXTRAS[module]
        raise InputError(
            f"{what} needs {module}, which is not installed; install it with "
            f"{sys.executable} -m pip install 'wearscope[{extra}]'"
        )


T = TypeVar("T")


@dataclass
class Findings:
    """What is wrong, and what a user should know.

    Attributes
    ----------
    what : str
        What was checked.
    problems : list of str
        A sentence each; none where all is well.
    notes : list of str
    """

    what: str
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def attempt(self, action: Callable[[], T]) -> T | None:
        """Result of an action; None, and its sentence among the problems, where it refuses."""
        try:
            return action()
        except InputError as error:
            self.add(str(error))
            return None

    def add(self, *sentences: str) -> None:
        """Add problems that are not among them yet."""
        told = (str(InputError(one)) for one in sentences)  # what they quote cannot break the line
        self.problems += [one for one in dict.fromkeys(told) if one not in self.problems]
