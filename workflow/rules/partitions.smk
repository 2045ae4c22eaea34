# A study of many robots: each partition is planned where it runs, by one job, as a study of its own robots. The
# tables of the partitions are joined as those of robots and test-cycles are.
PARTITION_TABLES = [
    "test_quantities",
    "failed_simulations",
    "screening",
    "scope",
    *(["chosen_surrogates"] if FILLED else []),
]


if PARTITIONS:

    rule run_partition:
        input:
            robots=lambda w: [file for one in PARTITIONS[w.part].robots for file in robot_files(one)],
            code=lambda w: [
                *code("run_partition"),
                *code("simulate_points", *cycle_files()),
                *code("compute_test_quantities", *detector_files()),
                *code("choose_surrogates"),
                *code("compute_scope"),
            ],
        output:
            expand("{R}/partitions/{{part}}/{table}.parquet", R=R, table=PARTITION_TABLES),
        log:
            f"{R}/logs/partitions/{{part}}.log",
        wildcard_constraints:
            part=r"\d+",
        conda:
            ENV
        threads: STUDY.partitions.threads
        resources:
            **needs(1000 + 1300 * STUDY.partitions.threads, partition_minutes()),
        params:
            installed=installed("robots", "cycles", "detectors", "effects"),
            study=lambda w: PARTITIONS[w.part].model_dump(mode="json"),
            file=lambda w: f"{R}/partitions/{w.part}/study.yaml",
            targets=lambda w, output: list(output),
            snakefile=os.path.join(HOME, "Snakefile"),
        message:
            "Run partition {wildcards.part}"
        script:
            "../scripts/run_partition.py"

else:

    rule join_screening:
        input:
            screening=SCREENINGS,
            code=code("join_screening"),
        output:
            f"{R}/screening.parquet",
        log:
            f"{R}/logs/join_screening.log",
        conda:
            ENV
        message:
            "Join what was screened"
        script:
            "../scripts/join_screening.py"


# A study that is shorter than a cluster's job should be: planned and run by one, where it lands. It has no output of
# its own, so that what is left to do is asked each time.
rule in_one_job:
    log:
        f"{R}/logs/in_one_job.log",
    conda:
        ENV
    threads: STUDY.partitions.threads
    resources:
        **needs(1000 + 1300 * STUDY.partitions.threads, 60),
    params:
        study=config,
        file=f"{R}/in_one_job.yaml",
        targets=["all"],
        snakefile=os.path.join(HOME, "Snakefile"),
    message:
        "Run {STUDY.study} as one job"
    script:
        "../scripts/run_partition.py"
