"""The page of detectors on recordings: alarms first, then all recorded and simulated values on one axis."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import altair as alt
import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.charts.base import Chart, Choice, Source
from wearscope.reporting.charts.encoding import named, offset, rows, symlog, tint, tips
from wearscope.reporting.labels import (
    count_text,
    detector_name,
    join_some,
    join_words,
    unit_text,
    upper_first,
)
from wearscope.reporting.page import (
    Section,
    badge,
    embed_chart,
    format_number,
    interval_text,
    render_page,
    render_part,
    render_table,
    say,
)
from wearscope.reporting.page_strip import Strip
from wearscope.storage import tables
from wearscope.storage.files import read_json

#: Factors in words, by kind.
FACTOR_NAMES = {"wear": "wear", "temperature": "temperature", "payload_mass_error": "payload mass error"}
#: An alarm is told with the difference of temperature where that is larger than this [K].
WARMER = 1.0
#: Verdicts by rank; a recording has the highest-ranked verdict of its joints and detectors.
_ORDER = ("alarm", "unchecked", "no alarm", "withheld", "failed")
_WORDS = "detection/words.html"
#: Colour of the strip by the verdict that it tells first; any other verdict is unsure.
_KINDS = {"alarm": "bad", "no alarm": "good"}
#: Kind of conclusion on a recording by its verdict; any other verdict is a notice.
_SAID = {"alarm": "alarm", "no alarm": "plain"}
#: Verdicts that give no answer, and the reason.
_OPEN = {
    "withheld": "No threshold",
    "unchecked": "Above the threshold, but too few nominal sessions tell how the machine scatters",
}


@dataclass(frozen=True)
class Detections:
    """Outcome of target ``detect``: ``detection.json`` and the tables next to it."""

    summary: Mapping[str, Any]
    detection: pd.DataFrame
    thresholds: pd.DataFrame
    simulated: pd.DataFrame

    @property
    def judged(self) -> pd.DataFrame:
        """Rows of the judged recordings."""
        return self.detection[self.detection["kind"] == "judged"]


def read_detections(folder: str | Path) -> Detections:
    """Read the files of target ``detect``, with the detectors' full names.

    Raises
    ------
    InputError
        Where they are not there.
    """
    summary = read_json(Path(folder) / "detection.json", missing="run the target detect first")
    full = {code: detector_name(code, use) for code, use in summary.get("detectors", {}).items()}
    names = ("detection", "thresholds", "simulated")
    read = (tables.read_table(Path(folder) / f"{name}.parquet") for name in names)
    return Detections(summary, *(one.assign(fda=one["fda"].astype(str).replace(full)) for one in read))


def lead_verdicts(judged: pd.DataFrame) -> pd.Series:
    """Verdict of each judged recording: the first in `_ORDER` that one of its joints and detectors has."""
    return judged.groupby("run", sort=False)["verdict"].agg(lambda own: min(own, key=_ORDER.index))


def detection_strip(found: Detections) -> Strip:
    """Strip of the page: whether any detector alarms; if none does, which wear would have shown."""
    told = describe(found)
    kind = (
        "unsure" if told.first == "no alarm" and told.number < told.all else _KINDS.get(told.first, "unsure")
    )
    answer, sure, caveat = (say(_WORDS, part, told).striptags() for part in ("answer", "sure", "caveat"))
    action = Markup('See <a href="#values">every value</a>; <code>wearscope track</code> says what changed.')
    return Strip(answer, kind, sure, caveat, action)


def describe(found: Detections) -> SimpleNamespace:
    """Values of all recordings that the strip's template needs."""
    lead = lead_verdicts(found.judged)
    first, runs = min(lead, key=_ORDER.index), lead.value_counts()
    own = found.judged[(found.judged["verdict"] == first) & (first in ("alarm", "unchecked"))]
    name = own["session"].where(own["session"] != "", own["run"]).astype(str)
    least = found.thresholds.groupby(["motion", "joint"])["wear_detected"].min()
    return SimpleNamespace(
        first=first,
        number=int(runs[first]),
        all=len(lead),
        where=join_some([f"{one} at {_name_joints(joints)}" for one, joints in own.groupby(name)["joint"]]),
        by=join_words(sorted(own["fda"].unique())),
        joints=found.summary["judged"]["joints"],
        of=found.summary["judged"]["of"],
        seconds=f"{found.summary['judged']['seconds']:.0f}",
        refused=len(found.summary["refused"]),
        false=f"{100 * found.summary['setting']['p_f']:g}",
        withheld=int(runs.get("withheld", 0)),
        blind=join_words(sorted({joint for _, joint in least.index[least.isna()]})),
        unseen=format_number(float(least.max()), 2),
    )


