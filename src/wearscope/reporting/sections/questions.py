"""The three questions: which factors matter, which detector is best, where it works."""

from typing import Any

from markupsafe import Markup

from wearscope.evaluation.snr_sources import snr_sources
from wearscope.reporting import answers, trust
from wearscope.reporting.charts.detectors import chart_snr, chart_snr_cells
from wearscope.reporting.charts.factors import chart_response, chart_weights
from wearscope.reporting.charts.scope import chart_roc, chart_scope, detection_cases
from wearscope.reporting.conclusion import thresholds_of
from wearscope.reporting.labels import COLUMNS, MODEL_NAMES, count_text, unit_text, words
from wearscope.reporting.page import render_table
from wearscope.reporting.sections.base import StudySection, embed_charts, say


def _best(section: StudySection) -> str:
    """The detector shown first where a chart shows only one."""
    conclusions = section.study.conclusions
    return conclusions[0].detector if conclusions else ""


class Factors(StudySection):
    """Q-1."""

    title, anchor, template = "Which factors matter?", "q1", "study/factors.html"

    def context(self) -> dict[str, Any]:
        """Sentences, coefficients, responses."""
        study = self.study
        response = chart_response(study, _best(self)) if study.responses is not None else None
        return {
            "sentences": say(answers.relevant_factors(study)),
            "model": MODEL_NAMES[study.config["sensitivity"]["model"]],
            "charts": embed_charts([chart_weights(study), response]),
        }


class Detectors(StudySection):
    """Q-2."""

    title, anchor, template = "Which detector is best?", "q2", "study/detectors.html"

    def context(self) -> dict[str, Any]:
        """Sentences, setting, ranking, charts."""
        study = self.study
        setting = study.config["snr"]
        shown = study.ranking.drop(columns="interval_from", errors="ignore").rename(columns=COLUMNS)
        fault = study.factor("f")
        ends = (setting["f0"], setting["f0"] + setting["delta"])
        low, high = (float(fault.to_natural(one)) for one in ends)
        return {
            "sentences": say(answers.best_detector(study)),
            "setting": f"wear from {low:g} to {high:g}, every other factor with σ of {setting['sigma']:g} "
            "coded units",
            "ranking": render_table(shown, filter_by={"detector": "fda"} if "detector" in shown else None),
            "charts": embed_charts([chart_snr(study), chart_snr_cells(study)]),
            "sources": self._sources(),
        }

    def _sources(self) -> Markup:
        """The SNR by source; nothing where there is only one."""
        study = self.study
        table = snr_sources(study.snr, study.paper_snr, study.direct, study.mismatch)
        if len(table.columns) < 3:
            return Markup("")
        names = {
            "fda": "detector",
            "median": "median, chosen surrogate",
            "median_paper": "median, the paper's model (3)",
        }
        note = "Signal-to-noise ratio by its source."
        if study.direct is not None and len(study.direct):
            cell = study.direct.iloc[0]
            where = f"{cell['robot']}, {words(cell['cycle'])}, axis {cell['axis']}"
            names |= {
                "surrogate": "surrogate there",
                "direct": "simulated directly",
                "answer": "answer there",
            }
            note += (
                f" There: {where}. Where surrogate and direct simulation disagree, the direct value answers."
            )
            if "mismatch" in table:
                names["mismatch"] = "robot differs from model"
                note += f" The robot that differs from the detectors' model has {trust.tell_mismatch(study)}."
        shown = table.assign(fda=table["fda"].map(study.detector_name), key=table["fda"]).rename(
            columns=names
        )
        cells = [{"fda": name} for name in shown.pop("key")]
        return render_table(shown, note, cells=cells)


class Scope(StudySection):
    """Q-3."""

    title, anchor, template = "Where does it work?", "q3", "study/scope.html"

    def context(self) -> dict[str, Any]:
        """Sentences, scope, ROC, thresholds."""
        study = self.study
        charts = [chart_scope(study, _best(self))]
        if study.detection is not None:
            _, choices = detection_cases(study)
            charts.append(chart_roc(study, choices))
        return {
            "sentences": say(answers.effective_scope(study)),
            "tolerances": render_table(
                answers.tolerance_table(study),
                "Exact, not by kernel density. σ in natural units; ≥: the end of the grid.",
            ),
            "charts": embed_charts(charts),
            "thresholds": self._thresholds(),
            "count": self._count(),
        }

    def _count(self) -> str:
        first = self.study.conclusions[:1]
        return count_text(sum(len(thresholds_of(self.study, one)) for one in first), "threshold")

    def _thresholds(self) -> Markup:
        study = self.study
        if not study.conclusions or not study.conclusions[0].detector:
            return Markup("")
        one = study.conclusions[0]
        table = thresholds_of(study, one)
        if table.empty:
            return Markup("")
        unit = unit_text(study.units.get(one.detector, ""))
        name = f"threshold [{unit}]" if unit else "threshold"
        shown = table.assign(cycle=table["cycle"].map(words))[["robot", "cycle", "axis", "fda", "threshold"]]
        shown = shown.assign(key=table["cycle"].to_numpy()).rename(
            columns={"cycle": "test-cycle", "fda": "detector", "threshold": name}
        )
        note = (
            "Alarm above it: at most the false-alarm rate asked, for variations up to those of the "
            "conclusion, with the largest threshold that any of the factors needs."
        )
        by = {"robot": "robot", "test-cycle": "cycle", "axis": "axis", "detector": "fda"}
        return render_table(shown.drop(columns="key"), note, digits=4, filter_by=by)
