"""The report of a study: one page that answers the three questions and sets them beside the paper."""

from collections.abc import Iterable, Sequence

import pandas as pd
import yaml
from markupsafe import Markup

from wearscope.reporting import answers, trust
from wearscope.reporting.assumptions import list_assumptions
from wearscope.reporting.findings import Finding, count_verdicts
from wearscope.reporting.labels import (
    MODEL_NAMES,
    count_text,
    group_columns,
    group_name,
    join_words,
    term_label,
)
from wearscope.reporting.loop import draw_loop, joint_table, verdict_sentences
from wearscope.reporting.page import (
    Section,
    badge,
    embed_figure,
    format_number,
    render_page,
    render_table,
    render_template,
    unbreak,
)
from wearscope.reporting.reevaluation_page import summarise_reevaluation
from wearscope.reporting.study import Study
from wearscope.reporting.study_tables import render_chosen, render_speed

VERDICT_KINDS = {
    "agrees": "good", "partly": "unsure", "disagrees": "bad", "undecided": "unsure", "not asked": "neutral",
}  # fmt: skip
DEMONSTRATION = "twin"


def render_study(study: Study, findings: Sequence[Finding]) -> str:
    """Report of a study as one self-contained page.

    Parameters
    ----------
    study : Study
    findings : sequence of Finding
        From `wearscope.reporting.findings.compare_with_paper`.
    """
    sections = [
        Section("Summary", _summary(study, findings), "summary"),
        Section("Beside the paper", _beside(study, findings), "paper"),
        Section("Q-1: which factors matter?", _relevance(study), "q1"),
        Section("Q-2: which detector is best?", _comparison(study), "q2"),
        Section("Q-3: where does it work?", _scope(study), "q3"),
        Section("Can the surrogates be trusted?", _trust(study), "trust"),
        Section("Failed points", _failures(study), "failures"),
        Section("What was simulated", _simulated(study), "simulated"),
        Section("What was assumed", _assumed(study), "assumed"),
        Section("What it cost", _costs(study), "costs"),
        Section("Provenance", _provenance(study), "provenance"),
    ]
    config = study.config
    subtitle = (
        f"{count_text(len(config['detectors']), 'detector')}, {count_text(len(config['robots']), 'robot')}, "
        f"{count_text(len(config['cycles']), 'test-cycle')}, "
        f"{count_text(len(config['axes']), 'axis', 'axes')}, {count_text(len(study.factors), 'factor')}; "
        f"seed {config['seed']}"
    )
    return render_page(f"Study {config['study']}", sections, subtitle, "Made by wearscope from its tables.")


def _paragraphs(sentences: Iterable[str]) -> Markup:
    return Markup("").join(Markup("<p>{}</p>").format(unbreak(one)) for one in sentences)


def _bullets(sentences: Iterable[str]) -> Markup:
    items = Markup("").join(Markup("<li>{}</li>").format(unbreak(one)) for one in sentences)
    return Markup("<ul>{}</ul>").format(items)


def _figure(study: Study, name: str, alt: str, caption: str = "") -> Markup:
    """A figure of the study, or a sentence that it was not drawn."""
    if name not in study.figures:
        return Markup('<p class="note">Figure {} was not drawn for this study.</p>').format(name)
    return embed_figure(study.figures[name], alt, caption)