def _name_joints(joints: pd.Series) -> str:
    """Names of up to two joints, else their number."""
    names = sorted(joints.astype(str).unique())
    return join_words(names) if len(names) <= 2 else count_text(len(names), "joint")


def write_quantity(row: Mapping[Any, Any], name: str = "y") -> str:
    """Test quantity, or its threshold, with its unit."""
    return f"{format_number(float(row[name]))} {unit_text(row['unit'])}".strip()


def conclude(found: Detections) -> list[tuple[str, str]]:
    """Conclusions, alarms first: kind (``alarm``, ``notice``, ``plain``) and sentence.

    Recordings with the same outcome share a sentence.
    """
    said: dict[tuple[str, str], list[str]] = {}
    lead = lead_verdicts(found.judged)
    for run, own in found.judged.groupby("run", sort=False):
        session, kind = own["session"].iloc[0], _SAID.get(lead[run], "notice")
        text = say(_WORDS, "outcome", kind, *_describe_outcome(own)).striptags()
        said.setdefault((kind, text), []).append(f"{run} ({session})" if session else str(run))
    sentences = [(kind, f"{join_words(names)}: {text}") for (kind, text), names in said.items()]
    return sorted(sentences, key=lambda one: ("alarm", "notice", "plain").index(one[0]))


def _describe_outcome(rows: pd.DataFrame) -> tuple[list[Any], list[str], list[Any]]:
    """Places of a recording's alarms by detector, joints that were warmer there, what has no answer."""
    alarms = rows[rows["verdict"] == "alarm"]
    places = [
        (fda, [f"{row.joint}{_tell_like(row.wear)}" for row in own.itertuples()])
        for fda, own in alarms.groupby("fda", sort=True)
    ]
    warmer = [
        f"{row.joint} ({format_number(abs(row.warmer), 2)} K {'warmer' if row.warmer > 0 else 'colder'})"
        for row in alarms.drop_duplicates("joint").itertuples()
        if abs(row.warmer) > WARMER
    ]
    left = [(text, rows[rows["verdict"] == verdict]) for verdict, text in _OPEN.items()]
    unknown = [
        (text, [(fda, sorted(part["joint"])) for fda, part in own.groupby("fda", sort=True)])
        for text, own in left
    ]
    return places, warmer, unknown


def _tell_like(wear: float) -> str:
    """Words for the simulated wear that gives the same value; empty where it is not known."""
    return f" (as at wear {format_number(float(wear), 2)})" if np.isfinite(wear) else ""


def tell_scatter(found: Detections) -> list[Markup]:
    """Sentences on the machine's scatter compared with the simulation's."""
    table = found.thresholds[found.thresholds["reason"] == ""]
    known = table[np.isfinite(table["widening"].astype(float))]
    wide = known[known["scatter_ratio"] > 1.0].sort_values("scatter_ratio")
    most = [
        (one.joint, one.fda, format_number(one.scatter_ratio, 2)) for one in wide.tail(1).itertuples()
    ] or [("", "", "")]
    said = [
        say(_WORDS, "scatter", len(wide), len(known), *most[0]),
        say(_WORDS, "unknown", len(table) - len(known)),
    ]
    return list(filter(None, said))


def tell_factors(found: Detections) -> list[Markup]:
    """Sentences on factors that change no torque in the simulated runs."""
    return [
        say(
            _WORDS,
            "idle",
            found.summary["model"],
            motion,
            join_words([FACTOR_NAMES[one] for one in idle]),
            len(idle),
        )
        for motion, one in found.summary["motions"].items()
        if (idle := one["factors_that_move_nothing"])
    ]


_BADGES = {
    "alarm": "bad",
    "no alarm": "good",
    "unchecked": "unsure",
    "withheld": "unsure",
    "failed": "neutral",
}
#: Names and colours in the chart, by the tables' kinds.
KINDS = {
    "simulated": ("simulated, no wear", "var(--soft)"),
    "simulated_worn": ("simulated, worn", "var(--c2)"),
    "nominal": ("recorded, nominal", "var(--after)"),
    "judged": ("recorded, judged", "var(--before)"),
}
_CELL = ["motion", "joint", "fda"]
#: Values that count as empty; a column without others is left out.
_NOTHING = {"", "nan", "n/a", "None"}
#: Largest number of rows of a table that is shown unfolded.
_MOST_SHOWN = 40


def write_detection_page(folder: str | Path) -> None:
    """Write ``report.html`` next to the files of target ``detect``."""
    tables.write_text(Path(folder) / "report.html", render_detection(read_detections(folder)))


