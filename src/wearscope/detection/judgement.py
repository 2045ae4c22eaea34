"""Tables of a detection: thresholds by joint and detector, judged recordings, simulated runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from wearscope.detection.run import COMPARED, JUDGED, NOMINAL, OK, UNWORN, WORN, Asked, Setting, Tested
from wearscope.detection.thresholds import (
    Cell,
    Scatter,
    WearScale,
    compare_scatter,
    find_detected_wear,
    find_p_value,
    find_threshold,
    least_runs,
    measure_distances,
    widen,
)
from wearscope.storage import tables

#: Verdicts on a recording.
ALARM, QUIET, UNCHECKED, WITHHELD, FAILED = "alarm", "no alarm", "unchecked", "withheld", "failed"
TABLES = ("detection", "thresholds", "simulated")


@dataclass(frozen=True)
class Detection:
    """Result of a detection.

    Attributes
    ----------
    detection : DataFrame
        One row per recording, joint and detector: `motion`, `joint`, `fda`, `run`, `session`, `kind`
        (``nominal`` or ``judged``), `y`, `unit`, `status`, `threshold`, `p_value` (share of the widened
        simulated runs without wear whose y is at least as large), `p_machine` (the same share of the nominal
        recordings), `verdict`, and `wear` with `wear_low`, `wear_high` (95 %): the wear that y indicates.
        Verdicts: ``alarm``; ``no alarm``; ``unchecked``, above the threshold, but too few nominal sessions
        show the machine's scatter; ``withheld``, where there is no threshold; ``failed``.
    thresholds : DataFrame
        One row per motion, joint and detector: `unit`, `threshold`, `p_f`, `p_f_low`, `p_f_high` (95 %
        interval of the threshold's false-alarm rate on simulated runs), `runs`, `wear_detected` (smallest
        wear from which on a share p_d is detected), `nominal_runs`, `nominal_above`, `scatter_ratio` (of the
        machine's nominal values to the simulated ones, over all motions), `widening` (of the simulated
        values, for the threshold; NaN where too few sessions are nominal), `reason` (why there is no
        threshold; else empty).
    simulated : DataFrame
        One row per simulated run, joint and detector: `kind` (``simulated``, ``simulated_worn``,
        ``compared``), `run`, `wear`, `temperature_change` [K], `payload_error` [%], `y`, `status`.
    summary : dict
        The content of ``detection.json``.
    """

    detection: pd.DataFrame
    thresholds: pd.DataFrame
    simulated: pd.DataFrame
    summary: dict[str, Any]

    def write(self, folder: str | Path) -> None:
        """Write the tables, and ``detection.json`` last."""
        out = Path(folder)
        pure = ("wear", "wear_low", "wear_high", "wear_detected", "p_value", "p_f", "scatter_ratio")
        units = {
            **dict.fromkeys(pure, "1"),
            **dict.fromkeys(("temperature_change", "warmer"), "K"),
            "payload_error": "%",
            **dict.fromkeys(("y", "threshold"), "as the column unit says"),
        }
        for name in TABLES:
            table = getattr(self, name)
            known = {column: unit for column, unit in units.items() if column in table}
            tables.write_table(out / f"{name}.parquet", table, known)
        tables.write_json(out / "detection.json", self.summary)


def judge_recordings(tested: Tested, setting: Setting) -> Detection:
    """Verdict on every test quantity, with thresholds and the wear that values indicate."""
    values = _collect(tested.asked)
    scatters = {cell: _find_scatter(cell, values, setting.p_f) for _, cell in values}
    thresholds, readings = [], {}
    for (motion, cell), kinds in values.items():
        row, readings[motion, cell] = _judge_cell(motion, cell, kinds, scatters[cell], tested, setting)
        thresholds.append(row)
    table = pd.DataFrame(thresholds)
    detection = _tabulate_measured(tested, table, readings)
    return Detection(detection, table, _tabulate_simulated(tested), _summarise(tested, setting, detection))


def _collect(asked: list[Asked]) -> dict[tuple[str, Cell], dict[str, list[tuple[float, Asked]]]]:
    """Finite test quantities by motion and cell, then by kind; cells without any are included."""
    values: dict[tuple[str, Cell], dict[str, list[tuple[float, Asked]]]] = {}
    for one in asked:
        for cell, (y, status) in one.answers.items():
            kinds = values.setdefault((one.motion, cell), {})
            found = kinds.setdefault(one.kind, [])
            if status == OK:
                found.append((y, one))
    return values


def _column(kinds: Mapping[str, list[tuple[float, Asked]]], kind: str) -> np.ndarray:
    return np.array([y for y, _ in kinds.get(kind, [])])


def _find_scatter(cell: Cell, values: Mapping[tuple[str, Cell], Mapping[str, Any]], p_f: float) -> Scatter:
    """Scatter of the nominal values of a joint and detector over all motions, against simulated ones."""
    of_cell = [kinds for (_, own), kinds in values.items() if own == cell]
    nominal = [each for kinds in of_cell for each in kinds.get(NOMINAL, [])]
    distances = [
        measure_distances(_column(kinds, NOMINAL), _column(kinds, COMPARED if COMPARED in kinds else UNWORN))
        for kinds in of_cell
    ]
    return compare_scatter(np.concatenate(distances), count_sessions(nominal), p_f)


def _judge_cell(
    motion: str,
    cell: Cell,
    kinds: Mapping[str, list[tuple[float, Asked]]],
    scatter: Scatter,
    tested: Tested,
    setting: Setting,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Row of a cell, and what its values are compared with: `unworn`, `nominal` and, with wear, `scale`."""
    joint, fda = cell
    j = tested.prepared.dataset.joints.index(joint)
    unworn, nominal = _column(kinds, UNWORN), _column(kinds, NOMINAL)
    row: dict[str, Any] = {
        "motion": motion, "joint": joint, "fda": fda, "unit": tested.units.get(cell, ""),
        "threshold": np.nan, "p_f": setting.p_f, "p_f_low": np.nan, "p_f_high": np.nan, "runs": len(unworn),
        "wear_detected": np.nan, "nominal_runs": len(nominal), "nominal_above": 0,
        "scatter_ratio": np.nan, "widening": np.nan, "reason": "",
    }  # fmt: skip
    reading: dict[str, Any] = {"unworn": unworn, "nominal": nominal}
    if len(unworn) < least_runs(setting.p_f):
        row["reason"] = _say_failure(motion, cell, tested.asked)
        return row, reading
    unworn = reading["unworn"] = widen(unworn, np.median(unworn), scatter.widening)
    threshold = find_threshold(unworn, setting.p_f)
    row |= {
        "threshold": threshold.value,
        "p_f_low": threshold.rate_low,
        "p_f_high": threshold.rate_high,
        "nominal_above": int(np.sum(nominal >= threshold.value)),
        "scatter_ratio": scatter.ratio,
        "widening": scatter.widening,
    }
    worn = kinds.get(WORN, [])
    if len(worn) > 10:
        wear = np.array([one.draw.wear[j] for _, one in worn if one.draw is not None])
        y = _column(kinds, WORN)
        every = np.concatenate([np.zeros(len(unworn)), wear]), np.concatenate([_column(kinds, UNWORN), y])
        scale = reading["scale"] = WearScale(*every, np.nan_to_num(scatter.widening, nan=1.0))
        y = widen(y, np.interp(wear, scale.grid, scale.mean), scatter.widening)
        row["wear_detected"] = find_detected_wear(wear, y, threshold.value, setting.p_d)
    return row, reading


