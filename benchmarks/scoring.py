"""Scores a verdict against the truth of a case with several plants: a row a planted effect or false entry.

An entry of the verdict is *accounted for* where its joint has a planted effect that it names, or whose name
stands in its `equivalent`, or that is not separable and counts the named effect among its rivals; and,
where an outside effect is planted at its joint, where it is ``unknown``. Any other entry is *extra*. A
planted effect is *required* where it is separable and at least `TIMES` its just findable size. A case is
*exact* where every required effect is named, nothing is extra, and every findable outside effect is answered
by ``unknown`` or ``unexplained``. A joint is *falsely unexplained* where it is called ``unexplained``
although each effect planted there is named and none is outside the vocabulary. It scores both generators.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

SHARED_PARAMETERS: dict[str, dict[str, tuple[str, ...]]] = {
    "torque_offset": {"offset": ("offset", "torque_offset", "tau0")},
    "torque_constant_error": {"gain": ("gain", "torque_gain", "gain_error")},
    "time_delay": {"delay": ("delay", "time_delay")},
    "joint_spring": {"stiffness": ("stiffness", "k")},
    "joint_elasticity": {"stiffness": ("stiffness", "k"), "compliance": ("compliance",)},
    "rotor_inertia_error": {"inertia": ("inertia", "J", "rotor_inertia", "dJ")},
    "payload_error": {"mass": ("mass", "dm", "mass_error", "delta_mass")},
    "load_dependent_friction": {"coefficient": ("coefficient", "mu")},
    "quadratic_viscous": {"slope": ("slope", "curvature", "Fq")},
    "coulomb_asymmetry": {"half_difference": ("half_difference",)},
    "viscous_asymmetry": {"half_difference": ("half_difference",)},
    "coulomb": {"level": ("level", "Fc")},
    "viscous": {"slope": ("slope", "Fv")},
    "backlash": {"gap": ("gap",)},
    "torque_ripple": {"order": ("order", "wavenumber")},
    "presliding_hysteresis": {"level": ("level",)},
}
"""Planted parameter by effect, and the names under which a verdict may state the same quantity.

Conventions: recorded torque = (1 + gain) x true torque; a positive delay means that the torque channel lags
the positions; mass is true minus declared; half_difference is added forwards and taken away backwards.
"""


def start_entry(effect: str, joint: str, joints: Sequence[str], standard: bool) -> dict[str, Any]:
    """Planted effect of a truth, as both generators describe one, before it is known how clear it is."""
    return {
        "effect": effect, "accepted": [effect], "also_accepted": [], "contains": [], "outside": False,
        "standard": standard, "joint": joint, "joints": list(joints), "rivals": {}, "parameters": {},
    }  # fmt: skip


TIMES = 2.0
"""Multiple of the just findable size from which on an effect must be named."""
WORSE = 1.03
"""Factor on a joint's held-out error above which the verdict has harmed."""
REPEATING = ("hum", "event", "harmonics")
"""Noise that a verdict may call `unexplained` without an error."""


_SAME_UNITS = ({"", "1", "-"}, {"kgm^2", "Nms^2/rad"}, {"kg", "Ns^2/m"})


def _same_unit(a: str, b: str) -> bool:
    def plain(unit: str) -> str:
        return re.sub(r"[*·() ]", "", unit).replace("²", "^2")

    return plain(a) == plain(b) or any({plain(a), plain(b)} <= same for same in _SAME_UNITS)


def score_parameter(entry: dict[str, Any], truth: dict[str, Any]) -> dict[str, float]:
    """Relative error and coverage of the planted main parameter, NaN where the verdict does not state it.

    A verdict's parameter is compared only where its name is known for the same quantity and its unit agrees.
    A plant of another form than the vocabulary's has two values: its own, and that of the usual form that
    fits it best. An interval that reaches the range between them is right.
    """
    out = {"parameter_error": np.nan, "covered": np.nan}
    for own, aliases in SHARED_PARAMETERS.get(truth["effect"], {}).items():
        planted = truth["parameters"].get(own)
        if planted is None:
            continue
        value = planted.get("nearest", planted["value"])
        least, most = sorted((planted["value"], value))
        for name in aliases:
            stated = entry.get("parameters", {}).get(name)
            if stated is None or not _same_unit(stated.get("unit", ""), planted["unit"]):
                continue
            low, high = stated["ci95"]
            out["parameter_error"] = (stated["value"] - value) / abs(value)
            out["covered"] = float(low <= most and high >= least)
            return out
    return out


def accounts_for(entry: dict[str, Any], plant: dict[str, Any]) -> str | None:
    """How a verdict's entry meets a planted effect.

    Returns
    -------
    str or None
        ``right``, ``equivalent`` (its confidence set holds the truth), ``excused`` (a rival that the data
        cannot tell apart), ``unknown`` (an outside effect called unknown), ``part`` (something that the
        effect contains, which does not name it), or None.
    """
    if entry["joint"] not in plant["joints"]:
        return None
    if plant["outside"] and entry["effect"] == "unknown":
        return "unknown"
    if not plant["outside"] and entry["effect"] in plant["accepted"]:
        return "right"
    named = {entry["effect"], *(entry.get("equivalent") or [])}
    if named & {*plant["accepted"], *plant["also_accepted"]}:
        return "equivalent"
    if not plant["separable"] and named & set(plant["rivals"]):
        return "excused"
    return "part" if entry["effect"] in plant["contains"] else None


