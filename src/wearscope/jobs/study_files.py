"""Lists the files that jobs depend on: robots, cycles, detectors, effects, a data set, sources of scripts.

The sources of a script are found by following its imports.
"""

import os
import re
from collections.abc import Callable, Collection, Iterable, Mapping
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import yaml

from wearscope.closed_loop.intake.data_folder import find_inside, list_named
from wearscope.closed_loop.intake.dataset_fields import folder_name, load_fields
from wearscope.config import label
from wearscope.config.study import StudyConfig
from wearscope.errors import InputError
from wearscope.plugins import identify_installed, installed_file, is_built_in, list_installed
from wearscope.robots.model_file import (
    Allowed,
    check_code,
    find_model,
    list_effects,
    locate_effect,
    read_model_file,
)
from wearscope.storage.files import LIST, forget_lost, made_in
from wearscope.storage.plain_yaml import take_label
from wearscope.tracking.session_names import Tracked

PACKAGE = "wearscope"
ROOT = Path(__file__).parents[1]
#: A line that imports from this package, indented or not. A pattern is used because parsing the files would
#: take a fifth of the time of a run that has nothing to do.
IMPORT = re.compile(
    rf"^\s*(?:from ({PACKAGE}[\w.]*) import (\([^)]*\)|[^\n;]+)|import ([^\n;]*\b{PACKAGE}\b[^\n;]*))",
    re.MULTILINE,
)
#: Blocks under ``if TYPE_CHECKING:`` and comments: they import nothing at run time.
LEFT_OUT = re.compile(r"^([ \t]*)if (?:\w+\.)?TYPE_CHECKING:\n(?:\1[ \t]+.*\n|\s*\n)+|#.*$", re.MULTILINE)


def find_sources(*files: str | Path) -> list[Path]:
    """List `files` and all modules of this package that they import, directly or through other modules.

    Imports for type checking are ignored. Plug-ins are loaded by name, so no import shows them: pass their
    files too (see `plugin_file`).

    Parameters
    ----------
    *files : path-like
        Python files.

    Returns
    -------
    list of Path
        Sorted, each once.

    Raises
    ------
    FileNotFoundError
        If a file does not exist.
    """
    found: set[Path] = set()
    waiting = [Path(file) for file in files]
    while waiting:
        file = waiting.pop()
        if file not in found:
            found.add(file)
            waiting.extend(_imports(file))
    return sorted(found)


def find_script_sources(script: str | Path, *plugins: str | Path) -> list[Path]:
    """List a workflow script, the scripts next to it that it imports, plug-ins, and all that these import.

    Plug-in files that do not exist are left out: the code that loads them reports which is missing.
    """
    files = [Path(script)]
    for file in files:  # the loop below appends scripts that a script imports
        imported = re.findall(r"^from (\w+) import", file.read_text(encoding="utf-8"), re.MULTILINE)
        shared = [file.with_name(f"{name}.py") for name in imported]
        files += [one for one in shared if one.is_file() and one not in files]
    return find_sources(*files, *(one for one in map(Path, plugins) if one.is_file()))


def plugin_file(reference: str, room: str) -> Path:
    """Return the file of a plug-in given as in `wearscope.plugins.load`; the file may be missing."""
    if reference.endswith(".py"):
        return Path(reference)
    own = ROOT / room / f"{reference}.py"
    return own if own.is_file() else installed_file(reference, room) or own


@cache
def _imports(file: Path) -> tuple[Path, ...]:
    """Return the files of this package that a Python file imports."""
    text = LEFT_OUT.sub("", file.read_text(encoding="utf-8"))
    names: set[str] = set()
    for module, attributes, modules in IMPORT.findall(text):
        listed = [one.split()[0] for one in (attributes or modules).strip("()").split(",") if one.strip()]
        names.update(f"{module}.{one}" if module else one for one in listed)
    return tuple(Path(file) for file in {file for name in names for file in _module_files(name)})


def _module_files(name: str) -> list[str]:
    """List the files that importing a dotted name runs: each package's ``__init__.py`` and the module."""
    first, *parts = name.split(".")
    if first != PACKAGE:
        return []
    folder = str(ROOT)
    files = [f"{folder}/__init__.py"]
    for part in parts:
        folder = f"{folder}/{part}"
        if os.path.isfile(f"{folder}.py"):
            return [*files, f"{folder}.py"]
        if not os.path.isfile(f"{folder}/__init__.py"):  # an attribute of the module
            break
        files.append(f"{folder}/__init__.py")
    return files


