LOOP_FILES = [
    "verdict.json",
    "residual.parquet",
    "candidates.parquet",
    "model_before.yaml",
    "model_after.yaml",
]
TWIN, TWIN_MADE = f"{R}/closed_loop/twin", f"{R}/parts/twin"
TWIN_ROBOT = "medium"  # of the demonstration, as wearscope.demonstration.twin has it
DEMONSTRATION = [f"{TWIN_MADE}/{name}" for name in LOOP_FILES]
LOOP_OPTIONS = dict(
    installed=installed("effects"),
    draws=STUDY.reevaluate.draws,
    policy=STUDY.closed_loop.policy.model_dump(mode="json"),
    effects=STUDY.closed_loop.effects,
    allow_code=STUDY.may_run_code(),
)

if STUDY.dataset is None:
    LOOP_PAGE, LOOP_FOLDER, SHOWN_LOOP = TWIN, TWIN_MADE, []
else:
    LOOP_PAGE = f"results/closed_loop/{DATASET.name}"
    LOOP_FOLDER, SHOWN_LOOP = made_in(LOOP_PAGE), shown(LOOP_PAGE)
LOOP = [f"{LOOP_FOLDER}/{name}" for name in LOOP_FILES]
LOOP_ANSWERED = SHOWN_LOOP or [f"{LOOP_PAGE}/report.html"]


rule closed_loop:
    input:
        LOOP,
        LOOP_ANSWERED,


rule demonstration:
    input:
        f"{TWIN}/report.html",


# Starts early, as the reevaluation does: these jobs depend on each other, and the report waits for them.
rule record_demonstration:
    input:
        code=lambda w: code("record_demonstration"),
    output:
        dataset=f"{R}/demonstration/twin/dataset.yaml",
        urdf=f"{R}/demonstration/twin/robot.urdf",
        runs=[f"{R}/demonstration/twin/runs/r{number}.parquet" for number in range(1, 7)],
        truth=f"{R}/demonstration/truth.json",
    log:
        f"{R}/logs/record_demonstration.log",
    priority: 1
    conda:
        ENV
    params:
        seed=STUDY.seed,
        seconds=STUDY.closed_loop.demonstration_seconds,
    message:
        "Record the demonstration's twin, with an effect that nobody declared"
    script:
        "../scripts/record_demonstration.py"


rule close_demonstration:
    input:
        dataset=rules.record_demonstration.output.dataset,
        urdf=rules.record_demonstration.output.urdf,
        runs=rules.record_demonstration.output.runs,
        effects=FILES.own_effects(),
        code=lambda w: code("close_loop", *effect_files()),
    output:
        DEMONSTRATION,
        PLAN.drawn_files(TWIN_MADE, "before", "after"),
    log:
        f"{R}/logs/close_demonstration.log",
    priority: 1
    conda:
        ENV
    resources:
        **needs(2200, 30),
    params:
        **LOOP_OPTIONS,
    message:
        "Close the loop on the demonstration's twin"
    script:
        "../scripts/close_loop.py"


rule report_demonstration:
    input:
        dataset=rules.record_demonstration.output.dataset,
        urdf=rules.record_demonstration.output.urdf,
        tables=DEMONSTRATION,
        drawn=PLAN.drawn_files(TWIN_MADE, "before", "after"),
        code=lambda w: code("report_loop"),
        style=REPORT_FILES,
    output:
        show_later(
            f"{TWIN}/report.html",
            caption="../report/closed_loop.rst",
            category="The loop closed",
            labels={"figure": "demonstration"},
        ),
        shown_together(TWIN, *LOOP_FILES),
        map(show_later, PLAN.drawn_files(TWIN, "before", "after")),
    log:
        f"{R}/logs/report_demonstration.log",
    priority: -1
    conda:
        ENV
    message:
        "Report the loop closed on the demonstration's twin"
    script:
        "../scripts/report_loop.py"


if STUDY.dataset is not None:

    rule close_loop:
        input:
            **DATASET_INPUTS,
            effects=FILES.own_effects(),
            code=code("close_loop", *effect_files()),
        output:
            LOOP,
            PLAN.drawn_files(LOOP_FOLDER, "before", "after"),
        log:
            f"{LOOP_PAGE}/close_loop.log",
        conda:
            ENV
        resources:
            **needs(4000, 120),
        params:
            **LOOP_OPTIONS,
        message:
            "Close the loop on {input.dataset}"
        script:
            "../scripts/close_loop.py"

    rule report_loop:
        input:
            **DATASET_INPUTS,
            tables=LOOP,
            code=lambda w: code("report_loop"),
            style=REPORT_FILES,
        output:
            f"{LOOP_FOLDER}/report.html",
        log:
            f"{LOOP_PAGE}/report_loop.log",
        conda:
            ENV
        message:
            "Report the loop closed on {STUDY.dataset}"
        script:
            "../scripts/report_loop.py"

    rule show_loop:
        input:
            LOOP,
            PLAN.drawn_files(LOOP_FOLDER, "before", "after"),
            f"{LOOP_FOLDER}/report.html",
            code=lambda w: code("show_answer"),
        output:
            SHOWN_LOOP,
        log:
            f"{LOOP_PAGE}/show_loop.log",
        conda:
            ENV
        params:
            folder=LOOP_PAGE,
        message:
            "Show the loop closed on {STUDY.dataset}"
        script:
            "../scripts/show_answer.py"
