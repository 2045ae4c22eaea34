"""A case written as a data set, with its truth."""

import numpy as np
import pandas as pd
import yaml

from benchmarks.outside.arms import ARMS
from benchmarks.outside.noise import make_noise
from benchmarks.outside.planted import Truth
from benchmarks.outside.runs import apply_plants, make_run, seat
from benchmarks.outside.sizes import judge_plain, size_plants


def make_case(case, folder):
    """Write a case's data set and return its `Truth`.

    Parameters
    ----------
    case : Case
    folder : Path
    """
    arm = ARMS[case.arm]()
    shapes = [case.generator(1, k).random(4) for k in range(len(case.plants))]
    runs = [make_run(case, arm, r) for r in range(len(case.train) + len(case.test))]
    training = [run for run in runs if run.use == "train"]
    base = np.sqrt(np.mean(np.vstack([run.plain for run in training]) ** 2, axis=0))
    sigma = case.level * base
    truth = Truth()
    scales = size_plants(case, arm, training, sigma, base, shapes, truth)
    judge_plain(case, arm, training, sigma, base, truth)
    (folder / "runs").mkdir(parents=True, exist_ok=True)
    entries = []
    for r, run in enumerate(runs):
        motion, torque = apply_plants(case, arm, run, scales, shapes)
        torque = torque + sigma * make_noise(case.noise, case.generator(2, r), *torque.shape, case.rate)
        name = f"runs/{run.use}_{r}.parquet"
        _record(case, arm, motion, torque, run, case.generator(3, r)).to_parquet(folder / name)
        entries.append({"file": name, "use": run.use})
        if run.payload:
            entries[-1]["payload"] = {"mass": run.payload, "com": seat(arm)}
    (folder / "robot.urdf").write_text(_state(case, arm).urdf())
    (folder / "dataset.yaml").write_text(yaml.safe_dump(_describe(case, arm, entries), sort_keys=False))
    return truth


def _state(case, arm):
    """The arm as its URDF says: masses off by `case.stated`, centres of mass by as much of 10 cm."""
    if not case.stated:
        return arm
    n, rng = len(arm.joints), case.generator(0)
    factor = 1.0 + case.stated * rng.choice([-1.0, 1.0], n) * rng.uniform(0.6, 1.4, n)
    return arm.with_inertials(factor, 0.1 * case.stated * rng.normal(size=(n, 3)))


def _describe(case, arm, entries):
    robot = {
        "urdf": "robot.urdf",
        "joints": arm.names,
        "inertials": case.inertials,
        "gravity": list(arm.gravity),
        "torque_limit": arm.column("effort").tolist(),
        "gear_ratio": arm.column("ratio").tolist(),
    }
    if case.drives:
        robot["rotor_inertia"] = arm.column("rotor").tolist()
    fields = {
        "name": case.name,
        "robot": robot,
        "sample_rate": case.rate,
        "declared_effects": list(case.declared),
        "runs": entries,
    }
    slides = [joint.prismatic for joint in arm.joints]
    if any(slides):
        fields["units"] = {
            "q": ["m" if slide else "rad" for slide in slides],
            "tau": ["N" if slide else "N m" for slide in slides],
        }
    return fields


def _record(case, arm, motion, torque, run, rng):
    q = motion.q
    if case.counts:
        step = 2 * np.pi / (case.counts * arm.column("ratio"))
        q = np.round(q / step) * step
    table = {"t": motion.t}
    for j, name in enumerate(arm.names):
        table[f"q_{name}"] = q[:, j]
        table[f"tau_{name}"] = torque[:, j]
        if case.speed:
            table[f"qd_{name}"] = motion.v[:, j] + 5e-4 * run.scene.top[j] * rng.normal(size=len(motion.t))
        if any(plant.effect == "temperature_dependent_friction" for plant in case.plants):
            table[f"temp_{name}"] = run.scene.temperature[:, j] + 0.1 * rng.normal(size=len(motion.t))
    return pd.DataFrame(table)