def _summary(study: Study, findings: Sequence[Finding]) -> Markup:
    cells = len(study.snr)
    more = ""
    if study.chosen is not None and len(study.chosen):
        more = f", and one chosen on {count_text(int(study.chosen['n_points'].max()), 'run')}"
    lead = (
        f"{count_text(cells, 'cell')} (robot, test-cycle, axis, detector), each with the paper's surrogates "
        f"fitted to {count_text(int(study.checks['points'].iloc[0]), 'simulated run')}{more}. Beside the "
        f"paper, {count_verdicts(findings)}."
    )
    cards = [
        ("Q-1: which factors matter?", answers.relevant_factors(study), "q1", "Figure 2 and the numbers"),
        ("Q-2: which detector is best?", answers.best_detector(study), "q2", "Figure 3 and every cell"),
        ("Q-3: where does it work?", answers.effective_scope(study), "q3", "Figure 4 and tolerances"),
        (
            "Can it be trusted?",
            [trust.surrogate_quality(study), *trust.audit_outcome(study), *trust.direct_outcome(study)],
            "trust",
            "Fits, audit, assumptions",
        ),
    ]
    cards = [(title, list(map(unbreak, _shorten(said))), link, more) for title, said, link, more in cards]
    alarms = [*trust.dropped_factors(study), *trust.doubts(study), *trust.failed_simulations(study)]
    alarms += [] if study.failures.empty else [trust.failed_points(study)]
    alarms = list(map(unbreak, alarms))
    below = _loops(study) + _corrected(study)
    return render_template("summary.html", lead=lead, alarms=alarms, cards=cards, loops=below)


def _shorten(sentences: list[str], most: int = 8) -> list[str]:
    """First and last of many sentences, and how many are left out."""
    left_out = len(sentences) - most
    if left_out <= 0:
        return sentences
    return [*sentences[: most - 1], f"{left_out} more of this kind below.", sentences[-1]]


def _loops(study: Study) -> Markup:
    """Outcome of every closed loop: what was named, errors before and after."""
    if not study.loops:
        return Markup(
            '<h3>The closed loop</h3><p class="note">Not demonstrated: no loop was closed in this study.</p>'
        )
    parts = []
    for name, verdict in study.loops.items():
        known = study.planted if name == DEMONSTRATION else None
        title = (
            "The closed loop, demonstrated on a simulated twin with an effect that its description hides"
            if known is not None
            else f"The closed loop on {name}"
        )
        table = joint_table(verdict)
        alt = (
            f"Error of every joint of {name} on the test runs before and after the correction: "
            + ", ".join(
                f"{row['joint']} {format_number(row['RMS before'])} to {format_number(row['RMS after'])} "
                f"{row['unit']}"
                for _, row in table.iterrows()
            )
        )
        caption = (
            "RMS error with 95 % interval on runs that no parameter and no choice came from. Before: the "
            "declared model, refitted."
        )
        parts.append(
            Markup("<h3>{}</h3>{}{}{}").format(
                title,
                _bullets(verdict_sentences(verdict, known)),
                embed_figure(draw_loop(verdict), alt, caption),
                render_table(table),
            )
        )
    return Markup("").join(parts)


def _corrected(study: Study) -> Markup:
    """What the correction changes; nothing where it was not asked."""
    if study.reevaluation is None:
        return Markup("")
    link = Markup('<p><a href="reevaluation/report.html">All of it: reevaluation/report.html</a></p>')
    return Markup("<h3>What the correction changes</h3>{}{}").format(
        summarise_reevaluation(study.reevaluation), link
    )


def _beside(study: Study, findings: Sequence[Finding]) -> Markup:
    table = pd.DataFrame(
        {
            "about": [one.question for one in findings],
            "the paper": [one.paper for one in findings],
            "this study": [one.here for one in findings],
            # As objects: a column of strings would forget that these are HTML.
            "verdict": pd.Series(
                [badge(one.verdict, VERDICT_KINDS[one.verdict]) for one in findings], dtype=object
            ),
        }
    )
    note = (
        "The paper's robots, test-cycles and FDAs are confidential, so disagreement is a finding like "
        "agreement. "
        "Agrees: every part of the claim holds with its whole 95 % interval; disagrees: every part that is "
        "settled "
        "is refuted, and at least one is; partly: some hold, some are refuted; undecided: none is refuted, "
        "but some "
        "interval leaves it open. θ̃ is a coefficient over that of wear (8)."
    )
    return Markup('<p class="note">{}</p>{}{}').format(note, render_table(table), render_speed(study))


