"""Closed loops that a study carries along, each with a page of its own."""

from typing import Any

from wearscope.reporting.loop_words import conclude_loop, tell_planted
from wearscope.reporting.page import render_part
from wearscope.reporting.reevaluation import count_truth, tell_headline
from wearscope.reporting.reevaluation_page import draw_change
from wearscope.reporting.sections.base import StudySection, say

DEMONSTRATION = "twin"


class Correction(StudySection):
    """What the correction of a model changes in the study's answers."""

    title, anchor, template = "What the correction changes", "correction", "study/correction.html"

    def context(self) -> dict[str, Any]:
        """Two sentences and the figure where it was asked; the page of its own has the rest."""
        one = self.study.reevaluation
        if one is None:
            return {}
        return {"told": render_part(listed=[tell_headline(one), count_truth(one)], parts=[draw_change(one)])}


class Loops(StudySection):
    """Outcome of every closed loop of the study."""

    title, anchor, template = "The closed loop", "loops", "study/loops.html"

    def context(self) -> dict[str, Any]:
        """The conclusion of each, where a loop was closed; its page has the rest."""
        loops = [self._tell(name) for name in self.study.loops]
        return {"loops": loops} if loops else {}

    def _tell(self, name: str) -> dict[str, Any]:
        verdict = self.study.loops[name]
        known = self.study.planted if name == DEMONSTRATION else None
        sentences = [conclude_loop(verdict)[1]]
        return {
            "title": "Demonstration on a simulated twin with an effect that its description hides"
            if known is not None
            else f"Closed on {name}",
            "sentences": say(sentences + ([] if known is None else [tell_planted(verdict, known)])),
            "page": f"{'' if known is not None else '../'}closed_loop/{name}/report.html",
        }
