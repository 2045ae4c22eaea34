# Exports the corrected model of a data set, or the model in the configuration.
if STUDY.export.model is not None:
    EXPORTED = robot_files(STUDY.export.model)
    EXPORT = f"results/export/{label(STUDY.export.model)}"
elif STUDY.dataset is not None:
    EXPORTED = [f"{LOOP_FOLDER}/model_after.yaml", f"{LOOP_FOLDER}/verdict.json"]
    EXPORT = f"results/export/{DATASET.name}"
else:
    EXPORTED, EXPORT = [], None

if EXPORT is None:

    rule export:
        input:
            refuse_without_dataset,

else:

    rule export:
        input:
            f"{EXPORT}/export.json",
            SHOWN_LOOP if STUDY.export.model is None else [],

    rule export_model:
        input:
            model=EXPORTED,
            code=lambda w: code("export_model", *effect_files()),
        output:
            f"{EXPORT}/robot.urdf",
            f"{EXPORT}/robot.xml",
            f"{EXPORT}/isaac_lab.json",
            f"{EXPORT}/parameters.csv",
            f"{EXPORT}/export.json",
        log:
            f"{EXPORT}/export_model.log",
        conda:
            ENV
        params:
            installed=installed("robots", "effects"),
            temperature=STUDY.export.temperature,
            allow_code=STUDY.allow_code or STUDY.may_run_code(),
        message:
            "Export {input.model[0]}"
        script:
            "../scripts/export_model.py"
