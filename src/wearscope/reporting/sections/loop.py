"""The parts of a closed loop's page after its outcome, one class each: charts, tables and what they mean."""

from typing import Any

import numpy as np
from markupsafe import Markup

from wearscope.reporting.charts.loop import (
    chart_against,
    chart_candidates,
    chart_errors,
    chart_forward,
    chart_residual,
    chart_torque,
)
from wearscope.reporting.closed_loop import STAGES, bounded, number
from wearscope.reporting.labels import count_text, join_words, words
from wearscope.reporting.page import badge, render_part, render_table
from wearscope.reporting.sections.base import JOINT, LoopSection, embed_charts

#: Longest list that is shown unfolded.
MOST_SHOWN = 12


class Errors(LoopSection):
    """Errors on the test runs."""

    title, anchor = "Errors on the test runs", "errors"

    def context(self) -> dict[str, Any]:
        """Chart and tables."""
        records, relative = [], []
        for joint, one in self.verdict["joints"].items():
            record = {"joint": joint, "unit": one["unit"], "as declared": number(one.get("rms_as_declared"))}
            for stage in STAGES:
                value = number(one.get(f"rms_{stage}"))
                record[f"{stage} (95 %)"] = bounded(value, one.get(f"rms_{stage}_ci95"))
            records.append(record | {"noise floor": number(one.get("noise_floor"))})
            for run, values in one.get("relative_error_percent", {}).items():
                before, after = map(number, values)
                row = {"joint": joint, "test run": run, "before [%]": before, "after [%]": after}
                relative.append(row | {"error": _compare(before, after)})
        note = "100 |residual| / |torque| over the rows that count."
        rest = render_table(relative, note, filter_by=JOINT | {"test run": "run"})
        return {
            "parts": [embed_charts([chart_errors(self.loop)]), render_table(records, filter_by=JOINT)],
            "folded": [("Relative error of every test run", len(relative) <= MOST_SHOWN, rest)],
        }


def _compare(before: float, after: float) -> Markup:
    if not np.isfinite([before, after]).all() or abs(after - before) < 1e-9 * max(before, 1.0):
        return badge("same")
    return badge("smaller", "good") if after < before else badge("larger", "bad")


class Residual(LoopSection):
    """Torque and residual over time and signals."""

    title, anchor = "Residual", "residual"

    def context(self) -> dict[str, Any]:
        """Charts."""
        loop, joint = self.loop, self.loop.foremost()
        runs = loop.residual.loc[loop.residual["use"] == "test", "run"]
        run = str(runs.iloc[0]) if len(runs) else ""
        charts = [
            chart_torque(loop, joint, run),
            chart_residual(loop, joint, run),
            chart_against(loop, joint),
        ]
        return {"parts": [embed_charts(charts)]}


class Candidates(LoopSection):
    """Ranking of the candidates at every step, and what was made of each."""

    title, anchor = "Candidates", "candidates"

    def context(self) -> dict[str, Any]:
        """Chart and steps."""
        chart = chart_candidates(self.loop)
        if chart is None:
            return {"notes": ["There was no candidate to try."]}
        text = (
            "Every candidate is fitted with all parameters of the model, and scored on training runs that "
            "its fit did not see. One is taken if it gains enough, is significant with all candidates "
            "counted, and the runs agree. A later step may drop or rename it. candidates.parquet has all."
        )
        return {"notes": [text], "parts": [embed_charts([chart])]}