def render_detection(found: Detections) -> str:
    """Self-contained page of the detectors on the recordings of a data set."""
    cells, drawn = found.thresholds, axis_tables(found)
    told = [sentence if kind == "plain" else (kind, sentence) for kind, sentence in conclude(found)]
    outcome = render_part(told=[*told, *tell_scatter(found), *tell_factors(found)])
    sections = [
        Section("Outcome", outcome, "outcome"),
        Section("Machine and simulator", embed_chart(chart_axis(drawn)), "axis"),
        Section("Every test quantity", _values(found), "values"),
        Section("Thresholds, and what they detect", _thresholds(found), "thresholds"),
        Section("Not judged, and why", _refused(found), "refused"),
        Section("How it was done", _setting(found), "setting"),
    ]
    judged, detectors = found.judged["run"].nunique(), cells["fda"].nunique()
    filters = [
        Choice(key, name, [(one, one) for one in dict.fromkeys(cells[key])])
        for key, name in {"motion": "Motion", "joint": "Joint", "fda": "Detector"}.items()
    ]
    return render_page(
        f"Detectors on recordings: {found.summary['dataset']}",
        sections,
        f"{count_text(judged, 'recording')} judged by {count_text(detectors, 'detector')} at a false-alarm "
        f"rate of {100 * found.summary['setting']['p_f']:g} %",
        filters=filters,
        tables=drawn,
        labels={"column": {"fda": "detector", "place": "place on the axis", "y": "test quantity"}},
        strip=detection_strip(found),
    )


def axis_tables(found: Detections) -> dict[str, pd.DataFrame]:
    """Simulated spans and recorded points on an axis where 0 is the median without wear, 1 the threshold.

    ``spans`` has the range of 95 % of the runs and their quartiles, ``points`` one row per recording. Cells
    without a threshold are left out.
    """
    cells = found.thresholds[[*_CELL, "threshold", "unit"]].set_index(_CELL)
    unworn = found.simulated[found.simulated["kind"] == "simulated"]
    cells["middle"] = unworn.groupby(_CELL)["y"].median()
    cells = cells[np.isfinite(cells[["threshold", "middle"]].astype(float)).all(axis=1)].reset_index()

    def scale(runs: pd.DataFrame) -> pd.DataFrame:
        own = runs.drop(columns=["threshold", "unit"], errors="ignore").merge(cells, on=_CELL)
        own = own[own["kind"].isin(KINDS)]
        place = (own["y"] - own["middle"]) / (own["threshold"] - own["middle"])
        names = own["kind"].map({key: text for key, (text, _) in KINDS.items()})
        return own.assign(place=place, cell=own["joint"] + ", " + own["fda"], kind=names)

    levels = {"low": 0.025, "first": 0.25, "third": 0.75, "high": 0.975}
    by = scale(found.simulated).groupby([*_CELL, "cell", "kind"], sort=False)["place"]
    spans = pd.DataFrame({name: by.quantile(level) for name, level in levels.items()}).reset_index()
    points = scale(found.detection)[[*_CELL, "cell", "kind", "run", "place", "y", "unit", "verdict"]]
    return {"points": points, "spans": spans}


def chart_axis(drawn: Mapping[str, pd.DataFrame]) -> Chart:
    """Chart of the test quantities by cell and kind, drawn from the tables of `axis_tables`."""
    known = {kind for table in drawn.values() for kind in table["kind"]}
    kinds = {name: colour for name, colour in KINDS.values() if name in known}
    look: dict[str, Any] = {
        "y": rows("cell:N"),
        "yOffset": offset("kind:N", kinds),
        "color": tint("kind:N", kinds),
    }
    told = tips("cell:N; kind:N; low:Q|95 % from|.3; first:Q|half from|.3; third:Q|to|.3; high:Q|95 % to|.3")
    spans = named("spans").encode(**look, tooltip=told)
    rule = alt.Chart(alt.InlineData([{"place": 1}])).mark_rule(strokeDash=[5, 4], color="var(--bad)")
    layers = (
        spans.mark_rule(strokeWidth=2).encode(x="low:Q", x2="high:Q"),
        spans.mark_rule(strokeWidth=6, opacity=0.6).encode(x="first:Q", x2="third:Q"),
        named("points")
        .mark_circle(size=45, opacity=0.8)
        .encode(
            x=symlog("place:Q", "test quantity (0: healthy, 1: alarm threshold)"),
            tooltip=tips("run:N|recording; cell:N; verdict:N; y:Q||.4; unit:N"),
            **look,
        ),
        rule.encode(x="place:Q"),
    )
    by = {key: key for key in _CELL}
    return Chart(
        "axis-chart",
        "Machine and simulator on one axis",
        alt.layer(*layers).properties(width="container", height={"step": 8}),
        {"points": Source("points", by), "spans": Source("spans", by)},
        "Each joint and detector, scaled so that 0 is healthy and 1 its alarm threshold (dashed). Bars: 95 % "
        "of the simulated runs, and half of them. Points: recordings; a nominal one is judged by detectors "
        "that are fitted to the others.",
        single=["motion"],
    )