def count_sessions(nominal: Sequence[tuple[float, Asked]]) -> int:
    """Number of independent nominal values: of sessions where several are named, else of recordings."""
    sessions = {one.session for _, one in nominal if one.session is not None}
    return len(sessions) if len(sessions) > 1 else len(nominal)


def _say_failure(motion: str, cell: Cell, asked: list[Asked]) -> str:
    """Why a cell has too few simulated test quantities: the first failure's reason."""
    for one in asked:
        if one.motion == motion and one.kind == UNWORN and one.answers[cell][1] != OK:
            return one.answers[cell][1]
    return "too few simulated runs"


def _tabulate_measured(
    tested: Tested, thresholds: pd.DataFrame, readings: dict[tuple[str, Cell], dict[str, Any]]
) -> pd.DataFrame:
    cells = {(row["motion"], (row["joint"], row["fda"])): row for row in thresholds.to_dict("records")}
    records = []
    warmer = _compare_temperatures(tested)
    for one in tested.asked:
        if one.kind not in (NOMINAL, JUDGED):
            continue
        for cell, (y, status) in one.answers.items():
            row, reading = cells[one.motion, cell], readings[one.motion, cell]
            known = status == OK
            wear = (np.nan, np.nan, np.nan)
            if known and "scale" in reading:
                wear = reading["scale"].read(y)
            bounded = np.isfinite(row["threshold"])
            records.append(
                {
                    "motion": one.motion,
                    "joint": cell[0],
                    "fda": cell[1],
                    "run": one.run,
                    "session": one.session or "",
                    "kind": one.kind,
                    "y": y,
                    "unit": row["unit"],
                    "status": status,
                    "threshold": row["threshold"],
                    "p_value": (find_p_value(y, reading["unworn"]) if known and bounded else np.nan),
                    "p_machine": (
                        find_p_value(y, reading["nominal"]) if known and one.kind == JUDGED else np.nan
                    ),
                    "verdict": _find_verdict(y, status, row),
                    "wear": wear[0],
                    "wear_low": wear[1],
                    "wear_high": wear[2],
                    "warmer": warmer.get((one.run, cell[0]), np.nan),
                }
            )
    return pd.DataFrame(records)


