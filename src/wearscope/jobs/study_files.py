"""Files that jobs depend on: robots, test-cycles, detectors, effects, a data set, and sources of scripts.

A script's sources are found by reading its imports.
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
from wearscope.storage.plain_yaml import take_label
from wearscope.tracking.session_names import Tracked

PACKAGE = "wearscope"
ROOT = Path(__file__).parents[1]
#: An import of this package at the beginning of a line, indented or not. Parsing the files would take a fifth
#: of an idle run.
IMPORT = re.compile(
    rf"^\s*(?:from ({PACKAGE}[\w.]*) import (\([^)]*\)|[^\n;]+)|import ([^\n;]*\b{PACKAGE}\b[^\n;]*))",
    re.MULTILINE,
)
#: Blocks under ``if TYPE_CHECKING:`` and comments, which are no imports at run time.
LEFT_OUT = re.compile(r"^([ \t]*)if (?:\w+\.)?TYPE_CHECKING:\n(?:\1[ \t]+.*\n|\s*\n)+|#.*$", re.MULTILINE)


def find_sources(*files: str | Path) -> list[Path]:
    """Python files that running `files` may run: themselves and, transitively, the modules they import.

    Only modules of this package count; imports for type checking do not. Plug-ins are loaded by name, so
    no import shows them: name their files too (see `plugin_file`).

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
        Where a file is not there.
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
    """Files that running a workflow script may run: also scripts next to it that it imports, and plug-ins.

    Plug-ins that are not there are left out: what loads them says which is missing.
    """
    files = [Path(script)]
    for file in files:  # the loop below appends scripts that a script imports
        imported = re.findall(r"^from (\w+) import", file.read_text(encoding="utf-8"), re.MULTILINE)
        shared = [file.with_name(f"{name}.py") for name in imported]
        files += [one for one in shared if one.is_file() and one not in files]
    return find_sources(*files, *(one for one in map(Path, plugins) if one.is_file()))


def plugin_file(reference: str, room: str) -> Path:
    """File of a plug-in given as `wearscope.plugins.load` takes it; it need not exist."""
    if reference.endswith(".py"):
        return Path(reference)
    own = ROOT / room / f"{reference}.py"
    return own if own.is_file() else installed_file(reference, room) or own


@cache
def _imports(file: Path) -> tuple[Path, ...]:
    text = LEFT_OUT.sub("", file.read_text(encoding="utf-8"))
    names: set[str] = set()
    for module, attributes, modules in IMPORT.findall(text):
        listed = [one.split()[0] for one in (attributes or modules).strip("()").split(",") if one.strip()]
        names.update(f"{module}.{one}" if module else one for one in listed)
    return tuple(Path(file) for file in {file for name in names for file in _module_files(name)})


def _module_files(name: str) -> list[str]:
    """Files that importing a dotted name runs: the packages on the way and the module itself."""
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
    """A robot's model file, with what it names.

    Parameters
    ----------
    reference : str
        As the configuration has it.
    allow_code : Allowed
        Code that models may name.

    Raises
    ------
    InputError
        Where the model cannot be read, or names code that is not allowed.
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
        """Model file and URDF."""
        urdf = os.path.join(self.path.parent, self._urdf)
        if not os.path.isfile(urdf) or _BRACES.search(urdf):
            raise InputError(
                f"{self.path}: urdf: {urdf!r} is no file, or its name holds braces; name the robot's URDF."
            )
        return [str(self.path), urdf]

    def list_effect_files(self) -> list[Path]:
        """Files of the effects that the model lists."""
        return [plugin_file(locate_effect(name, self.path.parent), "effects") for name in self.effects]


class NamedDataSet:
    """A measured data set, with the files that its ``dataset.yaml`` names.

    Parameters
    ----------
    path : str
        Its folder or ``dataset.yaml``.

    Raises
    ------
    InputError
        Where there is no such file, or no name for the results' folder in it.
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
        """URDF, runs and own effects that are there; the loop says which is missing."""
        return self._list_files(self.content)

    @property
    def effects(self) -> list[str]:
        """Names of effects that the data set asks for."""
        listed = [self.content.get(field) for field in ("effects", "declared_effects")]
        return [
            name for names in listed if isinstance(names, list) for name in names if isinstance(name, str)
        ]

    def take_session_fields(self, sessions: Collection[str]) -> str:
        """Fields of ``dataset.yaml`` that the runs of some sessions depend on, as YAML."""
        return yaml.safe_dump(self._take_sessions(sessions))

    def list_session_files(self, sessions: Collection[str]) -> list[str]:
        """As `files`, of the runs of some sessions."""
        return self._list_files(self._take_sessions(sessions))

    def _take_sessions(self, sessions: Collection[str]) -> dict[str, Any]:
        content = {key: value for key, value in self.content.items() if key not in ("reference", "runs")}
        listed = self.content.get("runs")
        runs = [run for run in listed if isinstance(run, dict)] if isinstance(listed, list) else []
        own = [run for run in runs if str(take_label(run.get("session"))) in sessions]
        return {**content, "runs": own}

    def _list_files(self, content: Mapping[str, Any]) -> list[str]:
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
    """Refuse a path that Snakemake would read as a pattern."""
    if _BRACES.search(file):
        raise InputError(f"{file}: the path holds a brace or the end of a line; rename that file or folder.")


#: Scripts that a partition runs, without those that load plug-ins.
_PARTITION = (
    "run_partition", "choose_surrogates", "compute_scope", "compute_snr", "validate_surrogates",
    "make_overview", "write_report",
)  # fmt: skip
#: Style sheets and templates of figures and pages, which no import shows.
_LOOKS = ("*.mplstyle", "templates/*", "templates/*/*")


