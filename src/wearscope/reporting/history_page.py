"""One page over time: every study and verdict of a folder, newest first, and the trend of errors and SNR."""

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

import altair as alt
import pandas as pd
import pyarrow as pa
from markupsafe import Markup
from pydantic import TypeAdapter

from wearscope import limits
from wearscope.reporting.charts.base import Chart, Source
from wearscope.reporting.charts.encoding import named, tips
from wearscope.reporting.labels import count_text, read_detector_names, upper_first
from wearscope.reporting.page import Section, badge, embed_chart, render_page, render_table
from wearscope.reporting.page_strip import Strip, read_strip
from wearscope.storage import tables
from wearscope.storage.files import (
    ANSWERS,
    MADE,
    SETTINGS,
    DamagedFile,
    check_answer,
    check_plain,
    digest_file,
    load_json,
)
from wearscope.storage.verdicts import read_verdict

#: File in which a folder of results keeps its answers, also those of earlier runs.
KEPT = "history.jsonl"
#: Quantities that are followed over time, by kind of page.
_QUANTITIES = {
    "diagnosis": "RMS error on the test runs after the correction [N m, or N of a slide]",
    "study": "median signal-to-noise ratio",
}
_BADGES = {"good": "sure", "unsure": "with a caveat", "bad": "needs attention"}


@dataclass(frozen=True)
class Answer:
    """Answer of a page, or of an earlier version of it.

    Attributes
    ----------
    path : str
        Path of the page in the folder; empty where another page has replaced it.
    kind, name : str
        Kind of result, such as ``diagnosis``, and its name.
    when : str
        Time at which the page was written (UTC).
    strip : Strip
    digest : str
        SHA-256 of the page.
    values : mapping of str to float
        Values that are followed over time, by joint or detector.
    version, settings : str
        Version of wearscope, and digest of the settings; empty where they were not kept.
    """

    path: str
    kind: str
    name: str
    when: str
    strip: Strip
    digest: str
    values: Mapping[str, float] = field(default_factory=dict)
    version: str = ""
    settings: str = ""


def find_answers(folder: Path) -> list[Answer]:
    """Answers below a folder, newest first: those of its pages, and kept ones of replaced pages."""
    found = [
        one
        for page in folder.rglob("report.html")
        if {MADE, "parts"}.isdisjoint(page.relative_to(folder).parts) and (one := read_answer(folder, page))
    ]
    there = {one.digest for one in found}
    found += [one for one in _read_kept(folder / KEPT) if one.digest not in there]
    return sorted(found, key=lambda one: (one.when, one.name), reverse=True)


def read_answer(folder: Path, page: Path) -> Answer | None:
    """Answer of a page below a folder; None where the page has no strip."""
    strip = read_strip(page)
    if strip is None:
        return None
    kind = next((kind for file, kind in ANSWERS.items() if (page.parent / file).is_file()), "page")
    try:
        check_answer(page)
    except DamagedFile as error:
        kind, strip = "damaged", Strip(str(error), "bad", "", "", "")
    place = page.relative_to(folder)
    written = datetime.fromtimestamp(page.stat().st_mtime, UTC)
    name = place.parent.as_posix() if place.parent != Path() else folder.resolve().name
    when, values = f"{written:%Y-%m-%d %H:%M:%S}", _read_values(page.parent, kind)
    return Answer(place.as_posix(), kind, name, when, strip, digest_file(page), values)


def keep_answer(folder: Path, page: Path, settings: str) -> None:
    """Add a page's answer as a line to the folder's `KEPT`, which reruns do not overwrite.

    Parameters
    ----------
    folder : Path
        Folder of all results.
    page : Path
        Page below it. One that is missing, has no strip or was kept before adds nothing.
    settings : str
        Text of the settings, of which the digest is kept.
    """
    one = read_answer(folder, page) if page.is_file() else None
    if (
        one is None
        or one.kind == "damaged"
        or one.digest in {kept.digest for kept in _read_kept(folder / KEPT)}
    ):
        return
    digest = hashlib.sha256(settings.encode()).hexdigest()[:12]
    line = replace(one, path="", settings=digest, version=metadata.version("wearscope"))
    fields = asdict(line) | {"strip": line.strip.plain()}
    with open(folder / KEPT, "a", encoding="utf-8") as file:
        file.write(json.dumps(fields, ensure_ascii=False) + "\n")


