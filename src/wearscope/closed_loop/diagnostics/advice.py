"""Which motion would separate the effects that the runs cannot, and what the runs leave undetermined."""

import numpy as np
import pandas as pd

from wearscope.closed_loop.model.candidates import applies, candidate_names
from wearscope.closed_loop.diagnostics.isolability import ABSORBED, CLOSE
from wearscope.closed_loop.intake.preprocessing import Prepared
from wearscope.effects.base import load_effect

#: Share of the largest speed below which friction falls with speed where there is a Stribeck effect.
_SLOW = 0.05
_COLD_SPAN = 10.0

_SPEEDS = "move in both directions at several constant speeds, from 1 % to 100 % of the largest one"
_SLOW_MOTION = "add slow motion: constant speeds below 5 % of the largest one, in both directions"
_RANGE = "cover the whole position range slowly, in both directions"
_POSTURES = "repeat the motion with the other joints in other postures, so that gravity's share changes"
_PAYLOAD = "repeat the motion with another known payload and with none"
_QUICK = "add motion with large accelerations about several postures (periodic excitation)"
_REVERSALS = "add slow reversals of a few tenths of a degree about several positions"
_TEMPERATURE = "repeat the motion cold and warm, and record the joint's temperature"
_TIME = "repeat one motion from a cold start until the friction no longer changes"
_GRAVITY_SIGN = "cross the posture where the gravity torque changes sign, slowly"
_SESSIONS = "record constant slow speed over the whole range in two sessions, both for training"
_ALONE = "move each joint alone, the others held still"

#: What motion shows an effect best.
MOTIONS = {
    "coulomb": _SPEEDS,
    "viscous": _SPEEDS,
    "torque_offset": _REVERSALS,
    "friction_wear_temperature": _TEMPERATURE,
    "stribeck": _SLOW_MOTION,
    "coulomb_asymmetry": _REVERSALS,
    "viscous_asymmetry": _SPEEDS,
    "quadratic_viscous": _SPEEDS,
    "concave_viscous": _SLOW_MOTION,
    "load_dependent_friction": _PAYLOAD,
    "temperature_dependent_friction": _TEMPERATURE,
    "warm_up_drift": _TIME,
    "presliding_hysteresis": _REVERSALS,
    "backlash": _GRAVITY_SIGN,
    "joint_elasticity": _QUICK,
    "torque_ripple": _SESSIONS,
    "joint_spring": _RANGE,
    "gravity_counterbalance": _RANGE,
    "payload_error": _POSTURES,
    "rotor_inertia": _QUICK,
    "rotor_inertia_error": _POSTURES,
    "torque_constant_error": _PAYLOAD,
    "time_delay": _QUICK,
    "cross_coupling": _ALONE,
}
#: Pairs whose separation needs another motion than either effect alone.
_PAIRS = {
    frozenset(("gravity_counterbalance", "payload_error")): _PAYLOAD,
    frozenset(("gravity_counterbalance", "torque_constant_error")): _PAYLOAD,
    frozenset(("joint_spring", "payload_error")): _PAYLOAD,
    frozenset(("gravity_counterbalance", "joint_spring")): _RANGE,
    frozenset(
        ("torque_constant_error", "payload_error")
    ): "hold still in several postures with a known payload",
    frozenset(
        ("joint_elasticity", "time_delay")
    ): "measure the link, or add quick motion with another payload",
    frozenset(("temperature_dependent_friction", "warm_up_drift")): _TEMPERATURE,
    frozenset(("coulomb_asymmetry", "torque_offset")): "hold still now and then: they differ only at rest",
}


#: What moves mass is one and the same for a single joint, however it moves.
_MASS = frozenset(("rotor_inertia", "rotor_inertia_error", "payload_error", "torque_constant_error"))


def _motion_for(name: str, prepared: Prepared) -> str:
    """Motion that tells an effect from the declared model."""
    return _PAYLOAD if prepared.n == 1 and name in _MASS else MOTIONS[name]


