rule design:
    input:
        expand("{R}/design/{table}.parquet", R=R, table=[*STUDY_SETS, "checks"]),


rule make_design:
    input:
        code=lambda w: code("make_design"),
    output:
        **{name: f"{R}/design/{name}.parquet" for name in RUN_SETS[2:]},
        identification=f"{R}/design/identification.parquet",
        validation=f"{R}/design/validation.parquet",
        nominal=f"{R}/design/nominal.parquet",
        checks=f"{R}/design/checks.parquet",
    log:
        f"{R}/logs/make_design.log",
    conda:
        ENV
    params:
        factors=FACTORS,
        kind=STUDY.design.kind,
        options=STUDY.design.options(),
        models=STUDY.surrogates.models,
        axes=STUDY.axes,
        nominal_runs=STUDY.simulation.nominal_runs,
        filling=STUDY.surrogates.filling.model_dump() if FILLED else None,
        questions=STUDY.scope.factors,
        seed=STUDY.seed,
    message:
        "Make the design matrices and check what they can tell"
    script:
        "../scripts/make_design.py"
