"""What a check found."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from wearscope.errors import InputError

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
