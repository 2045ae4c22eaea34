"""What stands on top of every page, as it is written and as it is read back."""

import re
from dataclasses import dataclass
from html.parser import HTMLParser
from pathlib import Path

from markupsafe import Markup


def unbreak(text: str) -> str:
    """Text whose numbers stay on the line of their unit, and signs on that of their number."""
    pattern = r"(?<=[\d>]) (?=%|°C|N m\b)|(?<=\bN) (?=m\b)|(?<=[≥≤=σΔ]) (?=[\d≥≤=])"
    return re.sub(pattern, "\N{NO-BREAK SPACE}", text)


#: Headings of a strip.
HEADINGS = ("How sure", "Mind", "Next")


@dataclass(frozen=True)
class Strip:
    """What stands on top of every page, to be read in ten seconds.

    Attributes
    ----------
    answer : str
        One sentence or two, without a code, an equation's number or a hash.
    kind : str
        Its colour: good, unsure or bad.
    sure : str
        How sure that is.
    caveat : str
        The one that matters most.
    action : str
        What to do next, as text or `Markup` with a link.
    """

    answer: str
    kind: str
    sure: str
    caveat: str
    action: str

    def rows(self) -> list[tuple[str, str]]:
        """What follows the answer, with its heading."""
        told = zip(HEADINGS, (self.sure, self.caveat, self.action), strict=True)
        return [(name, text if isinstance(text, Markup) else unbreak(text)) for name, text in told if text]


class _StripReader(HTMLParser):
    """Collects the texts of a page's strip."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.answer, self.kind, self.told = "", "", {}  # type: str, str, dict[str, str]
        self._place = self._heading = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Enter a part of the strip."""
        kinds = (dict(attrs).get("class") or "").split()
        if kinds[:2] == ["strip", "conclusion"]:
            self.kind = " ".join(kinds[2:3])
        elif self.kind and not self._place and ("answer" in kinds or tag in ("dt", "dd")):
            self._place = tag
            self._heading = "" if tag == "dt" else self._heading

    def handle_endtag(self, tag: str) -> None:
        """Leave it."""
        self._place = "" if tag == self._place else self._place

    def handle_data(self, data: str) -> None:
        """Take its text."""
        if self._place == "p":
            self.answer += data
        elif self._place == "dt":
            self._heading += data
        elif self._place == "dd":
            self.told[self._heading] = self.told.get(self._heading, "") + data


#: Beginning of a page in which its strip lies, in characters.
_TOP = 60_000


def read_strip(page: str | Path) -> Strip | None:
    """The strip of a page that was written, as a browser shows it; None where it has none."""
    if not Path(page).is_file():
        return None
    with Path(page).open(encoding="utf-8", errors="replace") as file:
        top = file.read(_TOP)
    start, end = top.find('<div class="strip'), top.find("</dl>")
    if start < 0 or end < 0:
        return None
    try:
        read = _StripReader(top[start:end])
    except AssertionError:  # how Python's parser says that it is no HTML
        return None
    sure, caveat, action = (" ".join(read.told.get(name, "").split()) for name in HEADINGS)
    return Strip(" ".join(read.answer.split()), read.kind, sure, caveat, action)