def is_required(plant: dict[str, Any]) -> bool:
    """Whether a verdict must name this effect."""
    return bool(plant["separable"]) and not plant["outside"] and plant["times_findable"] >= TIMES


def score_case(truth: dict[str, Any], verdict: dict[str, Any]) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Score one case.

    Parameters
    ----------
    truth : dict
        `planted`, a list of effects as `board.generate.generate_dataset` describes them, and `noise`.
    verdict : dict
        The content of ``verdict.json``; `status`, `state` and `unexplained_rms` may be absent.

    Returns
    -------
    case : dict
        `planted`, `required`, `named` (required ones that are), `missed`, `extra`, `unknowns`, `exact`,
        `joints`, `false_unexplained` (joints; None where the noise repeats, which may be unexplained),
        `null`, `false_in_null` (None in a planted case), `worse` (a joint's held-out error beyond `WORSE`),
        `worst_ratio`, `refuted`, `statuses` (entries that say a status), `outside_answered` (None where
        none is planted and findable), `outcome`.
    entries : list of dict
        A row by planted effect, `kind` ``planted``, and by extra entry, `kind` ``extra``.
    """
    said = list(verdict["verdict"])
    planted = truth["planted"]
    grades = [[accounts_for(entry, plant) for plant in planted] for entry in said]
    extra = [entry for entry, row in zip(said, grades, strict=True) if not any(row)]
    rows: list[dict[str, Any]] = []
    for p, plant in enumerate(planted):
        met = sorted((_ORDER.index(grade), i) for i in range(len(said)) if (grade := grades[i][p]) in _ORDER)
        grade = _ORDER[met[0][0]] if met else "missed"
        entry = said[met[0][1]] if met else {}
        state = (verdict["joints"].get(plant["joint"]) or {}).get("state")
        row = {
            "kind": "planted", "effect": plant["effect"], "joint": plant["joint"],
            "outside": plant["outside"], "standard": plant["standard"], "size": plant["measured_size"],
            "findable_size": plant["findable_size"], "times_findable": plant["times_findable"],
            "separable": plant["separable"], "required": is_required(plant), "grade": grade,
            "named_as": entry.get("effect", ""), "found": grade in ("right", "equivalent"),
            "state": state, "status": entry.get("status"),
        }  # fmt: skip
        if plant["outside"]:
            row["found"] = grade == "unknown" or state == "unexplained"
        if grade == "right":
            row |= score_parameter(entry, plant)
        rows.append(row)
    for entry in extra:
        rows.append({"kind": "extra", "effect": "none", "joint": entry["joint"], "outside": False,
                     "standard": False, "required": False, "found": False, "grade": "extra",
                     "named_as": entry["effect"], "status": entry.get("status"),
                     "named_set": len(entry.get("equivalent") or [])})  # fmt: skip
    required = [row for row in rows if row["required"]]
    missed = [row for row in required if not row["found"]]
    ratios = [
        joint["rms_after"] / joint["rms_before"]
        for joint in verdict["joints"].values()
        if joint.get("rms_before")
    ]
    outer = [row for row in rows if row["outside"] and row["times_findable"] >= TIMES]
    case: dict[str, Any] = {
        "planted": len(planted), "required": len(required), "named": len(required) - len(missed),
        "missed": len(missed), "extra": sum(entry["effect"] != "unknown" for entry in extra),
        "unknowns": sum(entry["effect"] == "unknown" for entry in extra),
        "entries": len(said), "exact": not missed and not extra and all(row["found"] for row in outer),
        "joints": len(verdict["joints"]),
        "false_unexplained": _count_unexplained(truth, verdict, rows), "null": not planted,
        "false_in_null": bool(extra) if not planted else None,
        "worst_ratio": max(ratios, default=np.nan), "worse": max(ratios, default=0.0) > WORSE,
        "refuted": sum(entry.get("status") == "refuted" for entry in said),
        "statuses": sum(entry.get("status") is not None for entry in said),
        "outside_answered": all(row["found"] for row in outer) if outer else None,
    }  # fmt: skip
    case["outcome"] = (
        "exact" if case["exact"] else "extra" if extra and not missed else "missed" if not extra else "both"
    )
    return case, rows


def _count_unexplained(
    truth: dict[str, Any], verdict: dict[str, Any], rows: list[dict[str, Any]]
) -> int | None:
    """Joints called unexplained where every planted effect is named and none is outside."""
    if truth.get("noise") in REPEATING:
        return None
    planted = zip(truth["planted"], (row for row in rows if row["kind"] == "planted"), strict=True)
    open_joints = {
        joint for plant, row in planted if plant["outside"] or not row["found"] for joint in plant["joints"]
    }
    called = {name for name, joint in verdict["joints"].items() if joint.get("state") == "unexplained"}
    return len(called - open_joints)


_ORDER = ("right", "unknown", "equivalent", "excused")
