AUDIT_TABLES = [f"{R}/{name}.parquet" for name in ("audit", "audit_verdicts", "audit_answers")]
AUDIT_PARTS = expand(
    "{R}/parts/audit_quantities/{robot}/{cycle}.parquet", R=R, robot=ROBOTS, cycle=PLAN.audited
)


rule audit:
    input:
        AUDIT_TABLES,


rule choose_audit_points:
    input:
        scope=expand("{R}/parts/scope/{robot}.parquet", R=R, robot=ROBOTS),
        code=lambda w: code("choose_audit_points"),
    output:
        f"{R}/design/audit.parquet",
    log:
        f"{R}/logs/choose_audit_points.log",
    priority: 1
    conda:
        ENV
    params:
        factors=FACTORS,
        about=STUDY.scope.factors,
        points=POINTS["audit"],
        axes=STUDY.axes,
        f0=STUDY.scope.f0,
        detection=STUDY.scope.p_d,
    message:
        "Choose the points of the audit"
    script:
        "../scripts/choose_audit_points.py"


use rule compute_test_quantities as compute_audit_quantities with:
    input:
        **PLAN.quantity_inputs("audit"),
        audit=f"{R}/design/audit.parquet",
        nominal=f"{R}/design/nominal.parquet",
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code("compute_test_quantities", *detector_files(), *robot_effects(ROBOTS[w.robot])),
    output:
        table=f"{R}/parts/audit_quantities/{{robot}}/{{cycle}}.parquet",
        failed=f"{R}/parts/audit_failed_simulations/{{robot}}/{{cycle}}.parquet",
    log:
        f"{R}/logs/compute_audit_quantities/{{robot}}/{{cycle}}.log",
    resources:
        **needs(1200, 30),
    params:
        sets=["audit"],
        reference=lambda w: ROBOTS[w.robot],
        axes=STUDY.axes,
        detectors=config["detectors"],
        factors=FACTORS,
        max_failed_share=1.0,
        time_limit=STUDY.time_limit,
        allow_code=STUDY.allow_code,
    message:
        "Compute the audit's test quantities of {wildcards.robot}, {wildcards.cycle}"


# Weighs the first evidence and makes the design of further points; it is empty unless a decision is close.
checkpoint weigh_audit:
    input:
        points=f"{R}/design/audit.parquet",
        parts=AUDIT_PARTS,
        asked=list(PLAN.asked_of(STUDY.scope.model)(None).values()),
        direct=DIRECT_TABLES,
        scope=expand("{R}/parts/scope/{robot}.parquet", R=R, robot=ROBOTS),
        code=lambda w: code("weigh_audit"),
    output:
        f"{R}/design/recheck.parquet",
    log:
        f"{R}/logs/weigh_audit.log",
    conda:
        ENV
    params:
        model=STUDY.scope.model,
        factors=FACTORS,
        about=STUDY.scope.factors,
        places=STUDY.audit.places,
        axes=STUDY.axes,
        f0=STUDY.scope.f0,
        detection=STUDY.scope.p_d,
    message:
        "Weigh the evidence of the audit; where it is close, choose more points"
    script:
        "../scripts/weigh_audit.py"


use rule compute_audit_quantities as compute_recheck_quantities with:
    input:
        **PLAN.quantity_inputs("recheck"),
        recheck=f"{R}/design/recheck.parquet",
        nominal=f"{R}/design/nominal.parquet",
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code("compute_test_quantities", *detector_files(), *robot_effects(ROBOTS[w.robot])),
    output:
        table=f"{R}/parts/recheck_quantities/{{robot}}/{{cycle}}.parquet",
        failed=f"{R}/parts/recheck_failed_simulations/{{robot}}/{{cycle}}.parquet",
    log:
        f"{R}/logs/compute_recheck_quantities/{{robot}}/{{cycle}}.log",
    params:
        sets=["recheck"],
    message:
        "Compute the test quantities of the audit's further points of {wildcards.robot}, {wildcards.cycle}"


rule audit_surrogates:
    input:
        points=[f"{R}/design/audit.parquet", f"{R}/design/recheck.parquet"],
        parts=AUDIT_PARTS,
        more=lambda w: PLAN.rechecked(checkpoints.weigh_audit.get().output[0]),
        asked=list(PLAN.asked_of(STUDY.scope.model)(None).values()),
        direct=DIRECT_TABLES,
        code=lambda w: code("audit_surrogates"),
    output:
        audit=f"{R}/audit.parquet",
        verdicts=f"{R}/audit_verdicts.parquet",
        answers=f"{R}/audit_answers.parquet",
    log:
        f"{R}/logs/audit_surrogates.log",
    conda:
        ENV
    params:
        model=STUDY.scope.model,
    message:
        "Compare the surrogates with direct simulation"
    script:
        "../scripts/audit_surrogates.py"
