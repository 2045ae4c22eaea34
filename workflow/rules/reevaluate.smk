RE, RE_MADE = f"{R}/reevaluation", f"{R}/parts/reevaluation"
TWIN_EFFECTS = [
    f"{PACKAGE}/demonstration/simulated_twin/{name}.py" for name in ("gas_spring_torque", "thinning_oil")
]
GIVEN = STUDY.reevaluate.before and {"before": STUDY.reevaluate.before, "after": STUDY.reevaluate.after}
if GIVEN:
    RE_NAME = "given"
    PAIRS = GIVEN
else:
    RE_NAME = os.path.basename(LOOP_FOLDER)
    PAIRS = {
        side: [
            f"{LOOP_FOLDER}/model_{side}.yaml",
            *PLAN.drawn_files(LOOP_FOLDER, side),
        ]
        for side in ("before", "after")
    }
RE_SOURCES = {
    f"{side}-{k:02d}" if k else side: reference
    for side, references in PAIRS.items()
    for k, reference in enumerate(references)
}
# The truth is a third side only in the demonstration, whose effects are known.
if not GIVEN and STUDY.dataset is None:
    RE_SOURCES["truth"] = PAIRS["after"][0]
RE_SIDES = [side for side in ("before", "after", "truth") if side in RE_SOURCES]
RE_CYCLES = {name: CYCLES[name] for name in STUDY.reevaluate.cycles or list(CYCLES)[:1]}
RE_SETS = ["identification", "filling", "checking", "nominal"]
RE_DESIGNS = {name: f"{RE}/design/{name}.parquet" for name in RE_SETS}
RE_CODE = (
    True
    if STUDY.allow_code is True
    else [*(STUDY.allow_code or []), *STUDY.closed_loop.effects, *TWIN_EFFECTS]
)
COMPARED = ["reevaluation.parquet", "reevaluation_ranking.parquet", "models.parquet"]
REEVALUATION = [f"{RE_MADE}/{name}" for name in COMPARED]


rule reevaluate:
    input:
        f"{RE}/report.html",
        [] if GIVEN else LOOP_ANSWERED,


rule make_reevaluation:
    input:
        models=lambda w: FILES.reevaluated_models(RE_SOURCES.values(), LOOP_FOLDER),
        truth=rules.record_demonstration.output.truth if "truth" in RE_SIDES else [],
        code=lambda w: code("make_reevaluation", *effect_files(), *TWIN_EFFECTS, *cycle_files()),
    output:
        **RE_DESIGNS,
        models=f"{RE}/models.json",
        sides=[f"{RE}/models/{side}.{kind}" for side in RE_SIDES for kind in ("yaml", "urdf")],
        screening=f"{RE}/screening.parquet",
    log:
        f"{R}/logs/make_reevaluation.log",
    priority: 1
    conda:
        ENV
    params:
        installed=installed("robots", "cycles", "effects"),
        sources=RE_SOURCES,
        sides=RE_SIDES,
        settings=STUDY.reevaluate.model_dump(),
        carry_over=STUDY.reevaluate.carry_over and STUDY.reevaluate.carry_over.model_dump(),
        cycles=RE_CYCLES,
        factors=FACTORS,
        ranges=STUDY.factor_ranges(),
        tested=STUDY.tested_factors(),
        worn=STUDY.worn_axes(),
        screening=STUDY.screening,
        questions=STUDY.scope.factors,
        snr={key: config["snr"][key] for key in ("f0", "delta", "sigma")},
        axes=STUDY.axes,
        step=STUDY.simulation.step,
        sample_rate=STUDY.simulation.sample_rate,
        seed=STUDY.seed,
        allow_code=RE_CODE,
    message:
        "Make the models that are reevaluated, and their design"
    script:
        "../scripts/make_reevaluation.py"


