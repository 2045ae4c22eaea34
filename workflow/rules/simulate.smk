# A partition is checked and simulated by the job that runs it.
rule check:
    input:
        SCREENINGS,
        f"{R}/design/checks.parquet",
        f"{R}/check/detectors.json",
        [] if PARTITIONS else expand("{R}/check/{robot}/{cycle}.json", R=R, robot=ROBOTS, cycle=CYCLES),


rule simulate:
    input:
        (
            SCREENINGS
            if PARTITIONS
            else [
                marker
                for robot in ROBOTS
                for cycle in CYCLES
                for marker in PLAN.traces(robot, cycle, *STUDY_SETS)
            ]
        ),


rule carry_over:
    input:
        robot=lambda w: robot_files(NAMED_ROBOTS[w.robot]),
        source=lambda w: robot_files(STUDY.carry_over[w.robot].source),
        code=lambda w: code("carry_over", *robot_effects(ROBOTS[w.robot])),
    output:
        model=f"{R}/robots/{{robot}}.yaml",
        urdf=f"{R}/robots/{{robot}}.urdf",
    log:
        f"{R}/logs/carry_over/{{robot}}.log",
    priority: 100
    conda:
        ENV
    params:
        installed=installed("robots", "effects"),
        robot=lambda w: NAMED_ROBOTS[w.robot],
        settings=lambda w: STUDY.carry_over[w.robot].model_dump(),
        worn=STUDY.worn_axes(),
        allow_code=STUDY.allow_code,
    message:
        "Carry wear and temperature over to {wildcards.robot}"
    script:
        "../scripts/carry_over.py"


rule screen_robot:
    input:
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code("screen_robot", *cycle_files(), *robot_effects(ROBOTS[w.robot])),
    output:
        f"{R}/screening/{{robot}}.parquet",
    log:
        f"{R}/logs/screen_robot/{{robot}}.log",
    priority: 100
    conda:
        ENV
    resources:
        **needs(1000, 20),
        gate=GATE,
    params:
        installed=installed("robots", "cycles", "effects"),
        robot=lambda w: ROBOTS[w.robot],
        cycles=CYCLES,
        ranges=STUDY.factor_ranges(),
        tested=STUDY.tested_factors(),
        worn=STUDY.worn_axes(),
        screening=STUDY.screening,
        step=STUDY.simulation.step,
        sample_rate=STUDY.simulation.sample_rate,
        time_limit=STUDY.time_limit,
        allow_code=STUDY.allow_code,
    message:
        "Screen which factors move the torque of {wildcards.robot}"
    script:
        "../scripts/screen_robot.py"


# Checks have priority and take the whole resource `gate`, so that no simulation runs before all checks have passed.
# (Making them an `ancient` input of all simulations would hide from Snakemake that simulations are out of date.)
# Each robot has one job, since starting a process takes as long as checking three test-cycles.
rule check_cycles:
    input:
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code("check_cycles", *cycle_files(), *robot_effects(ROBOTS[w.robot])),
    output:
        [f"{R}/check/{{robot}}/{cycle}.json" for cycle in CYCLES],
    log:
        f"{R}/logs/check_cycles/{{robot}}.log",
    priority: 100
    conda:
        ENV
    resources:
        **needs(1200, 20),
        gate=GATE,
    params:
        installed=installed("robots", "cycles", "effects"),
        robot=lambda w: ROBOTS[w.robot],
        cycles=CYCLES,
        worn=STUDY.worn_axes(),
        ranges=STUDY.factor_ranges(),
        step=STUDY.simulation.step,
        sample_rate=STUDY.simulation.sample_rate,
        time_limit=STUDY.time_limit,
        allow_code=STUDY.allow_code,
    message:
        "Check that {wildcards.robot} can do every test-cycle at every level"
    script:
        "../scripts/check_cycles.py"


