"""Cases drawn at random over machines, motions, noise, declared sets and plants."""

import numpy as np

from benchmarks.outside.arms import ARMS
from benchmarks.outside.forms import OUTSIDERS
from benchmarks.outside.planted import PLAIN, Case, Plant

_BODY = ("rigid_body",)
_LAW = ("rigid_body", "rotor_inertia", "friction_wear_temperature")
#: Sizes from which a structural plant is drawn.
SIZES = {
    "joint_elasticity": (6.0, 11.0),
    "backlash": (2.0, 6.0),
    "presliding_hysteresis": (0.008, 0.03),
    "inertial_error": (0.1, 0.2),
    "rotor_inertia_error": (0.2, 0.4),
    "torque_constant_error": (0.05, 0.1),
    "time_delay": (5.0, 15.0),
}
PAYLOAD = {"puma560": 1.0, "ur5": 1.2, "ur10": 2.8, "panda": 0.9, "iiwa14": 2.8, "manutec": 7.0, "tx40": 0.9,
            "scara": 0.8, "planar": 0.6}  # fmt: skip
#: Joints that carry much of the arm's weight.
HEAVY = {"puma560": (1, 2), "ur5": (1, 2), "ur10": (1, 2), "panda": (1, 3), "iiwa14": (1,),
         "manutec": (1, 2), "tx40": (1, 2), "scara": (2,), "planar": (0, 1)}  # fmt: skip
ONE = ("stribeck", "coulomb_asymmetry", "viscous_asymmetry", "quadratic_viscous", "concave_viscous",
        "load_dependent_friction", "temperature_dependent_friction", "warm_up_drift", "presliding_hysteresis",
        "backlash", "joint_elasticity", "torque_ripple", "joint_spring", "gravity_counterbalance",
        "payload_error", "rotor_inertia_error", "torque_constant_error", "time_delay", "cross_coupling",
        "inertial_error")  # fmt: skip
#: What an undeclared body, an uncertain one, or the declared law of friction may swallow.
_SWALLOWED = {
    "approximate": ("payload_error", "inertial_error", "rotor_inertia_error", "gravity_counterbalance",
                    "torque_constant_error", "joint_spring"),
    "law": ("stribeck", "temperature_dependent_friction", "concave_viscous", "quadratic_viscous",
            "warm_up_drift"),
    "bare": ("rotor_inertia_error",),
}  # fmt: skip


def draw_case(number):
    """Case of a number; the same number, the same case."""
    rng = np.random.default_rng(np.random.SeedSequence([8, number]))
    arm = str(rng.choice(list(ARMS)))
    n = len(ARMS[arm]().joints)
    kind = rng.choice(["null", "one", "several", "outsider"], p=[0.22, 0.42, 0.26, 0.10])
    regime = _draw_regime(rng, kind)
    plants = _draw_plants(rng, arm, n, kind, regime)
    return Case(f"drawn-{number:03d}", arm, plants, **regime)


def _draw_regime(rng, kind):
    noise = str(rng.choice(["white", "coloured", "hum", "heavy"], p=[0.4, 0.3, 0.12, 0.18]))
    level = 10 ** rng.uniform(-2.7, -1.0 if kind == "null" else -1.52)
    # A quarter more than one run in ten: one run is what many have.
    count = int(rng.choice([1, 2, 3, 4, 6], p=[0.12, 0.18, 0.3, 0.28, 0.12]))
    kinds = rng.choice(["fourier", "points", "sweeps"], count, p=[0.4, 0.4, 0.2])
    seconds = float(np.clip(round(rng.uniform(15, 45)), 10, 140 / count))
    regime = {
        "noise": noise, "level": float(level), "rate": float(rng.choice([50, 100, 125, 200, 250, 500])),
        "train": tuple((str(k), seconds if k != "sweeps" else max(seconds, 30.0)) for k in kinds),
        "test": (("points", 20.0), ("fourier", 20.0)),
        "counts": int(rng.choice([0, 1024, 4096, 65536])), "speed": bool(rng.random() < 0.25),
        "width": float(10 ** rng.uniform(-2.7, -1.6)), "drives": bool(rng.random() < 0.6),
    }  # fmt: skip
    if noise == "hum" and regime["rate"] <= 125.0:  # a line that is sampled as an offset or a slow drift
        regime["rate"] = 200.0
    if count == 1:
        regime["train"] = ((str(kinds[0]), 60.0),)
    draw = rng.random()
    if draw < 0.22:
        regime["declared"] = _BODY
    elif draw < 0.32:
        regime["declared"] = _LAW
    if rng.random() < 0.2:
        regime |= {"inertials": "approximate", "stated": 0.1}
    elif rng.random() < 0.1:
        regime |= {"loop": 0.005}
    return regime


def _draw_plants(rng, arm, n, kind, regime):
    heavy = HEAVY[arm]
    if kind == "null":
        return ()
    if kind == "outsider":
        return (Plant(str(rng.choice(list(OUTSIDERS))), int(rng.choice(heavy)), float(rng.uniform(3, 6))),)
    able = set(ONE)
    if regime.get("inertials") == "approximate":
        able -= set(_SWALLOWED["approximate"])
    if regime.get("declared") == _LAW:
        able -= set(_SWALLOWED["law"])
    if regime.get("declared", PLAIN) == _BODY or not regime["drives"]:
        able -= set(_SWALLOWED["bare"])
    if regime.get("loop", -1.0) >= 0:
        able -= {*SIZES, "temperature_dependent_friction", "warm_up_drift"}
    count = 1 if kind == "one" else int(rng.integers(2, 5))
    names = [str(x) for x in rng.permutation(sorted(able))[:count]]
    # Their columns are each other's.
    for pair in (("payload_error", "inertial_error"), ("temperature_dependent_friction", "warm_up_drift"),
                 ("joint_elasticity", "backlash")):  # fmt: skip
        if set(pair) <= set(names):
            names.remove(pair[1])
    plants, free = [], [int(j) for j in rng.permutation(n)]
    for name in names:
        loaded = name in ("load_dependent_friction", "gravity_counterbalance", "inertial_error", "backlash",
                          "joint_elasticity", "torque_constant_error", "rotor_inertia_error")  # fmt: skip
        able_at = (
            [j for j in free if j in heavy] if loaded else [j for j in free if name != "cross_coupling" or j]
        )
        if name == "payload_error":
            joint = n - 1
        elif able_at:
            joint = able_at[0]
            free.remove(joint)
        else:
            continue
        size = PAYLOAD[arm] if name == "payload_error" else rng.uniform(*SIZES.get(name, (3.0, 6.0)))
        plants.append(Plant(name, joint, float(size)))
    return tuple(plants)
