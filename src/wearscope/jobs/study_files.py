"""Files that jobs depend on: sources of scripts, robots, test-cycles, detectors, effects, a data set."""

import os
from collections.abc import Callable, Iterable
from functools import cache, cached_property
from pathlib import Path
from typing import Any

from wearscope.config import label
from wearscope.config.study import StudyConfig
from wearscope.errors import InputError
from wearscope.jobs.named_files import ROOT, NamedDataSet, NamedRobot, find_script_sources, plugin_file
from wearscope.plugins import identify_installed, is_built_in, list_installed
from wearscope.tracking.session_names import Tracked

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
