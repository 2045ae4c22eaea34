"""Paths, the validated configuration, and the files that a rule's result depends on."""

import glob
import os
import re
import sys
from functools import cache
from pathlib import Path

import yaml

SRC = os.path.join(workflow.basedir, "src")
sys.path.insert(0, SRC)
# Scripts run in other interpreters (with --sdm conda, in another environment): they find the package here,
# and compute with one thread each, so that results do not depend on the number of cores.
inherited = dict(os.environ)
os.environ.update(
    PYTHONPATH=os.pathsep.join(filter(None, [SRC, inherited.get("PYTHONPATH")])),
    OMP_NUM_THREADS="1",
    OPENBLAS_NUM_THREADS="1",
    MKL_NUM_THREADS="1",
    NUMBA_NUM_THREADS="1",
)

from wearscope.closed_loop.intake.data_folder import find_inside
from wearscope.closed_loop.intake.dataset_fields import folder_name, load_yaml
from wearscope.config import label, load_config
from wearscope.errors import InputError
from wearscope.processes import MAIN, identify_process
from wearscope.robots.model_file import (
    check_code,
    find_model,
    list_effects,
    locate_effect,
    read_model_file,
    read_text,
)
from wearscope.sources import find_sources, plugin_file

# A job ends with this process, also where it alone is killed.
os.environ[MAIN] = identify_process(os.getpid())

try:
    STUDY = load_config(config)
except InputError as error:
    raise SystemExit(str(error)) from None

config = STUDY.model_dump(mode="json")
R = f"results/{STUDY.study}"
GATE = 1000  # the profile lets this much through at a time
ENV = "../../envs/wearscope.yaml"
ROBOTS = {label(reference): reference for reference in STUDY.robots}
CYCLES = {label(reference): reference for reference in STUDY.cycles}
FACTORS = STUDY.factor_table()
N_POINTS = STUDY.design.count_points(STUDY.factors)
N_FILLING, N_CHECKING = STUDY.count_filling_points()
POINTS = {
    "identification": N_POINTS,
    "validation": N_POINTS,
    "filling": N_FILLING,
    "checking": N_CHECKING,
    "nominal": STUDY.simulation.nominal_runs,
    "audit": STUDY.count_audit_points(),
    "direct": 2 * STUDY.direct.runs,
}
FILLED = STUDY.surrogates.filling.enabled
# Runs that are asked for a test quantity in every cell, and those that are simulated for it.
RUN_SETS = ["identification", "validation", *(["filling", "checking"] if FILLED else [])]
STUDY_SETS = [*RUN_SETS, "nominal"]
# Direct Monte Carlo stands beside the chosen surrogate's answer.
DIRECT = STUDY.direct.enabled and STUDY.snr.model == "chosen"
AUDITED = list(CYCLES)[: STUDY.audit.cycles]

SCOPE_FIGURES = [f"scope_{factor}" for factor in STUDY.scope.factors]
SETUP_FIGURES = ["design", "recording", "friction"]
FINDING_FIGURES = ["sensitivity", "snr", "snr_cells", *SCOPE_FIGURES, "fit"]
FIGURES = [*SETUP_FIGURES, *FINDING_FIGURES, *(["audit"] if STUDY.audit.enabled else [])]
CATEGORIES = {
    "sensitivity": "Q-1: which factors matter",
    "snr": "Q-2: which detector is best",
    "snr_cells": "Q-2: which detector is best",
    **dict.fromkeys(SCOPE_FIGURES, "Q-3: where it works"),
    "fit": "Can the surrogates be trusted",
    "audit": "Can the surrogates be trusted",
    **dict.fromkeys(SETUP_FIGURES, "What was simulated"),
}


# Style sheets and templates of figures and page, which no import shows.
REPORT_FILES = sorted(
    os.path.relpath(file)
    for pattern in ("*.mplstyle", "templates/*", "templates/*/*")
    for file in glob.glob(f"{SRC}/wearscope/reporting/{pattern}")
    if os.path.isfile(file)
)


wildcard_constraints:
    robot="|".join(map(re.escape, ROBOTS)),
    cycle="|".join(map(re.escape, CYCLES)),
    set="|".join(POINTS),
    chunk=r"\d+",


