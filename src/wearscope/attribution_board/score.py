"""Scores one verdict against the sealed truth: a row by planted effect (one row for a null)."""

import json
import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from wearscope.attribution_board.features import smooth
from wearscope.errors import InputError
from wearscope.tables import read_table

Array = NDArray[np.float64]

SHARED_PARAMETERS: dict[str, dict[str, tuple[str, ...]]] = {
    "torque_offset": {"offset": ("offset", "torque_offset", "tau0")},
    "torque_constant_error": {"gain": ("gain", "torque_gain", "gain_error")},
    "time_delay": {"delay": ("delay", "time_delay")},
    "joint_spring": {"stiffness": ("stiffness", "k")},
    "joint_elasticity": {"stiffness": ("stiffness", "k"), "compliance": ("compliance",)},
    "rotor_inertia_error": {"inertia": ("inertia", "J", "rotor_inertia", "dJ")},
    "payload_error": {"mass": ("mass", "dm", "mass_error", "delta_mass")},
    "load_dependent_friction": {"coefficient": ("coefficient", "mu")},
    "quadratic_viscous": {"slope": ("slope", "curvature", "Fq")},
    "coulomb_asymmetry": {"half_difference": ("half_difference",)},
    "viscous_asymmetry": {"half_difference": ("half_difference",)},
    "coulomb": {"level": ("level", "Fc")},
    "viscous": {"slope": ("slope", "Fv")},
    "backlash": {"gap": ("gap",)},
    "torque_ripple": {"order": ("order", "wavenumber")},
    "presliding_hysteresis": {"level": ("level",)},
}
"""Planted parameter by effect, and the names under which a verdict may state the same quantity.

Conventions: recorded torque = (1 + gain) x true torque; a positive delay means that the torque channel lags
the positions; mass is true minus declared; half_difference is added forwards and taken away backwards.
"""

OUTCOMES = ("right", "equivalent", "none", "unknown", "wrong")


