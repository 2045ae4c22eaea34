"""Fits every detector and evaluates it on every batch, one after the other."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from wearscope import plugins
from wearscope.detectors.base import Batch, Detector, load_detector, make_detector
from wearscope.errors import InputError, tell_error
from wearscope.supervision import ProcessLost, run_supervised

if TYPE_CHECKING:
    from wearscope.robots.model import RobotModel

OK = "ok"
#: A design point: set, and number in the set.
Key = tuple[str, int]
#: Test quantity and status.
Answer = tuple[float, str]
#: A design point, and the column, which numbers the combinations of axis and detector.
Question = tuple[Key, int]


@dataclass(frozen=True)
class DetectorSpec:
    """A detector of the study.

    Attributes
    ----------
    name : str
        Name in the column `fda`.
    reference : str
        Module of `wearscope.detectors` or path of a ``.py`` file.
    options : mapping
        Keyword arguments of the detector.
    """

    name: str
    reference: str
    options: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Questions:
    """The batches and detectors that `collect_answers` evaluates.

    Attributes
    ----------
    batches, detectors, axes, model, nominal
        As in `wearscope.detectors.run.compute_test_quantities`.
    where : str
        Robot and test-cycle, for messages.
    wanted : set of (set, point)
        Design points.
    failed : set of (set, point)
        Design points whose simulation failed.
    options : mapping of (detector's name, (set, point)) to mapping
        Options that differ at a point, as they are factors of the study.
    """

    batches: Iterable[tuple[str, int, Batch]]
    detectors: Sequence[DetectorSpec]
    axes: Sequence[int]
    model: "RobotModel"
    nominal: Sequence[Batch]
    where: str
    wanted: AbstractSet[Key]
    failed: AbstractSet[Key]
    options: Mapping[tuple[str, Key], Mapping[str, float]] = field(default_factory=dict)

    def name_cell(self, column: int) -> str:
        """Name the detector, robot, test-cycle and axis of a column, for messages."""
        axis, spec = divmod(column, len(self.detectors))
        return f"fda '{self.detectors[spec].name}', {self.where}, axis {self.axes[axis]}"


def collect_answers(
    questions: Questions,
    allowed: Mapping[str, float],
    time_limit: float | None = None,
    report: Callable[[int], None] | None = None,
) -> tuple[dict[Question, Answer], list[Key]]:
    """Fit all detectors, and evaluate each on each batch.

    Parameters
    ----------
    questions : Questions
    allowed : mapping of str to float
        By set, the number of points at which a detector may be lost.
    time_limit : float, optional
        Longest time for a fit or a test quantity [s]. The detectors then run in a process of their own;
        without a limit they run in this one.
    report : callable, optional
        Called after each batch with the number of batches done.

    Returns
    -------
    answers : dict
        Test quantity and status by point and column.
    complete : list of (set, point)
        Points of the batches, in their order.

    Raises
    ------
    InputError
        Where a detector cannot be fitted, returns no number, or crashes or exceeds the time limit at more
        points than allowed; where a batch is in no design or comes twice.
    """
    answers: dict[Question, Answer] = {}
    complete: dict[Key, None] = {}
    lost: dict[tuple[str, int], int] = {}

    def work() -> Iterator[tuple]:
        return _ask_all(questions, frozenset(answers))

    while True:
        asked: Question | None = None
        at = questions.where
        try:
            for message in work() if time_limit is None else run_supervised(work, time_limit):
                match message:
                    case ("fit", column):
                        at = f"{questions.name_cell(column)}: fit"
                    case ("ask", question):
                        asked = question
                    case ("answer", answer):
                        assert asked is not None
                        answers[asked], asked = answer, None
                    case ("batch", key):
                        complete[key] = None
                        if report is not None:
                            report(len(complete))
            return answers, list(complete)
        except ProcessLost as error:
            if asked is None:
                raise InputError(f"{at} {error}; correct it, or raise time_limit.") from None
            answers[asked] = (math.nan, str(error))
            (set_name, point), column = asked
            lost[set_name, column] = lost.get((set_name, column), 0) + 1
            if lost[set_name, column] > allowed[set_name]:
                raise InputError(
                    f"{questions.name_cell(column)}: {error} at {lost[set_name, column]} {set_name} points, "
                    f"the last is {point}, more than the share allowed; correct the detector, or raise "
                    "time_limit or max_failed_share."
                ) from None


def _ask_all(questions: Questions, answered: AbstractSet[Question]) -> Iterator[tuple]:
    """Yield a message before each fit, before and after each test quantity, and after each batch.

    Test quantities that are answered already are left out: the process may have been restarted.
    """
    fitted = []
    varied: dict[tuple, Detector] = {}
    for column, detector in enumerate(_make_all(questions)):
        yield "fit", column
        _fit(detector, questions, column)
        fitted.append(detector)
    seen: set[Key] = set()
    for set_name, number, batch in questions.batches:
        key = (set_name, int(number))
        _check_key(key, seen, questions)
        seen.add(key)
        for column, detector in enumerate(fitted):
            if (key, column) not in answered:
                changed = _name_options(questions, column, key)
                if changed and (column, changed) not in varied:
                    yield "fit", column
                    varied[column, changed] = _make_varied(questions, column, dict(changed))
                detector = varied.get((column, changed), detector)
                yield "ask", (key, column)
                yield (
                    "answer",
                    ask_detector(
                        detector, batch, f"{questions.name_cell(column)}, {set_name} point {key[1]}"
                    ),
                )
        yield "batch", key


def _name_options(questions: Questions, column: int, key: Key) -> tuple[tuple[str, float], ...]:
    """Return the options of a column's detector that differ at a point."""
    name = questions.detectors[column % len(questions.detectors)].name
    return tuple(questions.options.get((name, key), {}).items())


def _make_varied(questions: Questions, column: int, changed: Mapping[str, float]) -> Detector:
    """Make a column's detector with changed options, and fit it."""
    spec = questions.detectors[column % len(questions.detectors)]
    detector = load_detector(spec.reference, {**spec.options, **changed})
    _fit(detector, questions, column)
    return detector


def _check_key(key: Key, seen: AbstractSet[Key], questions: Questions) -> None:
    """Refuse a batch of a failed simulation, a second batch of a point, and a point of no design."""
    set_name, point = key
    if key in questions.failed:
        raise InputError(
            f"{questions.where}: the simulation of set '{set_name}', point {point} failed, yet it has a "
            "batch; delete the trace."
        )
    if key in seen:
        raise InputError(f"{questions.where}: point {point} of set '{set_name}' has two batches; keep one.")
    if key not in questions.wanted:
        raise InputError(
            f"{questions.where}: the batch of set '{set_name}', point {point} is in no design; "
            "delete the trace or give its design."
        )


def _make_all(questions: Questions) -> Iterator[Detector]:
    """Yield a detector for each column: all detectors of the first axis, then of the next."""
    # A user's file is imported once, not once for each axis.
    factories = [plugins.load(spec.reference, "detectors", "DETECTOR") for spec in questions.detectors]
    for _ in questions.axes:
        for spec, factory in zip(questions.detectors, factories, strict=True):
            yield make_detector(factory, spec.reference, spec.options)


def _fit(detector: Detector, questions: Questions, column: int) -> None:
    """Fit a column's detector to the nominal batches; an error of the detector becomes InputError."""
    model = questions.model
    axis = questions.axes[column // len(questions.detectors)]
    try:
        detector.fit(questions.nominal, model.joints.index(model.axes[axis - 1]), model)
    except (Exception, SystemExit) as error:
        raise InputError(
            f"{questions.name_cell(column)}: cannot be fitted to the nominal batch, {tell_error(error)}; "
            "correct the detector or its data, or leave it out of the study."
        ) from error


def ask_detector(detector: Detector, batch: Batch, where: str) -> Answer:
    """Return test quantity and status of one batch; NaN and the reason where the detector fails.

    Raises
    ------
    InputError
        Where the detector does not return a single number.
    """
    try:
        value = detector.test_quantity(batch)
    except (Exception, SystemExit) as error:
        return math.nan, tell_error(error)
    number = np.asarray(value)
    if number.ndim or number.dtype.kind not in "iuf":
        kind = f"an array of shape {number.shape}" if number.ndim else f"{type(value).__name__}"
        raise InputError(
            f"{where}: test_quantity returned {kind}, not a number; make it return one float a batch."
        )
    y = float(number)
    return (y, OK) if math.isfinite(y) else (math.nan, f"returned {y}")
