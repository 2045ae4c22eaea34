"""The strip on top of every page, written and read back."""

import re
from dataclasses import dataclass, fields
from pathlib import Path

from markupsafe import Markup

from wearscope.storage.files import load_json


def unbreak(text: str) -> str:
    """Text in which no line breaks between a number and its unit or its sign."""
    pattern = r"(?<=[\d>]) (?=%|°C|N m\b)|(?<=\bN) (?=m\b)|(?<=[≥≤=σΔ]) (?=[\d≥≤=])"
    return type(text)(re.sub(pattern, "\N{NO-BREAK SPACE}", text))


#: Headings of a strip.
HEADINGS = ("How sure", "Mind", "Next")


@dataclass(frozen=True)
class Strip:
    """Top of every page, to be read in ten seconds.

    The answer is one or two sentences without a code, an equation's number or a hash, and its kind good,
    unsure or bad. Then how sure that is, the caveat that matters most, and what to do next (text or
    `Markup`).
    """

    answer: str
    kind: str
    sure: str
    caveat: str
    action: str

    def rows(self) -> list[tuple[str, str]]:
        """Texts that follow the answer, each with its heading."""
        told = zip(HEADINGS, (self.sure, self.caveat, self.action), strict=True)
        return [(name, unbreak(text)) for name, text in told if text]

    def plain(self) -> dict[str, str]:
        """Texts of the strip without markup, by field."""
        return {
            one.name: text.striptags() if isinstance(text := getattr(self, one.name), Markup) else text
            for one in fields(self)
        }


#: The strip lies within this many characters from the beginning of a page.
_TOP = 60_000
_DATA = re.compile(r'<script type="application/json" id="strip">(.*?)</script>', re.DOTALL)


def read_strip(page: str | Path) -> Strip | None:
    """The strip of a page that was written, as a browser shows it; None where it has none."""
    if not Path(page).is_file():
        return None
    with Path(page).open(encoding="utf-8", errors="replace") as file:
        return parse_strip(file.read(_TOP))


def parse_strip(page: str) -> Strip | None:
    """The strip in a page's text; None where it has none."""
    found = _DATA.search(page, 0, _TOP)
    try:
        told = load_json(found[1]) if found else {}
    except (ValueError, RecursionError):
        return None
    texts = [told.get(one.name) for one in fields(Strip)] if isinstance(told, dict) else []
    known = [one for one in texts if isinstance(one, str)]
    return Strip(*known) if len(known) == len(fields(Strip)) else None
