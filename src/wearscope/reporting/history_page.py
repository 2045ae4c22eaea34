"""One page over time: every study and verdict of a folder, newest first, and how errors and SNR went."""

from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

import altair as alt
import pandas as pd
import pyarrow as pa
from markupsafe import Markup

from wearscope import tables
from wearscope.checksums import ANSWERS, SETTINGS, check_answer
from wearscope.files import DamagedFile
from wearscope.reporting.charts.base import Chart, Source
from wearscope.reporting.charts.encoding import named, tips
from wearscope.reporting.labels import count_text, read_detector_names
from wearscope.reporting.page import Section, badge, embed_chart, render_page, render_table
from wearscope.reporting.page_strip import Strip, read_strip
from wearscope.verdicts import read_verdict

#: What is followed over time, by kind of page.
_QUANTITIES = {"diagnosis": "error after the correction", "study": "median signal-to-noise ratio"}
_BADGES = {"good": "sure", "unsure": "with a caveat", "bad": "not found"}


@dataclass(frozen=True)
class Answer:
    """A page with a strip: its path in the folder, what made it, what it is about, when (UTC)."""

    path: Path
    kind: str
    name: str
    when: str
    strip: Strip


def find_answers(folder: Path) -> list[Answer]:
    """Pages with an answer below a folder, newest first."""
    found = []
    for page in folder.rglob("report.html"):
        strip = read_strip(page)
        if strip is None:
            continue
        kind = next((kind for file, kind in ANSWERS.items() if (page.parent / file).is_file()), "page")
        try:
            check_answer(page)
        except DamagedFile as error:
            kind, strip = "damaged", Strip(str(error), "bad", "", "", "")
        place = page.relative_to(folder)
        written = datetime.fromtimestamp(page.stat().st_mtime, UTC)
        name = place.parent.as_posix() if place.parent != Path() else folder.resolve().name
        found.append(Answer(place, kind, name, f"{written:%Y-%m-%d %H:%M:%S}", strip))
    return sorted(found, key=lambda one: (one.when, one.name), reverse=True)


def render_history(folder: Path, found: list[Answer]) -> str:
    """Page of all answers of a folder.

    Parameters
    ----------
    folder : Path
        The page lies in it, as its links are relative.
    found : list of Answer
        From `find_answers`, at least one.
    """
    rows = [
        {
            "when (UTC)": one.when[:-3],
            "what": one.kind,
            "name": Markup('<a href="{}">{}</a>').format(one.path.as_posix(), one.name),
            "how sure": badge(_BADGES.get(one.strip.kind, "answered"), one.strip.kind),
            "answer": one.strip.answer,
        }
        for one in found
    ]
    newest, trend = found[0], trend_table(folder, found)
    sections = [Section("Answers", render_table(rows, "Newest first; a name leads to its page."), "answers")]
    shown = {"trend": trend} if trend["when"].nunique() > 1 else {}
    if shown:
        sections.append(Section("Trend", embed_chart(_chart()), "trend"))
    action = Markup('Open <a href="{}">{}</a>, the newest page.')
    strip = replace(newest.strip, action=action.format(newest.path.as_posix(), newest.name))
    subtitle = f"{count_text(len(found), 'page')}, the newest of {newest.when} UTC"
    return render_page(f"History of {folder.resolve().name}", sections, subtitle, "", (), shown, strip=strip)


def trend_table(folder: Path, found: list[Answer]) -> pd.DataFrame:
    """What can be followed over time: errors of diagnoses by joint, median SNR of studies by detector.

    Returns
    -------
    DataFrame
        ``when``, ``name``, ``quantity`` (error after the correction, or SNR), ``of``, ``value``.
    """
    rows = []
    for one in found:
        place = (folder / one.path).parent
        try:
            if one.kind == "diagnosis":
                joints = read_verdict(place / "verdict.json")["joints"]
                own = {joint: errors.get("rms_after") for joint, errors in joints.items()}
            elif one.kind == "study":
                tables.check_unpacked(place / "ranking.parquet")
                ranking = tables.read_table(place / "ranking.parquet")
                names = read_detector_names(place / SETTINGS)
                codes = ranking["fda"].astype(str).replace(names)
                own = dict(zip(codes, ranking["median"].astype(float), strict=True))
            else:
                continue
        except (OSError, ValueError, TypeError, KeyError, pa.ArrowException):
            continue
        known = {str(of): float(value) for of, value in own.items() if value is not None}
        rows += [(one.when, one.name, _QUANTITIES[one.kind], of, value) for of, value in known.items()]
    return pd.DataFrame(rows, columns=["when", "name", "quantity", "of", "value"])


def _chart() -> Chart:
    spec = (
        named("trend")
        .mark_line(point=True)
        .encode(
            x=alt.X("when:O", title=None, axis=alt.Axis(labelAngle=-30)),
            y=alt.Y("value:Q", title=None, scale=alt.Scale(type="symlog")),
            color=alt.Color("of:N", title=None, legend=alt.Legend(columns=6)),
            tooltip=tips("when:N; name:N; of:N; value:Q||.4"),
        )
        .properties(width=520, height=200)
        .facet(row=alt.Row("quantity:N", title=None))
        .resolve_scale(y="independent", color="independent")
    )
    return Chart(
        "trend-chart",
        "Errors and signal-to-noise ratios over time",
        spec,
        {"trend": Source("trend")},
        "Errors in the joint's unit of torque, on each diagnosis's own test runs.",
    )
