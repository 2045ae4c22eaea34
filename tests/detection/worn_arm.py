"""A two-joint arm with the friction of eq. (17), recorded without the simulator: the truth is at hand."""

from pathlib import Path

import numpy as np
import pandas as pd
from changed_fields import write_fields
from duo import JOINTS, URDF

from wearscope.effects.base import Signals, load_effect
from wearscope.robots.model import make_model

INERTIA = [1.5, 0.6]
NOISE = np.array([0.4, 0.2])
RATE, WARM = 200.0, 40.0
LAW = {
    "eta0": 6.0, "eta1": -2.0, "eta2": 0.12, "eta3": -0.05, "eta4": 0.004, "eta5": 6.0, "eta6": -0.06,
    "eta7": 0.08, "eta8": 0.002, "eta9": 0.02, "alpha": 1.0,
}  # fmt: skip


def make_duo(worn: bool = True):
    """The arm's model; without `worn` its friction knows neither wear nor temperature."""
    law = LAW if worn else LAW | dict.fromkeys(("eta2", "eta4", "eta6", "eta7", "eta9"), 0.0) | {"eta3": 0.1}
    effects = [{"joint": j, "effect": "rigid_body"} for j in JOINTS]
    effects += [{"joint": j, "effect": "friction_wear_temperature", "parameters": law} for j in JOINTS]
    fields = {
        "name": "duo",
        "urdf": "duo.urdf",
        "joints": JOINTS,
        "drive": {"rotor_inertia": INERTIA},
        "sensors": {"sample_rate": RATE},
        "effects": effects,
    }
    return make_model(fields, URDF)


def draw_motion(seed: int, seconds: float = 8.0, wait: float = 0.0):
    """Band-limited motion of both joints from rest to rest, after a wait."""
    t = np.arange(round((seconds + wait) * RATE)) / RATE
    rng = np.random.default_rng(seed)
    size, turn = rng.normal(0.0, 0.4, (2, 4)), rng.uniform(0, 2 * np.pi, (2, 4))
    k = np.arange(1, 5)

    def position(x):
        phase = np.clip((x - wait) / seconds, 0.0, 1.0)
        s = phase**3 * (10.0 - 15.0 * phase + 6.0 * phase**2)
        return np.sum(size / k * np.sin(2 * np.pi * k * s[:, None, None] + turn), axis=2)

    h, q = 1e-5, position(t)
    v = (position(t + h) - position(t - h)) / (2 * h)
    a = (position(t + h) - 2 * q + position(t - h)) / h**2
    return t, q, v, a


def record_run(path: Path, motion, wear, temperature, rng, disturbance=0.0) -> None:
    """Write what the machine records; `disturbance` [N m] is a torque that no model has, drawn for a run."""
    t, q, v, a = motion
    model = make_duo()
    load = model.rigid_body().inverse_dynamics(q, v, a)
    signals = Signals.along(t, v, q, a, load, temperature, wear)
    effect = load_effect("friction_wear_temperature")
    tau = load + np.array(INERTIA) * a
    for j in range(2):
        tau[:, j] += effect.torque(signals, j, LAW)
    tau += disturbance * rng.standard_normal(2) * np.sign(v) + NOISE * rng.standard_normal(q.shape)
    q = q + 1e-6 * rng.standard_normal(q.shape)
    columns = {"t": t}
    for j, joint in enumerate(JOINTS):
        columns |= {
            f"q_{joint}": q[:, j],
            f"tau_{joint}": tau[:, j],
            f"temp_{joint}": signals.temperature[:, j],
        }
    pd.DataFrame(columns).to_parquet(path)


def write_machine(folder: Path, judged, nominal=5, seed=1, disturbance=0.0, fields=None) -> Path:
    """Write a data set of nominal runs and judged ones, the latter as (motion seed, wear, seconds, wait)."""
    (folder / "runs").mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    rng = np.random.default_rng([seed, 5])
    entries = []
    plans = [(1, 0.0, 8.0, 0.5 * (k % 2)) for k in range(nominal)] + list(judged)
    for k, (motion, wear, seconds, wait) in enumerate(plans):
        file = f"runs/r{k}.parquet"
        temperature = WARM + 2.0 * rng.standard_normal()
        record_run(folder / file, draw_motion(motion, seconds, wait), wear, temperature, rng, disturbance)
        use = "train" if k < nominal else "test"
        entries.append({"file": file, "use": use, "session": "new" if k < nominal else f"day {k}"})
    return write_fields(folder, JOINTS, RATE, entries, robot={"rotor_inertia": INERTIA}, **(fields or {}))
