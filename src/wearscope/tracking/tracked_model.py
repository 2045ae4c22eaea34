"""The tracked machine as a model that can be simulated, with the temperature and wear of its sessions."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from wearscope.closed_loop.diagnosis import Diagnosis
from wearscope.closed_loop.model.correction import make_corrected_model
from wearscope.closed_loop.model.estimation import estimate
from wearscope.closed_loop.model.regression import Regression
from wearscope.effects.base import load_effect
from wearscope.effects.vocabulary import thermal_friction
from wearscope.robots.model import RobotModel
from wearscope.tracking.structure import FEATURES, Belief, Structure, temperature_features

#: Stage in the name of the model's file, ``model_tracked.yaml``.
STAGE = "tracked"
#: Friction depends on temperature where healthy sessions show it at this p-value. It is also modelled where
#: it is known well: a change by the second number [K] changes friction with a 95 % interval of at most the
#: third number (half width, as a share of friction).
_SHOWN, _KELVIN, _NARROW = 0.01, 10.0, 0.05
#: Smallest span of temperatures [K] from which a slope is taken.
_LEAST_SPAN = 2.0


def make_healthy_model(
    diagnosis: Diagnosis, model: Regression, structure: Structure, belief: Belief
) -> RobotModel:
    """Model of the healthy machine, with friction by temperature where its sessions show that.

    Parameters
    ----------
    diagnosis : Diagnosis
        Diagnosis of the reference.
    model : Regression
        Model with the terms of the structure.
    structure : Structure
    belief : Belief
    """
    estimates = estimate(model, most_rows=diagnosis.policy.most_rows)
    robot = make_corrected_model(diagnosis.prepared, model, estimates, STAGE)
    told = f"{diagnosis.prepared.dataset.fields.description} As its healthy sessions show it.".strip()
    return robot.add_effects(list_thermal(structure, belief, robot)).replace(description=told)


def list_thermal(structure: Structure, belief: Belief, robot: RobotModel) -> list[dict[str, Any]]:
    """Effects of a model file for friction's dependence on temperature, at joints whose sessions show it.

    The function of temperature that the reference determines is replaced by a straight line over the
    temperatures seen. A joint whose model already has such a dependence keeps it.
    """
    effect, k = thermal_friction(), FEATURES
    entries = []
    for place, j in enumerate(structure.thermal):
        name = structure.joints[j]
        if any(entry.joint == name and load_effect(entry.effect).is_thermal for entry in robot.effects):
            continue
        low, high = structure.warmth[:, j]
        if high - low < _LEAST_SPAN:
            continue
        warmth = np.linspace(low, high, 50)
        mean = float(structure.temperature[j])
        warmer = warmth - mean
        line = warmer @ temperature_features(warmth, mean) / float(warmer @ warmer)
        start = structure.count + 2 * k * place
        onto = np.zeros((2, structure.width))
        onto[0, start : start + k], onto[1, start + k : start + 2 * k] = line, line
        slopes, covariance = onto @ belief.mean, onto @ belief.covariance @ onto.T
        half = stats.norm.ppf(0.975) * np.sqrt(np.diag(covariance))
        p_value = float(stats.chi2.sf(slopes @ np.linalg.pinv(covariance, hermitian=True) @ slopes, 2))
        if p_value > _SHOWN and np.any(_KELVIN * half > _NARROW):
            continue
        friction = float(structure.scales.friction[j])
        scale = np.array([friction, friction / float(structure.scales.speed[j])])
        names = [p.name for p in effect.coefficients]
        values = dict(zip(names, (scale * slopes).tolist(), strict=True))
        ends = np.column_stack([scale * (slopes - half), scale * (slopes + half)])
        entries.append(
            {
                "joint": name,
                "effect": effect.label,
                "parameters": {**values, effect.shape[0].name: mean},
                "intervals": dict(zip(names, ends.tolist(), strict=True)),
                "identified": True,
                "source": f"identified in the healthy sessions, at {low:.4g} to {high:.4g} deg C",
            }
        )
    return entries


def make_tracked_model(healthy: RobotModel, worn: Sequence[Mapping[str, Any]]) -> RobotModel:
    """Model of the machine with the wear that its sessions showed.

    Parameters
    ----------
    healthy : RobotModel
    worn : sequence of mapping
        Entries of ``wear`` in ``tracking.json``; a joint's last entry counts.
    """
    last = {one["joint"]: one for one in worn}
    entries = [
        {
            "joint": joint,
            "effect": one["effect"],
            "parameters": {
                **{name: told["value"] for name, told in one["parameters"].items()},
                **one["fixed"],
            },
            "intervals": {name: told["ci95"] for name, told in one["parameters"].items()},
            "identified": True,
            "source": f"identified in session {one['session']}, in which wear is {one['level']:.4g}",
        }
        for joint, one in last.items()
        if not any(e.joint == joint and load_effect(e.effect).needs_wear for e in healthy.effects)
    ]
    axes = [joint for joint in healthy.joints if joint in last]
    others = [joint for joint in healthy.wear_joints if joint not in last]
    wearing = sorted([*axes, *others][: len(healthy.wear_joints)], key=healthy.joints.index)
    model = healthy.add_effects(entries)
    return model if wearing == healthy.wear_joints else model.replace(wear_axes=wearing)