def read_verdict(path: str | Path) -> dict[str, Any]:
    """Read ``verdict.json``.

    Raises
    ------
    InputError
        Where the file is missing, is no JSON, or lacks ``verdict`` or ``joints``.
    """
    try:
        verdict = json.loads(Path(path).read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; close the loop on the data set first.") from error
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: no JSON (line {error.lineno}); close the loop again.") from error
    for key in ("verdict", "joints"):
        if key not in verdict:
            raise InputError(f"{path}: has no '{key}'; close the loop again.")
    return dict(verdict)


def _grade(entry: dict[str, Any], truth: dict[str, Any]) -> str | None:
    """How a verdict's entry meets a planted effect: right, equivalent, or not at all."""
    if entry["joint"] not in truth["joints"]:
        return None
    if not truth["outside"] and entry["effect"] in truth["accepted"]:
        return "right"
    if set(entry.get("equivalent") or []) & set(truth["accepted"]):
        return "equivalent"
    if entry["effect"] in truth["also_accepted"]:
        return "equivalent"
    return None


_SAME_UNITS = ({"", "1", "-"}, {"kgm^2", "Nms^2/rad"}, {"kg", "Ns^2/m"})


def _same_unit(a: str, b: str) -> bool:
    def plain(unit: str) -> str:
        return re.sub(r"[*·() ]", "", unit).replace("²", "^2")

    return plain(a) == plain(b) or any({plain(a), plain(b)} <= same for same in _SAME_UNITS)


def score_parameter(entry: dict[str, Any], truth: dict[str, Any]) -> dict[str, float]:
    """Relative error and coverage of the planted main parameter, NaN where the verdict does not state it.

    A verdict's parameter is compared only where its name is known for the same quantity and its unit agrees.
    """
    out = {"parameter_error": np.nan, "covered": np.nan}
    for own, aliases in SHARED_PARAMETERS.get(truth["effect"], {}).items():
        planted = truth["parameters"].get(own)
        if planted is None:
            continue
        value = planted.get("nearest", planted["value"])
        for name in aliases:
            stated = entry.get("parameters", {}).get(name)
            if stated is None or not _same_unit(stated.get("unit", ""), planted["unit"]):
                continue
            low, high = stated["ci95"]
            out["parameter_error"] = (stated["value"] - value) / abs(value)
            out["covered"] = float(low <= value <= high)
            return out
    return out


FILTER_REACH = 1.0
"""Half length [s] of the filters that can be read off a reader's measured torque."""


def _lagged(raw: Array, at: NDArray[np.int64], reach: int) -> Array:
    """Regressors of a symmetric filter: raw[at], then raw[at - k] + raw[at + k] for k up to `reach`."""
    return np.column_stack([raw[at]] + [raw[at - k] + raw[at + k] for k in range(1, reach + 1)])


def true_floor(residual: pd.DataFrame, truth: dict[str, Any], joint: str) -> dict[int, float]:
    """RMS of the true torque noise as the reader's filtering shows it, by test run (its number from 0).

    The reader's linear, zero-phase filter is read off from its measured torque on all runs, so that a reader
    who smooths its signals is held to the noise that its smoothing leaves. Empty where no such filter
    explains the reader's measured torque to a fifth of that noise.

    Parameters
    ----------
    residual : DataFrame
        ``residual.parquet``: columns `t`, `run`, `joint`, `measured`, and `counts` where not every row does.
    truth : dict
        With `signals`.
    joint : str
    """
    signals, rate = truth["signals"], truth["recipe"]["rate"]
    reach = round(FILTER_REACH * rate)
    runs, numbers = np.asarray(signals["run"]), residual["run"].astype(str)
    left, right, floor_rows = [], [], {}
    for number, plan in enumerate(truth["recipe"]["plans"]):
        rows = runs == number
        noise = np.asarray(signals[f"noise_{joint}"])[rows]
        raw = np.asarray(signals[f"clean_{joint}"])[rows] + noise
        named = numbers.str.contains(f"r{number + 1}(?:\\.|$)", regex=True)
        mine = residual[named & (residual["joint"] == joint)]
        if mine.empty:
            continue
        start = float(np.asarray(signals["t"])[rows][0])
        at = np.round((mine["t"].to_numpy() - start) * rate).astype(np.int64)
        keep = (at >= reach) & (at < len(raw) - reach)
        left.append(_lagged(raw, at[keep], reach))
        right.append(mine["measured"].to_numpy()[keep])
        if plan["use"] == "test":
            counted = keep & mine["counts"].to_numpy() if "counts" in mine else keep
            floor_rows[number] = _lagged(noise, at[counted], reach)
    if not left:
        return {}
    matrix, shown = np.vstack(left), np.concatenate(right)
    if len(shown) < 1.5 * matrix.shape[1]:
        return {}
    taps, *_ = np.linalg.lstsq(matrix, shown, rcond=1e-10)
    free = 1 - matrix.shape[1] / len(shown)
    miss = np.sqrt(np.mean((shown - matrix @ taps) ** 2) / free)
    floors = {n: float(np.sqrt(np.mean((x @ taps) ** 2))) for n, x in floor_rows.items() if len(x)}
    return floors if floors and miss < 0.2 * min(floors.values()) else {}


def _raw_floor(truth: dict[str, Any], joint: str) -> dict[int, float]:
    plans = truth["recipe"]["plans"]
    return {i: truth["noise_rms"][joint] for i, plan in enumerate(plans) if plan["use"] == "test"}


def smoothed_floor(truth: dict[str, Any], joint: str) -> dict[int, float]:
    """RMS of the true torque noise by test run as the baselines' own smoothing leaves it."""
    signals, rate = truth["signals"], truth["recipe"]["rate"]
    out = {}
    for number, plan in enumerate(truth["recipe"]["plans"]):
        if plan["use"] == "test":
            noise = np.asarray(signals[f"noise_{joint}"])[np.asarray(signals["run"]) == number]
            out[number] = float(np.sqrt(np.mean(smooth(noise[:, None], rate) ** 2)))
    return out


def score_gap(verdict: dict[str, Any], truth: dict[str, Any], joint: str, floors: dict[int, float]) -> float:
    """Share of the gap to the true noise floor that was closed on the joint's test runs.

    (before^2 - after^2) / (before^2 - floor^2), pooled over the test runs; NaN where the floor cannot be told
    or there was no gap to speak of (less than a tenth of the floor's variance).
    """
    stated = verdict["joints"].get(joint)
    if stated is None:
        return float("nan")
    before = after = floor = 0.0
    for file, (was, now) in stated["test_runs"].items():
        digits = "".join(c for c in Path(file).stem if c.isdigit())
        number = int(digits) - 1 if digits else -1
        if number not in floors:
            return float("nan")
        before, after, floor = before + was**2, after + now**2, floor + floors[number] ** 2
    gap = before - floor
    return float((before - after) / gap) if gap > 0.1 * floor and floor > 0 else float("nan")


def score_case(
    truth: dict[str, Any],
    verdict: dict[str, Any],
    method: str = "tracer",
    floor: Callable[[str], dict[int, float]] | None = None,
) -> list[dict[str, Any]]:
    """Rows of one case: one by planted effect, or one row for a null.

    Parameters
    ----------
    truth : dict
        As `generate.generate_dataset` returns it.
    verdict : dict
        The content of ``verdict.json``.
    method : str
        Whose verdict it is.
    floor : callable, optional
        Noise floor of a joint by test run (its number from 0); by default that of the unfiltered noise.

    Returns
    -------
    list of dict
        `outcome` is one of `OUTCOMES`; `correct` says whether it is the wanted one (for a null ``none``, for
        an outside effect ``unknown``); `first` whether nothing wrong was named before it; `extra_named`
        counts entries of the verdict that name an effect that nothing planted accounts for.
    """
    entries = list(verdict["verdict"])
    floor = floor or partial(_raw_floor, truth)
    planted = truth["planted"]
    kind = "null" if not planted else "pair" if len(planted) > 1 else "single"
    common: dict[str, Any] = {
        "method": method, "dataset": truth["dataset"], "robot": truth["robot"], "seed": truth["seed"],
        "noise": truth["noise"], "kind": kind,
    }  # fmt: skip
    grades = [[_grade(entry, plant) for entry in entries] for plant in planted]
    loose = [i for i in range(len(entries)) if all(g[i] is None for g in grades)]
    unknown_meant = [
        i
        for i in loose
        if entries[i]["effect"] == "unknown"
        and any(p["outside"] and entries[i]["joint"] in p["joints"] for p in planted)
    ]
    named_wrong = [i for i in loose if entries[i]["effect"] != "unknown"]
    unknowns = [i for i in loose if entries[i]["effect"] == "unknown"]
    common |= {"entries": len(entries), "extra_named": len(named_wrong)}
    common["extra_unknown"] = len(unknowns) - len(unknown_meant)
    if not planted:
        outcome = "wrong" if named_wrong else "unknown" if unknowns else "none"
        named = entries[named_wrong[0]]["effect"] if named_wrong else outcome
        return [_row(common, outcome, named, correct=outcome == "none", first=outcome == "none")]
    rows = []
    for plant, grade in zip(planted, grades, strict=True):
        matched = [i for i, g in enumerate(grade) if g == "right"] or [
            i for i, g in enumerate(grade) if g == "equivalent"
        ]
        details: dict[str, Any] = {
            "effect": plant["effect"], "joint": plant["joint"], "size": plant["size"],
            "unabsorbed_size": plant["unabsorbed_size"], "separable": plant["separable"],
            "outside": plant["outside"],
            "gap_closure": score_gap(verdict, truth, plant["joint"], floor(plant["joint"])),
        }  # fmt: skip
        if matched:
            entry, outcome = entries[matched[0]], str(grade[matched[0]])
            first = not any(i < matched[0] for i in named_wrong + unknowns)
            details |= score_parameter(entry, plant)
            rows.append(_row(common, outcome, entry["effect"], correct=True, first=first, **details))
            continue
        here = [i for i in named_wrong if entries[i]["joint"] in plant["joints"]] or named_wrong
        mine = [i for i in unknowns if entries[i]["joint"] in plant["joints"]]
        outcome = "wrong" if here else "unknown" if mine else "none"
        named = entries[here[0]]["effect"] if here else outcome
        correct = plant["outside"] and outcome == "unknown"
        rows.append(_row(common, outcome, named, correct=correct, first=correct, **details))
    return rows


def _row(
    common: dict[str, Any], outcome: str, named: str, correct: bool, first: bool, **details: Any
) -> dict[str, Any]:
    absent: dict[str, Any] = {
        "effect": "none", "joint": "", "size": np.nan, "unabsorbed_size": np.nan, "separable": False,
        "outside": False, "gap_closure": np.nan, "parameter_error": np.nan, "covered": np.nan,
    }  # fmt: skip
    return (
        common | absent | details | {"outcome": outcome, "named": named, "correct": correct, "first": first}
    )


def score_folder(truth: dict[str, Any], out_dir: str | Path, method: str = "tracer") -> list[dict[str, Any]]:
    """Score what closing the loop wrote into a folder (``verdict.json``, ``residual.parquet`` if there)."""
    verdict = read_verdict(Path(out_dir) / "verdict.json")
    path = Path(out_dir) / "residual.parquet"
    if not path.exists() or "signals" not in truth:
        return score_case(truth, verdict, method)
    residual = read_table(path)
    return score_case(truth, verdict, method, lambda joint: true_floor(residual, truth, joint))


def read_truth(path: str | Path) -> dict[str, Any]:
    """Read a truth that `generate.generate_dataset` sealed, with its signals where they lie beside it."""
    truth = json.loads(Path(path).read_text(encoding="utf-8"))
    signals = Path(path).with_suffix(".signals.parquet")
    if signals.exists():
        table = read_table(signals)
        truth["signals"] = {name: table[name].to_numpy() for name in table}
    return dict(truth)
