"""Divides a study into jobs: points of each set, files of each chunk, memory and time of each job."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

from wearscope.config import label
from wearscope.config.study import StudyConfig
from wearscope.storage.verdicts import drawn_path

#: Memory [bytes] for joining test quantities, per point and cell; measured: 330 (docs/cluster.md).
CELL_BYTES = 350


@dataclass(frozen=True)
class Plan:
    """Sets of points of a study, the chunks that they are divided into, and the files of both.

    Attributes
    ----------
    study : StudyConfig
    folder : str
        Folder of the study's results.
    packs : bool
        Whether the recordings of each chunk are packed into one file, which is kept.
    drops : bool
        Whether they are packed into one file that is deleted once no job needs it; recordings of nominal runs
        are then not packed and are kept.
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
        """Return the set of nominal runs that detectors are fitted to before evaluation on a given set."""
        return "mismatch_nominal" if name == "mismatch" else "nominal"

    @cached_property
    def run_sets(self) -> list[str]:
        """Sets whose runs get a test quantity in every cell: each measurement axis with each detector."""
        more = ["filling", "checking"] if self.study.surrogates.filling.enabled else []
        return ["identification", "validation", *more]

    @cached_property
    def study_sets(self) -> list[str]:
        """Sets that are simulated to compute the test quantities: `run_sets` and the nominal runs."""
        return [*self.run_sets, "nominal"]

    @cached_property
    def points_per_job(self) -> int:
        """Points that one job simulates."""
        return self.study.simulation.points_per_job()

    @cached_property
    def scope_figures(self) -> list[str]:
        """Names of the scope's figures, one for each of its factors."""
        return [f"scope_{factor}" for factor in self.study.scope.factors]

    @cached_property
    def finding_figures(self) -> list[str]:
        """Names of the figures that answer the study's three questions."""
        return ["sensitivity", "snr", *self.scope_figures]

    @cached_property
    def figures(self) -> list[str]:
        """Names of the study's own figures; in a divided study each partition draws the other figures."""
        return self.scope_figures if self.study.divide() else self.finding_figures

    @cached_property
    def categories(self) -> dict[str, str]:
        """Category in Snakemake's report, by figure."""
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
        """Whether the study is evaluated before and after a correction of the model.

        This needs a closed loop, or the two models in the configuration.
        """
        asked = self.study.reevaluate
        closed = self.study.closed_loop.demonstration or self.study.dataset is not None
        return asked.enabled and bool(closed or asked.before)

    @cached_property
    def audited(self) -> list[str]:
        """Labels of the test-cycles whose answers the audit checks by direct simulation."""
        return [label(one) for one in self.study.cycles[: self.study.audit.cycles]]

    @cached_property
    def join_minutes(self) -> int:
        """Time [min] of a job that goes through all robots: 6 s a robot, measured 1.5 s (docs/cluster.md)."""
        return max(20, len(self.study.robots) // 10)

    def asked_of(self, model: str, find: Callable[[str], Any] | None = None) -> Callable[..., dict[str, Any]]:
        """Return a Snakemake input function: the tables that evaluating a kind of surrogate needs.

        Parameters
        ----------
        model : str
            Kind of surrogate; "chosen" also needs the choice for each cell and the test quantities.
        find : callable, optional
            Returns the files of a table, given its name; by default one file in the study's folder.
        """
        find = find or (lambda table: f"{self.folder}/{table}.parquet")
        files = {"surrogates": find("surrogates")}
        if model == "chosen":
            files |= {"chosen": find("chosen_surrogates"), "test_quantities": find("test_quantities")}
        return lambda wildcards: files

    def parts(self, table: str, *each: str) -> list[str]:
        """List the files that a study's table is joined from.

        A divided study has a file for each partition. Any other has a file for each combination of the
        wildcards in `each`, such as ``{robot}`` and ``{cycle}``.
        """
        if divided := self.study.divide():
            numbers = [part.partitions.number for part in divided]
            return [f"{self.folder}/partitions/{number:05d}/{table}.parquet" for number in numbers]
        pattern = f"{self.folder}/{'/'.join(each)}.parquet"
        pairs = product(map(label, self.study.robots), map(label, self.study.cycles))
        return list(dict.fromkeys(pattern.format(robot=robot, cycle=cycle) for robot, cycle in pairs))

    def whole(self, table: str) -> list[str]:
        """List the files of a complete table of the study: one, or one for each partition."""
        return self.parts(table) if self.study.divide() else [f"{self.folder}/{table}.parquet"]

    def figure_files(
        self, names: Iterable[str], folder: str, mark: Callable[..., Any] = lambda file, **about: file
    ) -> dict[str, Any]:
        """Return SVG and PNG files of figures, by name and format, such as ``snr_svg``.

        `mark` is Snakemake's `report`, which puts the SVG files into its report with caption and category.
        """
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
        """List file patterns, with wildcards, of a chunk's packed recordings, one for each packed set."""
        folder = f"{self.folder}/traces/{{robot}}/{{cycle}}"
        return [f"{folder}/{name}/_chunk-{chunk}.tar" for name in self.packed_sets(*sets)]

    def rechecked(self, design: str) -> list[str]:
        """List the files of test quantities at the audit's second points; none where the design is empty."""
        from pyarrow.parquet import read_metadata

        if not read_metadata(design).num_rows:
            return []
        pairs = product(map(label, self.study.robots), self.audited)
        return [f"{self.folder}/parts/recheck_quantities/{robot}/{cycle}.parquet" for robot, cycle in pairs]

    def drawn_files(self, folder: str, *sides: str) -> list[str]:
        """List the models that a closed loop draws from its uncertainty, before or after correction."""
        numbers = range(1, self.study.reevaluate.draws + 1)
        return [f"{folder}/{drawn_path(side, k)}" for side in sides for k in numbers]

    def chunks(self, name: str) -> range:
        """Return the numbers of the chunks that a set's points are divided into."""
        return range(-(-self.points[name] // self.points_per_job))

    def traces(self, robot: str, cycle: str, *sets: str) -> list[str]:
        """List the marker files of the simulated chunks of some sets; a chunk writes its marker last."""
        folder = f"{self.folder}/traces/{robot}/{cycle}"
        return [f"{folder}/{name}/_chunk-{chunk}.json" for name in sets for chunk in self.chunks(name)]

    def packed_sets(self, *sets: str) -> list[str]:
        """Return those of the given sets whose recordings are packed into a file for each chunk."""
        return [one for one in sets if self.packs or (self.drops and "nominal" not in one)]

    def packed(self, robot: str, cycle: str, *sets: str) -> list[str]:
        """List the files with the packed recordings of some sets, one for each chunk."""
        markers = self.traces(robot, cycle, *self.packed_sets(*sets))
        return [marker.replace(".json", ".tar") for marker in markers]

    def quantity_chunks(self, *sets: str) -> list[tuple[str, int]]:
        """List the chunks, as (set, number), for computing test quantities; empty where one job does all."""
        size = self.study.simulation.quantities_per_job()
        if size is None or sum(self.points[name] for name in sets) <= size:
            return []
        return [(name, chunk) for name in sorted(sets) for chunk in range(-(-self.points[name] // size))]

    def quantity_inputs(self, *sets: str) -> dict[str, Any]:
        """Return the inputs of a job that gives the test quantities of some sets.

        They are the recordings, or the test quantities of chunks where other jobs compute those.
        """
        simulated, cut = [*sets, self.nominal_of(sets[0])], self.quantity_chunks(*sets)
        folder = f"{self.folder}/parts/quantity_chunks/{{robot}}/{{cycle}}"
        return {
            "traces": lambda w: [] if cut else self.traces(w.robot, w.cycle, *simulated),
            "recordings": lambda w: [] if cut else self.packed(w.robot, w.cycle, *simulated),
            "parts": [f"{folder}/{name}-{chunk}.parquet" for name, chunk in cut],
            "failed": [f"{folder}/{name}-{chunk}-failed.parquet" for name, chunk in cut],
        }

    def quantity_traces(self, list_files: Callable[..., list[str]], w: Any) -> list[str]:
        """List files of the simulated chunks that a chunk of test quantities needs, and of the nominal runs.

        `list_files` is `traces` or `packed`; `w` holds the wildcards robot, cycle, set and chunk.
        """
        size, first = self.study.simulation.quantities_per_job(), int(w.chunk)
        assert size is not None, "there are chunks"
        last = min((first + 1) * size, self.points[w.set]) - 1
        held = slice(first * size // self.points_per_job, last // self.points_per_job + 1)
        return [
            *list_files(w.robot, w.cycle, w.set)[held],
            *list_files(w.robot, w.cycle, self.nominal_of(w.set)),
        ]

    def quantity_memory(self, *sets: str) -> int:
        """Return the memory [MiB] of a job that joins the test quantities of some sets."""
        cells = len(self.study.axes) * len(self.study.detectors)
        return 1200 + round(CELL_BYTES * sum(self.points[name] for name in sets) * cells / 2**20)

    def job_minutes(self) -> int:
        """Return the time limit [min] of a job: three times the stated ``job_seconds``, at least 20."""
        return max(20, round(3 * (self.study.simulation.job_seconds or 0) / 60))

    def partition_minutes(self) -> int:
        """Return the time limit [min] of a partition: three times its points' stated time, at least 60."""
        points = sum(self.points[name] for name in self.study_sets)
        points *= len(self.study.cycles) * self.study.partitions.robots
        seconds = points * (self.study.simulation.point_seconds + self.study.simulation.quantity_seconds)
        return max(60, round(3 * seconds / self.study.partitions.threads / 60))


def needs(mib: int, minutes: int) -> dict[str, Callable[..., int]]:
    """Return a rule's resources: memory [MiB] and time [min], multiplied by the number of the attempt.

    Rules state 1.6 to 2.4 times the largest measured memory (docs/cluster.md) and times guessed generously.
    Rules without resources take those of profiles/default.
    """
    return {
        "mem_mb": lambda wildcards, attempt: attempt * mib,
        "runtime": lambda wildcards, attempt: attempt * minutes,
    }
