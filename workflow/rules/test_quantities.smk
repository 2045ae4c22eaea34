rule test_quantities:
    input:
        f"{R}/test_quantities.parquet",


rule compute_test_quantities:
    input:
        **{name: f"{R}/design/{name}.parquet" for name in RUN_SETS},
        **PLAN.quantity_inputs(*RUN_SETS),
        nominal=f"{R}/design/nominal.parquet",
        detectors=f"{R}/check/detectors.json",
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code("compute_test_quantities", *detector_files(), *robot_effects(ROBOTS[w.robot])),
    output:
        table=f"{R}/parts/test_quantities/{{robot}}/{{cycle}}.parquet",
        failed=f"{R}/parts/failed_simulations/{{robot}}/{{cycle}}.parquet",
    log:
        f"{R}/logs/compute_test_quantities/{{robot}}/{{cycle}}.log",
    conda:
        ENV
    resources:
        **needs(PLAN.quantity_memory(*RUN_SETS), 30),
    params:
        installed=installed("robots", "detectors", "effects"),
        sets=RUN_SETS,
        nominal_set="nominal",
        reference=lambda w: ROBOTS[w.robot],
        axes=STUDY.axes,
        detectors=config["detectors"],
        factors=FACTORS,
        max_failed_share=STUDY.max_failed_share,
        time_limit=STUDY.time_limit,
        allow_code=STUDY.allow_code,
    message:
        "Compute the test quantities of {wildcards.robot}, {wildcards.cycle}"
    script:
        "../scripts/compute_test_quantities.py"


rule compute_quantity_chunk:
    input:
        design=f"{R}/design/{{set}}.parquet",
        nominal=lambda w: f"{R}/design/{PLAN.nominal_of(w.set)}.parquet",
        traces=lambda w: PLAN.quantity_traces(PLAN.traces, w),
        recordings=lambda w: PLAN.quantity_traces(PLAN.packed, w),
        detectors=f"{R}/check/detectors.json",
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code("compute_quantity_chunk", *detector_files(), *robot_effects(ROBOTS[w.robot])),
    output:
        table=f"{R}/parts/quantity_chunks/{{robot}}/{{cycle}}/{{set}}-{{chunk}}.parquet",
        failed=f"{R}/parts/quantity_chunks/{{robot}}/{{cycle}}/{{set}}-{{chunk}}-failed.parquet",
    log:
        f"{R}/logs/compute_quantity_chunk/{{robot}}/{{cycle}}/{{set}}-{{chunk}}.log",
    conda:
        ENV
    resources:
        **needs(1200, PLAN.job_minutes()),
    params:
        installed=installed("robots", "detectors", "effects"),
        reference=lambda w: ROBOTS[w.robot],
        size=STUDY.simulation.quantities_per_job(),
        nominal_set=lambda w: PLAN.nominal_of(w.set),
        axes=lambda w: STUDY.axes[:1] if w.set in ("direct", "mismatch") else STUDY.axes,
        detectors=config["detectors"],
        factors=FACTORS,
        max_failed_share=lambda w: STUDY.max_failed_share if w.set in RUN_SETS else 1.0,
        time_limit=STUDY.time_limit,
        allow_code=STUDY.allow_code,
    message:
        "Compute the test quantities of {wildcards.robot}, {wildcards.cycle}, {wildcards.set}, chunk {wildcards.chunk}"
    script:
        "../scripts/compute_quantity_chunk.py"


rule join_test_quantities:
    input:
        parts=parts("test_quantities", "parts/test_quantities", "{robot}", "{cycle}"),
        failed=parts("failed_simulations", "parts/failed_simulations", "{robot}", "{cycle}"),
        code=lambda w: code("join_test_quantities"),
    output:
        table=f"{R}/test_quantities.parquet",
        failures=f"{R}/failures.parquet",
        failed_simulations=f"{R}/failed_simulations.parquet",
    log:
        f"{R}/logs/join_test_quantities.log",
    conda:
        ENV
    resources:
        **needs(1000, PLAN.join_minutes),
    message:
        "Join the test quantities, count failures"
    script:
        "../scripts/join_test_quantities.py"
