"""What a reader in a hurry reads: the conclusion, doubts, the three answers, the robots side by side."""

from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup

from wearscope.evaluation.conclusion import Conclusion
from wearscope.reporting import answers, trust
from wearscope.reporting.conclusion import friction_rise, qualify, thresholds_of
from wearscope.reporting.labels import factor_name, quantity_text, unit_text
from wearscope.reporting.page import format_number, interval_text, render_table
from wearscope.reporting.sections.base import StudySection, say

#: Sentences of a card; the sections have all of them.
MOST = 2


class Summary(StudySection):
    """The conclusion first, then the answers to the three questions."""

    title, anchor, template = "Conclusion", "summary", "study/summary.html"

    def context(self) -> dict[str, Any]:
        """Conclusion, alarms, cards, robots."""
        study = self.study
        first = study.conclusions[0] if study.conclusions else None
        cards = [
            ("Which factors matter?", answers.relevant_factors(study), "q1", "Every factor and cell"),
            ("Which detector is best?", answers.best_detector(study), "q2", "Every cell"),
            ("Where does it work?", answers.effective_scope(study), "q3", "Scope, ROC, thresholds"),
            ("Can it be trusted?", self._trust(), "trust", "Fits, audit, assumptions"),
        ]
        alarms = [*trust.dropped_factors(study), *trust.doubts(study), *trust.failed_simulations(study)]
        failed = [] if study.failures.empty else say([trust.failed_points(study)])
        return {
            "qualifiers": [*(say(qualify(study, first)) if first else []), *trust.ask_moved(study), *failed],
            "alarms": say(alarms),
            "cards": [(title, say(said[:MOST]), link, more) for title, said, link, more in cards],
            "robots": self._robots(),
        }

    def _trust(self) -> list[str]:
        study = self.study
        audited = trust.audit_outcome(study) if study.audit is not None else []
        return [trust.surrogate_quality(study), *audited, *trust.direct_outcome(study)]

    def _robots(self) -> Markup:
        """Robots side by side; nothing where there is one."""
        rows = [self._row(one) for one in self.study.conclusions if one.robot]
        if not rows:
            return Markup("")
        note = (
            "Each robot by itself. Ranges hold 95 % of a factor that varies alone; ≥: the end of what was "
            "simulated. As friction: at a tenth of the joints' top speeds. Median SNR of the detector to "
            "use, with its 95 % interval."
        )
        return render_table(pd.DataFrame(rows), note, filter_by={"robot": "robot"})

    def _row(self, one: Conclusion) -> dict[str, Any]:
        study = self.study
        fault = study.factor("f")
        found = not np.isnan(one.wear)
        row: dict[str, Any] = {
            "robot": one.robot,
            "detector to use": study.detector_name(one.detector) if one.detector else "none",
            "finds wear from": quantity_text(one.wear, fault.unit) if found else "not found",
        }
        rise = friction_rise(study, one.wear, one.robot) if found else None
        row["as friction"] = f"+{100 * rise[0]:.2g} to {100 * rise[1]:.2g} %" if rise else "n/a"
        bounds = {bound.factor: bound for bound in one.bounds}
        for name in study.config["scope"]["factors"]:
            factor, bound = study.factor(name), bounds.get(name)
            size = f"±{quantity_text(1.96 * bound.sigma, factor.unit)}" if bound else "n/a"
            row[f"tolerates {factor_name(factor)}"] = f"≥ {size}" if bound and bound.largest else size
        values = thresholds_of(study, one)["threshold"].dropna()
        unit = unit_text(study.units.get(one.detector, ""))
        row["alarm threshold"] = (
            f"{format_number(values.min())} to {format_number(values.max())} {unit}".strip()
            if len(values)
            else "n/a"
        )
        row["median SNR"] = self._median(one)
        row["cells"] = f"{one.cells_sure} of {one.cells}"
        return row

    def _median(self, one: Conclusion) -> str:
        table = self.study.rankings
        if table is None:
            return "n/a"
        rows = table[(table["robot"] == one.robot) & (table["fda"] == one.detector)]
        if rows.empty:
            return "n/a"
        return interval_text(*rows[["median", "median_low", "median_high"]].iloc[0])
