"""Which motion would separate the effects that the runs cannot, and what the runs leave undetermined."""

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from wearscope.closed_loop.diagnostics.isolability import ABSORBED, CLOSE
from wearscope.closed_loop.intake.prepared import Prepared
from wearscope.closed_loop.selection.detection_limits import LARGE, say_limit
from wearscope.closed_loop.selection.problem import Problem
from wearscope.effects.motions import PAYLOAD, SLOW_MOTION, TEMPERATURE
from wearscope.effects.vocabulary import separating_motions

#: Share of the largest speed below which friction falls with speed where there is a Stribeck effect.
_SLOW = 0.05
_COLD_SPAN = 10.0


def advise(problem: Problem, isolability: pd.DataFrame) -> list[dict]:
    """Motions that would separate what these runs cannot.

    Parameters
    ----------
    problem : Problem
    isolability : DataFrame
        From `wearscope.closed_loop.diagnostics.isolability.measure_isolability`.

    Returns
    -------
    list of dict
        `motion`, in words, and `separates`: a list of ``joint: effect / effect`` (two candidates) or
        ``joint: effect / declared model`` that it would help, most helpful motion first.
    """
    effects = {effect.name: effect for effect in problem.effects}
    n = problem.prepared.n
    helped: dict[str, list[str]] = {}

    def add(motion: str, what: str) -> None:
        known = helped.setdefault(motion, [])
        if what not in known:
            known.append(what)

    for row in isolability.itertuples(index=False):
        for name, sine in ((row.effect_a, row.sine_a), (row.effect_b, row.sine_b)):
            if sine < ABSORBED:
                add(effects[name].motion_for(n), f"{row.joint}: {name} / declared model")
        if row.largest_angle_deg < CLOSE:
            what = f"{row.joint}: {row.effect_a} / {row.effect_b}"
            for motion in separating_motions(effects[row.effect_a], effects[row.effect_b], n):
                add(motion, what)
    ordered = sorted(helped.items(), key=lambda item: (-len(item[1]), item[0]))
    return [{"motion": motion, "separates": what} for motion, what in ordered]


def find_undetermined(problem: Problem, limits: Sequence[Mapping[str, float]]) -> list[dict]:
    """What could not be asked of these runs, and why.

    Parameters
    ----------
    problem : Problem
    limits : sequence of mapping of str to float
        By joint, from `wearscope.closed_loop.selection.detection_limits.find_limits`.

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
                if effect.lacking:
                    records.append(_record(joint, effect.name, effect.lacking, motion))
            elif (limit := limits[j].get(effect.name, 0.0)) > LARGE:
                reason = f"it gets no name below {say_limit(limit)} of the joint's torque on these runs"
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
