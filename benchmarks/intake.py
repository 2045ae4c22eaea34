"""Seconds and memory of reading and preparing a large data set, its readings of the columns included.

python benchmarks/intake.py [--runs 50] [--seconds 60] [--rate 1000] [--joints 7] [--out DIR]

The limit is for `--runs 10 --rate 100`: 60,000 rows of seven joints. Whether the readings are right is asked
by `python -m benchmarks.columns`.
"""

import argparse
import multiprocessing
import os
import resource
import tempfile
import time
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

LIMIT_MIB = 4096.0
LIMIT_ROWS, LIMIT_SECONDS = 60_000, 5.0
"""Processor time that so many rows of seven joints may take, all readings asked."""
COULOMB, VISCOUS, INERTIA, NOISE = 3.0, 2.0, 0.3, 0.2


def make_urdf(n):
    """A serial arm with axes in turn upright and level, lighter towards its end."""
    parts = ['<robot name="chain"><link name="l0"/>']
    for k in range(1, n + 1):
        mass, arm = 8.0 * 0.7**k, 0.3 * 0.9**k
        moment = mass * arm**2 / 6
        parts.append(
            f'<link name="l{k}"><inertial><origin xyz="0.02 0 {arm / 2}"/><mass value="{mass}"/>'
            f'<inertia ixx="{moment}" iyy="{moment}" izz="{moment / 2}" ixy="0" ixz="0" iyz="0"/></inertial>'
            f'</link><joint name="j{k}" type="revolute"><parent link="l{k - 1}"/><child link="l{k}"/>'
            f'<origin xyz="0 0 {arm}"/><axis xyz="0 {k % 2} {1 - k % 2}"/>'
            '<limit lower="-6" upper="6" effort="500" velocity="9"/></joint>'
        )
    return "".join([*parts, "</robot>"])


def make_folder(place, runs, seconds, rate, n):
    """Write the data set: band-limited motion, friction, rotors, white noise on torque and encoder."""
    from wearscope.robots.dynamics import RigidBody
    from wearscope.robots.urdf import normalise_urdf

    joints = [f"j{k}" for k in range(1, n + 1)]
    urdf = make_urdf(n)
    body = RigidBody(normalise_urdf(urdf, joints), joints)
    (place / "runs").mkdir(parents=True)
    (place / "robot.urdf").write_text(urdf)
    t = np.arange(int(seconds * rate)) / rate
    entries = []
    for r in range(runs):
        rng = np.random.default_rng(np.random.SeedSequence([0, r]))
        q, v, a = np.zeros((3, len(t), n))
        for j in range(n):
            for k in range(1, 9):
                w, size, phase = 0.6 * k * rng.uniform(0.8, 1.2), 0.8 * rng.normal() / k, rng.uniform(0, 6)
                q[:, j] += size * np.sin(w * t + phase)
                v[:, j] += size * w * np.cos(w * t + phase)
                a[:, j] -= size * w**2 * np.sin(w * t + phase)
        tau = body.inverse_dynamics(q, v, a) + INERTIA * a + COULOMB * np.sign(v) + VISCOUS * v
        table = {"t": t}
        for j, joint in enumerate(joints):
            table[f"q_{joint}"] = q[:, j] + 5e-6 * rng.normal(size=len(t))
            table[f"tau_{joint}"] = tau[:, j] + NOISE * rng.normal(size=len(t))
        file = f"runs/{r:03d}.parquet"
        pd.DataFrame(table).to_parquet(place / file, index=False)
        entries.append({"file": file, "use": "train" if r < max(1, 0.7 * runs) else "test"})
    fields = {
        "name": "large",
        "robot": {"urdf": "robot.urdf", "joints": joints},
        "sample_rate": rate,
        "declared_effects": ["rigid_body", "rotor_inertia", "coulomb", "viscous"],
        "runs": entries,
    }
    (place / "dataset.yaml").write_text(yaml.safe_dump(fields))


def peak():
    """Largest memory of this process so far [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main():
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=1000.0)
    parser.add_argument("--joints", type=int, default=7)
    parser.add_argument("--out", help="keep the data set there, and use one that is there")
    arguments = parser.parse_args()
    place = Path(arguments.out or tempfile.mkdtemp()) / "large"
    if not place.exists():
        # In a process of its own, whose memory is not counted.
        sizes = (arguments.runs, arguments.seconds, arguments.rate, arguments.joints)
        maker = multiprocessing.get_context("spawn").Process(target=make_folder, args=(place, *sizes))
        maker.start()
        maker.join()

    from wearscope.closed_loop.intake.dataset import read_dataset
    from wearscope.closed_loop.intake.plausibility import check_plausibility
    from wearscope.closed_loop.intake.preprocessing import prepare
    from wearscope.closed_loop.posing import find_prismatic

    print(f"{'with the packages':30}{'':10}{peak():8.0f} MiB")
    begun = time.process_time()
    last = start = time.perf_counter()
    dataset = read_dataset(place, find_prismatic)
    print(f"{'read and checked':30}{time.perf_counter() - last:8.1f} s{peak():8.0f} MiB", flush=True)
    last = time.perf_counter()
    prepared = prepare(dataset)
    print(f"{'prepared':30}{time.perf_counter() - last:8.1f} s{peak():8.0f} MiB", flush=True)
    last = time.perf_counter()
    check_plausibility(prepared)
    print(f"{'found plausible':30}{time.perf_counter() - last:8.1f} s{peak():8.0f} MiB", flush=True)
    rows = sum(len(run.tau) for run in prepared.runs)
    size = f"{arguments.joints} joints x {arguments.runs} runs x {arguments.seconds:g} s"
    busy, recorded = (
        time.process_time() - begun,
        int(sum(run.seconds for run in dataset.runs) * arguments.rate),
    )
    print("; ".join(prepared.notes))
    print(
        f"{size} at {arguments.rate:g} Hz: {time.perf_counter() - start:.1f} s ({busy:.1f} s of one core, "
        f"limit {LIMIT_SECONDS * max(1.0, recorded / LIMIT_ROWS):.0f}), "
        f"{peak():.0f} MiB (limit {LIMIT_MIB:g} for the whole loop), {rows} rows kept at "
        f"{prepared.band.rate:g} Hz; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
