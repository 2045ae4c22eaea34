"""What a part of a study's or a closed loop's page is."""

from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

from markupsafe import Markup

from wearscope.reporting.charts.base import Chart
from wearscope.reporting.closed_loop import ClosedLoop
from wearscope.reporting.findings import Finding
from wearscope.reporting.page import Section, embed_chart, embed_figure, render_part, render_template
from wearscope.reporting.page_strip import unbreak
from wearscope.reporting.study import Study


class StudySection:
    """A part of the page: what it needs of a study, and the template that says it.

    Parameters
    ----------
    study : Study
    findings : sequence of Finding
        What the paper found, compared with this study.
    """

    title: ClassVar[str]
    anchor: ClassVar[str]
    template: ClassVar[str]

    def __init__(self, study: Study, findings: Sequence[Finding] = ()) -> None:
        self.study = study
        self.findings = findings

    def is_wanted(self) -> bool:
        """Whether the study asked for it."""
        return True

    def context(self) -> dict[str, Any]:
        """What the template needs."""
        return {}

    def render(self) -> Section:
        """The section, ready for a page."""
        body = render_template(f"study/{self.template}", **self.context())
        return Section(self.title, body, self.anchor)

    def figure(self, name: str, alt: str, caption: str = "") -> Markup:
        """A drawn figure of the study; nothing where it was not drawn."""
        return (
            embed_figure(self.study.figures[name], alt, caption) if name in self.study.figures else Markup()
        )


def embed_charts(charts: Iterable[Chart | None]) -> Markup:
    """Figures of the charts that there are."""
    return Markup("").join(embed_chart(one) for one in charts if one is not None)


def say(sentences: Iterable[str]) -> list[str]:
    """Sentences whose numbers stay on the line of their units."""
    return [unbreak(one) for one in sentences]


#: Column of the joint, and the filter that it follows.
JOINT = {"joint": "joint"}


class LoopSection:
    """A part of the page; left out where it has nothing to say.

    Parameters
    ----------
    loop : ClosedLoop
    """

    title: str
    anchor: str
    #: Its template, where it is not the usual one.
    template = ""

    def __init__(self, loop: ClosedLoop) -> None:
        self.loop, self.verdict = loop, loop.verdict

    def context(self) -> dict[str, Any]:
        """What the template needs; nothing where there is nothing to say."""
        raise NotImplementedError

    def render(self) -> Section | None:
        """The section, ready for a page."""
        context = self.context()
        if not context:
            return None
        body = render_template(self.template, **context) if self.template else render_part(**context)
        return Section(self.title, body, self.anchor)
