"""Paths, the validated configuration, and the files that a rule's result depends on."""

import os
import re
import sys
import time
from pathlib import Path

from snakemake.io import sourcecache_entry

STARTED = time.monotonic()
# Folder of Snakefile, workflow and configuration: a clone, or a folder inside an installed wheel.
HOME = str(Path(str(workflow.current_basedir)).parents[1])
SRC = os.path.join(HOME, "src")
inherited = dict(os.environ)
# Scripts run in other interpreters (with --sdm conda, in another environment). These variables let them find a
# clone's package, and compute with one thread each, so that results do not depend on the number of cores.
if os.path.isdir(SRC):
    sys.path.insert(0, SRC)
    os.environ.update(PYTHONPATH=os.pathsep.join(filter(None, [SRC, inherited.get("PYTHONPATH")])))
os.environ.update({f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")})

from wearscope.processes import stay_apart

# No job may import modules or read settings from the working directory, which may be an unknown data set.
stay_apart()

from wearscope.cli.study import read_yaml
from wearscope.config import load_config
from wearscope.config.study import label
from wearscope.jobs.planning import Plan, needs
from wearscope.jobs.study_files import ROOT as PACKAGE
from wearscope.jobs.study_files import plugin_file
from wearscope.jobs.study_files import StudyFiles, list_tracked, refuse_without_dataset, tell
from wearscope.storage.files import check_folder

# A file given with --configfile is the complete study: no setting of the default configuration is added.
STUDY_FILE = "config/config.yaml" if os.path.isfile("config/config.yaml") else f"{HOME}/config/config.yaml"
GIVEN = workflow.config_settings.configfiles
for file in GIVEN or [STUDY_FILE]:
    if not str(file).endswith(".json"):  # JSON files are written by the command `wearscope`
        # Snakemake itself would accept a setting given twice, and may run code in a configuration.
        tell(read_yaml, Path(file))

if not GIVEN:

    configfile: STUDY_FILE


STUDY = tell(load_config, config)
for made in (STUDY.study, "closed_loop", "detection", "export", "tracking"):
    tell(check_folder, f"results/{made}")

# A study of many robots is run by partitions, each a study of its own robots in its own folder.
PARTITIONS = {f"{part.partitions.number:05d}": part for part in STUDY.divide()}
R = f"results/{STUDY.study}"
if STUDY.partitions.number is not None:
    R = f"{R}/partitions/{STUDY.partitions.number:05d}"
config = STUDY.model_dump(mode="json")
# If jobs share no file system, a storage plugin transfers their declared files, and recordings are packed by chunk.
CARRIED = workflow.storage_settings.default_storage_provider is not None
GATE = 1000  # the profile's limit for the resource `gate`, summed over running jobs
ENV = "../../envs/wearscope.yaml"


def here(files):
    """Mark source files, which are in every job's own copy of the repository and not in the storage.

    They are flagged like files of `workflow.source_path`. With the flag `local`, Snakemake would run their jobs
    on this machine only.
    """
    return [sourcecache_entry(file, file) for file in files] if CARRIED else files


# Answers of a study, its demonstration and its reevaluation are made in `parts`; the job that writes a page shows all
# of its files together.
ANSWER = f"{R}/parts/answer"


def show_later(file, **about):
    """Mark an output whose old version stays until the answer is shown; `about` are arguments of `report`."""
    return report(update(file), **about) if about else update(file)


def shown_together(folder, *names):
    return [show_later(f"{folder}/{name}") for name in names]


FILES = StudyFiles(STUDY, R, HOME, here, CARRIED, workflow.is_main_process)
code, installed = FILES.code, FILES.installed
made_in, shown = FILES.made_in, FILES.shown
robot_files, robot_effects = FILES.robot_files, FILES.robot_effects
cycle_files, detector_files, effect_files = FILES.cycle_files, FILES.detector_files, FILES.effect_files
# Robots as the configuration names them, and as they are simulated: with laws taken over from other robots.
NAMED_ROBOTS, ROBOTS, CYCLES = FILES.named_robots, FILES.robots, FILES.cycles
DATASET, DATASET_INPUTS, REPORT_FILES = FILES.dataset, FILES.dataset_inputs, FILES.report_files
FACTORS = STUDY.factor_table()
# Recordings are kept if the target is `simulate`. Snakemake knows its targets only after the rules are read, so the
# command line is searched.
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
