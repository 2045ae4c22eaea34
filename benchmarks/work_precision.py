"""Work against precision: this simulation, MuJoCo and PyBullet as users write them, in one run side by side.

    .venv/bin/python -m benchmarks.work_precision                     medium, point_to_point, five minutes
    .venv/bin/python -m benchmarks.work_precision --robot large --figure docs/figures/work_precision

All three follow the same motion under the same controller with the same friction, eq. (17), worn and with a
payload error. The error is the RMS difference of the recorded torque, over its RMS, of the worst joint; the
truth is this simulation at a 64th of the longest step. The cost is the time of a whole run without what is
made once a study (models, feed-forward); every method is timed in short turns, and the fastest turn counts.

MuJoCo: `armature`, friction by `qfrc_applied` from the speed at hand, its sign (or the tanh that errs least)
at reversals, semi-implicit Euler as it comes. PyBullet: the same with `TORQUE_CONTROL`; it has no rotor
inertia, whose torque is taken along the reference, the accelerations being unknown before the step: that
leaves an error that no step takes away. The bare step is PyBullet's own, without any torque, in a world as
PyBullet makes it: what no loop around it can undercut.
"""

import json
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import matplotlib.pyplot as plt
import mujoco
import numpy as np
import pybullet

from benchmarks.command import start_parser, write_heads, write_row
from benchmarks.simulation import ROBOTS, WORN, step_bare, take_start, time_in_turns
from wearscope.cycles.base import load_cycle
from wearscope.robots.model import RobotModel, load_model
from wearscope.simulation.arrays import Law
from wearscope.simulation.chain import write_plant_urdf
from wearscope.simulation.study import Simulator
from wearscope.simulation.world import World

#: Steps [s] of each method, each a whole part of the first.
OURS = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4)
THEIRS = (2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4, 6.25e-5)
#: Speeds at which a user smooths friction's jump [rad/s]; 0 is the jump.
WIDTHS = (0.0, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)
GOALS = (1.0, 0.2)


class Friction(NamedTuple):
    """Eq. (17) of all joints at one temperature and wear, as a user would write it."""

    level: np.ndarray
    bump: np.ndarray
    speed: np.ndarray
    worn: np.ndarray
    worn_speed: np.ndarray
    slope: np.ndarray

    def torque(self, v: np.ndarray, width: float) -> np.ndarray:
        """Torque (n,) at a speed."""
        size = np.abs(v)
        side = np.sign(v) if width == 0.0 else np.tanh(v / width)
        even = (
            self.level + self.bump * np.exp(-size / self.speed) + self.worn * np.exp(-size / self.worn_speed)
        )
        return side * even + self.slope * v


def make_friction(model: RobotModel, simulator: Simulator) -> Friction:
    """Numbers of eq. (17) for the conditions of the benchmark."""
    temperature, wear = WORN.temperature, simulator.wear(WORN.wear)
    values = {entry.joint: entry.parameters for entry in model.effects}
    if len(values) != len(model.effects) or any(p["alpha"] != 1.0 for p in values.values()):
        raise SystemExit(
            "the benchmark's user writes eq. (17) with alpha = 1, once a joint; use another robot"
        )
    eta = {k: np.array([values[j][f"eta{k}"] for j in model.joints]) for k in range(10)}
    return Friction(
        level=eta[0],
        bump=eta[1] + eta[2] * temperature,
        speed=eta[3] + eta[4] * temperature,
        worn=eta[7] * wear,
        worn_speed=np.where(wear > 0.0, eta[8] * wear, 1.0),
        slope=eta[5] + eta[6] * temperature + eta[9] * wear,
    )