_BRACES = re.compile(r"[{}\n]")


class NamedRobot:
    """A robot's model file, its URDF and the effects that it lists.

    Parameters
    ----------
    reference : str
        Robot as the configuration gives it: a name or a path.
    allow_code : Allowed
        Files with effects that models may load.

    Raises
    ------
    InputError
        If the model cannot be read, or lists an effect whose code is not allowed.
    """

    def __init__(self, reference: str, allow_code: Allowed) -> None:
        try:
            self.path = find_model(reference)
            content = read_model_file(self.path)
            self.effects = list_effects(content, str(self.path))
            check_code(self.effects, allow_code, str(self.path))
        except InputError as error:
            raise InputError(f"config: robots: {error}") from None
        self._urdf = content["urdf"]

    def list_files(self) -> list[str]:
        """List the model file and its URDF."""
        urdf = os.path.join(self.path.parent, self._urdf)
        if not os.path.isfile(urdf) or _BRACES.search(urdf):
            raise InputError(
                f"{self.path}: urdf: {urdf!r} is no file, or its name holds braces; name the robot's URDF."
            )
        return [str(self.path), urdf]

    def list_effect_files(self) -> list[Path]:
        """List the files of the effects that the model lists."""
        return [plugin_file(locate_effect(name, self.path.parent), "effects") for name in self.effects]


class NamedDataSet:
    """A measured data set, with the files that its ``dataset.yaml`` lists.

    Parameters
    ----------
    path : str
        The data set's folder, or its ``dataset.yaml``.

    Raises
    ------
    InputError
        If there is no such file, or its ``name`` cannot name a folder of results.
    """

    def __init__(self, path: str) -> None:
        self.file = os.path.join(path, "dataset.yaml") if os.path.isdir(path) else path
        try:
            _refuse_braces(self.file)
            self.content = load_fields(Path(self.file))
            self.name = folder_name(self.content.get("name"), self.file)
        except InputError as error:
            raise InputError(f"config: dataset: {error}") from None

    @cached_property
    def files(self) -> list[str]:
        """URDF, runs and own effects, as far as the files exist; the closed loop reports which is missing."""
        return self._list_files(self.content)

    @property
    def effects(self) -> list[str]:
        """Names of all effects in the data set's fields ``effects`` and ``declared_effects``."""
        listed = [self.content.get(field) for field in ("effects", "declared_effects")]
        return [
            name for names in listed if isinstance(names, list) for name in names if isinstance(name, str)
        ]

    def take_session_fields(self, sessions: Collection[str]) -> str:
        """Return, as YAML, the fields of ``dataset.yaml`` that results of the given sessions depend on."""
        return yaml.safe_dump(self._take_sessions(sessions))

    def list_session_files(self, sessions: Collection[str]) -> list[str]:
        """List the same files as `files`, but with the runs of the given sessions only."""
        return self._list_files(self._take_sessions(sessions))

    def _take_sessions(self, sessions: Collection[str]) -> dict[str, Any]:
        """Return the content of ``dataset.yaml`` with the runs of the given sessions only."""
        content = {key: value for key, value in self.content.items() if key not in ("reference", "runs")}
        listed = self.content.get("runs")
        runs = [run for run in listed if isinstance(run, dict)] if isinstance(listed, list) else []
        own = [run for run in runs if str(take_label(run.get("session"))) in sessions]
        return {**content, "runs": own}

    def _list_files(self, content: Mapping[str, Any]) -> list[str]:
        """List the existing files that fields of a ``dataset.yaml`` refer to."""
        folder, found = Path(self.file).parent, []
        for name in list_named(content):
            try:
                path = find_inside(folder, name, "dataset.yaml")
            except InputError:
                continue
            if path.is_file():
                found.append(str(path))
        for file in found:
            try:
                _refuse_braces(file)
            except InputError as error:
                raise InputError(f"config: dataset: {error}") from None
        return found


def _refuse_braces(file: str) -> None:
    """Refuse a path with braces or a line end: Snakemake would take braces for wildcards."""
    if _BRACES.search(file):
        raise InputError(f"{file}: the path holds a brace or the end of a line; rename that file or folder.")


