if STUDY.dataset is None:

    rule detect:
        input:
            refuse_without_dataset,

else:
    DETECTION = f"results/detection/{DATASET.name}"
    DETECTION_MADE, SHOWN_DETECTION = made_in(DETECTION), shown(DETECTION)
    # The corrected model from the diagnosis of the same data set, or the model in the configuration.
    DETECT_ROBOT = (
        [f"{LOOP_FOLDER}/model_after.yaml"] if STUDY.detect.model is None else robot_files(STUDY.detect.model)
    )

    rule detect:
        input:
            f"{DETECTION_MADE}/report.html",
            SHOWN_DETECTION,
            SHOWN_LOOP if STUDY.detect.model is None else [],

    rule judge_recordings:
        input:
            **DATASET_INPUTS,
            robot=DETECT_ROBOT,
            code=lambda w: code("judge_recordings", *detector_files(), *effect_files()),
        output:
            f"{DETECTION_MADE}/detection.parquet",
            f"{DETECTION_MADE}/thresholds.parquet",
            f"{DETECTION_MADE}/simulated.parquet",
            f"{DETECTION_MADE}/detection.json",
        log:
            f"{DETECTION}/judge_recordings.log",
        conda:
            ENV
        resources:
            **needs(2000, 60),
        params:
            installed=installed("robots", "detectors", "effects"),
            detectors=config["detectors"],
            factors=FACTORS,
            setting={
                **{key: value for key, value in config["detect"].items() if key != "model"},
                "max_failed_share": STUDY.max_failed_share,
                "time_limit": STUDY.time_limit,
                "seed": STUDY.seed,
            },
            allow_code=STUDY.allow_code or STUDY.may_run_code(),
        message:
            "Ask the study's detectors for the recordings of {STUDY.dataset}"
        script:
            "../scripts/judge_recordings.py"

    rule report_detection:
        input:
            rules.judge_recordings.output,
            code=lambda w: code("report_detection"),
            style=REPORT_FILES,
        output:
            f"{DETECTION_MADE}/report.html",
        log:
            f"{DETECTION}/report_detection.log",
        conda:
            ENV
        message:
            "Report the detectors on the recordings of {STUDY.dataset}"
        script:
            "../scripts/report_detection.py"

    rule show_detection:
        input:
            rules.judge_recordings.output,
            rules.report_detection.output,
            code=lambda w: code("show_answer"),
        output:
            SHOWN_DETECTION,
        log:
            f"{DETECTION}/show_detection.log",
        conda:
            ENV
        params:
            folder=DETECTION,
        message:
            "Show the detectors on the recordings of {STUDY.dataset}"
        script:
            "../scripts/show_answer.py"