class Case:
    """A robot and motion with everything that is made once."""

    def __init__(self, robot: str, cycle: str, seconds: float) -> None:
        self.model, self.cycle, self.seconds = load_model(robot, ROBOTS), load_cycle(cycle), seconds
        self.simulator = Simulator(self.model, sample_rate=1.0 / OURS[0])
        self.friction = make_friction(self.model, self.simulator)
        self.body = self.simulator.body(WORN.payload_mass_error)
        self.references: dict[float, object] = {}

    def reference(self, dt: float):
        """The motion at a step."""
        if dt not in self.references:
            whole = self.cycle.build(self.model, 0.05, dt)
            self.references[dt] = take_start(whole, self.seconds)
        return self.references[dt]

    def law(self, dt: float) -> Law:
        """The controller at a step."""
        return self.simulator._law(self.reference(dt))[0]

    def run_ours(self, dt: float) -> np.ndarray:
        """Torque of this simulation, sampled as all are compared."""
        return self.simulator.run(self.reference(dt), WORN, None).tau

    def make_mujoco(self, dt: float, width: float) -> Callable[[], np.ndarray]:
        """A user's loop around MuJoCo."""
        text = write_plant_urdf(self.body).split("?>\n")[1].replace('lower="1.0" upper="-1.0" ', "")
        head, tail = text.split(">", 1)
        spec = mujoco.MjModel.from_xml_string(
            f'{head}><mujoco><compiler fusestatic="false" balanceinertia="false"/></mujoco>{tail}'
        )
        spec.opt.timestep, spec.opt.gravity[:] = dt, self.body.gravity
        data = mujoco.MjData(spec)
        order = [spec.joint(name).dofadr[0] for name in self.model.joints]
        if order != list(range(self.model.n)):
            raise SystemExit("the benchmark's user has joints in MuJoCo's order; use another robot")
        spec.dof_armature[:] = self.model.rotor_inertia
        law, friction, reference = self.law(dt), self.friction, self.reference(dt)
        torque = np.empty_like(law.feedforward)

        def run() -> np.ndarray:
            mujoco.mj_resetData(spec, data)
            data.qpos[:], data.qvel[:] = reference.q[0], reference.v[0]
            q, v, applied = data.qpos, data.qvel, data.qfrc_applied
            for k in range(len(torque)):
                u = law.feedforward[k] + law.stiffness * (reference.q[k] - q)
                u += law.damping * (reference.v[k] - v)
                np.clip(u, -law.limit, law.limit, out=u)
                torque[k] = u
                applied[:] = u - friction.torque(v, width)
                mujoco.mj_step(spec, data)
            return torque[:: round(OURS[0] / dt)]

        return run

    def make_pybullet(self, dt: float, width: float) -> Callable[[], np.ndarray]:
        """A user's loop around PyBullet."""
        world = World()
        world.load(write_plant_urdf(self.body), self.body.names, self.body.gravity, dt)
        body, indices, client = world.body, world.indices, world.client
        law, friction, reference = self.law(dt), self.friction, self.reference(dt)
        rotor = self.model.rotor_inertia * reference.a
        torque = np.empty_like(law.feedforward)

        def run() -> np.ndarray:
            world.set_state(reference.q[0], reference.v[0])
            for k in range(len(torque)):
                states = pybullet.getJointStates(body, indices, physicsClientId=client)
                q, v = np.array([s[0] for s in states]), np.array([s[1] for s in states])
                u = law.feedforward[k] + law.stiffness * (reference.q[k] - q)
                u += law.damping * (reference.v[k] - v)
                np.clip(u, -law.limit, law.limit, out=u)
                torque[k] = u
                pybullet.setJointMotorControlArray(
                    body,
                    indices,
                    pybullet.TORQUE_CONTROL,
                    forces=u - friction.torque(v, width) - rotor[k],
                    physicsClientId=client,
                )
                pybullet.stepSimulation(physicsClientId=client)
            return torque[:: round(OURS[0] / dt)]

        return run

    def make_bare(self, dt: float) -> Callable[[], None]:
        """PyBullet's step alone, in a world as PyBullet makes it."""
        world = World()
        pybullet.resetSimulation(physicsClientId=world.client)
        world.body = -1
        world.load(write_plant_urdf(self.body), self.body.names, self.body.gravity, dt)
        count = len(self.reference(dt).t)
        return lambda: step_bare(world, count)


def find_error(torque: np.ndarray, exact: np.ndarray) -> float:
    """Relative RMS error of the worst joint [%]; infinite where a run left its motion."""
    count = min(len(torque), len(exact))
    off = np.sqrt(np.mean((torque[:count] - exact[:count]) ** 2, axis=0))
    worst = 100.0 * float(np.max(off / np.sqrt(np.mean(exact[:count] ** 2, axis=0))))
    return worst if np.isfinite(worst) else np.inf


def find_cost(errors: list[float], costs: list[float], goal: float) -> float:
    """Cost at an error [%]: by a power law between the steps measured; the longest step's if that does."""
    pairs = sorted(zip(costs, errors, strict=True))
    if pairs[0][1] <= goal:
        return pairs[0][0]
    for (low, above), (high, below) in pairwise(pairs):
        if below <= goal < above:
            share = np.log(above / goal) / np.log(above / below)
            return float(np.exp(np.log(low) + share * np.log(high / low)))
    return np.inf