def tell(find: Callable[..., Any], *given: Any) -> Any:
    """Result of a function; where it refuses the input, the run ends with its sentence."""
    try:
        return find(*given)
    except InputError as error:
        raise SystemExit(str(error)) from None


def refuse_without_dataset(wildcards: Any) -> None:
    """End the run in one sentence."""
    raise SystemExit(
        "config: dataset is missing; name a data set, as in snakemake --cores 2 detect --config dataset=PATH"
    )


def list_tracked(sessions: Tracked | None, folder: str) -> list[str]:
    """Files that tracking makes in a folder; the run ends in one sentence if there is nothing to track."""
    if sessions is None:
        raise SystemExit("config: dataset is missing; say which machine to track: --config dataset=PATH.")
    if sessions.refusal:
        raise SystemExit(sessions.refusal)
    return [f"{folder}/{name}" for name in ("tracking.json", "changes.parquet", "report.html")]


class StudyFiles:
    """Files of a study; each answer is kept, as no file changes while jobs are planned.

    Parameters
    ----------
    study : StudyConfig
    folder : str
        Of the results.
    home : str
        Folder of Snakefile and workflow.
    flag : callable
        Marks files that are no results, given as a list of paths.

    Attributes
    ----------
    robots, cycles : dict of str to str
        Model file or name, and test-cycle, by label; robots as they are simulated.
    named_robots : dict of str to str
        Robots as the configuration names them.
    dataset : NamedDataSet or None
    """

    def __init__(
        self, study: StudyConfig, folder: str, home: str, flag: Callable[[list[str]], list[Any]] = list
    ) -> None:
        self.study, self.home, self.flag = study, home, flag
        self.named_robots = {label(reference): reference for reference in study.robots}
        self.robots = self.named_robots | {
            robot: f"{folder}/robots/{robot}.yaml" for robot in self.named_robots if robot in study.carry_over
        }
        #: Model files that a rule makes, with the models that they are made from.
        self.made_models = {
            self.robots[robot]: [self.named_robots[robot], carried.source]
            for robot, carried in study.carry_over.items()
        }
        self.cycles = {label(reference): reference for reference in study.cycles}
        self.dataset = tell(NamedDataSet, study.dataset) if study.dataset is not None else None
        # Snakemake asks for a job's inputs each time that it looks at the job.
        self.code = cache(self._list_code)
        self.read_robot = cache(lambda reference: tell(NamedRobot, reference, study.allow_code))
        self.installed = cache(self._identify_installed)

    def _list_code(self, script: str, *plugins: str) -> list[Any]:
        """Source files that a script's result depends on: itself, what it imports, and plug-ins it loads."""
        files = find_script_sources(f"{self.home}/workflow/scripts/{script}.py", *plugins)
        return self.flag(sorted({os.path.relpath(file) for file in files}))

    def list_partition_code(self) -> list[Any]:
        """Source files that what a partition makes depends on, each once."""
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
        """Model file and URDF of a robot."""
        if reference in self.made_models:
            return [reference, str(Path(reference).with_suffix(".urdf"))]
        return self.flag(tell(self.read_robot(reference).list_files))

    def robot_effects(self, reference: str) -> list[str]:
        """Files of the effects that a robot's model lists, or may list where a rule makes it."""
        if reference in self.made_models:
            sources = self.made_models[reference]
            return [*self.effect_files(), *{file for one in sources for file in self.robot_effects(one)}]
        return self.read_robot(reference).list_effect_files()

    def reevaluated_models(self, references: Iterable[str], loop: str) -> list[Any]:
        """Model files that a reevaluation starts from, those of a closed loop's folder among them."""
        named, lender = list(references), self.study.reevaluate.carry_over
        if lender is not None:
            named.append(lender.source)
        made = {file for file in named if file.startswith(f"{loop}/")}
        return sorted([*made, *(file for one in set(named) - made for file in self.robot_files(one))])

    def detector_files(self) -> list[Path]:
        """Files of the study's detectors."""
        return [plugin_file(detector.use, "detectors") for detector in self.study.detectors.values()]

    def cycle_files(self) -> list[Path]:
        """Files of the study's test-cycles."""
        return [plugin_file(reference, "cycles") for reference in self.study.cycles]

    def effect_files(self) -> list[str]:
        """Files of all effects: whatever closes the loop may try each."""
        return sorted(str(file) for file in (ROOT / "effects").iterdir())

    def own_effects(self) -> list[Any]:
        """Own effects' files that the configuration names and that are there."""
        files = [str(plugin_file(reference, "effects")) for reference in self.study.closed_loop.effects]
        return self.flag([file for file in files if os.path.isfile(file)])

    def own_files(self) -> list[Any]:
        """Files that the configuration names beyond the platform's code: robots, test-cycles, detectors."""
        robots = set(self._list_robots())
        files: list[Any] = [*self.cycle_files(), *self.detector_files()]
        for find in (self.robot_files, self.robot_effects):
            files += [file for reference in robots for file in find(reference)]
        own = {os.path.relpath(file) for file in files if ROOT not in Path(os.path.abspath(file)).parents}
        return self.flag(sorted(own))

    def _list_robots(self) -> Iterable[str]:
        return [*self.named_robots.values(), *(one.source for one in self.study.carry_over.values())]

    def _identify_installed(self, *rooms: str) -> dict[str, Any]:
        """Plug-ins of installed packages, by name and version: dates of their files do not tell changes."""
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
