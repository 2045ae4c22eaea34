"""Computes the test quantities of one robot and test-cycle: every detector, axis and batch.

An option of a detector may be a factor of the study, of the kind ``detectors.<name>.<option>``.
"""

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc

from wearscope import plugins
from wearscope.designs.checks import view_for_axis
from wearscope.designs.factors import PAPER_FACTORS, Factor
from wearscope.detectors.base import Batch
from wearscope.detectors.questions import OK, DetectorSpec, Questions, collect_answers
from wearscope.errors import InputError

if TYPE_CHECKING:
    from wearscope.robots.model import RobotModel

#: Beginning of the status of a point whose simulation failed, so that no detector could be evaluated.
NOT_SIMULATED = "simulation failed: "


def compute_test_quantities(
    batches: Iterable[tuple[str, int, Batch]],
    detectors: Sequence[DetectorSpec],
    axes: Sequence[int],
    model: "RobotModel",
    nominal: Sequence[Batch],
    *,
    robot: str,
    cycle: str,
    designs: Mapping[str, pd.DataFrame],
    factors: Sequence[Factor] = PAPER_FACTORS,
    max_failed_share: float = 0.05,
    failed_simulations: Mapping[tuple[str, int], str] | None = None,
    report: Callable[[int], None] | None = None,
    time_limit: float | None = None,
    sizes: Mapping[str, int] | None = None,
) -> pd.DataFrame:
    """Fit every detector to the nominal batches of each axis, then evaluate it on each batch.

    Parameters
    ----------
    batches : iterable of (set, point, Batch)
        Recordings in any order; only one is in memory at a time.
    detectors : sequence of DetectorSpec
    axes : sequence of int
        Tested axes, counted as in `RobotModel.axes`.
    model : RobotModel
        The nominal declared model.
    nominal : sequence of Batch
        Recordings of this robot and test-cycle without wear.
    robot, cycle : str
    designs : mapping of str to DataFrame
        Design table by set, with `point` and the coded factors. Each point must have a batch or a failed
        simulation.
    factors : sequence of Factor
    max_failed_share : float
        Largest share of a cell's points that may fail in each set, in simulation or in the detector.
    failed_simulations : mapping of (set, point) to str, optional
        Reason by design point whose simulation failed; it has no batch.
    report : callable, optional
        Called after each batch with the number of batches done.
    time_limit : float, optional
        Longest time for a fit or a test quantity [s]. The detectors then run in a process of their own, which
        also reads the batches. A test quantity that takes longer or crashes the process is a failed point.
    sizes : mapping of str to int, optional
        Number of points of each whole set, where `designs` holds a chunk of it; the share refers to the whole
        set.

    Returns
    -------
    DataFrame
        One row for each axis, detector, set and point, in that order: `robot`, `cycle`, `axis`, `fda`, `set`,
        `point`, the coded factors with the axis's own wear as ``f``, `y`, and `status`, which is ``ok`` or,
        for a NaN `y`, the reason in one line.

    Raises
    ------
    InputError
        Where a detector cannot be made or fitted, returns no number, or fails at more points than the share
        allows; where a design point has no batch, a batch has no design point, or a failed simulation has a
        batch.
    """
    where = f"robot {robot}, cycle {cycle}"
    _check_specs(detectors, axes, model, where)
    cells = [(axis, spec) for axis in axes for spec in detectors]
    wanted = {(name, int(point)) for name, design in designs.items() for point in design["point"]}
    failed = {key: reason for key, reason in (failed_simulations or {}).items() if key in wanted}
    options = vary_options(detectors, designs, factors)
    questions = Questions(batches, detectors, axes, model, nominal, where, wanted, frozenset(failed), options)
    sizes = {name: len(design) for name, design in designs.items()} | dict(sizes or {})
    shares = {name: max_failed_share * size for name, size in sizes.items()}
    answers, complete = collect_answers(questions, shares, time_limit, report)
    results = {key: [answers[key, column] for column in range(len(cells))] for key in complete}
    results |= {key: [(math.nan, f"{NOT_SIMULATED}{failed[key]}")] * len(cells) for key in sorted(failed)}
    missing = sorted(wanted - results.keys())
    if missing:
        raise InputError(
            f"{where}: {len(missing)} design points have no batch, the first is point {missing[0][1]} of set "
            f"'{missing[0][0]}'; simulate them first."
        )
    parts = []
    for column, (axis, spec) in enumerate(cells):
        outcomes = {key: answers[column] for key, answers in results.items()}
        cell = _tabulate(designs, outcomes, axis, factors)
        check_failed_share(cell, f"fda '{spec.name}', {where}, axis {axis}", max_failed_share, sizes)
        parts.append(cell.assign(robot=robot, cycle=cycle, axis=axis, fda=spec.name))
    names = [factor.name for factor in factors]
    table = pd.concat(parts, ignore_index=True)
    return table[["robot", "cycle", "axis", "fda", "set", "point", *names, "y", "status"]]