def measure(case: Case, turns: int) -> dict[str, list[dict]]:
    """Error and cost of every method at every step."""
    exact = case.run_ours(OURS[0] / 64)
    tasks: dict[tuple[str, float], Callable] = {}
    errors: dict[tuple[str, float], float] = {}
    for dt in OURS:
        tasks["wearscope", dt] = lambda dt=dt: case.run_ours(dt)
        errors["wearscope", dt] = find_error(case.run_ours(dt), exact)
        tasks["bare step", dt] = case.make_bare(dt)
        errors["bare step", dt] = errors["wearscope", dt]
    for name, make in (("MuJoCo", case.make_mujoco), ("PyBullet", case.make_pybullet)):
        for dt in THEIRS:
            loops = {width: make(dt, width) for width in WIDTHS}
            tried = {width: find_error(loop().copy(), exact) for width, loop in loops.items()}
            best = min(tried, key=lambda width: tried[width])
            tasks[name, dt], errors[name, dt] = loops[best], tried[best]
    seconds = time_in_turns({str(key): task for key, task in tasks.items()}, turns)
    table: dict[str, list[dict]] = {}
    for (name, dt), error in errors.items():
        cost = 1e3 * seconds[str((name, dt))] / case.seconds
        row = {"step_ms": 1e3 * dt, "error_percent": error, "ms_per_robot_second": cost}
        table.setdefault(name, []).append({**row, "us_per_step": cost * dt * 1e3})
    return table


def draw(table: dict[str, list[dict]], title: str, stem: str) -> None:
    """The diagram as SVG and PNG."""
    styles = {"wearscope": "o-", "MuJoCo": "s-", "PyBullet": "^-", "bare step": "k:"}
    figure, axes = plt.subplots(figsize=(6.0, 4.2), layout="constrained")
    for name, rows in table.items():
        shown = [row for row in rows if row["error_percent"] < 100.0]
        x, y = ([row[key] for row in shown] for key in ("error_percent", "ms_per_robot_second"))
        axes.loglog(x, y, styles[name], label=name)
        if name != "bare step":
            for row in shown:
                where = (row["error_percent"], row["ms_per_robot_second"])
                axes.annotate(f"{row['step_ms']:g}", where, (4, 4), textcoords="offset points", fontsize=7)
    for goal in GOALS:
        axes.axvline(goal, color="0.7", linewidth=0.8, zorder=0)
    axes.set_xlabel("torque error of the worst joint, relative RMS [%]")
    axes.set_ylabel("cost [ms per second of motion]")
    axes.set_title(f"{title}; steps in ms", fontsize=9)
    axes.legend()
    for kind in ("svg", "png"):
        figure.savefig(f"{stem}.{kind}", dpi=150, metadata={"Date": None} if kind == "svg" else None)


def main() -> None:
    """Print the tables as Markdown and the costs at equal error as JSON."""
    parser = start_parser(__doc__)
    parser.add_argument("--robot", default="medium")
    parser.add_argument("--cycle", default="point_to_point")
    parser.add_argument("--seconds", type=float, default=6.0, help="of the motion")
    parser.add_argument("--turns", type=int, default=12)
    parser.add_argument("--figure", type=Path, help="where to draw, without the ending")
    given = parser.parse_args()
    case = Case(given.robot, given.cycle, given.seconds)
    table = measure(case, given.turns)
    print(write_heads("loop", "step [ms]", "torque error [%]", "cost [ms/s]", "a step [us]"))
    for name, rows in table.items():
        for row in rows:
            error = "" if name == "bare step" else f"{row['error_percent']:.3g}"
            cost, step = f"{row['ms_per_robot_second']:.2f}", f"{row['us_per_step']:.1f}"
            print(write_row(name, f"{row['step_ms']:g}", error, cost, step))
    costs = {}
    for name in ("wearscope", "MuJoCo", "PyBullet"):
        errors, spent = (
            [row[key] for row in table[name]] for key in ("error_percent", "ms_per_robot_second")
        )
        costs[name] = {f"{goal:g} %": find_cost(errors, spent, goal) for goal in GOALS}
    print(json.dumps({"ms_per_robot_second_at_error": costs}, indent=2))
    if given.figure is not None:
        draw(table, f"{given.robot}, {given.cycle}", str(given.figure))


if __name__ == "__main__":
    main()