def advise(prepared: Prepared, isolability: pd.DataFrame) -> list[dict]:
    """Motions that would separate what these runs cannot.

    Parameters
    ----------
    prepared : Prepared
    isolability : DataFrame
        From `wearscope.closed_loop.diagnostics.isolability.measure_isolability`.

    Returns
    -------
    list of dict
        `motion`, in words, and `separates`: a list of ``joint: effect / effect`` (two candidates) or
        ``joint: effect / declared model`` that it would help, most helpful motion first.
    """
    helped: dict[str, list[str]] = {}

    def add(motion: str, what: str) -> None:
        known = helped.setdefault(motion, [])
        if what not in known:
            known.append(what)

    for row in isolability.itertuples(index=False):
        for name, sine in ((row.effect_a, row.sine_a), (row.effect_b, row.sine_b)):
            if sine < ABSORBED:
                add(_motion_for(name, prepared), f"{row.joint}: {name} / declared model")
        if row.largest_angle_deg < CLOSE:
            pair = frozenset((row.effect_a, row.effect_b))
            what = f"{row.joint}: {row.effect_a} / {row.effect_b}"
            for motion in [_PAIRS[pair]] if pair in _PAIRS else [MOTIONS[name] for name in sorted(pair)]:
                add(motion, what)
    ordered = sorted(helped.items(), key=lambda item: (-len(item[1]), item[0]))
    return [{"motion": motion, "separates": what} for motion, what in ordered]


def find_undetermined(prepared: Prepared, isolability: pd.DataFrame) -> list[dict]:
    """What could not be asked of these runs, and why.

    Returns
    -------
    list of dict
        `joint`, `effect`, `reason` and `motion`.
    """
    fields = prepared.dataset.fields
    names = candidate_names(fields.declared_effects, fields.robot.rotor_inertia is not None)
    records = []
    sines: dict[tuple[str, str], float] = {}
    for row in isolability.itertuples(index=False):
        sines[row.joint, row.effect_a] = row.sine_a
        sines[row.joint, row.effect_b] = row.sine_b
    for j, joint in enumerate(prepared.dataset.joints):
        if not prepared.moving[j]:
            records.append(_record(joint, "all", "the joint does not move in the training runs", "move it"))
            continue
        for name in names:
            if name == "payload_error" and j < prepared.n - 1:
                continue
            if not applies(load_effect(name), j, prepared):
                if name != "cross_coupling":
                    reason = "its temperature is not recorded, or hardly changes"
                    records.append(_record(joint, name, reason, MOTIONS[name]))
            elif sines.get((joint, name), 1.0) < ABSORBED:
                reason = "the declared model's own parameters absorb it on these runs"
                records.append(_record(joint, name, reason, _motion_for(name, prepared)))
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
            records.append(_record(joint, "friction at low speed", reason, _SLOW_MOTION))
        for sign, word in ((1, "positive"), (-1, "negative")):
            share = np.mean(sign * speed > 0.01 * top)
            if share < 0.1:
                reason = f"only {100 * share:.1f} % of the samples move in the {word} direction"
                records.append(_record(joint, "friction by direction", reason, "move it in both directions"))
        temperature = np.concatenate([run.signals.temperature[:, j] for run in train])
        if np.isfinite(temperature).all() and np.ptp(temperature) < _COLD_SPAN:
            reason = f"the temperature spans {np.ptp(temperature):.1f} degrees only"
            records.append(_record(joint, "friction by temperature", reason, _TEMPERATURE))
    if len(train) < 2:
        reason = "there is one training run: nothing shows what repeats from run to run"
        records.append(_record("all", "all", reason, "record the motion again, and others"))
    payloads = [run.payload for run in prepared.dataset.runs_for("train")]
    if all(payload == payloads[0] for payload in payloads):
        reason = "all training runs carry the same payload"
        records.append(_record("all", "effects of load", reason, _PAYLOAD))
    return records
