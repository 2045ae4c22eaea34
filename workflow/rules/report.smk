# Configuration that the page shows: without the data set, which is not part of the study.
REPORTED = {key: value for key, value in config.items() if key != "dataset"}
# The demonstration's twin is the medium robot, so the pages of other robots' studies leave it out.
TELLS_DEMONSTRATION = STUDY.closed_loop.demonstration and TWIN_ROBOT in STUDY.robots


rule report:
    input:
        f"{R}/report.html",
        [f"{R}/figures/{name}.svg" for name in PLAN.figures],
        [f"{R}/{table}.parquet" for table in [*JOINED_TABLES, "scope", "test_quantities"]]
        if PARTITIONS
        else f"{R}/findings.parquet",
        [f"{TWIN}/report.html"] if TELLS_DEMONSTRATION else [],
        [f"{RE}/report.html"] if PLAN.reevaluates else [],
        SHOWN_LOOP,


rule figures:
    input:
        expand(f"{R}/figures/{{name}}.{{kind}}", name=PLAN.figures, kind=["svg", "png"]),


rule describe_robots:
    input:
        robots=[file for reference in ROBOTS.values() for file in robot_files(reference)],
        code=lambda w: code(
            "describe_robots",
            *{file for reference in ROBOTS.values() for file in robot_effects(reference)},
        ),
    output:
        f"{R}/friction.parquet",
    log:
        f"{R}/logs/describe_robots.log",
    conda:
        ENV
    params:
        installed=installed("robots", "effects"),
        factors=FACTORS,
        robots=ROBOTS,
        worn=STUDY.worn_axes(),
        allow_code=STUDY.allow_code,
    message:
        "Compute the robots' friction over speed"
    script:
        "../scripts/describe_robots.py"


rule draw_findings:
    input:
        surrogates=f"{R}/surrogates.parquet",
        snr=f"{R}/snr.parquet",
        ranking=f"{R}/ranking.parquet",
        scope=f"{R}/scope.parquet",
        screening=SCREENINGS,
        code=lambda w: code("draw_findings"),
        style=REPORT_FILES,
    output:
        **PLAN.figure_files(PLAN.finding_figures, ANSWER),
    log:
        f"{R}/logs/draw_findings.log",
    conda:
        ENV
    params:
        factors=FACTORS,
        scope_factors=STUDY.scope.factors,
        model=STUDY.sensitivity.model,
        sensitivity_by=STUDY.sensitivity.group_by,
        snr_by=STUDY.snr.group_by,
        scope_by=STUDY.scope.group_by,
    message:
        "Draw the figures of the findings"
    script:
        "../scripts/draw_findings.py"


rule compare_paper:
    input:
        surrogates=f"{R}/surrogates.parquet",
        validation=f"{R}/validation.parquet",
        sensitivity=f"{R}/sensitivity.parquet",
        snr=f"{R}/snr.parquet",
        ranking=f"{R}/ranking.parquet",
        scope=f"{R}/scope.parquet",
        failures=f"{R}/failures.parquet",
        checks=f"{R}/design/checks.parquet",
        answers=f"{R}/audit_answers.parquet" if STUDY.audit.enabled else [],
        code=lambda w: code("compare_paper"),
    output:
        f"{ANSWER}/findings.parquet",
    log:
        f"{R}/logs/compare_paper.log",
    conda:
        ENV
    params:
        config=REPORTED,
        factors=FACTORS,
    message:
        "Compare with what the paper found"
    script:
        "../scripts/compare_paper.py"


rule write_report:
    input:
        surrogates=f"{R}/surrogates.parquet",
        validation=f"{R}/validation.parquet",
        sensitivity=f"{R}/sensitivity.parquet",
        snr=f"{R}/snr.parquet",
        ranking=f"{R}/ranking.parquet",
        scope=f"{R}/scope.parquet",
        failures=f"{R}/failures.parquet",
        failed_simulations=f"{R}/failed_simulations.parquet",
        checks=f"{R}/design/checks.parquet",
        screening=SCREENINGS,
        audit=AUDIT_TABLES if STUDY.audit.enabled else [],
        chosen=ASKED[1] if FILLED else [],
        direct=DIRECT_TABLES[0] if PLAN.compares_direct else [],
        mismatch=MISMATCH_TABLES[0] if MISMATCH else [],
        conclusion=f"{ANSWER}/conclusion.json",
        thresholds=f"{ANSWER}/thresholds.parquet",
        rankings=f"{ANSWER}/rankings.parquet",
        responses=f"{R}/responses.parquet",
        simulated=f"{R}/simulated.parquet",
        detection=f"{R}/detection.parquet",
        friction=f"{R}/friction.parquet",
        findings=f"{ANSWER}/findings.parquet",
        figures=PLAN.figure_files(PLAN.finding_figures, ANSWER).values(),
        loop=[
            *(DEMONSTRATION[:1] if TELLS_DEMONSTRATION else []),
            *(LOOP[:1] if STUDY.dataset is not None else []),
        ],
        truth=rules.record_demonstration.output.truth if TELLS_DEMONSTRATION else [],
        reevaluation=REEVALUATION if PLAN.reevaluates else [],
        after=f"{RE}/models/after.yaml" if PLAN.reevaluates else [],
        robots=[file for reference in ROBOTS.values() for file in robot_files(reference)],
        code=lambda w: code("write_report", *detector_files()),
        style=REPORT_FILES,
    output:
        **PLAN.figure_files(PLAN.finding_figures, R, show_later),
        report=show_later(
            f"{R}/report.html",
            caption="../report/report.rst",
            category="Report",
            labels={"figure": "the whole report"},
        ),
        shown=shown_together(
            R, "conclusion.json", "thresholds.parquet", "rankings.parquet", "findings.parquet"
        ),
    log:
        f"{R}/logs/write_report.log",
    conda:
        ENV
    params:
        installed=installed("robots", "detectors", "effects"),
        config=REPORTED,
        factors=FACTORS,
        robots=ROBOTS,
        allow_code=STUDY.allow_code,
    message:
        "Write the report"
    script:
        "../scripts/write_report.py"
