"""The report of a study of many robots: what it concludes, and each robot and test-cycle, worst first.

It has a row for each robot and test-cycle; details are on the pages of the partitions, which it links.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting.charts.base import Choice
from wearscope.reporting.charts.study import FILTER_LABELS
from wearscope.reporting.labels import (
    CELL,
    COLUMNS,
    count_text,
    factor_name,
    finite,
    join_some,
    join_words,
    term_name,
    unit_text,
    with_unit,
    words,
)
from wearscope.reporting.page import (
    Section,
    describe_study,
    embed_figure,
    render_page,
    render_part,
    render_table,
    render_template,
)
from wearscope.reporting.study import Study
from wearscope.reporting.study_page import render_provenance
from wearscope.reporting.study_words import SIMULATED, count_failed, failed_simulations, qualify, study_strip

#: Largest number of terms that are shown unfolded.
_MOST = 15


def render_overview(study: Study, overview: pd.DataFrame, pages: Mapping[str, str]) -> str:
    """Report of a divided study as one self-contained page.

    Parameters
    ----------
    study : Study
        The study; its tables by cell (surrogates, validation, fits, snr, scope, checks) are not needed.
    overview : DataFrame
        From `wearscope.evaluation.conclusion`, the worst first.
    pages : mapping of str to str
        Path of each robot's own page, relative to this page.
    """
    robots, strip = overview["robot"].nunique(), study_strip(study, pages=True)
    config = study.config
    sections = [
        Section("Conclusion", _summarise(study, overview), "summary"),
        Section("Robots and test-cycles", _tabulate(study, overview, pages), "robots"),
        Section("Which detector is best?", _rank(study), "q2"),
        Section("Which factors matter?", _weigh(study), "q1"),
        Section("Where does it work?", _draw_scopes(study), "q3"),
        Section("Provenance", render_provenance(study), "provenance"),
    ]
    filters = [
        Choice(key, FILTER_LABELS[key], [(str(value), words(value)) for value in sorted(values)])
        for key, values in (
            ("robot", overview["robot"].unique()),
            ("cycle", overview["cycle"].unique()),
            ("fda", list(config["detectors"])),
        )
    ]
    return render_page(
        f"Study {config['study']}",
        sections,
        describe_study(config, robots),
        "Made by wearscope from its tables.",
        filters,
        strip=replace(strip, caveat=_caveat(overview)) if strip else None,
    )


def _summarise(study: Study, overview: pd.DataFrame) -> Markup:
    return render_template(
        "study/summary.html",
        qualifiers=[*qualify(study), *count_failed(study)],
        alarms=failed_simulations(study),
        robots="",
        cards=[("Robots", _compare(study, overview), "robots", "Every robot and test-cycle")],
    )


def _caveat(overview: pd.DataFrame) -> str:
    """Sentence on robots and test-cycles where no wear is found; else that everything is simulated."""
    lost = overview[overview["wear"].isna()]
    if lost.empty:
        return SIMULATED
    names = list(dict.fromkeys(lost["robot"]))
    return f"In {_count(len(lost))} no simulated change of wear is found: on {join_some(names)}."


def _count(n: int) -> str:
    return count_text(n, "robot and test-cycle", "robots and test-cycles")


def _compare(study: Study, overview: pd.DataFrame) -> list[str]:
    """Sentences on the recommended detectors, and on the range of the wear found over robots and cycles."""
    counts = overview.drop_duplicates("robot")["detector"].value_counts()
    used = [f"{name or 'none'} on {count_text(int(count), 'robot')}" for name, count in counts.items()]
    said = [f"Detector to use by robot: {join_words(used)}."]
    found = finite(overview["wear"])
    if found.size:
        fault = study.factor("f")
        low, middle, high = np.quantile(found, [0.0, 0.5, 1.0])
        span = f"{low:.3g} to {high:.3g} {unit_text(fault.unit)}".rstrip()
        said.append(
            f"Smallest change of {factor_name(fault)} that is found: {span}, {middle:.3g} in the median of "
            f"{_count(found.size)}."
        )
    return said


def _tabulate(study: Study, overview: pd.DataFrame, pages: Mapping[str, str]) -> Markup:
    rows = overview.assign(fda=overview["detector"])[["robot", "cycle", "fda"]].to_dict("records")
    records = [
        row
        | {
            "robot": Markup('<a href="{}">{}</a>').format(pages[row["robot"]], row["robot"]),
            "cycle": words(row["cycle"]),
            "detector": row["detector"] or "none",
        }
        for row in overview.to_dict("records")
    ]
    note = (
        "Worst first: where no wear is found (n/a), then by the smallest change that is found, then by SNR. "
        "All of the detector recommended for the robot. A robot's name leads to its page."
    )
    columns = (
        "robot; cycle|test-cycle; detector|detector to use; "
        f"wear|{with_unit('finds wear from', study.factor('f').unit)}; snr|median SNR; fit|lowest fit [%]; "
        "cells; cells_sure|of them sure; failed_simulations|failed simulations"
    )
    return render_table(records, note, cells=rows, columns=columns)


def _rank(study: Study) -> Markup:
    shown = study.ranking.drop(columns="interval_from", errors="ignore").rename(columns=COLUMNS)
    by = {"detector": "fda"} if "detector" in shown else None
    return render_table(shown, "Over the cells of all robots.", filter_by=by)


def _weigh(study: Study) -> Markup:
    """Table of terms by the share of cells in which they outweigh wear."""
    table = study.sensitivity[study.sensitivity["term"] != "f"]
    table = table.sort_values(["share_relevant", "median_absolute"], ascending=False, kind="stable")
    shares = table[["share_relevant", "share_low", "share_high"]].mul(100)
    shown = table.assign(term=[term_name(term, study.factors) for term in table["term"]], **shares)
    keys = [f"{name}|{COLUMNS.get(name, name)}" for name in CELL if name in table]
    columns = "; ".join(keys) + (
        "; term; n|cells; share_relevant|outweighs wear in [%]; share_low|95 % from; share_high|to; "
        "median_absolute|median size over that of wear"
    )
    note = "Coefficients of the surrogates over that of wear, in the cells of all robots."
    by = {"detector": "fda"} if "fda" in table else None
    first = render_table(shown[:_MOST], note, filter_by=by, columns=columns)
    if len(shown) <= _MOST:
        return first
    rest = render_table(shown[_MOST:], "The others.", filter_by=by, columns=columns)
    return first + render_part(folded=[(f"{len(shown) - _MOST} more terms", False, rest)])


def _draw_scopes(study: Study) -> Markup:
    figures = Markup("")
    for name, file in study.figures.items():
        factor = factor_name(study.factor(name.removeprefix("scope_")))
        shown = f"Number of cells of all robots in which each detector works while {factor} varies"
        figures += embed_figure(file, shown, f"{factor}: cells that meet the requirement.")
    return figures
