"""Test quantities of one robot and test-cycle from chunks of its design points, as if computed in one go."""

from collections.abc import Sequence

import pyarrow as pa
import pyarrow.compute as pc

from wearscope.detectors.run import check_failed_share
from wearscope.errors import InputError


def join_test_quantities(
    chunks: Sequence[pa.Table], detectors: Sequence[str], axes: Sequence[int], max_failed_share: float
) -> pa.Table:
    """One table of chunks, in the order that `wearscope.detectors.run.compute_test_quantities` gives it.

    Parameters
    ----------
    chunks : sequence of pyarrow.Table
        What it gave for chunks of the sets, by set, in the order of their points.
    detectors : sequence of str
        Names in the column `fda`.
    axes : sequence of int
    max_failed_share : float
        Largest share of a cell's points that may fail in each set.

    Raises
    ------
    InputError
        Where a chunk holds other cells than asked for, or a detector failed at more than the share.
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
    # In one piece, as it would be at once: how a file is paged depends on it.
    return pa.concat_tables(joined).combine_chunks()
