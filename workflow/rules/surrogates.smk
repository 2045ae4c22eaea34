rule surrogates:
    input:
        f"{R}/surrogates.parquet",


rule validate:
    input:
        f"{R}/validation.parquet",
        f"{R}/fit_table.parquet",


rule fit_surrogates:
    input:
        test_quantities=f"{R}/test_quantities.parquet",
        code=code("fit_surrogates"),
    output:
        f"{R}/surrogates.parquet",
    log:
        f"{R}/logs/fit_surrogates.log",
    benchmark:
        f"{R}/benchmarks/fit_surrogates.tsv"
    conda:
        ENV
    params:
        models=STUDY.surrogates.models,
        max_failed_share=STUDY.max_failed_share,
    message:
        "Fit the surrogates of every cell"
    script:
        "../scripts/fit_surrogates.py"


rule validate_surrogates:
    input:
        test_quantities=f"{R}/test_quantities.parquet",
        surrogates=f"{R}/surrogates.parquet",
        code=code("validate_surrogates"),
    output:
        validation=f"{R}/validation.parquet",
        fit_table=f"{R}/fit_table.parquet",
    log:
        f"{R}/logs/validate_surrogates.log",
    benchmark:
        f"{R}/benchmarks/validate_surrogates.tsv"
    conda:
        ENV
    params:
        models=STUDY.surrogates.models,
        max_failed_share=STUDY.max_failed_share,
    message:
        "Validate the surrogates"
    script:
        "../scripts/validate_surrogates.py"
