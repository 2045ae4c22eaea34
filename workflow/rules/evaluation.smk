rule sensitivity:
    input:
        f"{R}/sensitivity.parquet",


rule snr:
    input:
        f"{R}/snr.parquet",
        f"{R}/ranking.parquet",


rule scope:
    input:
        f"{R}/scope.parquet",
        f"{R}/group_scope.parquet",


rule compute_sensitivity:
    input:
        surrogates=whole("surrogates"),
        screening=SCREENINGS,
        code=lambda w: code("compute_sensitivity"),
    output:
        f"{R}/sensitivity.parquet",
    log:
        f"{R}/logs/compute_sensitivity.log",
    conda:
        ENV
    params:
        model=STUDY.sensitivity.model,
        group_by=STUDY.sensitivity.group_by,
    message:
        "Compare the factors (Q-1)"
    script:
        "../scripts/compute_sensitivity.py"


rule compute_snr:
    input:
        unpack(PLAN.asked_of(STUDY.snr.model)),
        # The filling design has replicates, which show whether a robot's model has noise.
        noise=f"{R}/chosen_surrogates.parquet" if FILLED else [],
        # The SNR is also computed by the paper's own model, for comparison with the chosen surrogate.
        paper=(
            f"{R}/surrogates.parquet"
            if STUDY.snr.model == "chosen" and "full" in STUDY.surrogates.models
            else []
        ),
        code=lambda w: code("compute_snr"),
    output:
        snr=f"{R}/snr.parquet",
        ranking=f"{R}/ranking.parquet",
    log:
        f"{R}/logs/compute_snr.log",
    conda:
        ENV
    params:
        settings=config["snr"],
        detectors=config["detectors"],
        seed=STUDY.seed,
    message:
        "Compare the detectors (Q-2)"
    script:
        "../scripts/compute_snr.py"


# Has priority over other rules that use the surrogates, since the audit waits for it.
rule compute_scope:
    input:
        unpack(PLAN.asked_of(STUDY.scope.model)),
        code=lambda w: code("compute_scope"),
    output:
        f"{R}/parts/scope/{{robot}}.parquet",
    log:
        f"{R}/logs/compute_scope/{{robot}}.log",
    priority: 1
    conda:
        ENV
    params:
        settings={key: value for key, value in config["scope"].items() if key != "group_by"},
        factors=FACTORS,
        seed=STUDY.seed,
    message:
        "Find where the detectors work (Q-3) on {wildcards.robot}"
    script:
        "../scripts/compute_scope.py"


rule join_scope:
    input:
        parts=parts("scope", "parts/scope", "{robot}"),
        screening=SCREENINGS,
        code=lambda w: code("join_scope"),
    output:
        scope=f"{R}/scope.parquet",
        groups=f"{R}/group_scope.parquet",
    log:
        f"{R}/logs/join_scope.log",
    priority: 1
    conda:
        ENV
    resources:
        **needs(1000, PLAN.join_minutes),
    params:
        group_by=STUDY.scope.group_by,
    message:
        "Join the scope matrices"
    script:
        "../scripts/join_scope.py"


# Data of the page's interactive charts: other factors, other probabilities of false alarm.
rule compute_responses:
    input:
        unpack(PLAN.asked_of(STUDY.scope.model)),
        test_quantities=f"{R}/test_quantities.parquet",
        code=lambda w: code("compute_responses"),
    output:
        responses=f"{R}/responses.parquet",
        simulated=f"{R}/simulated.parquet",
        detection=f"{R}/detection.parquet",
    log:
        f"{R}/logs/compute_responses.log",
    conda:
        ENV
    params:
        scope=config["scope"],
        factors=FACTORS,
    message:
        "Follow the test quantities along each factor, and the detection over false alarms"
    script:
        "../scripts/compute_responses.py"


rule conclusion:
    input:
        f"{R}/conclusion.json",


rule draw_conclusion:
    input:
        unpack(PLAN.asked_of(STUDY.scope.model, whole)),
        test_quantities=whole("test_quantities"),
        scope=whole("scope"),
        snr=f"{R}/snr.parquet",
        audit=AUDIT_TABLES if STUDY.audit.enabled else [],
        direct=DIRECT_TABLES,
        code=lambda w: code("draw_conclusion"),
    output:
        conclusion=f"{ANSWER}/conclusion.json",
        thresholds=f"{ANSWER}/thresholds.parquet",
        rankings=f"{ANSWER}/rankings.parquet",
    log:
        f"{R}/logs/draw_conclusion.log",
    conda:
        ENV
    resources:
        **needs(1000, PLAN.join_minutes),
    params:
        scope=config["scope"],
        factors=FACTORS,
        detectors=config["detectors"],
        seed=STUDY.seed,
    message:
        "Conclude which detector to use, what it finds and what it bears"
    script:
        "../scripts/draw_conclusion.py"
