"""Self-contained pages: one template, one style sheet, figures as data; nothing is loaded from elsewhere."""

import base64
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from numbers import Integral, Real
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.charts.base import Chart, Choice, chart_library, pack_table
from wearscope.reporting.labels import count_text, join_words, upper_first
from wearscope.reporting.page_strip import Strip, unbreak

TEMPLATES = Path(__file__).with_name("templates")
_MEDIA = {"svg": "image/svg+xml", "png": "image/png"}
#: Column with the joint, and the filter of the same name.
JOINT = {"joint": "joint"}


@dataclass(frozen=True)
class Section:
    """A part of a page, with its name for links; left out where its body is empty.

    Text from elsewhere must have been escaped in its body (``Markup.format`` and templates do).
    """

    title: str
    body: str
    anchor: str


@cache
def environment() -> jinja2.Environment:
    """Templates of this package; text is escaped, an unknown name is an error."""
    made = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["unbreak"] = unbreak
    told = (badge, count_text, format_number, join_words, upper_first)
    made.globals |= {one.__name__: one for one in told}
    return made


def render_template(name: str, **context: Any) -> Markup:
    """HTML of one of the package's templates."""
    return Markup(environment().get_template(name).render(**context))


def say(template: str, macro: str, *given: Any) -> Markup:
    """Sentences of a macro of one of the package's templates, on one line."""
    text = getattr(environment().get_template(template).module, macro)(*given)
    return Markup(" ".join(str(text).split()))


def say_lines(template: str, macro: str, *given: Any) -> list[Markup]:
    """Sentences of a template's macro, one for each line that has text."""
    text = str(getattr(environment().get_template(template).module, macro)(*given))
    return [Markup(" ".join(line.split())) for line in text.split("\n") if line.strip()]


def render_part(**given: Any) -> Markup:
    """HTML of sentences, tables and figures in the usual order; empty where nothing is given.

    Parameters
    ----------
    told : sequence of str, or of (str, str)
        Sentences, or with ``alarm`` or ``notice`` before them.
    notes, listed : sequence of str
        Small print, and bullets.
    parts : sequence of Markup
        Tables and figures.
    folded : sequence of (str, bool, Markup)
        Summary, whether it is open, and what it folds.
    """
    if not any(given.values()):
        return Markup("")
    empty = dict.fromkeys(("told", "notes", "parts", "listed", "folded"), ())
    return render_template("part.html", **empty | given)


def render_page(
    title: str,
    sections: Sequence[Section],
    subtitle: str = "",
    footer: str = "",
    filters: Sequence[Choice] = (),
    tables: Mapping[str, pd.DataFrame] | None = None,
    labels: Mapping[str, Mapping[str, str]] | None = None,
    strip: Strip | None = None,
    picture: str = "",
) -> str:
    """Whole page: title, contents, filters, sections, and what its charts need.

    Parameters
    ----------
    title : str
    sections : sequence of Section
        Sections in order; the first one is for a reader in a hurry.
    subtitle : str
        One line of text under the title.
    footer : str
        One line of text at the end.
    filters : sequence of Choice
        Filters of all charts and tables; those with fewer than two options are left out.
    tables : mapping of str to DataFrame, optional
        Tables that the charts draw, by the name in their sources.
    labels : mapping of str to mapping, optional
        Labels of values, by choice; ``column`` holds those of the tables' columns.
    strip : Strip, optional
        The answer, how sure it is, its caveat and what to do next.
    picture : str
        HTML of a chart under the strip that shows the answer.

    Returns
    -------
    str
        HTML that refers to nothing outside itself.
    """
    shown = [one for one in filters if len(one.options) > 1]
    settings = {"filters": [{"key": one.key, "label": one.label} for one in filters], "labels": labels or {}}
    drawn = any('class="chart"' in body for body in (picture, *(one.body for one in sections)))
    return str(
        render_template(
            "page.html",
            title=title,
            subtitle=subtitle,
            strip=strip,
            picture=Markup(picture),
            strip_data=embed_json(strip.plain()) if strip else "",
            sections=[(one.anchor, one.title, Markup(one.body)) for one in sections if one.body],
            css=_read("page.css"),
            footer=footer,
            filters=shown,
            settings=embed_json(settings),
            tables=[(name, Markup(pack_table(frame))) for name, frame in (tables or {}).items()],
            library=Markup(chart_library()) if drawn else "",
            script=_read("page.js"),
        )
    )


def describe_study(config: Mapping[str, Any], robots: int) -> str:
    """Subtitle of a study's page: numbers of robots, test-cycles, axes and detectors."""
    counts = {
        "detector": len(config["detectors"]),
        "robot": robots,
        "test-cycle": len(config["cycles"]),
        "axis": len(config["axes"]),
        "factor": len(config["factors"]),
    }
    return ", ".join(count_text(n, what, "axes" * (what == "axis")) for what, n in counts.items())


