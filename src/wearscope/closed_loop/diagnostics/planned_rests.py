"""Stops from both sides: the run that tells names apart which motion shows alike and a rest does not."""

import numpy as np
from scipy import stats

from wearscope.closed_loop.diagnostics.plan import (
    DWELL,
    LEAST_RUNS,
    MOST_RUNS,
    POWER,
    SECONDS,
    NextMeasurement,
    Plan,
    list_payloads,
    list_temperatures,
    make_planned_run,
)
from wearscope.closed_loop.diagnostics.rivalry import Rivalry
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.intake.signals import join_signals
from wearscope.closed_loop.model.declared import fit_declared
from wearscope.closed_loop.model.regression import Regression
from wearscope.closed_loop.model.rests import (
    CLOSE,
    are_enough,
    find_rests,
    measure_left,
    median_length,
    replace_term,
)
from wearscope.cycles.planned import PlannedMotion
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel


def plan_rests(
    after: Regression, index: int, rivalry: Rivalry, prepared: Prepared, model: RobotModel
) -> NextMeasurement | None:
    """Stops from both sides, where the names are told apart at rest and in no motion; None elsewhere.

    What is promised holds on a joint that no static friction holds at rest, as `is_refuted` asks.
    """
    term, joint = after.entries[index], after.entries[index].joint
    others = [name for name in rivalry.names[1:] if not (name.effect.spread or term.effect.spread)]
    if len(others) < len(rivalry.names) - 1:
        return None
    joined = join_signals(run.signals for run in prepared.runs_for("train"))
    rivals = [fit_declared(prepared, name.effect, joint, joined) for name in others]
    carried = list_payloads(prepared)[0]
    stated = None if carried is None else {"mass": carried.mass, "com": list(carried.com)}
    motion = PlannedMotion("rests", joint, 0, 1.0, 1.0, SECONDS).plan_within(model)
    try:
        reference = motion.build(model.replace(payload=stated), DWELL, 1.0 / prepared.band.rate)
    except InputError:
        return None
    temperature = list_temperatures(prepared)[0]
    run = make_planned_run(prepared, reference, carried, temperature)
    rests = find_rests(run, joint)
    if not are_enough(rests) or any(rival is None for rival in rivals):
        return None
    still = np.concatenate([np.arange(rest.rows.start, rest.rows.stop) for rest in rests])

    def torques(one: Regression) -> tuple[np.ndarray, np.ndarray]:
        columns = run.reduce(one.entries[index].columns(run.signals)[:, joint])
        torque = columns @ one.solve()[one.spans[index]]
        return torque[still], torque[run.keep[:, joint]]

    own = torques(after)
    apart = np.inf
    for rival in rivals:
        assert rival is not None
        other = torques(replace_term(after, index, rival))
        at_rest, in_motion = (float(np.sqrt(np.mean((a - b) ** 2))) for a, b in zip(own, other, strict=True))
        if not in_motion < CLOSE * at_rest:
            return None
        apart = min(apart, at_rest)
    error = measure_left(after, joint, [], median_length(rests)).error
    sides = sum(rest.forwards for rest in rests), sum(not rest.forwards for rest in rests)
    runs, power = LEAST_RUNS, 0.0
    for runs in range(LEAST_RUNS, MOST_RUNS + 1):
        within = [CLOSE * apart * np.sqrt(runs * side) / max(error, 1e-300) for side in sides]
        power = float(np.prod(2.0 * stats.norm.cdf(within) - 1.0))
        if power >= POWER:
            break
    before = rivalry.worst(rivalry.recorded)
    telling = runs * len(still)
    angle = float(np.degrees(np.arctan(np.sqrt(telling / (rivalry.recorded.rows + telling)))))
    plan = Plan(motion.name, motion, reference, carried, temperature, prepared.moving)
    evidence = runs * len(rests) * (apart / max(error, 1e-300)) ** 2
    return NextMeasurement(
        prepared.dataset.joints[joint], [name.effect.name for name in rivalry.names], plan, runs, power,
        before.angle, angle, before.evidence, evidence, 1,
    )  # fmt: skip
