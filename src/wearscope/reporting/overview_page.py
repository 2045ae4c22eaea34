"""The report of a study of many robots: what it concludes, and each robot and test-cycle, worst first.

Details are on the pages of the partitions, to which it links: so it holds a row, not a chart, for each.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.reporting import trust
from wearscope.reporting.charts.base import Choice
from wearscope.reporting.charts.study import FILTER_LABELS, words
from wearscope.reporting.conclusion import qualify
from wearscope.reporting.labels import (
    COLUMNS,
    count_text,
    factor_name,
    finite,
    join_words,
    term_name,
    unit_text,
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
from wearscope.reporting.sections.background import Provenance
from wearscope.reporting.sections.base import say
from wearscope.reporting.strips import SIMULATED, study_strip
from wearscope.reporting.study import Study

#: Terms that are shown unfolded.
_MOST = 15


def render_overview(study: Study, overview: pd.DataFrame, pages: Mapping[str, str]) -> str:
    """Report of a divided study as one self-contained page.

    Parameters
    ----------
    study : Study
        Without its tables by cell (surrogates, validation, fits, snr, scope, checks), which are not asked.
    overview : DataFrame
        From `wearscope.evaluation.overview`, the worst first.
    pages : mapping of str to str
        By robot, where its own page is, relative to this one.
    """
    robots, strip = overview["robot"].nunique(), study_strip(study, pages=True)
    config = study.config
    sections = [
        Section("Conclusion", _summarise(study, overview), "summary"),
        Section("Robots and test-cycles", _tabulate(study, overview, pages), "robots"),
        Section("Which detector is best?", _rank(study), "q2"),
        Section("Which factors matter?", _weigh(study), "q1"),
        Section("Where does it work?", _draw_scopes(study), "q3"),
        Provenance(study).render(),
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
    first = study.conclusions[0]
    failed = [] if study.failures.empty else [trust.failed_points(study)]
    return render_template(
        "study/summary.html",
        qualifiers=say([*qualify(study, first), *failed]),
        alarms=say(trust.failed_simulations(study)),
        robots="",
        cards=[("Robots", say(_compare(study, overview)), "robots", "Every robot and test-cycle")],
    )


def _caveat(overview: pd.DataFrame) -> str:
    """Where nothing is found, or that all is simulated."""
    lost = overview[overview["wear"].isna()]
    if lost.empty:
        return SIMULATED
    names = list(dict.fromkeys(lost["robot"]))
    shown = join_words([*names[:3], *([f"{len(names) - 3} more"] if len(names) > 3 else [])])
    many = count_text(len(lost), "robot and test-cycle", "robots and test-cycles")
    return f"In {many} no change of wear that was asked is found: on {shown}."


def _compare(study: Study, overview: pd.DataFrame) -> list[str]:
    """Detectors that are recommended, and how far what is found spreads over robots and test-cycles."""
    counts = overview.drop_duplicates("robot")["detector"].value_counts()
    used = [f"{name or 'none'} on {count_text(int(count), 'robot')}" for name, count in counts.items()]
    said = [f"Detector to use by robot: {join_words(used)}."]
    found = finite(overview["wear"])
    if found.size:
        unit = unit_text(study.factor("f").unit)
        low, middle, high = np.quantile(found, [0.0, 0.5, 1.0])
        said.append(
            f"Smallest change of {factor_name(study.factor('f'))} that is found: "
            f"{low:.3g} to {high:.3g}{' ' + unit if unit else ''}, {middle:.3g} in the median of "
            f"{count_text(found.size, 'robot and test-cycle', 'robots and test-cycles')}."
        )
    return said


def _tabulate(study: Study, overview: pd.DataFrame, pages: Mapping[str, str]) -> Markup:
    unit = unit_text(study.factor("f").unit)
    links = [Markup('<a href="{}">{}</a>').format(pages[robot], robot) for robot in overview["robot"]]
    shown = pd.DataFrame(
        {
            # As objects: a column of strings would forget that these are HTML.
            "robot": pd.Series(links, dtype=object),
            "test-cycle": overview["cycle"].map(words),
            "detector to use": overview["detector"].replace("", "none"),
            f"finds wear from{f' [{unit}]' if unit else ''}": overview["wear"],
            "median SNR": overview["snr"],
            "lowest fit [%]": overview["fit"],
            "cells": overview["cells"],
            "of them sure": overview["cells_sure"],
            "failed simulations": overview["failed_simulations"],
        }
    )
    note = (
        "Worst first: where no wear is found (n/a), then by the smallest change that is found, then by SNR. "
        "All of the detector recommended for the robot. A robot's name leads to its page."
    )
    keys = overview.rename(columns={"detector": "fda"})[["robot", "cycle", "fda"]]
    return render_table(shown, note, cells=keys.to_dict("records"))


def _rank(study: Study) -> Markup:
    shown = study.ranking.drop(columns="interval_from", errors="ignore").rename(columns=COLUMNS)
    note = "Over the cells of all robots."
    return render_table(shown, note, filter_by={"detector": "fda"} if "detector" in shown else None)


def _weigh(study: Study) -> Markup:
    """Terms by the share of cells in which they outweigh wear."""
    table = study.sensitivity[study.sensitivity["term"] != "f"]
    table = table.sort_values(["share_relevant", "median_absolute"], ascending=False, kind="stable")
    keys = [name for name in ("robot", "cycle", "axis", "fda") if name in table]
    shown = table[keys].assign(
        term=[term_name(term, study.factors) for term in table["term"]],
        cells=table["n"],
        share=100 * table["share_relevant"],
        low=100 * table["share_low"],
        high=100 * table["share_high"],
        median=table["median_absolute"],
    )
    names = {"share": "outweighs wear in [%]", "low": "95 % from", "high": "to"}
    shown = shown.rename(columns=COLUMNS | names | {"median": "median size over that of wear"})
    note = "Coefficients of the surrogates over that of wear, in the cells of all robots."
    by = {"detector": "fda"} if "detector" in shown else None
    if len(shown) <= _MOST:
        return render_table(shown, note, filter_by=by)
    rest = render_table(shown[_MOST:], "The others.", filter_by=by)
    folded = [(f"{len(shown) - _MOST} more terms", False, rest)]
    return render_table(shown[:_MOST], note, filter_by=by) + render_part(folded=folded)


def _draw_scopes(study: Study) -> Markup:
    figures = Markup("")
    for name, file in study.figures.items():
        factor = factor_name(study.factor(name.removeprefix("scope_")))
        shown = f"Number of cells of all robots in which each detector works while {factor} varies"
        figures += embed_figure(file, shown, f"{factor}: cells that meet the requirement.")
    return figures
