"""Self-contained pages: one template, one style sheet, figures as data; nothing is loaded from elsewhere."""

import base64
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
from markupsafe import Markup, escape
from matplotlib.figure import Figure

from wearscope.reporting.style import figure_bytes

TEMPLATES = Path(__file__).with_name("templates")
_MEDIA = {"svg": "image/svg+xml", "png": "image/png"}


@dataclass(frozen=True)
class Section:
    """A part of a page.

    Attributes
    ----------
    title : str
    body : str
        HTML; text from elsewhere must have been escaped (``Markup.format`` and templates do).
    anchor : str
        Name for links to it; made from the title where left out.
    """

    title: str
    body: str
    anchor: str = field(default="")

    @property
    def id(self) -> str:
        """Name for links to it."""
        return self.anchor or re.sub(r"[^a-z0-9]+", "-", self.title.lower()).strip("-")


def environment() -> jinja2.Environment:
    """Templates of this package; text is escaped, an unknown name is an error."""
    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def render_template(name: str, **context: Any) -> Markup:
    """HTML of one of the package's templates."""
    return Markup(environment().get_template(name).render(**context))


def render_page(title: str, sections: Sequence[Section], subtitle: str = "", footer: str = "") -> str:
    """Whole page: title, contents, sections.

    Parameters
    ----------
    title : str
    sections : sequence of Section
        The first one is what a reader in a hurry reads.
    subtitle : str
        One line of text under the title.
    footer : str
        One line of text at the end.

    Returns
    -------
    str
        HTML that refers to nothing outside itself.
    """
    css = (TEMPLATES / "page.css").read_text(encoding="utf-8")
    return str(
        render_template(
            "page.html",
            title=title,
            subtitle=subtitle,
            sections=[(section.id, section.title, Markup(section.body)) for section in sections],
            css=Markup(css),
            footer=footer,
        )
    )


def embed_figure(figure: Figure | str | Path, alt: str, caption: str = "", kind: str = "svg") -> Markup:
    """Figure element with its image inside.

    Parameters
    ----------
    figure : Figure or path-like
        A figure, or an SVG or PNG file.
    alt : str
        What the picture shows, for who does not see it.
    caption : str
        Text or `Markup` under it.
    kind : {"svg", "png"}
        For a `Figure`: SVG stays sharp, PNG is smaller where there are many thousands of points.
    """
    if isinstance(figure, Figure):
        content = figure_bytes(figure, kind)
    else:
        content, kind = Path(figure).read_bytes(), Path(figure).suffix.lstrip(".")
    data = base64.b64encode(content).decode("ascii")
    image = Markup('<img src="data:{};base64,{}" alt="{}">').format(_MEDIA[kind], data, alt)
    text = Markup("<figcaption>{}</figcaption>").format(caption) if caption else ""
    return Markup("<figure>{}{}</figure>").format(image, text)


def unbreak(text: str) -> str:
    """Text whose numbers stay on the line of their unit, and signs on that of their number."""
    return re.sub(r"(?<=[\d>]) (?=%|°C)|(?<=[≥≤=σΔ]) (?=[\d≥≤=])", "\N{NO-BREAK SPACE}", text)


def badge(text: str, kind: str = "neutral") -> Markup:
    """Short coloured label; `kind` is good, bad, unsure or neutral."""
    return Markup('<span class="badge {}">{}</span>').format(kind, text)


def format_number(value: Any, digits: int = 3) -> str:
    """Number to some significant digits; what is missing is said so, never shown as zero.

    >>> format_number(12345.6), format_number(0.00123456), format_number(float("nan"))
    ('12,346', '0.00123', 'n/a')
    """
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if not isinstance(value, Real):
        return "n/a" if value is None else str(value)
    number = float(value)
    if number != number:
        return "n/a"
    if abs(number) == float("inf"):
        return "∞" if number > 0 else "−∞"
    if isinstance(value, Integral):
        text = f"{number:,.0f}"
    elif abs(number) >= 10 ** (digits - 1):
        text = f"{number:,.0f}"
    elif number == 0 or abs(number) >= 1e-4:
        text = f"{number:.{digits}g}"
    else:
        text = f"{number:.{digits - 1}e}"
    return text.replace("-", "−")


def render_table(table: pd.DataFrame, caption: str = "", digits: int = 3) -> Markup:
    """Table of a data frame: numbers to `digits` digits, missing ones as n/a, text escaped."""
    head = Markup("").join(Markup('<th scope="col">{}</th>').format(str(name)) for name in table.columns)
    rows = []
    for values in table.itertuples(index=False):
        cells = Markup("")
        for value in values:
            number = isinstance(value, Real) and not isinstance(value, bool)
            text = value if isinstance(value, Markup) else escape(format_number(value, digits))
            cells += Markup('<td class="number">{}</td>' if number else "<td>{}</td>").format(text)
        rows.append(Markup("<tr>{}</tr>").format(cells))
    title = Markup("<caption><span>{}</span></caption>").format(caption) if caption else ""
    body = Markup("\n").join(rows)
    return Markup(
        '<div class="wide"><table>{}<thead><tr>{}</tr></thead><tbody>{}</tbody></table></div>'
    ).format(title, head, body)
