"""What the simulation costs; `benchmarks.work_precision` says what a smaller step buys.

    .venv/bin/python -m benchmarks.simulation                    all of it, a few minutes
    .venv/bin/python -m benchmarks.simulation --robot large --cycle point_to_point

Everything is timed in short turns in one process, and the fastest turn counts: other load on the machine then
spoils neither side of a ratio for long.
"""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count

import numpy as np

from benchmarks import ROOT
from benchmarks.command import start_parser
from wearscope.cycles.base import Reference, load_cycle
from wearscope.robots.model import RobotModel, load_model
from wearscope.simulation.study import Conditions, Simulator
from wearscope.simulation.world import World, pybullet

ROBOTS = ROOT / "config" / "robots"
WORN = Conditions(wear=(20.0, 20.0, 20.0), temperature=45.0, payload_mass_error=0.05)


def take_start(reference: Reference, seconds: float) -> Reference:
    """First seconds of a motion."""
    kept = round(seconds / (reference.t[1] - reference.t[0])) + 1
    return Reference(*(x[:kept] for x in (reference.t, reference.q, reference.v, reference.a)))


def time_in_turns(tasks: dict[str, Callable[[], None]], turns: int) -> dict[str, float]:
    """Seconds of the fastest turn of each task."""
    best = dict.fromkeys(tasks, np.inf)
    for _ in range(turns):
        for name, task in tasks.items():
            start = time.perf_counter()
            task()
            best[name] = min(best[name], time.perf_counter() - start)
    return best


def step_bare(world: World, steps: int) -> None:
    """Step without touching the torques: what a step of PyBullet costs by itself."""
    step, client = pybullet.stepSimulation, world.client
    for _ in range(steps):
        step(client)


def measure_speed(model: RobotModel, reference: Reference, turns: int) -> dict[str, float]:
    """Microseconds a step: all of a run, the same without effects, and PyBullet's step alone.

    `run_of_new_payload` carries another payload each time, of which nothing is kept from the run before.
    """
    smooth = model.replace(effects=[])
    steps = len(reference.t)
    payloads = (replace(WORN, payload_mass_error=0.05 + 1e-5 * k) for k in count(1))
    with Simulator(model) as full, Simulator(smooth) as without:
        full.run(reference, WORN, 1)
        without.run(reference, WORN, 1)
        seconds = time_in_turns(
            {
                "run": lambda: full.run(reference, WORN, 1),
                "run_of_new_payload": lambda: full.run(reference, next(payloads), 1),
                "run_without_effects": lambda: without.run(reference, WORN, 1),
                "bare_step": lambda: step_bare(full.world, steps),
            },
            turns,
        )
    micro = {f"{name}_us": 1e6 * value / steps for name, value in seconds.items()}
    return {
        **micro,
        "run_over_bare_step": seconds["run"] / seconds["bare_step"],
        "run_of_new_payload_over_bare_step": seconds["run_of_new_payload"] / seconds["bare_step"],
        "effects_add": seconds["run"] / seconds["run_without_effects"] - 1.0,
        "robot_seconds_per_second": float(reference.t[-1]) / seconds["run"],
    }


def main() -> None:
    """Print the figures as JSON."""
    parser = start_parser(__doc__)
    parser.add_argument("--robot", action="append", help="medium and large by default")
    parser.add_argument("--cycle", default="point_to_point")
    parser.add_argument("--step", type=float, default=1e-3, help="[s]")
    parser.add_argument("--turns", type=int, default=80)
    parser.add_argument("--seconds", type=float, help="of the test-cycle, a turn; all of it by default")
    options = parser.parse_args()
    figures = {}
    for name in options.robot or ["medium", "large"]:
        model = load_model(name, ROBOTS)
        reference = load_cycle(options.cycle).build(model, 0.05, options.step)
        if options.seconds is not None:
            reference = take_start(reference, options.seconds)
        figures[name] = measure_speed(model, reference, options.turns)
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
