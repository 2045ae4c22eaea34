from wearscope.tracking.session_names import name_sessions

# Tracking has one job for the reference and one for each later session. A job's parameters contain only its own part of
# dataset.yaml, so that adding a session does not repeat the others.
TRACKED = name_sessions(STUDY.dataset) if DATASET else None
TRACK_FOLDER = f"results/tracking/{DATASET.name}" if DATASET else ""
TRACK_MADE, SHOWN_TRACK = (made_in(TRACK_FOLDER), shown(TRACK_FOLDER)) if DATASET else ("", [])
if TRACKED:
    TRACK_LEVEL = STUDY.tracking.false_alarm_rate
    TRACK_EFFECTS = {name: LOOP_OPTIONS[name] for name in ("installed", "effects", "allow_code")}

    rule identify_healthy:
        input:
            dataset=ancient(DATASET_INPUTS["dataset"]),
            files=here(DATASET.list_session_files(TRACKED.reference)),
            effects=FILES.own_effects(),
            code=lambda w: code("identify_healthy", *effect_files()),
        output:
            f"{TRACK_FOLDER}/reference.npz",
        log:
            f"{TRACK_FOLDER}/identify_healthy.log",
        conda:
            ENV
        resources:
            **needs(4000, 120),
        params:
            **LOOP_OPTIONS,
            fields=DATASET.take_session_fields(TRACKED.reference),
        message:
            "Identify the healthy machine of {STUDY.dataset}"
        script:
            "../scripts/identify_healthy.py"

    rule assess_session:
        input:
            dataset=ancient(DATASET_INPUTS["dataset"]),
            reference=rules.identify_healthy.output,
            files=lambda wildcards: here(DATASET.list_session_files([TRACKED.named[wildcards.session]])),
            code=lambda w: code("assess_session", *effect_files()),
        output:
            f"{TRACK_FOLDER}/sessions/{{session}}.json",
        log:
            f"{TRACK_FOLDER}/logs/{{session}}.log",
        wildcard_constraints:
            session="|".join(map(re.escape, TRACKED.named)) or "none",
        conda:
            ENV
        resources:
            **needs(2000, 60),
        params:
            **TRACK_EFFECTS,
            session=lambda wildcards: TRACKED.named[wildcards.session],
            fields=lambda wildcards: DATASET.take_session_fields([TRACKED.named[wildcards.session]]),
            level=TRACK_LEVEL,
        message:
            "Compare session {wildcards.session} with the healthy machine"
        script:
            "../scripts/assess_session.py"

    rule join_sessions:
        input:
            **DATASET_INPUTS,
            reference=rules.identify_healthy.output,
            sessions=expand(rules.assess_session.output, session=list(TRACKED.named)),
            code=lambda w: code("join_sessions", *effect_files()),
        output:
            f"{TRACK_MADE}/tracking.json",
            f"{TRACK_MADE}/changes.parquet",
            f"{TRACK_MADE}/model_tracked.yaml",
            f"{TRACK_MADE}/model_tracked.urdf",
        log:
            f"{TRACK_FOLDER}/join_sessions.log",
        conda:
            ENV
        params:
            **TRACK_EFFECTS,
            level=TRACK_LEVEL,
            limit=STUDY.tracking.friction_limit,
        message:
            "Say what changed since the machine was healthy"
        script:
            "../scripts/join_sessions.py"

    rule report_tracking:
        input:
            tables=rules.join_sessions.output,
            code=lambda w: code("report_tracking"),
            style=REPORT_FILES,
        output:
            f"{TRACK_MADE}/report.html",
        log:
            f"{TRACK_FOLDER}/report_tracking.log",
        conda:
            ENV
        message:
            "Report what changed since the machine was healthy"
        script:
            "../scripts/report_tracking.py"

    rule show_tracking:
        input:
            rules.join_sessions.output,
            rules.report_tracking.output,
            code=lambda w: code("show_answer"),
        output:
            SHOWN_TRACK,
        log:
            f"{TRACK_FOLDER}/show_tracking.log",
        conda:
            ENV
        params:
            folder=TRACK_FOLDER,
        message:
            "Show what changed since the machine was healthy"
        script:
            "../scripts/show_answer.py"


rule track:
    input:
        lambda wildcards: [*list_tracked(TRACKED, TRACK_MADE), *SHOWN_TRACK],
