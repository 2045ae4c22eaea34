# One cell of each detector: the first robot, test-cycle and axis.
DIRECT_ROBOT, DIRECT_CYCLE = next(iter(ROBOTS)), next(iter(CYCLES))
DIRECT_TABLES = [f"{R}/direct.parquet"] if PLAN.compares_direct else []


MISMATCH = PLAN.compares_direct and bool(STUDY.direct.mismatch)
MISMATCH_TABLES = [f"{R}/mismatch.parquet"] if MISMATCH else []


rule direct:
    input:
        DIRECT_TABLES,
        MISMATCH_TABLES,


rule make_direct_design:
    input:
        code=lambda w: code("make_direct_design"),
    output:
        f"{R}/design/direct.parquet",
    log:
        f"{R}/logs/make_direct_design.log",
    conda:
        ENV
    params:
        factors=FACTORS,
        runs=STUDY.direct.runs,
        axis=STUDY.axes[0],
        setting={key: config["snr"][key] for key in ("f0", "delta", "sigma")},
        seed=STUDY.seed,
    message:
        "Draw the runs of the direct Monte Carlo"
    script:
        "../scripts/make_direct_design.py"


use rule compute_test_quantities as compute_direct_quantities with:
    input:
        **PLAN.quantity_inputs("direct"),
        direct=f"{R}/design/direct.parquet",
        nominal=f"{R}/design/nominal.parquet",
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code("compute_test_quantities", *detector_files(), *robot_effects(ROBOTS[w.robot])),
    output:
        table=f"{R}/parts/direct_quantities/{{robot}}/{{cycle}}.parquet",
        failed=f"{R}/parts/direct_failed_simulations/{{robot}}/{{cycle}}.parquet",
    log:
        f"{R}/logs/compute_direct_quantities/{{robot}}/{{cycle}}.log",
    resources:
        **needs(PLAN.quantity_memory("direct"), 30),
    params:
        sets=["direct"],
        nominal_set="nominal",
        reference=lambda w: ROBOTS[w.robot],
        axes=STUDY.axes[:1],
        detectors=config["detectors"],
        factors=FACTORS,
        max_failed_share=1.0,
    message:
        "Compute the direct Monte Carlo's test quantities of {wildcards.robot}, {wildcards.cycle}"


rule compare_direct:
    input:
        design=f"{R}/design/direct.parquet",
        direct=f"{R}/parts/direct_quantities/{DIRECT_ROBOT}/{DIRECT_CYCLE}.parquet",
        chosen=f"{R}/chosen_surrogates.parquet",
        test_quantities=f"{R}/test_quantities.parquet",
        code=lambda w: code("compare_direct"),
    output:
        f"{R}/direct.parquet",
    log:
        f"{R}/logs/compare_direct.log",
    conda:
        ENV
    params:
        setting={key: config["snr"][key] for key in ("f0", "delta", "sigma")},
        seed=STUDY.seed,
    message:
        "Compare the surrogates' SNR with direct Monte Carlo"
    script:
        "../scripts/compare_direct.py"


if MISMATCH:

    # The same SNR for a robot that differs from the model that the detectors use.
    rule make_mismatch_design:
        input:
            direct=f"{R}/design/direct.parquet",
            nominal=f"{R}/design/nominal.parquet",
            code=lambda w: code("make_mismatch_design"),
        output:
            pairs=f"{R}/design/mismatch.parquet",
            nominal=f"{R}/design/mismatch_nominal.parquet",
        log:
            f"{R}/logs/make_mismatch_design.log",
        conda:
            ENV
        params:
            mismatch=STUDY.direct.mismatch,
            runs=STUDY.direct.mismatch_runs,
        message:
            "Draw the runs on a robot that differs from its model"
        script:
            "../scripts/make_mismatch_design.py"

    use rule compute_direct_quantities as compute_mismatch_quantities with:
        input:
            **PLAN.quantity_inputs("mismatch"),
            mismatch=f"{R}/design/mismatch.parquet",
            nominal=f"{R}/design/mismatch_nominal.parquet",
            robot=lambda w: robot_files(ROBOTS[w.robot]),
            code=lambda w: code("compute_test_quantities", *detector_files(), *robot_effects(ROBOTS[w.robot])),
        output:
            table=f"{R}/parts/mismatch_quantities/{{robot}}/{{cycle}}.parquet",
            failed=f"{R}/parts/mismatch_failed_simulations/{{robot}}/{{cycle}}.parquet",
        log:
            f"{R}/logs/compute_mismatch_quantities/{{robot}}/{{cycle}}.log",
        params:
            sets=["mismatch"],
            nominal_set="mismatch_nominal",
        message:
            "Compute the test quantities of {wildcards.robot}, {wildcards.cycle}, which differs from its model"

    rule compare_mismatch:
        input:
            quantities=f"{R}/parts/mismatch_quantities/{DIRECT_ROBOT}/{DIRECT_CYCLE}.parquet",
            direct=f"{R}/direct.parquet",
            code=lambda w: code("compare_mismatch"),
        output:
            f"{R}/mismatch.parquet",
        log:
            f"{R}/logs/compare_mismatch.log",
        conda:
            ENV
        params:
            seed=STUDY.seed,
        message:
            "Compare the SNR with that of a robot that differs from its model"
        script:
            "../scripts/compare_mismatch.py"
