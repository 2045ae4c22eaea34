"""A small arm over its sessions, made with Pinocchio alone: nothing of the platform is in its truth."""

from pathlib import Path

import numpy as np
import pandas as pd
import pinocchio as pin
from changed_fields import write_fields
from duo import JOINTS, URDF, draw_motion

INERTIA, COULOMB, VISCOUS = np.array([1.5, 0.6]), np.array([6.0, 3.0]), np.array([4.0, 2.0])
NOISE = np.array([0.6, 0.3])
HEAT = 0.012
"""Friction falls by this share of it with each K at 35 deg C."""
MEAN = 35.0
RATE, DURATION = 100.0, 9.0

Day = dict


def simulate(day: Day, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Columns of one run: a day has `temperature`, `wear` (share of friction), `mass`, `gain`, `worn`.

    The last is what wear adds at the first joint: height and width of a bump at low speed, and a slope.
    `push` is the moment [s] and size [N m] of a short push on the first joint.
    """
    t = np.arange(int(DURATION * RATE)) / RATE
    q, v, a = draw_motion(rng, t)
    model = pin.buildModelFromXML(URDF)
    if day.get("mass"):
        model.inertias[2] += pin.Inertia(day["mass"], np.array([0.3, 0.0, 0.0]), np.zeros((3, 3)))
    data = model.createData()
    rigid = np.array([pin.rnea(model, data, *row).copy() for row in zip(q, v, a, strict=True)])
    warmth = day.get("temperature", MEAN) + 2.0 * (1.0 - np.exp(-t / 4.0))
    fall = np.exp(-HEAT * (warmth - MEAN))
    friction = (COULOMB * np.tanh(v / 0.005) + VISCOUS * v) * fall[:, None]
    friction[:, 0] *= 1.0 + day.get("wear", 0.0)
    if day.get("worn"):
        height, width, slope = day["worn"]
        friction[:, 0] += height * np.exp(-np.abs(v[:, 0]) / width) * np.tanh(v[:, 0] / 0.005)
        friction[:, 0] += slope * v[:, 0]
    tau = rigid + INERTIA * a + friction
    tau[:, 0] *= 1.0 + day.get("gain", 0.0)
    if day.get("push"):
        at, size = day["push"]
        tau[:, 0] += size * np.exp(-(((t - at) / 0.2) ** 4))
    tau += NOISE * rng.standard_normal(q.shape)
    columns = {"t": t}
    for j, joint in enumerate(JOINTS):
        columns[f"q_{joint}"] = q[:, j] + 2e-6 * rng.standard_normal(len(t))
        columns[f"tau_{joint}"] = tau[:, j]
        columns[f"temp_{joint}"] = np.round(warmth, 1)
    return columns


def write_machine(
    folder: Path, days: list[Day], healthy: int, seed: int = 0, runs: int = 2, thermometer: bool = True,
    fields: dict | None = None,
) -> Path:  # fmt: skip
    """Write sessions s0, s1...; the first `healthy` are the reference, whose last run is a test run."""
    (folder / "runs").mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    entries = []
    for d, day in enumerate(days):
        for r in range(runs):
            columns = simulate(day, np.random.default_rng([seed, d, r]))
            if not thermometer:
                columns = {name: x for name, x in columns.items() if not name.startswith("temp_")}
            file = f"runs/d{d}r{r}.parquet"
            pd.DataFrame(columns).to_parquet(folder / file)
            train = d < healthy and not (d == healthy - 1 and r == runs - 1)
            entries.append({"file": file, "use": "train" if train else "test", "session": f"s{d}"})
    more = {"reference": [f"s{d}" for d in range(healthy)]} | (fields or {})
    return write_fields(folder, JOINTS, RATE, entries, robot={"rotor_inertia": INERTIA.tolist()}, **more)


HEALTHY = [{"temperature": x} for x in (25.0, 45.0, 35.0, 30.0)]
LATER = [
    {"temperature": 40.0},
    {"temperature": 26.0},
    {"temperature": 45.0, "wear": 0.13},
    {"temperature": 28.0, "wear": 0.1, "mass": 0.8},
    {"temperature": 38.0, "gain": -0.08},
    {"temperature": 66.0},
]
"""Nothing, colder, worn, worn and loaded, another drive, far warmer than the reference."""
