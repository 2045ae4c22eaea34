"""Checks a study: its settings, robots, test-cycles and detectors, and whether they suit each other."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir
from functools import partial
from math import prod
from pathlib import Path
from typing import Any

from wearscope import limits
from wearscope.checking.robot import STEP, check_factors, check_model
from wearscope.config import CarryOverSettings, StudyConfig, label, list_breaches, load_config
from wearscope.cycles.base import Cycle, load_cycle
from wearscope.designs.checks import check_design
from wearscope.designs.factors import Factor
from wearscope.designs.kinds import make_design
from wearscope.detectors.base import load_detector
from wearscope.errors import Findings, InputError
from wearscope.robots.friction import carry_over
from wearscope.robots.model import RobotModel, load_model
from wearscope.robots.model_file import Allowed
from wearscope.simulation.feasibility import check_cycle

#: Orders of magnitude: time to evaluate a surrogate in one Monte Carlo run [s]; memory of a sample of one
#: axis [bytes] and of a value in a table [bytes]; duration of a test-cycle [s].
RUN_SECONDS, SAMPLE_BYTES, VALUE_BYTES, CYCLE_SECONDS = 1e-7, 24, 8, 20.0
#: Integration step [s] that the setting `simulation.point_seconds` relates to.
USUAL_STEP = 0.001


def list_excesses(study: StudyConfig) -> Iterator[str]:
    """Yield a sentence for each setting that would take over a year of one core or a terabyte of space."""
    pairs = len(study.robots) * len(study.cycles)
    cells = pairs * len(study.axes) * len(study.detectors)
    points = sum(
        (
            2 * study.design.count_points(study.factors),
            *study.count_filling_points(),
            study.simulation.nominal_runs,
            study.count_audit_points(),
        )
    )
    direct = study.direct.runs + bool(study.direct.mismatch) * study.direct.mismatch_runs
    runs = pairs * points + 2 * direct * study.direct.enabled
    slower = max(1.0, USUAL_STEP / study.simulation.step)
    grid = prod(study.scope.grid) * len(study.scope.factors)
    rate = study.simulation.sample_rate or 250.0
    seconds = {
        "simulation": runs * study.simulation.point_seconds * slower,
        "snr.runs": 2.0 * cells * study.snr.runs * RUN_SECONDS,
        "scope.grid and scope.runs": 2.0 * cells * grid * study.scope.runs * RUN_SECONDS,
    }
    room = {
        "simulation": runs * CYCLE_SECONDS * rate * SAMPLE_BYTES * 6.0,
        "snr.runs": 2.0 * study.snr.runs * len(study.factors) * VALUE_BYTES,
        "scope.grid": cells * grid * 4.0 * VALUE_BYTES,
    }
    for name, taken in seconds.items():
        if taken > limits.YEAR:
            years = taken / limits.YEAR
            yield f"{name}: takes about {years:.2g} years of one core as it is set; make it smaller."
    for name, taken in room.items():
        if taken > limits.TERABYTE:
            yield f"{name}: takes about {taken / 1e12:.2g} TB as it is set; make it smaller."


def check_study(config: Mapping[str, Any], what: str, folder: str | Path = ".") -> Findings:
    """Check a study without simulating anything.

    Parameters
    ----------
    config : mapping
        Configuration as read from YAML.
    what : str
        Name of the study in messages.
    folder : path-like
        Folder that the configuration's relative paths start from.
    """
    found = Findings(what)
    found.add(*list_breaches(config))
    study = None if found.problems else load_config(config)
    with chdir(folder):
        _check_parts(config, study, found)
    return found


def _check_parts(config: Mapping[str, Any], study: StudyConfig | None, found: Findings) -> None:
    """Check robots, test-cycles and detectors.

    `study` is None if other settings are wrong; then each part is checked only by itself.
    """
    allow: Allowed = study.allow_code if study else False
    robots = []
    for name in _take_texts(config.get("robots")):
        model = check_model(name, found, allow)
        carried = study.carry_over.get(label(name)) if study is not None else None
        if model is not None and study is not None and carried is not None:
            complete = partial(_complete, model, carried, allow, study.worn_axes())
            model = found.attempt(complete)
        if model is not None:
            robots.append(model)
    cycles: dict[str, Cycle] = {}
    for name in _take_texts(config.get("cycles")):
        cycle = found.attempt(lambda name=name: load_cycle(name))  # type: ignore[misc]
        if cycle is not None:
            cycles[name] = cycle
    detectors = config.get("detectors")
    for name, one in detectors.items() if isinstance(detectors, Mapping) else ():
        use, options = (one, {}) if isinstance(one, str) else _read_detector(one)
        if use is not None:
            _try_detector(str(name), use, options, found)
    if study is None:
        return
    found.add(*list_excesses(study))
    found.attempt(lambda: _make_design(study))
    ranges = {name: (kind, low, high) for name, (kind, low, high) in study.factor_ranges().items()}
    for model in robots:
        worn = found.attempt(lambda model=model: model.wearing(study.worn_axes()))  # type: ignore[misc]
        if worn is None:
            continue
        model = worn
        known = len(found.problems)
        may_drop = [name for name in ranges if name != "f"] if study.screening == "drop" else []
        check_factors(model, ranges, found, study.simulation.sample_rate, cycles, may_drop)
        if len(found.problems) > known:
            continue
        for name, cycle in cycles.items():
            found.attempt(
                lambda model=model, cycle=cycle, name=name: check_cycle(model, cycle, name, ranges, 10 * STEP)  # type: ignore[misc]
            )
    points = study.design.count_points(study.factors)
    runs = points * 2 * len(robots) * len(cycles)
    cells = len(robots) * len(cycles) * len(study.axes) * len(study.detectors)
    found.notes.append(f"{cells} cells; {points} design points, {runs} simulations of the paper's design.")


def _make_design(study: StudyConfig) -> None:
    """Refuse a design that cannot be made, or has too few points for the study's surrogates."""
    factors = [Factor(**one) for one in study.factor_table()]
    design = make_design(study.design.kind, factors, study.design.options(), study.seed)
    check_design(design, factors, study.surrogates.models, study.axes)


def _complete(
    model: RobotModel, carried: CarryOverSettings, allow: Allowed, worn: Sequence[int]
) -> RobotModel:
    """Return the robot as it is simulated: with the effects that it takes over from another model."""
    source = load_model(carried.source, allow_code=allow)
    return carry_over(model, source, carried.effects, carried.reference, worn)


def _take_texts(value: Any) -> list[str]:
    """Return the texts of a list in an unchecked configuration; other entries are reported elsewhere."""
    return [one for one in value if isinstance(one, str)] if isinstance(value, list) else []


def _read_detector(one: Any) -> tuple[str | None, dict[str, Any]]:
    """Return ``use`` and ``options`` of a detector in an unchecked configuration; ``use`` may be None."""
    if not isinstance(one, Mapping) or not isinstance(one.get("use"), str):
        return None, {}
    options = one.get("options")
    return one["use"], dict(options) if isinstance(options, Mapping) else {}


def _try_detector(name: str, use: str, options: dict[str, Any], found: Findings) -> None:
    """Load a detector; add a problem if that fails."""
    try:
        load_detector(use, options)
    except InputError as error:
        found.add(f"detectors.{name}: {error}")
