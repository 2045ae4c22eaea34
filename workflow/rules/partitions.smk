# A study of many robots is divided. One job plans and runs each partition as a study of its own robots, with its own
# report. The partitions' tables of cells are joined here, one robot at a time.
JOINED_TABLES = ["surrogates", "validation", "snr"]
PARTITION_TABLES = [
    "test_quantities",
    "failed_simulations",
    "screening",
    "scope",
    "overview",
    *JOINED_TABLES,
    *(["chosen_surrogates"] if FILLED else []),
    *(["audit"] if STUDY.audit.enabled else []),
]


#: Partition of each robot.
PARTITION_OF = {label(robot): part for part, one in PARTITIONS.items() for robot in one.robots}


#: Targets that can run as one job, and the memory per core [MiB].
ONE_JOB_MEMORY = {
    "all": 1300,
    "closed_loop": 4000,
    "detect": 4000,
    "track": 4000,
    "reevaluate": 2200,
}


if PARTITIONS:

    rule run_partition:
        input:
            robots=lambda w: [file for one in PARTITIONS[w.part].robots for file in robot_files(one)],
            code=lambda w: FILES.list_partition_code(),
            style=REPORT_FILES,
        output:
            expand("{R}/partitions/{{part}}/{table}.parquet", R=R, table=PARTITION_TABLES),
            f"{R}/partitions/{{part}}/report.html",
        log:
            f"{R}/logs/partitions/{{part}}.log",
        wildcard_constraints:
            part=r"\d+",
        conda:
            ENV
        threads: STUDY.partitions.threads
        resources:
            **needs(1000 + 1300 * STUDY.partitions.threads, PLAN.partition_minutes()),
        params:
            installed=installed("robots", "cycles", "detectors", "effects"),
            study=lambda w: PARTITIONS[w.part].model_dump(mode="json"),
            file=lambda w: f"{R}/partitions/{w.part}/study.yaml",
            targets=lambda w: [
                *(f"{R}/partitions/{w.part}/{table}.parquet" for table in PARTITION_TABLES),
                f"{R}/partitions/{w.part}/report.html",
            ],
            snakefile=os.path.join(HOME, "Snakefile"),
        message:
            "Run partition {wildcards.part}"
        script:
            "../scripts/run_partition.py"

    rule join_partitions:
        input:
            parts=lambda w: [
                f"{R}/partitions/{PARTITION_OF[robot]}/{w.table}.parquet" for robot in sorted(ROBOTS)
            ],
            code=lambda w: code("join_partitions"),
        output:
            f"{R}/{{table}}.parquet",
        log:
            f"{R}/logs/join_partitions/{{table}}.log",
        wildcard_constraints:
            table="|".join(JOINED_TABLES),
        conda:
            ENV
        params:
            robots=sorted(ROBOTS),
        message:
            "Join {wildcards.table} of the partitions"
        script:
            "../scripts/join_partitions.py"

    rule rank_detectors:
        input:
            snr=f"{R}/snr.parquet",
            code=lambda w: code("rank_detectors"),
        output:
            f"{R}/ranking.parquet",
        log:
            f"{R}/logs/rank_detectors.log",
        conda:
            ENV
        params:
            group_by=STUDY.snr.group_by,
            detectors=config["detectors"],
            seed=STUDY.seed,
        message:
            "Rank the detectors (Q-2)"
        script:
            "../scripts/rank_detectors.py"

    rule join_audit:
        input:
            parts=parts("audit"),
            code=lambda w: code("join_audit"),
        output:
            audit=f"{R}/audit.parquet",
            verdicts=f"{R}/audit_verdicts.parquet",
            answers=f"{R}/audit_answers.parquet",
        log:
            f"{R}/logs/join_audit.log",
        conda:
            ENV
        message:
            "Join the audits of the partitions"
        script:
            "../scripts/join_audit.py"

    ruleorder: join_partitions > fit_surrogates > validate_surrogates > compute_snr
    ruleorder: rank_detectors > compute_snr
    ruleorder: join_audit > audit_surrogates

else:

    rule join_screening:
        input:
            screening=SCREENINGS,
            code=lambda w: code("join_screening"),
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


# Runs a complete target as one job of a cluster, for short studies. The rule has no output, so that the job runs each
# time and finds out what is left to do.
for ONE_JOB_TARGET, ONE_JOB_MIB in ONE_JOB_MEMORY.items():

    rule:
        name:
            "in_one_job" if ONE_JOB_TARGET == "all" else f"{ONE_JOB_TARGET}_in_one_job"
        log:
            f"{R}/logs/{ONE_JOB_TARGET}_in_one_job.log",
        conda:
            ENV
        threads: STUDY.partitions.threads
        resources:
            mem_mb=lambda w, attempt, threads, mib=ONE_JOB_MIB: attempt * (1000 + mib * threads),
            runtime=lambda w, attempt: attempt * 60,
        params:
            study=config,
            file=f"{R}/{ONE_JOB_TARGET}_in_one_job.yaml",
            targets=[ONE_JOB_TARGET],
            snakefile=os.path.join(HOME, "Snakefile"),
        message:
            f"Run {ONE_JOB_TARGET} of {STUDY.study} as one job"
        script:
            "../scripts/run_partition.py"
