"""Tables that the charts of a closed loop draw, and the words for what a reader chooses."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from wearscope.reporting.charts.base import Choice
from wearscope.reporting.closed_loop import STAGES, ClosedLoop, against_signal, dominant_signals, number
from wearscope.reporting.closed_loop import signal_label as label_signal
from wearscope.reporting.labels import words

#: Rows that all joints and runs share in the charts over time, and points of a chart over a signal.
MOST_ROWS, MOST_POINTS = 40_000, 600
#: What a residual can be drawn over, in addition to what it depends on most.
OWN = {
    "qd": "its own speed",
    "q": "its own position",
    "qdd": "its own acceleration",
    "load": "its own rigid-body torque",
    "temp": "its temperature",
    "t": "time in the run",
}
RANKS = ("what it depends on most", "the second such signal", "the third such signal")


def loop_filters(loop: ClosedLoop) -> list[Choice]:
    """What a reader may filter all charts by: joint and run."""
    runs = list(dict.fromkeys(loop.residual["run"]))
    uses = dict(zip(loop.residual["run"], loop.residual["use"], strict=True))
    return [
        Choice("joint", "Joint", [(name, name) for name in loop.joints]),
        Choice("run", "Run", [(name, f"{short_run(name)} ({uses[name]})") for name in runs]),
    ]


def short_run(name: str) -> str:
    """A run's file without its folder and ending."""
    return name.rsplit("/", 1)[-1].rsplit(".", 1)[0]


def signals_of(loop: ClosedLoop, joint: str) -> dict[str, str]:
    """Signal by choice: what the joint's residual depends on most, then its own signals."""
    ranked = dict(zip(map(str, range(len(RANKS))), dominant_signals(loop, joint), strict=False))
    own = {code: "t" if code == "t" else f"{code}_{joint}" for code in OWN}
    return ranked | own


def signal_choices(loop: ClosedLoop) -> list[tuple[str, str]]:
    """What a reader may draw a residual over."""
    ranked = [(str(k), text) for k, text in enumerate(RANKS)]
    own = list(OWN.items()) if loop.signals is not None else [("t", OWN["t"])]
    return [*(ranked if loop.signals is not None else []), *own]


def loop_labels(loop: ClosedLoop) -> dict[str, Mapping[str, str]]:
    """Text of every choice's value, and of the tables' columns."""
    units = {joint: loop.verdict["joints"][joint]["unit"] for joint in loop.joints}
    against = {
        f"{joint}|{choice}": label_signal(loop, signal)
        for joint in loop.joints
        for choice, signal in signals_of(loop, joint).items()
    }
    return {
        "joint.unit": units,
        "run": {name: short_run(name) for name in loop.residual["run"].unique()},
        "joint+choice": against,
        "column": {"t": "time [s]", "x": "signal", "cv_gain": "gain [%]"},
    }


def loop_tables(loop: ClosedLoop) -> dict[str, pd.DataFrame]:
    """What the charts draw, by name; only what the loop has."""
    found = {"errors": error_table(loop), "series": series_table(loop), "against": against_table(loop)}
    if loop.profiles is not None:
        found["profiles"] = profile_table(loop)
    if len(loop.candidates):
        found["candidates"] = candidate_table(loop.candidates)
    if loop.forward_series is not None and len(loop.forward_series):
        found["forward"] = forward_table(loop)
    return found


def error_table(loop: ClosedLoop) -> pd.DataFrame:
    """RMS errors on the test runs: ``joint``, ``kind``, ``value``, ``low``, ``high``, ``unit``."""
    records = []
    for joint, one in loop.verdict["joints"].items():
        known = {"joint": joint, "unit": one["unit"]}
        for stage in STAGES:
            low, high = (number(value) for value in one.get(f"rms_{stage}_ci95") or (None, None))
            value = number(one.get(f"rms_{stage}"))
            records.append(known | {"kind": stage, "value": value, "low": low, "high": high})
        for kind, field in (("as declared", "rms_as_declared"), ("noise floor", "noise_floor")):
            records.append(known | {"kind": kind, "value": number(one.get(field))})
    table = pd.DataFrame(records)
    return table[np.isfinite(table["value"])].reset_index(drop=True)