def _relevance(study: Study) -> Markup:
    table = study.sensitivity
    by = group_columns(table)
    main = table[~table["term"].str.contains(r"[:^]", regex=True) & (table["term"] != "f")]
    shown = main.assign(
        term=main["term"].map(term_label),
        text=[
            f"{format_number(row.median_absolute)}; {row.n_relevant} of {row.n}"
            + (f", {row.n_nan} n/a" if row.n_nan else "")
            for row in main.itertuples()
        ],
    )
    shown = shown.assign(
        group=[group_name(by, key) for key in shown[by].itertuples(index=False)] if by else "all"
    )
    wide = shown.pivot(index="group", columns="term", values="text").reset_index()
    model = study.config["sensitivity"]["model"]
    caption = (
        f"Fig. 2: normalised coefficients (8) of the {MODEL_NAMES[model]} model. Dotted circle: median; box: "
        "quartiles; whiskers: 1.5 boxes; circles: outliers. Beyond the dashed lines a term weighs more "
        "than wear. "
        "The scale turns logarithmic beyond ±1 where values reach far. Model (19) has no square of f: "
        "where y "
        "curves with f, part of that (a quarter, with its sign turned, in the paper's design) shows in the "
        "other "
        "squares, so the sentences name a square only where the full model (3) agrees."
    )
    note = (
        "Direct effects: median |θ̃|; cells in which it outweighs wear. Interactions and squares: "
        "sensitivity.parquet."
    )
    sentences = answers.relevant_factors(study)
    return Markup("{}{}{}").format(
        _bullets(sentences),
        _figure(
            study, "sensitivity", "Box plots of the normalised coefficients. " + " ".join(sentences), caption
        ),
        render_table(wide, note),
    )


def _comparison(study: Study) -> Markup:
    sentences = answers.best_detector(study)
    setting = study.config["snr"]
    first, last = (
        f"{value:g}".replace("-", "−") for value in (setting["f0"], setting["f0"] + setting["delta"])
    )
    caption = (
        f"Fig. 3: SNR (11), f from {first} to {last}, σ = "
        f"{setting['sigma']:g} (20), by Monte Carlo; red: y falls with wear. Median and rank with 95 % "
        "intervals over "
        "the choice of cells."
    )
    shown = study.ranking.rename(
        columns={"n": "cells", "n_nan": "cells n/a", "tied_with": "not told apart from"}
    )
    return Markup("{}{}{}{}").format(
        _paragraphs(sentences),
        _figure(study, "snr", "Box plots of the SNR, medians and ranks. " + " ".join(sentences), caption),
        render_table(shown),
        _figure(
            study, "snr_cells", "SNR of every cell as a heat map.",
            "Exact SNR of every cell. n/a: the detector always says the same; violet: y falls with wear.",
        ),
    )  # fmt: skip


def _scope(study: Study) -> Markup:
    sentences = answers.effective_scope(study)
    parts = [_paragraphs(sentences)]
    for name in study.config["scope"]["factors"]:
        factor = study.factor(name)
        alt = f"Group scope matrices for {factor.description} by both methods, and their difference."
        caption = (
            f"Fig. 4: cells that meet P_d ≥ {study.config['scope']['p_d']:g} at P_f ≤ "
            f"{study.config['scope']['p_f']:g} with {factor.description} ({name}) ~ N(0, σ²). Solid: "
            "bounds where half "
            "the cells pass; dashed: where half of them pass with 95 % confidence in the surrogate. "
            "Below: cells by which the kernel density estimate passes more (violet) or fewer (orange)."
        )
        parts.append(_figure(study, f"scope_{name}", alt, caption))
    parts.append(
        render_table(
            answers.tolerance_table(study),
            "Closed form. σ in coded and natural units; ≥: the end of the grid; Δ: change of f, coded.",
        )
    )
    return Markup("").join(parts)


