# The report of a divided study has a row for each robot and test-cycle; details are in the reports of its partitions.
rule make_overview:
    input:
        scope=f"{R}/scope.parquet",
        snr=f"{R}/snr.parquet",
        fits=f"{R}/chosen_surrogates.parquet" if STUDY.scope.model == "chosen" else f"{R}/validation.parquet",
        failed_simulations=f"{R}/failed_simulations.parquet",
        conclusion=f"{ANSWER}/conclusion.json",
        code=lambda w: code("make_overview"),
    output:
        f"{R}/overview.parquet",
    log:
        f"{R}/logs/make_overview.log",
    conda:
        ENV
    params:
        model=STUDY.scope.model,
        factors=FACTORS,
        unit=STUDY.factors["f"].unit,
    message:
        "Tell robots and test-cycles at a glance"
    script:
        "../scripts/make_overview.py"


if PARTITIONS:

    rule draw_scopes:
        input:
            scope=whole("scope"),
            code=lambda w: code("draw_scopes"),
            style=REPORT_FILES,
        output:
            **PLAN.figure_files(PLAN.scope_figures, ANSWER),
        log:
            f"{R}/logs/draw_scopes.log",
        conda:
            ENV
        resources:
            **needs(1000, PLAN.join_minutes),
        params:
            factors=FACTORS,
            names=STUDY.scope.factors,
            by=STUDY.scope.group_by,
        message:
            "Draw where the detectors work"
        script:
            "../scripts/draw_scopes.py"

    rule write_overview:
        input:
            overviews=whole("overview"),
            pages=expand("{R}/partitions/{part}/report.html", R=R, part=PARTITIONS),
            conclusion=f"{ANSWER}/conclusion.json",
            thresholds=f"{ANSWER}/thresholds.parquet",
            rankings=f"{ANSWER}/rankings.parquet",
            ranking=f"{R}/ranking.parquet",
            sensitivity=f"{R}/sensitivity.parquet",
            failures=f"{R}/failures.parquet",
            failed_simulations=f"{R}/failed_simulations.parquet",
            answers=f"{R}/audit_answers.parquet" if STUDY.audit.enabled else [],
            figures=PLAN.figure_files(PLAN.scope_figures, ANSWER).values(),
            robots=[file for reference in ROBOTS.values() for file in robot_files(reference)],
            code=lambda w: code("write_overview", *detector_files()),
            style=REPORT_FILES,
        output:
            **PLAN.figure_files(PLAN.scope_figures, R, show_later),
            overview=f"{R}/overview.parquet",
            report=show_later(
                f"{R}/report.html",
                caption="../report/report.rst",
                category="Report",
                labels={"figure": "the whole report"},
            ),
            shown=shown_together(R, "conclusion.json", "thresholds.parquet", "rankings.parquet"),
        log:
            f"{R}/logs/write_overview.log",
        conda:
            ENV
        params:
            installed=installed("robots", "detectors", "effects"),
            config=REPORTED,
            factors=FACTORS,
            robots=ROBOTS,
            pages={robot: f"partitions/{part}/report.html" for robot, part in PARTITION_OF.items()},
            allow_code=STUDY.allow_code,
        message:
            "Write the report: robots and test-cycles at a glance"
        script:
            "../scripts/write_overview.py"

    ruleorder: draw_scopes > draw_findings
    ruleorder: write_overview > write_report > make_overview