class Forward(LoopSection):
    """Both models simulated forward, and the measurement."""

    title, anchor = "Simulated forward", "forward"

    def context(self) -> dict[str, Any]:
        """Failed simulations, errors, chart."""
        table = self.loop.forward
        if table is None:
            return {}
        failed = table[(table["run"] != "all") & (table["outcome"] != "ok")]
        told = failed[["run", "stage", "outcome"]].drop_duplicates().itertuples(index=False)
        rows = table[table["run"] == "all"].set_index(["joint", "stage"])
        records = []
        for joint in self.loop.joints:
            unit = self.verdict["joints"][joint]["unit"]
            record = {"joint": joint, "unit": unit}
            for kind, scale in (("torque", 1.0), ("motion", 1e3)):
                for stage in STAGES:
                    low, value, high = (
                        scale * rows.loc[(joint, stage), f"{kind}_rms{end}"] for end in ("_low", "", "_high")
                    )
                    record[f"{kind} {stage}"] = bounded(value, [low, high])
            records.append(record | {"motion in": "mm" if unit == "N" else "mrad"})
        text = (
            "Both models follow the measured motion of the test runs in PyBullet under the same controller. "
            "Torque: the controller feeds forward what the model before needs, so the measured torque has no "
            "part in it. Motion: it feeds forward the torque that was measured, and a model that is right "
            "stays on the measured motion."
        )
        note = "RMS error against the measurement on the test runs (95 %)."
        chart = embed_charts([chart_forward(self.loop, self.loop.foremost())])
        return {
            "told": [("alarm", f"{run}, model {stage}: {outcome}") for run, stage, outcome in told],
            "notes": [text],
            "parts": [render_table(records, note, filter_by=JOINT), chart],
        }


class Undetermined(LoopSection):
    """What the runs could not tell, and motions that would."""

    title, anchor = "What these runs cannot tell", "undetermined"

    def context(self) -> dict[str, Any]:
        """Two tables."""
        undetermined, advice = (self.verdict.get(key) or [] for key in ("undetermined", "advice"))
        grouped: dict[tuple[str, str, str], list[str]] = {}
        for one in undetermined:
            grouped.setdefault((one["effect"], one["reason"], one["motion"]), []).append(one["joint"])
        rows = [
            {"joints": self._where(joints), "effect": words(effect), "why not": reason, "would help": motion}
            for (effect, reason, motion), joints in grouped.items()
        ]
        motions = [{"motion": one["motion"], "separates": self._shorten(one["separates"])} for one in advice]
        told = ((rows, "What could not be tested."), (motions, "Motions that would separate effects."))
        parts = [render_table(table, text) for table, text in told if table]
        return {"parts": parts} if parts else {}

    def _where(self, joints: list[str]) -> str:
        every = len(joints) > 1 and set(joints) >= set(self.loop.joints)
        return "all joints" if every else join_words(joints)

    def _shorten(self, pairs: list[str]) -> str:
        """Pairs with the joints they are at, the first ones where there are many."""
        found: dict[str, list[str]] = {}
        for pair in pairs:
            joint, _, names = pair.partition(": ")
            found.setdefault(words(names).replace(" / ", " from "), []).append(joint)
        said = [f"{names} ({self._where(joints)})" for names, joints in found.items()]
        more = [f"{len(said) - MOST_SHOWN} more"] if len(said) > MOST_SHOWN else []
        return "; ".join([*said[:MOST_SHOWN], *more])


class Notes(LoopSection):
    """What a reader should know of the data."""

    title, anchor = "Notes", "notes"

    def context(self) -> dict[str, Any]:
        """Notes of the verdict, rows that do not count."""
        counted = self.loop.residual.groupby(["run", "joint"], sort=False)["counts"].mean()
        left_out = [
            f"{run}: {100 * (1 - share):.0f} % of the rows of {joint} do not count (at rest, at the torque "
            "limit, or no measurement)."
            for (run, joint), share in counted.items()
            if share < 0.8
        ]
        notes = self.verdict.get("notes", [])
        folded = []
        if left_out:
            how_many = count_text(len(left_out), "run and joint", "runs and joints")
            summary = f"Rows that do not count: {how_many} with more than a fifth"
            folded = [(summary, False, render_part(listed=left_out))]
        return {"listed": notes, "notes": [] if notes else ["None."], "folded": folded}
