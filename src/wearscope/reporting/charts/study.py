"""Tables that the charts of a study draw, and the words for what a reader chooses."""

from collections.abc import Mapping
from functools import cache

import numpy as np
import pandas as pd

from wearscope.reporting.charts.base import CELL_KEYS, Choice, round_digits
from wearscope.reporting.labels import (
    factor_label,
    factor_name,
    natural_step,
    term_factors,
    term_name,
    unit_text,
    with_unit,
    words,
)
from wearscope.reporting.study import Study

_KEYS = list(CELL_KEYS)
FILTER_LABELS = {"robot": "Robot", "cycle": "Test-cycle", "axis": "Axis", "fda": "Detector"}
ALL_ROBOTS = "all robots"


def study_filters(study: Study) -> list[Choice]:
    """What a reader may filter all charts by: robots, test-cycles, axes, detectors of the study."""
    values = {key: list(dict.fromkeys(study.snr[key])) for key in _KEYS}
    return [
        Choice(key, FILTER_LABELS[key], [(str(one), _text(study, key, one)) for one in sorted(values[key])])
        for key in _KEYS
    ]


def _text(study: Study, key: str, value: object) -> str:
    return study.detector_name(str(value)) if key == "fda" else words(value)


def study_labels(study: Study) -> dict[str, Mapping[str, str]]:
    """Text of every choice's value, and of the tables' columns."""
    cycles = {name: words(name) for name in study.snr["cycle"].unique()}
    units = {name: unit_text(study.units.get(name, "")) for name in study.snr["fda"].unique()}
    return {
        "factor": {one.name: factor_label(one) for one in study.factors},
        "factor.name": {one.name: factor_name(one) for one in study.factors},
        "cycle": cycles,
        "axis": {str(axis): f"axis {axis}" for axis in study.snr["axis"].unique()},
        "fda": {name: study.detector_name(name) for name in units},
        "fda.y": {
            name: with_unit(f"test quantity of {study.detector_name(name)}", unit)
            for name, unit in units.items()
        },
        "column": {
            "fda": "detector", "cycle": "test-cycle", "p_d": "detected", "p_f": "false alarms",
            "y_held": "y, others held",
            "natural": "level", "snr": "SNR", "sigma": "standard deviation", "change": "change of wear",
            "place": "cell",
        },
    }  # fmt: skip


def study_tables(study: Study) -> dict[str, pd.DataFrame]:
    """What the charts draw, by name; only what the study has."""
    found = {
        "snr": study.snr[[*_KEYS, "snr_exact", "snr_low", "snr_high", "status"]]
        .rename(columns={"snr_exact": "snr", "snr_low": "low", "snr_high": "high"})
        .assign(place=places(study.snr)),
        "weights": weight_table(study),
        "scope": scope_cells(study),
        "fits": fit_cells(study),
    }
    if study.rankings is not None:
        columns = ["robot", "fda", "median", "median_low", "median_high", "rank"]
        table = study.rankings[columns].replace({"robot": {"": together(study)}})
        found["rankings"] = table.rename(columns={"median_low": "low", "median_high": "high"})
    if study.responses is not None and study.simulated is not None:
        found["responses"] = study.responses[[*_KEYS, "factor", "natural", "y", "low", "high"]]
        found["simulated"] = study.simulated[[*_KEYS, "factor", "set", "natural", "y", "y_held"]]
    if study.detection is not None:
        found["detection"] = detection_cells(study)
    if study.friction is not None:
        found["friction"] = study.friction[["robot", "joint", "speed", "temperature", "wear", "torque"]]
    if study.postures is not None:
        found["postures"] = study.postures
    return found


def together(study: Study) -> str:
    """What all robots together are called: by its name where there is one."""
    robots = list(study.snr["robot"].unique())
    return str(robots[0]) if len(robots) == 1 else ALL_ROBOTS


def places(table: pd.DataFrame) -> list[str]:
    """Where each row's cell is, without its detector: test-cycle, axis, and robot where there are several."""
    several = table["robot"].nunique() > 1
    cells = zip(*[table[key].tolist() for key in ("robot", "cycle", "axis")], strict=True)
    name = cache(lambda robot, cycle, axis: f"{words(cycle)} {axis}" + (f", {robot}" if several else ""))
    return [name(*cell) for cell in cells]


def weight_table(study: Study) -> pd.DataFrame:
    """Every cell's normalised coefficients (8) of the model that Q-1 asks, terms in words.

    Columns: the keys, ``term``, ``kind`` (direct, interaction, square), ``weight``.
    """
    model = study.config["sensitivity"]["model"]
    rows = study.surrogates[(study.surrogates["model"] == model) & ~study.surrogates["term"].isin(["1", "f"])]
    if study.screening is not None:
        idle = study.screening[study.screening["dropped"]]
        gone = set(zip(idle["robot"], idle["factor"], strict=True))
        pairs = zip(rows["robot"], rows["term"], strict=True)
        rows = rows[[not any((robot, one) in gone for one in term_factors(term)) for robot, term in pairs]]
    kinds = np.select(
        [rows["term"].str.contains(":"), rows["term"].str.contains("^", regex=False)],
        ["interaction", "square"],
        "direct",
    )
    table = rows[_KEYS].assign(
        term=[term_name(term, study.factors) for term in rows["term"]],
        kind=kinds,
        weight=rows["theta_normalised"].to_numpy(dtype=float),
    )
    return table.replace({"weight": {np.inf: np.nan, -np.inf: np.nan}})


def scope_cells(study: Study) -> pd.DataFrame:
    """Scope matrices in natural units.

    Columns: the keys, ``factor``, ``change`` (of wear), ``sigma`` (of the factor), ``p_d``, ``passes``,
    ``sure`` (with 95 % confidence; never where that was not asked), ``place`` (see `places`).
    """
    method = "exact" if (study.scope["method"] == "exact").any() else "kde"
    rows = study.scope[study.scope["method"] == method]
    steps = {one.name: natural_step(one) for one in study.factors}
    return rows[[*_KEYS, "factor"]].assign(
        change=rows["delta"] * steps["f"],
        sigma=rows["sigma"] * rows["factor"].map(steps),
        p_d=np.floor(1e4 * rows["p_d"].to_numpy()) / 1e4,
        passes=rows["passes"].to_numpy(),
        sure=(rows["confidence"] >= 0.95).to_numpy(),
        place=places(rows),
    )


def detection_cells(study: Study) -> pd.DataFrame:
    """ROC of every cell in natural units: ``change``, ``sigma``, ``p_f``, ``threshold``, ``p_d``."""
    rows = study.detection
    assert rows is not None
    steps = {one.name: natural_step(one) for one in study.factors}
    return rows[[*_KEYS, "factor"]].assign(
        change=round_digits((rows["delta"] * steps["f"]).to_numpy()),
        sigma=round_digits((rows["sigma"] * rows["factor"].map(steps)).to_numpy()),
        p_f=rows["p_f"],
        p_d=rows["p_d"],
        threshold=rows["threshold"],
        place=places(rows),
    )


def fit_cells(study: Study) -> pd.DataFrame:
    """Fit of the surrogate that is asked, by cell: ``fit`` [%], and what a perfect one would have."""
    model = study.config["scope"]["model"]
    if model == "chosen" and study.chosen is not None:
        return study.chosen[[*_KEYS, "fit", "ceiling", "kind"]].assign(
            kind=study.chosen["kind"].map(words).to_numpy()
        )
    rows = study.validation[study.validation["model"] == model]
    return rows[[*_KEYS, "fit"]].assign(ceiling=np.nan, kind=f"{model} quadratic")
