# Surrogates that answer the questions: the quadratic models, and the one chosen for each cell.
ASKED = [f"{R}/surrogates.parquet", *([f"{R}/chosen_surrogates.parquet"] if FILLED else [])]


rule surrogates:
    input:
        ASKED,


rule validate:
    input:
        f"{R}/validation.parquet",


rule fit_surrogates:
    input:
        test_quantities=f"{R}/test_quantities.parquet",
        code=lambda w: code("fit_surrogates"),
    output:
        f"{R}/surrogates.parquet",
    log:
        f"{R}/logs/fit_surrogates.log",
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
        code=lambda w: code("validate_surrogates"),
    output:
        f"{R}/validation.parquet",
    log:
        f"{R}/logs/validate_surrogates.log",
    conda:
        ENV
    params:
        max_failed_share=STUDY.max_failed_share,
    message:
        "Validate the surrogates"
    script:
        "../scripts/validate_surrogates.py"


# Each robot has one job, since the imports take longer than choosing the surrogates of a test-cycle.
rule choose_surrogates:
    input:
        test_quantities=[f"{R}/parts/test_quantities/{{robot}}/{cycle}.parquet" for cycle in CYCLES],
        code=lambda w: code("choose_surrogates"),
    output:
        f"{R}/parts/chosen_surrogates/{{robot}}.parquet",
    log:
        f"{R}/logs/choose_surrogates/{{robot}}.log",
    conda:
        ENV
    params:
        kinds=STUDY.surrogates.filling.kinds,
        goal=STUDY.surrogates.filling.goal,
        factors=FACTORS,
        max_failed_share=STUDY.max_failed_share,
    message:
        "Choose the surrogates of {wildcards.robot}"
    script:
        "../scripts/choose_surrogates.py"


rule join_chosen:
    input:
        parts=parts("chosen_surrogates", "parts/chosen_surrogates", "{robot}"),
        code=lambda w: code("join_chosen"),
    output:
        f"{R}/chosen_surrogates.parquet",
    log:
        f"{R}/logs/join_chosen.log",
    conda:
        ENV
    message:
        "Join the chosen surrogates"
    script:
        "../scripts/join_chosen.py"