def _trust(study: Study) -> Markup:
    parts = [
        _paragraphs([trust.surrogate_quality(study)]),
        _figure(
            study, "fit", "Fit of every surrogate on the validation runs as a heat map.",
            "The table like Table 4 for every robot and test-cycle: fit (6) on the validation runs; a mean "
            "predictor "
            "has 0 %, 90 % leaves 1 % of the variance.",
        ),
        render_chosen(study),
        _paragraphs([*trust.audit_outcome(study), *trust.direct_outcome(study)]),
    ]  # fmt: skip
    if study.audit is not None:
        caption = (
            "Each point is a cell. z⁰: nominal; H⁰, H¹: without and with the change of wear at the edge of "
            "the "
            "scope, the factor at its lower (−) or upper (+) quantile. Within the band the 95 % prediction "
            "interval "
            "holds the directly simulated value."
        )
        parts.append(_figure(study, "audit", "Error of the surrogates at the audited points.", caption))
    if study.audit_summary is not None:
        shown = study.audit_summary.rename(
            columns={"n": "values", "n_failed": "failed", "n_inside": "inside"}
        )
        parts.append(
            render_table(shown, "median_error: median absolute error in half-widths of the interval.")
        )
    columns = ["model", "points", "terms", "rank", "condition", "dof", "resolution", "variance_centre"]
    checks = study.checks[[*columns, "variance_nominal", "nominal_outside"]]
    parts.append(
        render_table(checks, "The design, checked before anything was simulated; variances in σ² of a run.")
    )
    return Markup("").join(parts)


def _failures(study: Study) -> Markup:
    parts = [_paragraphs([*trust.failed_simulations(study), trust.failed_points(study)])]
    if len(study.failed_simulations):
        parts.append(render_table(study.failed_simulations, "Every point whose simulation failed."))
    if len(study.failures):
        parts.append(
            render_table(study.failures, "Every cell and set at a point of which the detector failed.")
        )
    return Markup("").join(parts)


def _simulated(study: Study) -> Markup:
    shown = [
        ("design", "Coded levels of every factor in every run.", "Factors down, runs across."),
        (
            "recording",
            "Position, speed and motor torque of one joint in two runs that differ in wear.",
            "What a drive records and a detector sees: two identification runs of one robot and test-cycle.",
        ),
        (
            "friction",
            "Friction torque against speed at several temperatures and wear levels.",
            "The friction law (17) of the wearing joints. Wear adds friction at low speed and in "
            "proportion to "
            "speed; temperature changes both.",
        ),
    ]
    return Markup("").join(_figure(study, *one) for one in shown)


def _assumed(study: Study) -> Markup:
    items = [
        Markup("<dt><strong>{}</strong></dt><dd>{}</dd>").format(what, text)
        for what, text in list_assumptions(study)
    ]
    return Markup("<dl>{}</dl>").format(Markup("").join(items))


def _costs(study: Study) -> Markup:
    costs = study.costs
    if costs.empty:
        return Markup("<p>Not measured: no timings lie beside the results.</p>")
    shown = costs.sort_values("seconds", ascending=False, kind="stable").rename(
        columns={"seconds": "seconds, all jobs", "memory": "largest job [MiB]"}
    )
    note = "Seconds of the jobs of the last run of each stage, added up; two jobs run at once on two cores."
    return Markup('<p class="note">{}</p>{}').format(note, render_table(shown))


def _provenance(study: Study) -> Markup:
    facts = {name: value for name, value in study.provenance.items() if not isinstance(value, dict)}
    rows = pd.DataFrame(
        {"what": list(facts), "value": ["n/a" if v is None else str(v) for v in facts.values()]}
    )
    packages = study.provenance.get("packages") or {}
    config = yaml.safe_dump(dict(study.config), sort_keys=False, allow_unicode=True)
    return Markup(
        "{}<details><summary>Configuration, defaults filled in</summary><pre>{}</pre></details>"
        "<details><summary>Package versions</summary><p>{}</p></details>"
    ).format(render_table(rows), config, join_words([f"{name} {one}" for name, one in packages.items()]))
