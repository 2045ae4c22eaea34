"""Closed loops that a study carries along: what was named, errors before and after."""

from typing import Any

from wearscope.reporting.loop import draw_loop, joint_table, verdict_sentences
from wearscope.reporting.page import embed_figure, format_number, render_table
from wearscope.reporting.reevaluation_page import summarise_reevaluation
from wearscope.reporting.sections.base import StudySection, say

DEMONSTRATION = "twin"


class Correction(StudySection):
    """What the correction of a model changes in the study's answers."""

    title, anchor, template = "What the correction changes", "correction", "correction.html"

    def is_wanted(self) -> bool:
        """Only where it was asked."""
        return self.study.reevaluation is not None

    def context(self) -> dict[str, Any]:
        """Sentences and figure; the page of its own has the rest."""
        assert self.study.reevaluation is not None
        return {"told": summarise_reevaluation(self.study.reevaluation)}


class Loops(StudySection):
    """Outcome of every closed loop of the study."""

    title, anchor, template = "The closed loop", "loops", "loops.html"

    def is_wanted(self) -> bool:
        """Only where a loop was closed."""
        return bool(self.study.loops)

    def context(self) -> dict[str, Any]:
        """Sentences, figure and table of each."""
        return {"loops": [self._tell(name) for name in self.study.loops]}

    def _tell(self, name: str) -> dict[str, Any]:
        verdict = self.study.loops[name]
        known = self.study.planted if name == DEMONSTRATION else None
        table = joint_table(verdict)
        errors = ", ".join(
            f"{row['joint']} {format_number(row['RMS before'])} to {format_number(row['RMS after'])} "
            f"{row['unit']}"
            for _, row in table.iterrows()
        )
        alt = f"Error of every joint of {name} on the test runs before and after the correction: {errors}"
        caption = (
            "RMS error with 95 % interval on runs that no parameter and no choice came from. Before: the "
            "declared model, refitted."
        )
        return {
            "title": "Demonstration on a simulated twin with an effect that its description hides"
            if known is not None
            else f"Closed on {name}",
            "sentences": say(verdict_sentences(verdict, known)),
            "figure": embed_figure(draw_loop(verdict), alt, caption),
            "table": render_table(table),
        }
