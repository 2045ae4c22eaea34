"""How a study is cut into jobs: the points of each set, the files of their chunks, memory and time."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

from wearscope.config import label
from wearscope.config.study import StudyConfig
from wearscope.storage.verdicts import drawn_path

#: Memory [bytes] that joining test quantities takes a point and cell: 330 were measured (docs/cluster.md).
CELL_BYTES = 350


@dataclass(frozen=True)
class Plan:
    """Sets, chunks and files of a study.

    Attributes
    ----------
    study : StudyConfig
    folder : str
        Of the results.
    packs : bool
        Whether the recordings of a chunk are one file.
    drops : bool
        Whether they are such a file for as long as they are needed, except those of nominal runs.
    """

    study: StudyConfig
    folder: str
    packs: bool
    drops: bool = False

    @cached_property
    def points(self) -> dict[str, int]:
        """Number of points of each set."""
        designed = self.study.design.count_points(self.study.factors)
        filling, checking = self.study.count_filling_points()
        asked = self.study.direct
        apart = {
            "mismatch": 2 * min(asked.mismatch_runs, asked.runs),
            "mismatch_nominal": self.study.simulation.nominal_runs,
        }
        return {
            "identification": designed,
            "validation": designed,
            "filling": filling,
            "checking": checking,
            "nominal": self.study.simulation.nominal_runs,
            "audit": self.study.count_audit_points(),
            "recheck": 4 * len(self.study.audit.places) * len(self.study.scope.factors),
            "direct": 2 * asked.runs,
            **(apart if asked.mismatch else {}),
        }

    def nominal_of(self, name: str) -> str:
        """Set whose runs the detectors are fitted to before they are evaluated at a set's points."""
        return "mismatch_nominal" if name == "mismatch" else "nominal"

    @cached_property
    def run_sets(self) -> list[str]:
        """Sets with a test quantity in every cell."""
        more = ["filling", "checking"] if self.study.surrogates.filling.enabled else []
        return ["identification", "validation", *more]

    @cached_property
    def study_sets(self) -> list[str]:
        """Sets that are simulated for the test quantities."""
        return [*self.run_sets, "nominal"]

    @cached_property
    def points_per_job(self) -> int:
        """Points that one job simulates."""
        return self.study.simulation.points_per_job()

    @cached_property
    def scope_figures(self) -> list[str]:
        """Figures of the scope, one for each of its factors."""
        return [f"scope_{factor}" for factor in self.study.scope.factors]

    @cached_property
    def finding_figures(self) -> list[str]:
        """Figures that answer the study's questions."""
        return ["sensitivity", "snr", *self.scope_figures]

    @cached_property
    def figures(self) -> list[str]:
        """All figures of the study; where it is divided, those that show each cell are the partitions'."""
        return self.scope_figures if self.study.divide() else self.finding_figures

    @cached_property
    def categories(self) -> dict[str, str]:
        """Category of a figure in Snakemake's report."""
        return {
            "sensitivity": "Q-1: which factors matter",
            "snr": "Q-2: which detector is best",
            **dict.fromkeys(self.scope_figures, "Q-3: where it works"),
        }

    @cached_property
    def compares_direct(self) -> bool:
        """Whether direct Monte Carlo is shown next to the chosen surrogate's answer."""
        return self.study.direct.enabled and self.study.snr.model == "chosen" and not self.study.divide()

    @cached_property
    def reevaluates(self) -> bool:
        """Whether the study says what a correction changes: a loop is closed, or both models are given."""
        asked = self.study.reevaluate
        closed = self.study.closed_loop.demonstration or self.study.dataset is not None
        return asked.enabled and bool(closed or asked.before)

    @cached_property
    def audited(self) -> list[str]:
        """Test-cycles whose answers are checked directly, by label."""
        return [label(one) for one in self.study.cycles[: self.study.audit.cycles]]

    @cached_property
    def join_minutes(self) -> int:
        """Time [min] for what goes through all robots: 1.5 s a robot were measured (docs/cluster.md)."""
        return max(20, len(self.study.robots) // 10)

    def asked_of(self, model: str, find: Callable[[str], Any] | None = None) -> Callable[..., dict[str, Any]]:
        """Input function: tables for a section's surrogates, at the places that `find` gives."""
        find = find or (lambda table: f"{self.folder}/{table}.parquet")
        files = {"surrogates": find("surrogates")}
        if model == "chosen":
            files |= {"chosen": find("chosen_surrogates"), "test_quantities": find("test_quantities")}
        return lambda wildcards: files

    def parts(self, table: str, *each: str) -> list[str]:
        """Parts that a study's table is joined from: a table for each robot, test-cycle or partition."""
        if divided := self.study.divide():
            numbers = [part.partitions.number for part in divided]
            return [f"{self.folder}/partitions/{number:05d}/{table}.parquet" for number in numbers]
        pattern = f"{self.folder}/{'/'.join(each)}.parquet"
        pairs = product(map(label, self.study.robots), map(label, self.study.cycles))
        return list(dict.fromkeys(pattern.format(robot=robot, cycle=cycle) for robot, cycle in pairs))

    def whole(self, table: str) -> list[str]:
        """A table of the study: one file, or a file for each partition."""
        return self.parts(table) if self.study.divide() else [f"{self.folder}/{table}.parquet"]

    def figure_files(
        self, names: Iterable[str], folder: str, mark: Callable[..., Any] = lambda file, **about: file
    ) -> dict[str, Any]:
        """SVG files, marked with what Snakemake's `report` takes, and PNG files of figures in a folder."""
        files = {}
        for name in names:
            caption = "scope" if name in self.scope_figures else name
            files[f"{name}_svg"] = mark(
                f"{folder}/figures/{name}.svg",
                caption=f"../report/{caption}.rst",
                category=self.categories[name],
                labels={"figure": name.replace("_", " ")},
            )
            files[f"{name}_png"] = mark(f"{folder}/figures/{name}.png")
        return files

    def recordings_of(self, sets: Iterable[str], chunk: str = "0") -> list[str]:
        """Patterns of the files of a chunk's recordings, by set, where they are packed."""
        folder = f"{self.folder}/traces/{{robot}}/{{cycle}}"
        return [f"{folder}/{name}/_chunk-{chunk}.tar" for name in self.packed_sets(*sets)]

    def rechecked(self, design: str) -> list[str]:
        """Test quantities of the audit's second look; none where its design has no point."""
        from pyarrow.parquet import read_metadata

        if not read_metadata(design).num_rows:
            return []
        pairs = product(map(label, self.study.robots), self.audited)
        return [f"{self.folder}/parts/recheck_quantities/{robot}/{cycle}.parquet" for robot, cycle in pairs]

    def drawn_files(self, folder: str, *sides: str) -> list[str]:
        """Models of sides of a correction that a closed loop in a folder draws, in addition to its own."""
        numbers = range(1, self.study.reevaluate.draws + 1)
        return [f"{folder}/{drawn_path(side, k)}" for side in sides for k in numbers]

    def chunks(self, name: str) -> range:
        """Numbers of the chunks into which a set's points are cut."""
        return range(-(-self.points[name] // self.points_per_job))

    def traces(self, robot: str, cycle: str, *sets: str) -> list[str]:
        """Markers of the simulated chunks of some sets."""
        folder = f"{self.folder}/traces/{robot}/{cycle}"
        return [f"{folder}/{name}/_chunk-{chunk}.json" for name in sets for chunk in self.chunks(name)]

    def packed_sets(self, *sets: str) -> list[str]:
        """Those sets whose recordings are packed, a file for each chunk."""
        return [one for one in sets if self.packs or (self.drops and "nominal" not in one)]

    def packed(self, robot: str, cycle: str, *sets: str) -> list[str]:
        """Files with the packed recordings of some sets, one a chunk."""
        markers = self.traces(robot, cycle, *self.packed_sets(*sets))
        return [marker.replace(".json", ".tar") for marker in markers]

    def quantity_chunks(self, *sets: str) -> list[tuple[str, int]]:
        """Set and number of the chunks in which test quantities are computed; none where one job does all."""
        size = self.study.simulation.quantities_per_job()
        if size is None or sum(self.points[name] for name in sets) <= size:
            return []
        return [(name, chunk) for name in sorted(sets) for chunk in range(-(-self.points[name] // size))]

    def quantity_inputs(self, *sets: str) -> dict[str, Any]:
        """Inputs of the test quantities of some sets: traces, or test quantities of their chunks."""
        simulated, cut = [*sets, self.nominal_of(sets[0])], self.quantity_chunks(*sets)
        folder = f"{self.folder}/parts/quantity_chunks/{{robot}}/{{cycle}}"
        return {
            "traces": lambda w: [] if cut else self.traces(w.robot, w.cycle, *simulated),
            "recordings": lambda w: [] if cut else self.packed(w.robot, w.cycle, *simulated),
            "parts": [f"{folder}/{name}-{chunk}.parquet" for name, chunk in cut],
            "failed": [f"{folder}/{name}-{chunk}-failed.parquet" for name, chunk in cut],
        }

    def quantity_traces(self, list_files: Callable[..., list[str]], w: Any) -> list[str]:
        """Files, by `list_files`, of the nominal runs and of the points of a chunk of test quantities."""
        size, first = self.study.simulation.quantities_per_job(), int(w.chunk)
        assert size is not None, "there are chunks"
        last = min((first + 1) * size, self.points[w.set]) - 1
        held = slice(first * size // self.points_per_job, last // self.points_per_job + 1)
        return [
            *list_files(w.robot, w.cycle, w.set)[held],
            *list_files(w.robot, w.cycle, self.nominal_of(w.set)),
        ]

    def quantity_memory(self, *sets: str) -> int:
        """Memory [MiB] for the test quantities of some sets."""
        cells = len(self.study.axes) * len(self.study.detectors)
        return 1200 + round(CELL_BYTES * sum(self.points[name] for name in sets) * cells / 2**20)

    def job_minutes(self) -> int:
        """Time [min] for a job of a given number of points: three times the stated time."""
        return max(20, round(3 * (self.study.simulation.job_seconds or 0) / 60))

    def partition_minutes(self) -> int:
        """Time [min] for a partition: three times the stated time of its points."""
        points = sum(self.points[name] for name in self.study_sets)
        points *= len(self.study.cycles) * self.study.partitions.robots
        seconds = points * (self.study.simulation.point_seconds + self.study.simulation.quantity_seconds)
        return max(60, round(3 * seconds / self.study.partitions.threads / 60))


def needs(mib: int, minutes: int) -> dict[str, Callable[..., int]]:
    """Memory [MiB] and time [min] that a job asks a cluster for, more each time that it is tried again.

    Memory is 1.6 to 2.4 times the largest that was measured (docs/cluster.md); times are generous guesses.
    Resources that a rule does not state are in profiles/default.
    """
    return {
        "mem_mb": lambda wildcards, attempt: attempt * mib,
        "runtime": lambda wildcards, attempt: attempt * minutes,
    }