#: Scripts that a partition runs, except those that load plug-ins.
_PARTITION = (
    "run_partition", "choose_surrogates", "compute_scope", "compute_snr", "validate_surrogates",
    "make_overview", "write_report",
)  # fmt: skip
#: Style sheets and templates of figures and pages. They are read, not imported, so no import shows them.
_LOOKS = ("*.mplstyle", "templates/*", "templates/*/*")


def tell(find: Callable[..., Any], *given: Any) -> Any:
    """Call a function and return its result; an `InputError` ends the run with its message only."""
    try:
        return find(*given)
    except InputError as error:
        raise SystemExit(str(error)) from None


def refuse_without_dataset(wildcards: Any) -> None:
    """End the run with the message that a data set is needed; an input function of Snakemake."""
    raise SystemExit(
        "config: dataset is missing; name a data set, as in snakemake --cores 2 detect --config dataset=PATH"
    )


def list_tracked(sessions: Tracked | None, folder: str) -> list[str]:
    """List the files that tracking makes in a folder; end the run with a message if it cannot track."""
    if sessions is None:
        raise SystemExit("config: dataset is missing; say which machine to track: --config dataset=PATH.")
    if sessions.refusal:
        raise SystemExit(sessions.refusal)
    return [f"{folder}/{name}" for name in ("tracking.json", "changes.parquet", "report.html")]