def join_test_quantities(
    chunks: Sequence[pa.Table], detectors: Sequence[str], axes: Sequence[int], max_failed_share: float
) -> pa.Table:
    """Join the tables of chunks to one, in the order of `compute_test_quantities`.

    Parameters
    ----------
    chunks : sequence of pyarrow.Table
        Tables from `compute_test_quantities` for the chunks, sorted by set and point.
    detectors : sequence of str
        Names in the column `fda`.
    axes : sequence of int
    max_failed_share : float
        Largest share of a cell's points that may fail in each set.

    Raises
    ------
    InputError
        Where a chunk holds other cells than expected, or a detector failed at more points than the share
        allows.
    """
    cells = [(axis, fda) for axis in axes for fda in detectors]
    joined = []
    for number, (axis, fda) in enumerate(cells):
        cell = pa.concat_tables(
            one.slice(number * (one.num_rows // len(cells)), one.num_rows // len(cells)) for one in chunks
        )
        if not pc.all(pc.and_(pc.equal(cell["axis"], axis), pc.equal(cell["fda"], fda))).as_py():
            raise InputError(f"a chunk holds no cell of axis {axis} and fda '{fda}'; compute it again.")
        sizes = {row["values"]: row["counts"] for row in pc.value_counts(cell["set"]).to_pylist()}
        robot, cycle = cell["robot"][0].as_py(), cell["cycle"][0].as_py()
        where = f"fda '{fda}', robot {robot}, cycle {cycle}, axis {axis}"
        check_failed_share(
            cell.select(["set", "point", "status"]).to_pandas(), where, max_failed_share, sizes
        )
        joined.append(cell)
    # Combined to one piece, as the bytes of the Parquet file depend on the pieces.
    return pa.concat_tables(joined).combine_chunks()


def count_failures(test_quantities: pd.DataFrame) -> pd.DataFrame:
    """Count by cell and set the points at which the detector failed, with the first reason.

    Points whose simulation failed are not counted, as the detector did not fail there.

    Parameters
    ----------
    test_quantities : DataFrame
        From `compute_test_quantities`.

    Returns
    -------
    DataFrame
        `robot`, `cycle`, `axis`, `fda`, `set`, `points`, `failed`, `first_reason`; only cells and sets with
        failed points.
    """
    keys = ["robot", "cycle", "axis", "fda", "set"]
    rows: list[dict[str, Any]] = []
    for values, group in test_quantities.groupby(keys, sort=False):
        failed = group[(group["status"] != OK) & ~group["status"].str.startswith(NOT_SIMULATED)]
        if len(failed):
            first = f"point {failed['point'].iloc[0]}: {failed['status'].iloc[0]}"
            counts = {"points": len(group), "failed": len(failed), "first_reason": first}
            rows.append(dict(zip(keys, values, strict=True)) | counts)
    return pd.DataFrame(rows, columns=[*keys, "points", "failed", "first_reason"])


def _check_specs(
    detectors: Sequence[DetectorSpec], axes: Sequence[int], model: "RobotModel", where: str
) -> None:
    names = [spec.name for spec in detectors]
    if not names or not axes:
        raise InputError(f"{where}: no detector or no axis to test; name at least one of each.")
    if len(set(names)) != len(names) or len(set(axes)) != len(axes):
        raise InputError(f"{where}: a detector or an axis is named twice; name each once.")
    for axis in axes:
        if not 1 <= axis <= len(model.axes):
            raise InputError(
                f"{where}: there is no axis {axis}; the robot has 1 to {len(model.axes)}, "
                f"{', '.join(model.axes)}."
            )


def _tabulate(
    designs: Mapping[str, pd.DataFrame],
    outcomes: Mapping[tuple[str, int], tuple[float, str]],
    axis: int,
    factors: Sequence[Factor],
) -> pd.DataFrame:
    """Return the rows of a cell sorted by set and point: coded factors with its own wear as f, y, status."""
    names = ["point", *(factor.name for factor in factors)]
    parts = []
    for set_name in sorted(designs):
        part = designs[set_name][names].sort_values("point", kind="stable", ignore_index=True)
        part = view_for_axis(part, axis, factors).assign(set=set_name)
        answers = [outcomes[set_name, int(point)] for point in part["point"]]
        y, status = np.array([y for y, _ in answers], dtype=float), [status for _, status in answers]
        parts.append(part.assign(y=y, status=status))
    return pd.concat(parts, ignore_index=True)


def check_failed_share(
    cell: pd.DataFrame, where: str, max_failed_share: float, sizes: Mapping[str, int]
) -> None:
    """Refuse a detector that failed at too many points of a set; `sizes` gives the points of each set.

    The share is checked set by set, as each set has its own purpose: points of another set cannot replace
    those that a fit lacks.
    """
    for set_name, rows in cell.groupby("set", sort=False):
        failed, size = rows[rows["status"] != OK], sizes[str(set_name)]
        if len(failed) > max_failed_share * size:
            first = failed.iloc[0]
            raise InputError(
                f"{where}: failed at {len(failed)} of {size} {set_name} points, more than the share "
                f"{max_failed_share:g} allowed; first at point {first['point']}: {first['status']}; correct "
                "the detector, what is simulated, or raise max_failed_share."
            )


_SECTION = "detectors."
_RELATIVE = " %"


def find_options(factors: Sequence[Factor], name: str) -> dict[str, Factor]:
    """Return the factors that are options of a detector, by option."""
    found = {}
    for factor in factors:
        if factor.kind.startswith(_SECTION):
            detector, _, option = factor.kind.removeprefix(_SECTION).removesuffix(_RELATIVE).partition(".")
            if detector == name:
                found[option] = factor
    return found


def set_option(
    reference: str, options: Mapping[str, Any], option: str, factor: Factor, level: float
) -> float:
    """Return the value of a detector's option at a natural level of its factor.

    It is rounded where the stated or default value is an integer.

    Raises
    ------
    InputError
        Where the detector has no such option, or the factor is a change in per cent and the option has no
        number as its stated or default value.
    """
    factory = plugins.load(reference, "detectors", "DETECTOR")
    known = inspect.signature(factory).parameters
    if option not in known:
        raise InputError(
            f"factors.{factor.name}: detector {reference} has no option '{option}'; it has "
            f"{', '.join(known) or 'none'}."
        )
    stated = options.get(option, known[option].default)
    is_number = isinstance(stated, int | float) and not isinstance(stated, bool)
    if factor.kind.endswith(_RELATIVE):
        if not is_number:
            raise InputError(
                f"factors.{factor.name}: option '{option}' of detector {reference} is no number that a "
                "change in percent could be of; give the option, or the factor's values themselves."
            )
        level = stated * (1.0 + level / 100.0)
    return round(level) if is_number and isinstance(stated, int) else float(level)


def vary_options(
    detectors: Sequence[DetectorSpec], designs: Mapping[str, pd.DataFrame], factors: Sequence[Factor]
) -> dict[tuple[str, tuple[str, int]], dict[str, float]]:
    """Return the options of detectors that factors set at each design point, by detector and (set, point).

    Raises
    ------
    InputError
        As `set_option`.
    """
    varied: dict[tuple[str, tuple[str, int]], dict[str, float]] = {}
    for spec in detectors:
        for option, factor in find_options(factors, spec.name).items():
            for set_name, design in designs.items():
                levels = factor.to_natural(design[factor.name])
                for point, level in zip(design["point"], levels, strict=True):
                    value = set_option(spec.reference, spec.options, option, factor, float(level))
                    varied.setdefault((spec.name, (set_name, int(point))), {})[option] = value
    return varied