# Snakemake asks for a job's inputs each time it looks at the job; the answers are kept, as files do not change
# while it makes its plan.
@cache
def code(script, *plugins):
    """Source files that a script's result depends on: itself, what it imports, and plug-ins it loads."""
    files = [f"workflow/scripts/{script}.py", "workflow/scripts/job.py"]
    files += [file for file in map(str, plugins) if os.path.isfile(file)]
    return sorted({os.path.relpath(file) for file in find_sources(*files)})


@cache
def read_robot(reference):
    """Path and content of a robot's model file; ends the run in one sentence where it cannot be used."""
    try:
        path = find_model(reference)
        content = read_model_file(path)
        check_code(list_effects(content, str(path)), STUDY.allow_code, str(path))
    except InputError as error:
        raise SystemExit(f"config: robots: {error}") from None
    return path, content


def robot_files(reference):
    """Model file and URDF of a robot."""
    path, content = read_robot(reference)
    urdf = os.path.join(path.parent, content["urdf"])
    if not os.path.isfile(urdf) or re.search(r"[{}\n]", urdf):
        raise SystemExit(
            f"{path}: urdf: {urdf!r} is no file, or its name holds braces; name the robot's URDF."
        )
    return [str(path), urdf]


def robot_effects(reference):
    """Files of the effects that a robot's model lists."""
    path, content = read_robot(reference)
    names = list_effects(content, str(path))
    return [plugin_file(locate_effect(name, path.parent), "effects") for name in names]


def detector_files():
    """Files of the study's detectors."""
    return [plugin_file(detector.use, "detectors") for detector in STUDY.detectors.values()]


def cycle_files():
    """Files of the study's test-cycles."""
    return [plugin_file(reference, "cycles") for reference in STUDY.cycles]


def own_files():
    """Files that the configuration names beyond the platform's code: robots, test-cycles, detectors."""
    files = [file for reference in ROBOTS.values() for file in robot_files(reference)]
    files += [file for reference in ROBOTS.values() for file in robot_effects(reference)]
    files += [*cycle_files(), *detector_files()]
    return sorted({os.path.relpath(file) for file in files if not os.path.abspath(file).startswith(SRC)})


def traces(robot, cycle, *sets):
    """Markers of the simulated chunks of some sets."""
    return [f"{R}/traces/{robot}/{cycle}/{set}/_chunk-{chunk}.json" for set in sets for chunk in chunks(set)]


def chunks(set):
    """Numbers of the chunks into which a set's points are cut."""
    return range(-(-POINTS[set] // STUDY.simulation.chunk))


def effect_files():
    """Files of all effects: whatever closes the loop may try each."""
    return sorted(
        os.path.join(SRC, "wearscope/effects", name) for name in os.listdir(f"{SRC}/wearscope/effects")
    )


def own_effects():
    """Own effects' files that the configuration names and that are there; the loop itself says which is missing."""
    return [path for path in STUDY.closed_loop.effects if os.path.isfile(path)]


def dataset_file(path):
    """The dataset.yaml of a measured data set given as its folder or that file."""
    return os.path.join(path, "dataset.yaml") if os.path.isdir(path) else path


def read_dataset(path):
    """Content of a dataset.yaml; ends the run in one sentence where there is none."""
    file = dataset_file(path)
    try:
        content = load_yaml(Path(file))
        if not isinstance(content, dict):
            raise InputError(f"{file}: holds no fields; write them as 'field: value'.")
        folder_name(content.get("name"), file)
    except InputError as error:
        raise SystemExit(f"config: dataset: {error}")
    return content


def dataset_name(path):
    """Name of the results' folder of a measured data set."""
    return folder_name(read_dataset(path)["name"], dataset_file(path))


def dataset_files(path):
    """URDF, runs and own effects that a data set names and that are there; the loop says which is missing."""
    content, folder = read_dataset(path), os.path.dirname(dataset_file(path))
    robot, runs = content.get("robot"), content.get("runs")
    names = [robot.get("urdf")] if isinstance(robot, dict) else []
    names += [run.get("file") for run in runs if isinstance(run, dict)] if isinstance(runs, list) else []
    for field in ("effects", "declared_effects"):
        listed = content.get(field)
        names += [name for name in listed if str(name).endswith(".py")] if isinstance(listed, list) else []
    paths = [find_listed(folder, name) for name in names if isinstance(name, str)]
    return [path for path in paths if path is not None]


def find_listed(folder, name):
    """A file that a data set names, where it lies in its folder and is an ordinary one."""
    try:
        path = find_inside(Path(folder), name, "dataset.yaml")
    except InputError:
        return None
    return str(path) if path.is_file() else None


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
