rule check:
    input:
        f"{R}/design/checks.parquet",
        f"{R}/check.json",


rule simulate:
    input:
        [
            marker
            for robot in ROBOTS
            for cycle in CYCLES
            for marker in traces(robot, cycle, *STUDY_SETS)
        ],


rule check_study:
    input:
        robots=[file for reference in ROBOTS.values() for file in robot_files(reference)],
        code=code(
            "check_study",
            *cycle_files(),
            *detector_files(),
            *{file for reference in ROBOTS.values() for file in robot_effects(reference)},
        ),
    output:
        f"{R}/check.json",
    log:
        f"{R}/logs/check_study.log",
    benchmark:
        f"{R}/benchmarks/check_study.tsv"
    conda:
        ENV
    params:
        robots=ROBOTS,
        cycles=CYCLES,
        axes=STUDY.axes,
        detectors=config["detectors"],
        ranges=STUDY.factor_ranges(),
        step=STUDY.simulation.step,
        sample_rate=STUDY.simulation.sample_rate,
    message:
        "Check robots, test-cycles, factor ranges and detectors before anything is simulated"
    script:
        "../scripts/check_study.py"


rule simulate_points:
    input:
        design=f"{R}/design/{{set}}.parquet",
        # The check comes before any simulation, but making it again makes no simulation stale.
        check=ancient(f"{R}/check.json"),
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code(
            "simulate_points",
            plugin_file(CYCLES[w.cycle], "cycles"),
            *robot_effects(ROBOTS[w.robot]),
        ),
    output:
        f"{R}/traces/{{robot}}/{{cycle}}/{{set}}/_chunk-{{chunk}}.json",
    log:
        f"{R}/logs/simulate_points/{{robot}}/{{cycle}}/{{set}}-{{chunk}}.log",
    benchmark:
        f"{R}/benchmarks/simulate_points/{{robot}}/{{cycle}}/{{set}}-{{chunk}}.tsv"
    conda:
        ENV
    params:
        robot=lambda w: ROBOTS[w.robot],
        cycle=lambda w: CYCLES[w.cycle],
        size=STUDY.simulation.chunk,
        kinds={name: factor.kind for name, factor in STUDY.factors.items()},
        seed=STUDY.seed,
        step=STUDY.simulation.step,
        sample_rate=STUDY.simulation.sample_rate,
    message:
        "Simulate {wildcards.robot}, {wildcards.cycle}, {wildcards.set}, chunk {wildcards.chunk}"
    script:
        "../scripts/simulate_points.py"
