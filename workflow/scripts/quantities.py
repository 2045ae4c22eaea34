"""Computes test quantities of one robot and test-cycle from its recordings; shared by several scripts."""

from job import count_progress
from wearscope.detectors.base import Batch
from wearscope.detectors.questions import DetectorSpec
from wearscope.detectors.run import compute_test_quantities
from wearscope.simulation.chunk import check_failures, failure_table
from wearscope.simulation.recording import read_points


def quantify(
    say, traces, model, designs, nominal, outcome, params, factors, robot, cycle, sizes=None, packed=None,
    nominal_set="nominal",
):  # fmt: skip
    """Tables of test quantities and of failed simulations.

    `outcome` is what `wearscope.simulation.chunk.read_markers` gives, `params` the rule's; `sizes` are the
    points of whole sets, where `designs` hold a chunk; `packed` are recordings that are no file a point;
    the detectors learn from `nominal_set`.
    """
    fingerprints, failed = outcome
    points = {name: list(table["point"]) for name, table in [*designs.items(), (nominal_set, nominal)]}
    check_failures(failed, points, f"robot {robot}, cycle {cycle}", params.max_failed_share, sizes)

    def read_batches(name):
        there = [point for point in points[name] if (name, point) not in failed]
        for point, one in read_points(traces, name, there, model, fingerprints, packed):
            yield name, point, Batch(one.t, one.q, one.qd, one.tau)

    batches = sum((name, point) not in failed for name in designs for point in points[name])
    table = compute_test_quantities(
        (batch for name in designs for batch in read_batches(name)),
        [DetectorSpec(name, one["use"], one["options"]) for name, one in params.detectors.items()],
        params.axes,
        model,
        [batch for _, _, batch in read_batches(nominal_set)],
        robot=robot,
        cycle=cycle,
        designs=designs,
        factors=factors,
        max_failed_share=params.max_failed_share,
        failed_simulations=failed,
        report=count_progress(say, batches, "batches"),
        time_limit=params.time_limit,
        sizes=sizes,
    )
    return table, failure_table(failed, points, robot, cycle)
