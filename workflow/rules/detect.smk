if STUDY.dataset is None:

    rule detect:
        input:
            refuse_without_dataset,

else:
    DETECTION = f"results/detection/{DATASET.name}"
    # The corrected model of the loop closed on the same data set, or the one that is named.
    DETECT_ROBOT = (
        [f"{LOOP_FOLDER}/model_after.yaml"] if STUDY.detect.model is None else robot_files(STUDY.detect.model)
    )

    rule detect:
        input:
            f"{DETECTION}/report.html",

    rule judge_recordings:
        input:
            **DATASET_INPUTS,
            robot=DETECT_ROBOT,
            code=lambda w: code("judge_recordings", *detector_files(), *effect_files()),
        output:
            f"{DETECTION}/detection.parquet",
            f"{DETECTION}/thresholds.parquet",
            f"{DETECTION}/simulated.parquet",
            f"{DETECTION}/detection.json",
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
            f"{DETECTION}/report.html",
        log:
            f"{DETECTION}/report_detection.log",
        conda:
            ENV
        message:
            "Report the detectors on the recordings of {STUDY.dataset}"
        script:
            "../scripts/report_detection.py"
