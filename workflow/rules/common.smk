"""Paths, the validated configuration, and the files that a rule's result depends on."""

import glob
import os
import re
import sys
import time
from contextlib import ExitStack
from functools import cache
from pathlib import Path

from pyarrow.parquet import read_metadata
from snakemake.io import sourcecache_entry

STARTED = time.monotonic()
# The folder of Snakefile, workflow and configuration: a clone, or what an installed wheel carries.
HOME = str(Path(str(workflow.current_basedir)).parents[1])
SRC = os.path.join(HOME, "src")
inherited = dict(os.environ)
# Scripts run in other interpreters (with --sdm conda, in another environment): they find a
# clone's package here, and compute with one thread each, so that results do not depend on the number of cores.
if os.path.isdir(SRC):
    sys.path.insert(0, SRC)
    os.environ.update(PYTHONPATH=os.pathsep.join(filter(None, [SRC, inherited.get("PYTHONPATH")])))
os.environ.update({f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")})

from wearscope.processes import MAIN, STARTER, end_with, identify_process, ignore_settings_here, isolate

# No job runs or obeys what lies in the working directory, which may be a data set.
ignore_settings_here()
os.environ.update(isolate(os.environ))

from wearscope.cli.study import read_yaml
from wearscope.cli.workflow import wait_turn
from wearscope.closed_loop.names import drawn_path
from wearscope.config import label, load_config
from wearscope.errors import InputError
from wearscope.storage.files import check_folder
from wearscope.jobs.named_files import NamedDataSet, NamedRobot
from wearscope.jobs.planning import Plan
from wearscope.plugins import identify_installed, is_built_in, list_installed
from wearscope.jobs.sources import ROOT as PACKAGE
from wearscope.jobs.sources import find_script_sources, plugin_file
from wearscope.tracking.session_names import name_sessions

# A file given with --configfile is the whole study: nothing of the default's shows through.
STUDY_FILE = "config/config.yaml"
if not os.path.isfile(STUDY_FILE):
    STUDY_FILE = os.path.join(HOME, STUDY_FILE)
GIVEN = workflow.config_settings.configfiles

try:
    for file in GIVEN or [STUDY_FILE]:
        if not str(file).endswith(".json"):  # which the command writes
            # Snakemake keeps the last of two settings of one name, and may run code in it.
            read_yaml(Path(file))
except InputError as error:
    raise SystemExit(str(error)) from None

if not GIVEN:

    configfile: STUDY_FILE


try:
    STUDY = load_config(config)
    for made in (STUDY.study, "closed_loop", "detection", "export", "tracking"):
        check_folder(f"results/{made}")
except InputError as error:
    raise SystemExit(str(error)) from None


def tell(find, *given):
    """What a function finds; ends the run in its sentence where it refuses."""
    try:
        return find(*given)
    except InputError as error:
        raise SystemExit(str(error)) from None


# Started by a job (partitions.smk) or by `wearscope`, which hold the folder for it, it ends with that process.
STARTED_BY = os.environ.pop(STARTER, "")
end_with(STARTED_BY)
# Two of one study at once would miss files of each other: this one plans when the other one is done, and holds the
# folder from its start on (scheduler.smk). A program that only plans need not wait.
TURN = ExitStack()
OWN_TURN = workflow.is_main_process and not STARTED_BY and not {"-n", "--dry-run", "--dryrun"} & {*sys.argv}


def take_turn():
    tell(TURN.enter_context, wait_turn(Path(), lambda told: print(told, file=sys.stderr)))


if OWN_TURN and os.path.lexists("results/.wearscope.lock"):
    take_turn()
    TURN.close()
# A job ends with this process, also where it alone is killed.
os.environ[MAIN] = identify_process(os.getpid())

# A study of many robots is run by partitions, each a study of its own robots in its own folder.
PARTITIONS = {f"{part.partitions.number:05d}": part for part in STUDY.divide()}
R = f"results/{STUDY.study}"
if STUDY.partitions.number is not None:
    R = f"{R}/partitions/{STUDY.partitions.number:05d}"
config = STUDY.model_dump(mode="json")
# Where jobs share no file system, a storage plugin carries what they declare, the recordings of a chunk as one file.
CARRIED = workflow.storage_settings.default_storage_provider is not None
PACKED = CARRIED or STUDY.simulation.packed
GATE = 1000  # the profile lets this much through at a time
ENV = "../../envs/wearscope.yaml"
# Robots as the configuration names them, and as they are simulated: with what is carried over to them.
NAMED_ROBOTS = {label(reference): reference for reference in STUDY.robots}
ROBOTS = {
    robot: f"{R}/robots/{robot}.yaml" if robot in STUDY.carry_over else reference
    for robot, reference in NAMED_ROBOTS.items()
}
#: Model files that a rule makes, with the models that they are made from.
MADE_MODELS = {
    ROBOTS[robot]: [NAMED_ROBOTS[robot], carried.source] for robot, carried in STUDY.carry_over.items()
}
CYCLES = {label(reference): reference for reference in STUDY.cycles}
FACTORS = STUDY.factor_table()
# Recordings stay where they are what was asked for.
ASKED_FOR = getattr(workflow.dag_settings, "targets", None) or ()
DROPPED = not (PACKED or STUDY.simulation.keep_recordings or "simulate" in ASKED_FOR)
PLAN = Plan(STUDY, R, PACKED, DROPPED)
POINTS, POINTS_PER_JOB = PLAN.points, PLAN.points_per_job
FILLED = STUDY.surrogates.filling.enabled
RUN_SETS, STUDY_SETS = PLAN.run_sets, PLAN.study_sets
# Direct Monte Carlo is shown next to the chosen surrogate's answer.
DIRECT = STUDY.direct.enabled and STUDY.snr.model == "chosen" and not PARTITIONS
# What a correction changes is asked where a loop is closed, or models of both sides are given.
REEVALUATED = STUDY.reevaluate.enabled and bool(
    STUDY.closed_loop.demonstration or STUDY.dataset is not None or STUDY.reevaluate.before
)
AUDITED = list(CYCLES)[: STUDY.audit.cycles]

SCOPE_FIGURES, FIGURES, CATEGORIES = PLAN.scope_figures, PLAN.figures, PLAN.categories


def here(files):
    """Files that are no results: every job finds them in its own copy of the tree, no storage holds them.

    Flagged as `workflow.source_path` flags a file. With `local` Snakemake would run each of their jobs itself,
    and send none to the cluster.
    """
    return [sourcecache_entry(file, file) for file in files] if CARRIED else files


# The measured data set that the configuration names, and its dataset.yaml and other files as inputs.
DATASET = tell(NamedDataSet, STUDY.dataset) if STUDY.dataset is not None else None
DATASET_INPUTS = (
    dict(dataset=here([DATASET.file])[0], files=here(tell(lambda: DATASET.files))) if DATASET else {}
)

# Style sheets and templates of figures and page, which no import shows.
REPORT_FILES = here(
    sorted(
        os.path.relpath(file)
        for pattern in ("*.mplstyle", "templates/*", "templates/*/*")
        for file in glob.glob(f"{PACKAGE}/reporting/{pattern}")
        if os.path.isfile(file)
    )
)


wildcard_constraints:
    robot="|".join(map(re.escape, ROBOTS)),
    cycle="|".join(map(re.escape, CYCLES)),
    set="|".join(POINTS),
    chunk=r"\d+",
    side="before|after|truth",


def parts(table, *each):
    """Tables that make a table of the study: one a robot, or a robot and test-cycle; or one a partition."""
    if PARTITIONS:
        return expand("{R}/partitions/{part}/{table}.parquet", R=R, part=PARTITIONS, table=table)
    return expand(f"{R}/{'/'.join(each)}.parquet", robot=ROBOTS, cycle=CYCLES)


def whole(table):
    """A table of the study, as one file; or as one a partition, from which it would be joined."""
    return parts(table) if PARTITIONS else [f"{R}/{table}.parquet"]


SCREENINGS = parts("screening", "screening", "{robot}")


def needs(mib, minutes):
    """Memory [MiB] and time [min] that a job asks a cluster for, as much again each time that it is tried anew.

    Memory is 1.6 to 2.4 times the largest that was measured (docs/cluster.md); times are guesses, generous ones.
    What is not said on a rule is in profiles/default.
    """
    return dict(
        mem_mb=lambda wildcards, attempt: attempt * mib,
        runtime=lambda wildcards, attempt: attempt * minutes,
    )


#: Time [min] for what goes through all robots: 1.5 s of a processor a robot were measured (docs/cluster.md).
JOIN_MINUTES = max(20, len(ROBOTS) // 10)


# Snakemake asks for a job's inputs each time it looks at the job; the answers are kept, as files do not change
# while it makes its plan.
@cache
def code(script, *plugins):
    """Source files that a script's result depends on: itself, what it imports, and plug-ins it loads."""
    files = find_script_sources(f"{HOME}/workflow/scripts/{script}.py", *plugins)
    return here(sorted({os.path.relpath(file) for file in files}))


@cache
def read_robot(reference):
    """A robot's model file, and what it names."""
    return tell(NamedRobot, reference, STUDY.allow_code)


def robot_files(reference):
    """Model file and URDF of a robot."""
    if reference in MADE_MODELS:
        return [reference, str(Path(reference).with_suffix(".urdf"))]
    return here(tell(read_robot(reference).list_files))


def robot_effects(reference):
    """Files of the effects that a robot's model lists, or may list where a rule makes it."""
    if reference in MADE_MODELS:
        return [*effect_files(), *{file for one in MADE_MODELS[reference] for file in robot_effects(one)}]
    return read_robot(reference).list_effect_files()


def detector_files():
    """Files of the study's detectors."""
    return [plugin_file(detector.use, "detectors") for detector in STUDY.detectors.values()]


def cycle_files():
    """Files of the study's test-cycles."""
    return [plugin_file(reference, "cycles") for reference in STUDY.cycles]


@cache
def offered(room):
    """Names that installed packages offer for a room."""
    return set(list_installed(room))


@cache
def installed(*rooms):
    """What is used of installed packages, by name: a parameter, as the dates of their files tell no change."""
    robots = [*NAMED_ROBOTS.values(), *(carried.source for carried in STUDY.carry_over.values())]
    named = {
        "robots": robots,
        "cycles": STUDY.cycles,
        "detectors": [detector.use for detector in STUDY.detectors.values()],
        "effects": [
            *STUDY.closed_loop.effects,
            *(name for reference in robots for name in read_robot(reference).effects),
            *(DATASET.effects if DATASET else []),
        ],
    }
    return {
        f"{room}: {name}": identify_installed(name, room)
        for room in rooms
        for name in sorted({str(name) for name in named[room]} & offered(room))
        if not is_built_in(name, room)
    }


def own_files():
    """Files that the configuration names beyond the platform's code: robots, test-cycles, detectors."""
    named = {*NAMED_ROBOTS.values(), *(carried.source for carried in STUDY.carry_over.values())}
    files = [file for reference in named for file in robot_files(reference)]
    files += [file for reference in named for file in robot_effects(reference)]
    files += [*cycle_files(), *detector_files()]
    named = {os.path.relpath(file) for file in files if PACKAGE not in Path(os.path.abspath(file)).parents}
    return here(sorted(named))


def effect_files():
    """Files of all effects: whatever closes the loop may try each."""
    return sorted(str(file) for file in (PACKAGE / "effects").iterdir())


def own_effects():
    """Own effects' files that the configuration names and that are there; the loop itself says which is missing."""
    files = [str(plugin_file(reference, "effects")) for reference in STUDY.closed_loop.effects]
    return here([file for file in files if os.path.isfile(file)])


def tracked_files():
    """What the target `track` makes; ends the run in one sentence where there is nothing to track."""
    if not DATASET:
        raise SystemExit("config: dataset is missing; say which machine to track: --config dataset=PATH.")
    if TRACKED.refusal:
        raise SystemExit(TRACKED.refusal)
    return [f"{TRACK_FOLDER}/{name}" for name in ("tracking.json", "changes.parquet", "report.html")]


def figure_files(names):
    """SVG files, with caption and category for `snakemake --report`, and PNG files of some figures."""
    files = {}
    for name in names:
        caption = "scope" if name in SCOPE_FIGURES else name
        files[f"{name}_svg"] = report(
            f"{R}/figures/{name}.svg",
            caption=f"../report/{caption}.rst",
            category=CATEGORIES[name],
            labels={"figure": name.replace("_", " ")},
        )
        files[f"{name}_png"] = f"{R}/figures/{name}.png"
    return files


def asked_of(model, find=lambda table: f"{R}/{table}.parquet"):
    """Input function: the tables that make a section's surrogates, where `find` says that they are."""
    tables = ["surrogates", *(["chosen_surrogates", "test_quantities"] if model == "chosen" else [])]
    files = {"chosen" if table == "chosen_surrogates" else table: find(table) for table in tables}
    return lambda wildcards: files


def rechecked(wildcards):
    """Test quantities of the second look; none where the first leaves nothing open."""
    design = checkpoints.weigh_audit.get().output[0]
    if not read_metadata(design).num_rows:
        return []
    return expand("{R}/parts/recheck_quantities/{robot}/{cycle}.parquet", R=R, robot=ROBOTS, cycle=AUDITED)


def refuse_without_dataset(wildcards):
    """End the run in one sentence."""
    raise SystemExit(
        "config: dataset is missing; name a data set, as in snakemake --cores 2 detect --config dataset=PATH"
    )


def reevaluated_models(wildcards):
    """Model files that a reevaluation starts from, and the robot that lends."""
    references = [*RE_SOURCES.values()]
    if STUDY.reevaluate.carry_over is not None:
        references.append(STUDY.reevaluate.carry_over.source)
    made = {file for file in references if file.startswith(f"{LOOP_FOLDER}/")}
    files = [*made, *(file for one in set(references) - made for file in robot_files(one))]
    return sorted(files)


def recordings_of(sets, chunk="0"):
    """Files of a chunk's recordings, by set, where they are packed; temporary where they are dropped."""
    files = [f"{R}/traces/{{robot}}/{{cycle}}/{set}/_chunk-{chunk}.tar" for set in PLAN.packed_sets(*sets)]
    return temp(files) if DROPPED else files


def drawn_files(folder):
    """Models that a closed loop draws in addition to those before and after."""
    paths = [drawn_path(stage, k + 1) for stage in ("before", "after") for k in range(STUDY.reevaluate.draws)]
    return [f"{folder}/{path}" for path in paths]


def partition_code():
    """Source files that what a partition makes depends on, each once: a plan of many jobs is made of them."""
    scripts = [
        "run_partition",
        "choose_surrogates",
        "compute_scope",
        "compute_snr",
        "validate_surrogates",
        "make_overview",
        "write_report",
    ]
    files = [file for script in scripts for file in code(script)]
    files += code("simulate_points", *cycle_files()) + code("compute_test_quantities", *detector_files())
    return list(dict.fromkeys(files))