def thin_runs(table: pd.DataFrame, most: int = MOST_ROWS) -> pd.DataFrame:
    """Every so many rows of each joint and run, evenly, so that all together are at most about `most`."""
    each = max(50, most // max(1, len(table[["joint", "run"]].drop_duplicates())))
    place = table.groupby(["joint", "run"], sort=False).cumcount()
    size = table.groupby(["joint", "run"], sort=False)["t"].transform("size")
    return table[(place % np.maximum(1, -(-size // each))) == 0]


def series_table(loop: ClosedLoop) -> pd.DataFrame:
    """Torque and residual over time; NaN where a row does not count. Runs are thinned evenly."""
    wanted = ["measured", "predicted_before", "predicted_after", "residual_before", "residual_after"]
    columns = [name for name in wanted if name in loop.residual]
    rows = thin_runs(loop.residual)
    table = rows[["joint", "run", "t"]].copy()
    counts = rows["counts"].astype(bool)
    for name in columns:
        table[name] = rows[name].where(counts) if name.startswith("residual") else rows[name]
    return table


def against_table(loop: ClosedLoop) -> pd.DataFrame:
    """Residuals over the signals that a reader may choose: ``joint``, ``choice``, ``x``, before, after."""
    parts = []
    for joint in loop.joints:
        for choice, signal in signals_of(loop, joint).items():
            if signal != "t" and loop.signals is None:
                continue
            rows = against_signal(loop, joint, signal)
            rows = rows.iloc[:: max(1, -(-len(rows) // MOST_POINTS))]
            columns = ["run", "x", "residual_before", "residual_after"]
            parts.append(rows[columns].assign(joint=joint, choice=choice))
    return pd.concat(parts, ignore_index=True)


def profile_table(loop: ClosedLoop) -> pd.DataFrame:
    """Medians and quartiles in bins, by ``joint`` and ``choice``."""
    assert loop.profiles is not None
    parts = []
    for joint in loop.joints:
        own = loop.profiles[loop.profiles["joint"] == joint]
        for choice, signal in signals_of(loop, joint).items():
            parts.append(own[own["signal"] == signal].assign(choice=choice))
    return pd.concat(parts, ignore_index=True).drop(columns="signal")


def rank_candidates(rows: pd.DataFrame) -> pd.DataFrame:
    """Best variant of every effect at every joint, the best ones first, what was taken always among them."""
    ordered = rows.sort_values(["taken", "cv_gain", "joint", "effect"], ascending=[False, False, True, True])
    best = ordered.drop_duplicates(["joint", "effect"])
    best = best.sort_values(["cv_gain", "joint", "effect"], ascending=[False, True, True])
    best = pd.concat([best[best["taken"]], best[~best["taken"]]])
    return best.assign(label=best["joint"] + ": " + best["effect"].map(words))


def candidate_table(candidates: pd.DataFrame, most: int = 16) -> pd.DataFrame:
    """The best candidates of every step: ``step``, ``label``, ``gain`` [%], ``taken``, ``reason``."""
    parts = []
    for step, rows in candidates.groupby("step", sort=True):
        best = rank_candidates(rows).head(most)
        parts.append(
            pd.DataFrame(
                {
                    "step": int(step),
                    "label": best["label"],
                    "joint": best["joint"],
                    "gain": 100.0 * best["cv_gain"],
                    "taken": np.where(best["taken"], "taken", "left"),
                    "reason": best["reason"],
                    "p_value": best["p_value"],
                }
            )
        )
    return pd.concat(parts, ignore_index=True)


def forward_table(loop: ClosedLoop) -> pd.DataFrame:
    """Torque of both models simulated forward less the measured one; NaN where it does not count."""
    series = loop.forward_series
    assert series is not None
    rows = thin_runs(series)
    counts = rows["counts"].astype(bool)
    table = rows[["joint", "run", "t"]].copy()
    for stage in STAGES:
        table[stage] = (rows[f"simulated_{stage}"] - rows["measured"]).where(counts)
    return table
