"""The report of a study: one page that concludes, answers the three questions and lets itself be asked."""

from collections.abc import Sequence

from wearscope.reporting.charts.scope import detection_cases
from wearscope.reporting.charts.study import study_filters, study_labels, study_tables
from wearscope.reporting.findings import Finding
from wearscope.reporting.labels import count_text
from wearscope.reporting.page import describe_study, render_page
from wearscope.reporting.reevaluation_page import snr_sides
from wearscope.reporting.sections.background import Paper, Provenance, Simulated, Trust
from wearscope.reporting.sections.base import StudySection
from wearscope.reporting.sections.loops import Correction, Loops
from wearscope.reporting.sections.questions import Detectors, Factors, Scope
from wearscope.reporting.sections.summary import Summary
from wearscope.reporting.strips import study_strip
from wearscope.reporting.study import Study

SECTIONS: tuple[type[StudySection], ...] = (
    Summary, Factors, Detectors, Scope, Trust, Loops, Correction, Paper, Simulated, Provenance,
)  # fmt: skip


def render_study(study: Study, findings: Sequence[Finding]) -> str:
    """Report of a study as one self-contained page.

    Parameters
    ----------
    study : Study
    findings : sequence of Finding
        From `wearscope.reporting.findings.compare_with_paper`.
    """
    tables = study_tables(study)
    if study.detection is not None:
        tables["detection"] = detection_cases(study)[0]
    if study.reevaluation is not None:
        tables["sides"] = snr_sides(study.reevaluation)
    config = study.config
    cells = count_text(len(study.snr), "cell")
    return render_page(
        f"Study {config['study']}",
        [section(study, findings).render() for section in SECTIONS],
        f"{describe_study(config, len(config['robots']))}; {cells}",
        "Made by wearscope from its tables.",
        study_filters(study),
        tables,
        study_labels(study),
        study_strip(study),
    )