class StudyFiles:
    """Files that the jobs of a study depend on.

    Answers are cached: Snakemake asks repeatedly, and no file changes while it plans the jobs.

    Parameters
    ----------
    study : StudyConfig
    folder : str
        Folder of the study's results.
    home : str
        Folder that holds the Snakefile and ``workflow``.
    flag : callable
        Marks a list of paths as source files for Snakemake, which no job makes.
    carried : bool
        Whether a storage plugin transfers the files of each job.
    plans : bool
        Whether this process plans the jobs, as Snakemake's main process does.

    Attributes
    ----------
    robots : dict of str to str
        Model that is simulated, as a name or a file, by label; a rule makes the file of a robot that takes
        over corrections from another.
    cycles : dict of str to str
        Test-cycle, as a name or a file, by label.
    named_robots : dict of str to str
        Robots as the configuration names them, by label.
    dataset : NamedDataSet or None
    """

    def __init__(
        self,
        study: StudyConfig,
        folder: str,
        home: str,
        flag: Callable[[list[str]], list[Any]] = list,
        carried: bool = False,
        plans: bool = False,
    ) -> None:
        self.study, self.home, self.flag, self.carried, self.plans = study, home, flag, carried, plans
        self.named_robots = {label(reference): reference for reference in study.robots}
        self.robots = self.named_robots | {
            robot: f"{folder}/robots/{robot}.yaml" for robot in self.named_robots if robot in study.carry_over
        }
        #: Models that a rule makes each model file from: the robot's own and the one with the corrections.
        self.made_models = {
            self.robots[robot]: [self.named_robots[robot], carried.source]
            for robot, carried in study.carry_over.items()
        }
        self.cycles = {label(reference): reference for reference in study.cycles}
        self.dataset = tell(NamedDataSet, study.dataset) if study.dataset is not None else None
        # Snakemake evaluates the inputs of a job many times, so these are cached.
        self.code = cache(self._list_code)
        self.read_robot = cache(lambda reference: tell(NamedRobot, reference, study.allow_code))
        self.installed = cache(self._identify_installed)

    def _list_code(self, script: str, *plugins: str) -> list[Any]:
        """List a script's source files, relative to the working folder: itself, its imports, its plug-ins."""
        files = find_script_sources(f"{self.home}/workflow/scripts/{script}.py", *plugins)
        return self.flag(sorted({os.path.relpath(file) for file in files}))

    def list_partition_code(self) -> list[Any]:
        """List the source files that the results of a partition depend on, each once."""
        files = [
            *(file for script in _PARTITION for file in self.code(script)),
            *self.code("simulate_points", *self.cycle_files()),
            *self.code("compute_test_quantities", *self.detector_files()),
        ]
        return list(dict.fromkeys(files))

    @cached_property
    def dataset_inputs(self) -> dict[str, Any]:
        """The data set's ``dataset.yaml`` and its other files as inputs; none without a data set."""
        if (data := self.dataset) is None:
            return {}
        return {"dataset": self.flag([data.file])[0], "files": self.flag(tell(lambda: data.files))}

    @cached_property
    def report_files(self) -> list[Any]:
        """Style sheets and templates of figures and pages."""
        found = {file for pattern in _LOOKS for file in (ROOT / "reporting").glob(pattern) if file.is_file()}
        return self.flag(sorted(map(os.path.relpath, found)))

    def robot_files(self, reference: str) -> list[Any]:
        """List the model file and the URDF of a robot."""
        if reference in self.made_models:
            return [reference, str(Path(reference).with_suffix(".urdf"))]
        return self.flag(tell(self.read_robot(reference).list_files))

    def robot_effects(self, reference: str) -> list[str]:
        """List the files of the effects in a robot's model; for a model yet to be made, all possible ones."""
        if reference in self.made_models:
            sources = self.made_models[reference]
            return [*self.effect_files(), *{file for one in sources for file in self.robot_effects(one)}]
        return self.read_robot(reference).list_effect_files()

    def reevaluated_models(self, references: Iterable[str], loop: str) -> list[Any]:
        """List the model files that a reevaluation starts from.

        Files in the folder `loop` are made by the closed loop and are listed as they are.
        """
        named, lender = list(references), self.study.reevaluate.carry_over
        if lender is not None:
            named.append(lender.source)
        made = {file for file in named if file.startswith(f"{loop}/")}
        return sorted([*made, *(file for one in set(named) - made for file in self.robot_files(one))])

    def detector_files(self) -> list[Path]:
        """List the files of the study's detectors."""
        return [plugin_file(detector.use, "detectors") for detector in self.study.detectors.values()]

    def cycle_files(self) -> list[Path]:
        """List the files of the study's test-cycles."""
        return [plugin_file(reference, "cycles") for reference in self.study.cycles]

    def effect_files(self) -> list[str]:
        """List the files of all built-in effects: a closed loop may try each."""
        return sorted(str(file) for file in (ROOT / "effects").iterdir())

    def made_in(self, folder: str) -> str:
        """Return the folder in which an answer is made before it is shown.

        With a storage plugin it is the answer's final folder.
        """
        return folder if self.carried else str(made_in(Path(folder)))

    def shown(self, folder: str) -> list[str]:
        """List the output that marks an answer as shown; with a storage plugin there is none.

        If a file of the answer is missing, the process that plans the jobs deletes the mark, so that a job
        shows the answer again.
        """
        if self.carried:
            return []
        if self.plans:
            forget_lost(Path(self.made_in(folder)), Path(folder))
        return [f"{self.made_in(folder)}/{LIST}"]

    def own_effects(self) -> list[Any]:
        """List the existing files of the user's own effects that the configuration names."""
        files = [str(plugin_file(reference, "effects")) for reference in self.study.closed_loop.effects]
        return self.flag([file for file in files if os.path.isfile(file)])

    def own_files(self) -> list[Any]:
        """List files outside the package that the configuration names: robots, test-cycles, detectors."""
        robots = set(self._list_robots())
        files: list[Any] = [*self.cycle_files(), *self.detector_files()]
        for find in (self.robot_files, self.robot_effects):
            files += [file for reference in robots for file in find(reference)]
        own = {os.path.relpath(file) for file in files if ROOT not in Path(os.path.abspath(file)).parents}
        return self.flag(sorted(own))

    def _list_robots(self) -> Iterable[str]:
        """List all models that the configuration names, also those that corrections are taken from."""
        return [*self.named_robots.values(), *(one.source for one in self.study.carry_over.values())]

    def _identify_installed(self, *rooms: str) -> dict[str, Any]:
        """Return package, version and digest of installed plug-ins that the study uses, by kind and name.

        They replace the files as a job's inputs: dates of installed files do not show what has changed.
        """
        robots = self._list_robots()
        named = {
            "robots": robots,
            "cycles": self.study.cycles,
            "detectors": [detector.use for detector in self.study.detectors.values()],
            "effects": [
                *self.study.closed_loop.effects,
                *(name for reference in robots for name in self.read_robot(reference).effects),
                *(self.dataset.effects if self.dataset else []),
            ],
        }
        return {
            f"{room}: {name}": identify_installed(name, room)
            for room in rooms
            for name in sorted({str(name) for name in named[room]} & set(list_installed(room)))
            if not is_built_in(name, room)
        }