rule check_detectors:
    input:
        code=lambda w: code("check_detectors", *detector_files()),
    output:
        f"{R}/check/detectors.json",
    log:
        f"{R}/logs/check_detectors.log",
    priority: 100
    conda:
        ENV
    resources:
        gate=GATE,
    params:
        installed=installed("detectors"),
        detectors=config["detectors"],
        factors=FACTORS,
        time_limit=STUDY.time_limit,
    message:
        "Check that every detector can be made"
    script:
        "../scripts/check_detectors.py"


# If all sets of a robot and test-cycle fit into one job, one job simulates them: starting a process takes a second.
# The points of audit and direct Monte Carlo are chosen later and have jobs of their own.
AT_ONCE = STUDY_SETS if sum(POINTS[set] for set in STUDY_SETS) <= POINTS_PER_JOB else []


# Nominal runs are kept even if other recordings are deleted: detectors of later stages are fitted to them.
KEPT = [set for set in POINTS if "nominal" in set] if DROPPED else []


rule simulate_points:
    input:
        design=f"{R}/design/{{set}}.parquet",
        check=f"{R}/check/{{robot}}/{{cycle}}.json",
        screening=f"{R}/screening/{{robot}}.parquet",
        robot=lambda w: robot_files(ROBOTS[w.robot]),
        code=lambda w: code(
            "simulate_points",
            plugin_file(CYCLES[w.cycle], "cycles"),
            *robot_effects(ROBOTS[w.robot]),
        ),
    output:
        marker=f"{R}/traces/{{robot}}/{{cycle}}/{{set}}/_chunk-{{chunk}}.json",
        recordings=(temp if DROPPED else list)(PLAN.recordings_of(["{set}"], "{chunk}")),
    log:
        f"{R}/logs/simulate_points/{{robot}}/{{cycle}}/{{set}}-{{chunk}}.log",
    wildcard_constraints:
        set="|".join(set for set in POINTS if set not in [*AT_ONCE, *KEPT]),
    priority: 1
    conda:
        ENV
    resources:
        **needs(1300, PLAN.job_minutes()),
        gate=1,
    params:
        installed=installed("robots", "cycles", "effects"),
        robot=lambda w: ROBOTS[w.robot],
        cycle=lambda w: CYCLES[w.cycle],
        size=POINTS_PER_JOB,
        packed=STUDY.simulation.packed or DROPPED,
        kinds=lambda w: STUDY.factor_kinds(w.get("set", "")),
        worn=STUDY.worn_axes(),
        seed=STUDY.seed,
        step=STUDY.simulation.step,
        sample_rate=STUDY.simulation.sample_rate,
        time_limit=STUDY.time_limit,
        allow_code=STUDY.allow_code,
    message:
        "Simulate {wildcards.robot}, {wildcards.cycle}, {wildcards.set}, chunk {wildcards.chunk}"
    script:
        "../scripts/simulate_points.py"


if AT_ONCE:

    use rule simulate_points as simulate_study with:
        input:
            design=[f"{R}/design/{set}.parquet" for set in AT_ONCE],
            check=f"{R}/check/{{robot}}/{{cycle}}.json",
            screening=f"{R}/screening/{{robot}}.parquet",
            robot=lambda w: robot_files(ROBOTS[w.robot]),
            code=lambda w: code(
                "simulate_points",
                plugin_file(CYCLES[w.cycle], "cycles"),
                *robot_effects(ROBOTS[w.robot]),
            ),
        output:
            marker=[f"{R}/traces/{{robot}}/{{cycle}}/{set}/_chunk-0.json" for set in AT_ONCE],
            recordings=(temp if DROPPED else list)(PLAN.recordings_of(AT_ONCE)),
        log:
            f"{R}/logs/simulate_points/{{robot}}/{{cycle}}/study.log",
        message:
            "Simulate the study of {wildcards.robot}, {wildcards.cycle}"


if set(KEPT) - set(AT_ONCE):

    use rule simulate_points as simulate_nominal with:
        output:
            marker=f"{R}/traces/{{robot}}/{{cycle}}/{{set}}/_chunk-{{chunk}}.json",
        wildcard_constraints:
            set="|".join(sorted(set(KEPT) - set(AT_ONCE))),
