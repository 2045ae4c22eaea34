"""What a part of a study's or a closed loop's page is."""

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

from markupsafe import Markup

from wearscope.reporting.charts.base import Chart
from wearscope.reporting.closed_loop import ClosedLoop
from wearscope.reporting.findings import Finding
from wearscope.reporting.page import Section, embed_chart, render_part, render_template
from wearscope.reporting.page_strip import unbreak
from wearscope.reporting.study import Study


class PageSection:
    """A part of a page: what it says, and the template that says it; left out where it says nothing."""

    title: ClassVar[str]
    anchor: ClassVar[str]
    #: Its template, where it is not the usual one.
    template: ClassVar[str] = ""

    def context(self) -> dict[str, Any]:
        """What the template needs; nothing where there is nothing to say."""
        raise NotImplementedError

    def render(self) -> Section:
        """The section, ready for a page; without a body where it says nothing."""
        context = self.context()
        template = self.template if context else ""
        body = render_template(template, **context) if template else render_part(**context)
        return Section(self.title, body, self.anchor)


class StudySection(PageSection):
    """A part of a study's page.

    Parameters
    ----------
    study : Study
    findings : sequence of Finding
        What the paper found, compared with this study.
    """

    def __init__(self, study: Study, findings: Sequence[Finding] = ()) -> None:
        self.study = study
        self.findings = findings


class LoopSection(PageSection):
    """A part of a closed loop's page.

    Parameters
    ----------
    loop : ClosedLoop
    """

    def __init__(self, loop: ClosedLoop) -> None:
        self.loop, self.verdict = loop, loop.verdict


def embed_charts(charts: Iterable[Chart | None]) -> Markup:
    """Figures of the charts that there are."""
    return Markup("").join(embed_chart(one) for one in charts if one is not None)


def say(sentences: Iterable[str]) -> list[str]:
    """Sentences whose numbers stay on the line of their units."""
    return [unbreak(one) for one in sentences]


#: Column of the joint, and the filter that it follows.
JOINT = {"joint": "joint"}