def _fold(records: Sequence[Mapping[Any, Any]], caption: str, summary: str, columns: str) -> Markup:
    """Table without columns of empty values, folded where it is long."""
    parts = [one.strip() for one in columns.split(";")]
    told = {one: {str(row[one.partition("|")[0]]) for row in records} for one in parts}
    kept = [one for one, seen in told.items() if not seen <= _NOTHING and (one != "motion" or len(seen) > 1)]
    columns = "; ".join(kept if records else parts)
    by = {"motion": "motion", "joint": "joint", "detector": "fda"}
    by = {name: key for name, key in by.items() if name in columns}
    table = render_table(records, caption, filter_by=by if records else None, columns=columns)
    return table if len(records) <= _MOST_SHOWN else render_part(folded=[(summary, False, table)])


def _values(found: Detections) -> Markup:
    order = {verdict: k for k, verdict in enumerate(_BADGES)}
    own = found.judged.assign(order=found.judged["verdict"].map(order))
    own = own[own["status"] == "ok"].sort_values(["order", "run"], kind="stable")
    records = [
        row
        | {
            "verdict": badge(row["verdict"], _BADGES[row["verdict"]]),
            "y": write_quantity(row),
            "threshold": write_quantity(row, "threshold"),
            "wear": interval_text(row["wear"], row["wear_low"], row["wear_high"], 2),
        }
        for row in own.to_dict("records")
    ]
    caption = (
        "Wear like it: the simulated wear that gives such a test quantity. detection.parquet has the nominal "
        "recordings too."
    )
    columns = (
        "run|recording; session; joint; fda|detector; verdict; y|test quantity; threshold; "
        "warmer|warmer by [K]; wear|wear like it (95 %)"
    )
    return _fold(records, caption, f"All {len(records)} values", columns)


def _thresholds(found: Detections) -> Markup:
    own = found.thresholds[found.thresholds["reason"] == ""]
    records = [
        row
        | {
            "threshold": write_quantity(row, "threshold"),
            "p_f": interval_text(row["p_f"], row["p_f_low"], row["p_f_high"], 2),
        }
        for row in own.to_dict("records")
    ]
    p_d = 100 * found.summary["setting"]["p_d"]
    caption = (
        "Threshold: a simulated run without wear exceeds it at most at the false-alarm rate. Wear detected "
        f"from: smallest wear of which {p_d:g} % of simulated runs exceed it; n/a where there is none. "
        "Scatter: of the nominal recordings, over that of the simulated runs, which are widened for the "
        "threshold."
    )
    columns = (
        "motion; joint; fda|detector; threshold; p_f|false-alarm rate (95 %); "
        "wear_detected|wear detected from; nominal_runs|nominal recordings; "
        "nominal_above|of them above; scatter_ratio|scatter; widening|widened by"
    )
    return _fold(records, caption, "All thresholds", columns)


def _refused(found: Detections) -> Markup:
    own = found.thresholds[found.thresholds["reason"] != ""]
    without = [
        f"{fda} at {join_words(sorted(part['joint'].unique()))}: {str(reason).rstrip('.')}."
        for (fda, reason), part in own.groupby(["fda", "reason"], sort=True)
    ]
    return render_part(listed=[one["reason"] for one in found.summary["refused"]] + without)


def _setting(found: Detections) -> Markup:
    setting, summary = found.summary["setting"], found.summary
    measured = setting["nominal"] == "measured"
    fitted = "the nominal recordings" if measured else "simulated runs of the corrected model"
    worn = any("wear" not in one["factors_that_move_nothing"] for one in summary["motions"].values())
    runs = f"{setting['runs']} runs without wear" + f" and {setting['worn_runs']} with wear" * worn
    sentences = [
        f"For the recordings the detectors were fitted to {fitted}; for simulated runs, to simulated nominal "
        "runs.",
        f"{runs} of the model {summary['model']} were simulated along each motion, at the recorded "
        f"temperatures. Temperature and payload mass error scatter by {25 * setting['sigma']:.2g} % of their "
        "ranges in the study (standard deviation). The torque noise is that of "
        f"{summary['torque_noise_from']}. Recorded and simulated runs "
        "were filtered alike.",
        *(
            f"{upper_first(motion)}, {format_number(one['seconds'])} s: nominal {', '.join(one['nominal'])}."
            for motion, one in summary["motions"].items()
        ),
    ]
    return render_part(told=sentences)