def _read_kept(file: Path) -> list[Answer]:
    """Answers of a file; lines that are no answer are left out."""
    found: list[Answer] = []
    if not os.path.lexists(file):
        return found
    check_plain(file, limits.JSON_BYTES, "move it away")
    for line in file.read_text(encoding="utf-8", errors="replace").splitlines():
        with suppress(ValueError, TypeError, RecursionError):
            found.append(TypeAdapter(Answer).validate_python(load_json(line) | {"path": ""}))
    return found


def render_history(folder: Path, found: list[Answer]) -> str:
    """Page of all answers of a folder.

    Parameters
    ----------
    folder : Path
        Folder of the page, to which its links are relative.
    found : list of Answer
        From `find_answers`, at least one.
    """
    rows = [
        {
            "when (UTC)": one.when[:-3],
            "what": one.kind,
            "name": Markup('<a href="{}">{}</a>').format(one.path, one.name) if one.path else one.name,
            "how sure": badge(_BADGES.get(one.strip.kind, "answered"), one.strip.kind),
            "answer": one.strip.answer,
        }
        for one in found
    ]
    newest = next((one for one in found if one.path), found[0])
    note = "Newest first. A name links to its page; the page of a name without a link was replaced."
    table = trend_table(found)
    # Machines and studies differ in their joints or detectors; a chart has those whose first one is the same.
    first = table.groupby(["when", "name"])["of"].transform("min")
    trends = table.groupby(["quantity", first.rename("first")])
    followed = [rows for _, rows in trends if rows["when"].nunique() > 1]
    shown = {f"trend-{k}": rows for k, rows in enumerate(followed)}
    sections = [
        Section("Answers", render_table(rows, note), "answers"),
        Section("Trend", embed_chart(*map(_chart, shown, shown.values())), "trend"),
    ]
    action = Markup('Open <a href="{}">{}</a>, the newest page.').format(newest.path, newest.name)
    strip = replace(
        newest.strip, action=action if newest.path else "Run the newest one again: its page is gone."
    )
    subtitle = f"{count_text(len(found), 'answer')}, the newest of {newest.when} UTC"
    return render_page(f"History of {folder.resolve().name}", sections, subtitle, "", (), shown, strip=strip)


def trend_table(found: list[Answer]) -> pd.DataFrame:
    """Quantities over time: errors of diagnoses by joint, median SNR of studies by detector.

    Returns
    -------
    DataFrame
        ``when``, ``name``, ``quantity`` (error after the correction, or SNR), ``of``, ``value``.
    """
    rows = [
        (one.when, one.name, _QUANTITIES[one.kind], of, value)
        for one in found
        for of, value in one.values.items()
        if one.kind in _QUANTITIES
    ]
    return pd.DataFrame(rows, columns=["when", "name", "quantity", "of", "value"])


def _read_values(place: Path, kind: str) -> dict[str, float]:
    """Quantities of the results in a folder that are followed over time."""
    try:
        if kind == "diagnosis":
            joints = read_verdict(place / "verdict.json")["joints"]
            own = {joint: errors.get("rms_after") for joint, errors in joints.items()}
        elif kind == "study":
            tables.check_unpacked(place / "rankings.parquet")
            ranking = tables.read_table(place / "rankings.parquet").query("robot == ''")
            codes = ranking["fda"].astype(str).replace(read_detector_names(place / SETTINGS))
            own = dict(zip(codes, ranking["median"].astype(float), strict=True))
        else:
            return {}
        return {str(of): float(value) for of, value in own.items() if value is not None}
    except (OSError, ValueError, TypeError, KeyError, pa.ArrowException):
        return {}


def _chart(name: str, rows: pd.DataFrame) -> Chart:
    """Chart of one quantity over time, with a line per joint or detector."""
    labels = alt.Axis(labelAngle=-30, labelExpr="slice(datum.label, 5, 16)")
    spec = (
        named(name)
        .mark_line(point=True)
        .encode(
            x=alt.X("when:O", title=None, axis=labels),
            y=alt.Y("value:Q", title=None, scale=alt.Scale(type="symlog")),
            color=alt.Color("of:N", title=None),
            tooltip=tips("when:N; name:N; of:N; value:Q||.4"),
        )
        .properties(width="container", height=200)
    )
    return Chart(f"{name}-chart", upper_first(rows["quantity"].iloc[0]), spec, {name: Source(name)})