def _read(name: str) -> Markup:
    return Markup((TEMPLATES / name).read_text(encoding="utf-8"))


def embed_json(value: Any) -> Markup:
    """JSON text that is safe inside a script element."""
    return Markup(json.dumps(value, separators=(",", ":"), ensure_ascii=False).replace("<", "\\u003c"))


def embed_chart(*charts: Chart) -> Markup:
    """HTML of interactive charts; `render_page` must get the tables that they draw."""
    drawn = [(chart, embed_json(chart.definition())) for chart in charts]
    return Markup("").join(render_template("chart.html", chart=one, definition=text) for one, text in drawn)


def embed_figure(file: str | Path, alt: str, caption: str = "") -> Markup:
    """Figure element with an SVG or PNG file inside.

    Parameters
    ----------
    file : path-like
    alt : str
        Text of what the picture shows, for readers who cannot see it.
    caption : str
        Text or `Markup` under it.
    """
    path = Path(file)
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    source = f"data:{_MEDIA[path.suffix.lstrip('.')]};base64,{data}"
    return render_template("figure.html", source=source, alt=alt, caption=caption)


def badge(text: str, kind: str = "neutral") -> Markup:
    """Short coloured label; `kind` is good, bad, unsure or neutral."""
    return Markup('<span class="badge {}">{}</span>').format(kind, text)


def format_number(value: Any, digits: int = 3) -> str:
    """Number to some significant digits; a missing number is shown as n/a, never as zero.

    >>> format_number(12345.6), format_number(0.00123456), format_number(float("nan"))
    ('12,346', '0.00123', 'n/a')
    """
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if not isinstance(value, Real):
        return "n/a" if value is None else str(value)
    number = float(value) + 0.0
    if number != number:
        return "n/a"
    if abs(number) == float("inf"):
        return "∞" if number > 0 else "−∞"
    if isinstance(value, Integral) or abs(number) >= 10 ** (digits - 1):
        text = f"{number:,.0f}"
    elif number == 0 or abs(number) >= 1e-4:
        text = f"{number:.{digits}g}"
    else:
        text = f"{number:.{digits - 1}e}"
    return text.replace("-", "−")


def interval_text(value: Any, low: Any, high: Any, digits: int = 3) -> str:
    """A value with its interval: ``12.1 (8.7 to 14.5)``; the value alone where the interval is unknown."""
    told = format_number(value, digits)
    if not np.isfinite([float(low), float(high)]).all():
        return told
    return f"{told} ({format_number(low, digits)} to {format_number(high, digits)})"


#: Characters of a text above which a table's rows are stacked on a phone.
PROSE = 60


def render_table(
    table: pd.DataFrame | Sequence[Mapping[str, Any]],
    caption: str = "",
    digits: int = 3,
    filter_by: Mapping[str, str] | None = None,
    cells: Sequence[Mapping[str, object]] = (),
    columns: str = "",
) -> Markup:
    """Table of a data frame that sorts and exports: missing numbers as n/a, text escaped.

    Parameters
    ----------
    table : DataFrame or sequence of mapping
        Rows that hold `Markup` must be mappings: pandas makes plain strings of a column of it.
    caption : str
    digits : int
        Significant digits of the numbers.
    filter_by : mapping of str to str, optional
        The page's filter by column; it hides rows with other values of this column.
    cells : sequence of mapping
        Values for the page's filters by row, where no column holds them.
    columns : str
        Columns to show, each with its title where that is not its name: ``fda|detector; joint``.
    """
    if not isinstance(table, pd.DataFrame):
        table = pd.DataFrame(list(table), dtype=object)
    if columns:
        parts = (one.strip().partition("|") for one in columns.split(";"))
        titles = {name: title or name for name, _, title in parts}
        table = table.reindex(columns=list(titles)).rename(columns=titles)
    names = [str(name) for name in table.columns]
    lines = list(table.itertuples(index=False))
    texts = (value for values in lines for value in values if isinstance(value, str))
    prose = any(len(text.striptags() if isinstance(text, Markup) else text) > PROSE for text in texts)
    places = {list(table.columns).index(column): key for column, key in (filter_by or {}).items()}
    rows = []
    for place, values in enumerate(lines):
        own = {key: str(values[column]) for column, key in places.items()}
        own |= {key: str(value) for key, value in cells[place].items()} if cells else {}
        shown = [value if isinstance(value, Markup) else format_number(value, digits) for value in values]
        numbers = [isinstance(value, Real) and not isinstance(value, bool) for value in values]
        rows.append((own, list(zip(names, numbers, shown, strict=True))))
    return render_template("table.html", caption=caption, names=names, prose=prose, rows=rows)