rule simulate_models:
    input:
        **RE_DESIGNS,
        models=f"{RE}/models.json",
        code=lambda w: code("simulate_models", *effect_files(), *TWIN_EFFECTS, *cycle_files()),
    output:
        (temp if DROPPED else str)(f"{RE}/traces/{{side}}.json"),
    log:
        f"{R}/logs/simulate_models/{{side}}.log",
    priority: 1
    conda:
        ENV
    resources:
        **needs(1300, 60),
    params:
        installed=installed("robots", "cycles", "effects"),
        cycles=RE_CYCLES,
        sets=RE_SETS,
        few_sets=["filling", "nominal"],
        kinds=STUDY.factor_kinds(),
        worn=STUDY.worn_axes(),
        seed=STUDY.seed,
        step=STUDY.simulation.step,
        sample_rate=STUDY.simulation.sample_rate,
        time_limit=STUDY.time_limit,
        allow_code=RE_CODE,
    message:
        "Simulate the models of side {wildcards.side}"
    script:
        "../scripts/simulate_models.py"


rule quantify_models:
    input:
        **RE_DESIGNS,
        models=f"{RE}/models.json",
        traces=f"{RE}/traces/{{side}}.json",
        detectors=f"{R}/check/detectors.json",
        code=lambda w: code("quantify_models", *detector_files(), *effect_files(), *TWIN_EFFECTS),
    output:
        own=f"{RE}/parts/test_quantities/{{side}}.parquet",
        drawn=f"{RE}/parts/drawn_test_quantities/{{side}}.parquet",
        left_out=f"{RE}/parts/left_out/{{side}}.parquet",
    log:
        f"{R}/logs/quantify_models/{{side}}.log",
    priority: 1
    conda:
        ENV
    resources:
        **needs(1200, 30),
    params:
        installed=installed("robots", "detectors", "effects"),
        axes=STUDY.axes,
        detectors=config["detectors"],
        factors=FACTORS,
        max_failed_share=STUDY.max_failed_share,
        time_limit=STUDY.time_limit,
        allow_code=RE_CODE,
        dropped=DROPPED,
    message:
        "Compute the test quantities of side {wildcards.side}"
    script:
        "../scripts/quantify_models.py"


use rule choose_surrogates as choose_reevaluated with:
    input:
        test_quantities=expand("{RE}/parts/test_quantities/{side}.parquet", RE=RE, side=RE_SIDES),
        code=lambda w: code("choose_surrogates"),
    output:
        f"{RE}/chosen_surrogates.parquet",
    log:
        f"{R}/logs/choose_reevaluated.log",
    priority: 1
    message:
        "Choose the surrogates before and after"


rule compare_sides:
    input:
        models=f"{RE}/models.json",
        own=expand("{RE}/parts/test_quantities/{side}.parquet", RE=RE, side=RE_SIDES),
        drawn=expand("{RE}/parts/drawn_test_quantities/{side}.parquet", RE=RE, side=RE_SIDES),
        left_out=expand("{RE}/parts/left_out/{side}.parquet", RE=RE, side=RE_SIDES),
        chosen=f"{RE}/chosen_surrogates.parquet",
        code=lambda w: code("compare_sides"),
    output:
        table=REEVALUATION[0],
        ranking=REEVALUATION[1],
        models=REEVALUATION[2],
    log:
        f"{R}/logs/compare_sides.log",
    priority: 1
    conda:
        ENV
    params:
        robot=RE_NAME,
        sides=RE_SIDES,
        factors=FACTORS,
        model=STUDY.sensitivity.model,
        snr={key: config["snr"][key] for key in ("f0", "delta", "sigma")},
        scope={key: config["scope"][key] for key in ("factors", "f0", "sigma", "grid", "p_f", "p_d")},
        seed=STUDY.seed,
    message:
        "Compare the answers before and after"
    script:
        "../scripts/compare_sides.py"


rule report_reevaluation:
    input:
        reevaluation=REEVALUATION,
        after=f"{RE}/models/after.yaml",
        chosen=f"{RE}/chosen_surrogates.parquet",
        code=lambda w: code("report_reevaluation"),
        style=REPORT_FILES,
    output:
        show_later(
            f"{RE}/report.html",
            caption="../report/reevaluation.rst",
            category="The loop closed",
            labels={"figure": "what the correction changes"},
        ),
        shown_together(RE, *COMPARED),
    log:
        f"{R}/logs/report_reevaluation.log",
    priority: -1
    conda:
        ENV
    params:
        installed=installed("detectors"),
        factors=FACTORS,
        detectors=config["detectors"],
    message:
        "Report what the correction changes"
    script:
        "../scripts/report_reevaluation.py"
