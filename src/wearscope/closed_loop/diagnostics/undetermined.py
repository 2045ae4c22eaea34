"""Effects that the runs leave undetermined, and the motion that would show each."""

from collections.abc import Mapping, Sequence

import numpy as np

from wearscope.closed_loop.inference.detection_limits import LARGE, say_limit
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.effects.effect import PAYLOAD, SLOW_MOTION, TEMPERATURE
from wearscope.effects.temperature_dependent_friction import varies

#: A Stribeck effect acts below this share of the largest speed.
_SLOW = 0.05
#: Least span of a joint's temperatures that shows how friction depends on them [deg C].
_COLD_SPAN = 10.0


def find_undetermined(problem: Problem, limits: Sequence[Mapping[str, float]]) -> list[dict]:
    """What these runs cannot show, and why.

    Parameters
    ----------
    problem : Problem
    limits : sequence of mapping of str to float
        By joint, from `wearscope.closed_loop.inference.detection_limits.find_limits`.

    Returns
    -------
    list of dict
        `joint`, `effect`, `reason` and `motion`.
    """
    prepared = problem.prepared
    records = []
    for j, joint in enumerate(prepared.dataset.joints):
        if not prepared.moving[j]:
            records.append(_record(joint, "all", "the joint does not move in the training runs", "move it"))
            continue
        for effect in problem.effects:
            if effect.per_robot and j < prepared.n - 1:
                continue
            motion = effect.motion_for(prepared.n)
            if not effect.is_usable(problem.joined, j):
                reason = "the runs do not hold the signals that it needs"
                if "temp_{joint}" in effect.depends_on and not varies(problem.joined, j):
                    reason = "its temperature is not recorded, or hardly changes"
                records.append(_record(joint, effect.name, reason, motion))
            elif (limit := limits[j].get(effect.name, 0.0)) > LARGE:
                share = f"below {say_limit(limit)} of the joint's torque"
                reason = f"it gets no name {share if np.isfinite(limit) else 'of any size'} on these runs"
                records.append(_record(joint, effect.name, reason, motion))
    return records + _judge_coverage(prepared)


def _record(joint: str, effect: str, reason: str, motion: str) -> dict:
    return {"joint": joint, "effect": effect, "reason": reason, "motion": motion}


def _judge_coverage(prepared: Prepared) -> list[dict]:
    """Bands of speed, directions and temperatures that the training runs miss."""
    records = []
    train = prepared.runs_for("train")
    for j in np.flatnonzero(prepared.moving):
        joint = prepared.dataset.joints[j]
        speed = np.concatenate([run.signals.v[:, j] for run in train])
        top = np.abs(speed).max()
        slow = np.mean((np.abs(speed) < _SLOW * top) & (np.abs(speed) > 0.01 * top))
        if slow < 0.02:
            reason = f"only {100 * slow:.1f} % of the samples move below {100 * _SLOW:.0f} % of the top speed"
            records.append(_record(joint, "friction at low speed", reason, SLOW_MOTION))
        for sign, word in ((1, "positive"), (-1, "negative")):
            share = np.mean(sign * speed > 0.01 * top)
            if share < 0.1:
                reason = f"only {100 * share:.1f} % of the samples move in the {word} direction"
                records.append(_record(joint, "friction by direction", reason, "move it in both directions"))
        temperature = np.concatenate([run.signals.temperature[:, j] for run in train])
        if np.isfinite(temperature).all() and np.ptp(temperature) < _COLD_SPAN:
            reason = f"the temperature spans {np.ptp(temperature):.1f} degrees only"
            records.append(_record(joint, "friction by temperature", reason, TEMPERATURE))
    if len(train) < 2:
        reason = "there is one training run: nothing shows what repeats from run to run"
        records.append(_record("all", "all", reason, "record the motion again, and others"))
    payloads = [run.payload for run in prepared.dataset.runs_for("train")]
    if all(payload == payloads[0] for payload in payloads):
        reason = "all training runs carry the same payload"
        records.append(_record("all", "effects of load", reason, PAYLOAD))
    return records
