"""Paths, the validated configuration, and the files that a rule's result depends on."""

import os
import re
import sys
import time
from contextlib import ExitStack
from pathlib import Path

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

from wearscope.processes import (
    MAIN,
    STARTER,
    end_with,
    identify_process,
    ignore_settings_here,
    isolate,
    keep_compiled,
)

# No job runs or obeys what lies in the working directory, which may be a data set.
ignore_settings_here()
os.environ.update(isolate(os.environ))
keep_compiled()

from wearscope.cli.study import read_yaml
from wearscope.cli.workflow import wait_turn
from wearscope.config import load_config
from wearscope.config.study import label
from wearscope.jobs.planning import Plan, needs
from wearscope.jobs.study_files import ROOT as PACKAGE
from wearscope.jobs.study_files import plugin_file
from wearscope.jobs.study_files import StudyFiles, list_tracked, refuse_without_dataset, tell
from wearscope.storage.files import check_folder
from wearscope.storage.files import LIST, MADE, forget_lost

# A file given with --configfile is the whole study: nothing of the default's shows through.
STUDY_FILE = "config/config.yaml" if os.path.isfile("config/config.yaml") else f"{HOME}/config/config.yaml"
GIVEN = workflow.config_settings.configfiles
for file in GIVEN or [STUDY_FILE]:
    if not str(file).endswith(".json"):  # which the command writes
        # Snakemake keeps the last of two settings of one name, and may run code in it.
        tell(read_yaml, Path(file))

if not GIVEN:

    configfile: STUDY_FILE


STUDY = tell(load_config, config)
for made in (STUDY.study, "closed_loop", "detection", "export", "tracking"):
    tell(check_folder, f"results/{made}")

# Started by a job (partitions.smk) or by `wearscope`, which hold the folder for it, it ends with that process.
STARTED_BY = os.environ.pop(STARTER, "")
end_with(STARTED_BY)
# Two of one study at once would miss files of each other: this one plans when the other is done, and holds the folder
# from its start on (scheduler.smk). A program that only plans need not wait.
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
GATE = 1000  # the profile lets this much through at a time
ENV = "../../envs/wearscope.yaml"


def here(files):
    """Files that are no results: every job finds them in its own copy of the tree, no storage holds them.

    Flagged as `workflow.source_path` flags a file; with `local` Snakemake would send none of their jobs away.
    """
    return [sourcecache_entry(file, file) for file in files] if CARRIED else files


def made_in(folder):
    """Where an answer is made before all of it is shown together; in place where a storage carries what is declared."""
    return folder if CARRIED else os.path.join(os.path.dirname(folder), MADE, os.path.basename(folder))


def shown(folder):
    """What is made once a folder shows an answer; made again where a file of it is lost."""
    if CARRIED:
        return []
    if workflow.is_main_process:
        forget_lost(Path(made_in(folder)), Path(folder))
    return [f"{made_in(folder)}/{LIST}"]


# What a study, its demonstration and its correction answer is made in `parts`; the job that writes a page shows all
# that belongs to it together.
ANSWER = f"{R}/parts/answer"


def show_later(file, **about):
    """A file that stays as it is until the page of its answer is written, with what `report` takes of it."""
    return report(update(file), **about) if about else update(file)


def shown_together(folder, *names):
    return [show_later(f"{folder}/{name}") for name in names]


FILES = StudyFiles(STUDY, R, HOME, here)
code, installed = FILES.code, FILES.installed
robot_files, robot_effects = FILES.robot_files, FILES.robot_effects
cycle_files, detector_files, effect_files = FILES.cycle_files, FILES.detector_files, FILES.effect_files
# Robots as the configuration names them, and as they are simulated: with what is carried over to them.
NAMED_ROBOTS, ROBOTS, CYCLES = FILES.named_robots, FILES.robots, FILES.cycles
DATASET, DATASET_INPUTS, REPORT_FILES = FILES.dataset, FILES.dataset_inputs, FILES.report_files
FACTORS = STUDY.factor_table()
# Recordings stay where they are what was asked for. Of its targets Snakemake itself tells once the rules are read.
PACKED = CARRIED or STUDY.simulation.packed
DROPPED = not (PACKED or STUDY.simulation.keep_recordings or "simulate" in sys.argv)
PLAN = Plan(STUDY, R, PACKED, DROPPED)
POINTS, POINTS_PER_JOB = PLAN.points, PLAN.points_per_job
FILLED = STUDY.surrogates.filling.enabled
parts, whole = PLAN.parts, PLAN.whole
SCREENINGS = parts("screening", "screening", "{robot}")
RUN_SETS, STUDY_SETS = PLAN.run_sets, PLAN.study_sets


wildcard_constraints:
    robot="|".join(map(re.escape, ROBOTS)),
    cycle="|".join(map(re.escape, CYCLES)),
    set="|".join(POINTS),
    chunk=r"\d+",
    side="before|after|truth",