def _compare_temperatures(tested: Tested) -> dict[tuple[str, str], float]:
    """Mean temperature less that of the nominal recordings [K], by recording and joint."""
    joints = tested.prepared.dataset.joints
    found: dict[tuple[str, str], float] = {}
    for group in tested.groups:
        usual = np.mean([one.temperature for one in group.nominal], axis=0)
        for one in (*group.nominal, *group.judged):
            found |= {
                (one.file, joint): float(x) for joint, x in zip(joints, one.temperature - usual, strict=True)
            }
    return found


def _find_verdict(y: float, status: str, row: dict[str, Any]) -> str:
    """Verdict on a value; the words are explained at `Detection.detection`."""
    if status != OK:
        return FAILED
    if not np.isfinite(row["threshold"]):
        return WITHHELD
    if y < row["threshold"]:
        return QUIET
    return UNCHECKED if np.isnan(row["widening"]) else ALARM


def _tabulate_simulated(tested: Tested) -> pd.DataFrame:
    joints = tested.prepared.dataset.joints
    return pd.DataFrame(
        [
            {
                "motion": one.motion,
                "joint": joint,
                "fda": fda,
                "kind": one.kind,
                "run": int(one.run),
                "wear": float(one.draw.wear[joints.index(joint)]),
                "temperature_change": one.draw.warmth,
                "payload_error": 100.0 * one.draw.payload_error,
                "y": y,
                "status": status,
            }
            for one in tested.asked
            if one.draw is not None
            for (joint, fda), (y, status) in one.answers.items()
        ]
    )


def _summarise(tested: Tested, setting: Setting, detection: pd.DataFrame) -> dict[str, Any]:
    judged = detection[detection["kind"] == JUDGED]
    verdicts = [
        {
            "run": run,
            "session": rows["session"].iloc[0] or None,
            "motion": rows["motion"].iloc[0],
            "events": [event for event in tested.events if event["run"] == run],
            "alarms": [
                {
                    "joint": row.joint,
                    "fda": row.fda,
                    "y": row.y,
                    "threshold": row.threshold,
                    "unit": row.unit,
                    "wear95": None if np.isnan(row.wear_low) else [row.wear_low, row.wear_high],
                }
                for row in rows[rows["verdict"] == ALARM].itertuples()
            ],
            **{
                word: [
                    {"joint": row.joint, "fda": row.fda} for row in rows[rows["verdict"] == word].itertuples()
                ]
                for word in (UNCHECKED, WITHHELD, FAILED)
            },
        }
        for run, rows in judged.groupby("run", sort=False)
    ]
    decided = judged[judged["verdict"].isin([ALARM, QUIET])]
    used = set(decided["run"])
    lengths = [
        float(one.batch.t[-1] - one.batch.t[0])
        for group in tested.groups
        for one in group.judged
        if one.file in used
    ]
    return {
        "judged": {
            "joints": int(decided["joint"].nunique()),
            "of": tested.prepared.n,
            "seconds": sum(lengths),
            "refused": [one.reason for one in tested.refused],
        },
        "dataset": tested.prepared.dataset.name,
        "dataset_digest": tested.prepared.dataset.digest,
        "model": tested.model,
        "joints": tested.joints,
        "detectors": tested.detectors,
        "setting": {
            "p_f": setting.p_f, "p_d": setting.p_d, "runs": setting.runs, "worn_runs": setting.worn_runs,
            "sigma": setting.sigma, "nominal": setting.nominal, "seed": setting.seed,
        },
        "motions": {
            group.name: {
                "nominal": [one.file for one in group.nominal],
                "judged": [one.file for one in group.judged],
                "seconds": float(group.nominal[0].batch.t[-1] - group.nominal[0].batch.t[0]),
                "factors_that_move_nothing": tested.idle[group.name],
            }
            for group in tested.groups
        },
        "torque_noise_from": tested.noise_from,
        "refused": [{"run": one.file, "reason": one.reason} for one in tested.refused],
        "runs": verdicts,
    }  # fmt: skip
