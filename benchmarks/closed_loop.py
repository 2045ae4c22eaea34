"""Seconds and memory of the closed loop and its page on data sets of five sizes, by stage.

    python -m benchmarks.closed_loop [--size small|contract|large|longer|hundredfold] [--light] [--out DIR]

small: 6 joints x 6 runs x 40 s at 100 Hz; contract: 6 joints x 5 runs x 60 s at 250 Hz; large: 7 joints x 50
runs x 60 s at 1 kHz, of a serial arm with an undeclared spring at the second joint; longer
and hundredfold: 400 and 5,000 such runs, of which the stretches that inform most are used. The data set is
made in a process of its own, whose memory is not counted; the largest is 44 GB and an hour's work.

Before all else, one pass over the dictionary: the columns of every candidate at every joint, and their
products with the declared model. No search of these candidates can take less. Its processor time and peak
memory stand next to those of `diagnose`.
"""

import multiprocessing
import os
import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import yaml

from benchmarks.board.generate import generate_dataset
from benchmarks.board.machines import MACHINES, write_chain
from benchmarks.board.recipe import Planted, Recipe, RunPlan
from benchmarks.command import start_parser
from wearscope.closed_loop.diagnosis import diagnose
from wearscope.closed_loop.diagnostics.examination import examine
from wearscope.closed_loop.inference.extensions import list_extensions
from wearscope.closed_loop.inference.score import Model
from wearscope.closed_loop.posing import pose_problem
from wearscope.reporting.closed_loop_page import write_closed_loop_page
from wearscope.robots.dynamics import RigidBody
from wearscope.robots.urdf import normalise_urdf

KINDS = ("fourier", "sweep", "points")
SPRING = 4.0
COULOMB, VISCOUS, INERTIA, NOISE = 3.0, 2.0, 0.3, 0.2


@dataclass(frozen=True)
class Size:
    """A data set's size and the limits that closing the loop on it must keep to [s, MiB]."""

    joints: int
    runs: int
    seconds: float
    rate: float
    limit_seconds: float
    limit_mib: float


SIZES = {
    "small": Size(6, 6, 40.0, 100.0, 60.0, 2048.0),
    "contract": Size(6, 5, 60.0, 250.0, 120.0, 2048.0),
    "large": Size(7, 50, 60.0, 1000.0, 900.0, 4096.0),
    "longer": Size(7, 400, 60.0, 1000.0, 900.0, 4096.0),
    "hundredfold": Size(7, 5000, 60.0, 1000.0, 3600.0, 4096.0),
}


def make_plans(runs):
    """Plans of `runs` runs, the last two for testing."""
    plans = []
    for number in range(runs):
        use = "train" if number < max(1, runs - 2) else "test"
        plans.append(RunPlan(use, KINDS[number % len(KINDS)], number, 24.0 + 7.0 * number))
    return tuple(plans)


def make_urdf(n):
    """A serial arm with axes in turn upright and level, lighter towards its end."""
    rows = []
    for k in range(1, n + 1):
        mass, arm = 8.0 * 0.7**k, 0.3 * 0.9**k
        moment = mass * arm**2 / 6
        axis, centre = f"0 {k % 2} {1 - k % 2}", f"0.02 0 {arm / 2}"
        rows.append((f"j{k}", f"0 0 {arm}", axis, f"l{k}", mass, centre, (moment, moment, moment / 2)))
    return write_chain("chain", "l0", rows)


def make_long_runs(place, runs, seconds, rate, n):
    """Write a data set: band-limited motion, friction, rotors, a spring, white noise on both columns."""
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
        tau[:, 1] += SPRING * q[:, 1]
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


def make_data(place, name):
    """Write the data set of a size, with one effect that it does not declare."""
    size = SIZES[name]
    if name in ("large", "longer", "hundredfold"):
        return make_long_runs(place, size.runs, size.seconds, size.rate, size.joints)
    machine = next(m for m in MACHINES.values() if len(m.joints) == size.joints)
    recipe = Recipe(duration=size.seconds, rate=size.rate, plans=make_plans(size.runs), temperatures=True)
    planted = [Planted("load_dependent_friction", machine.joints[1], 4.0)]
    return generate_dataset(place, machine.name, planted, 3, recipe)


def pass_over(data):
    """Processor seconds of reading, and of one pass over the dictionary of columns; the count of columns."""
    begin = time.process_time()
    problem = pose_problem(data)
    model = Model(problem, (), np.ones(problem.prepared.n))
    read, begin = time.process_time() - begin, time.process_time()
    extensions = list_extensions(model, range(problem.prepared.n))
    candidates = {id(o.term.candidate): o.term.candidate for o in extensions}
    count = sum(x.shape[1] for candidate in candidates.values() for x in candidate.rows)
    return read, time.process_time() - begin, count


def measure_peak():
    """Peak memory of this process [MiB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main():
    """Measure and print."""
    parser = start_parser(__doc__)
    parser.add_argument("--size", choices=SIZES, default="small")
    parser.add_argument("--light", action="store_true", help="without diagnostics and forward simulation")
    parser.add_argument("--out", help="keep data set and results there, and use a data set that is there")
    arguments = parser.parse_args()
    place, size = Path(arguments.out or tempfile.mkdtemp()), SIZES[arguments.size]
    data, out = place / arguments.size, place / f"{arguments.size}-out"
    start = time.perf_counter()
    if not (data / "dataset.yaml").is_file():
        maker = multiprocessing.get_context("spawn").Process(target=make_data, args=(data, arguments.size))
        maker.start()
        maker.join()
        print(f"{'made in':58}{time.perf_counter() - start:8.1f} s", flush=True)

    read, once, columns = pass_over(data)
    first_peak = measure_peak()
    start = last = time.perf_counter()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    begin = time.process_time()

    def show(line):
        nonlocal last
        now = time.perf_counter()
        print(
            f"  until '{line[:46]}'".ljust(58) + f"{now - last:8.1f} s{measure_peak():8.0f} MiB", flush=True
        )
        last = now

    diagnosis = diagnose(data, progress=show)
    asked = time.process_time() - begin
    show("diagnosed")
    print(
        f"processor time: read {read:.1f} s, diagnose {asked:.1f} s, peak {measure_peak():.0f} MiB; "
        f"one pass over {columns} columns {once:.1f} s, peak {first_peak:.0f} MiB"
    )
    extra = {} if arguments.light else examine(out, diagnosis, show)
    verdict = diagnosis.write(out, extra)
    show("written")
    write_closed_loop_page(out)
    show("report.html")
    seconds = time.perf_counter() - start
    usage = resource.getrusage(resource.RUSAGE_SELF)
    print([(e["joint"], e["effect"], e["status"]) for e in verdict["verdict"]])
    print({joint: one["state"] for joint, one in verdict["joints"].items()})
    print(
        f"{size.joints} joints x {size.runs} runs x {size.seconds:g} s at {size.rate:g} Hz: {seconds:.1f} s "
        f"(limit {size.limit_seconds:g}), {usage.ru_utime - before:.1f} s of one core's time, "
        f"{measure_peak():.0f} MiB (limit {size.limit_mib:g}); {os.cpu_count()} cores, "
        f"load {os.getloadavg()[0]:.1f}"
    )


if __name__ == "__main__":
    main()
