"""Motions that a few numbers define, planned within a robot's limits; a diagnosis proposes them as tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wearscope.cycles.base import Cycle, Reference
from wearscope.cycles.motion import MotionPlan
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array

KINDS = ("sweeps", "postures", "points", "fourier", "strokes")
#: A motion uses this share of the way from home to a joint's limit; where there is no limit, this distance
#: from home [rad or m].
SHARE, OPEN = 0.95, 1.5
#: Speeds of the sweeps, as shares of the largest speed.
SPEEDS = (0.02, 0.05, 0.12, 0.3, 0.7, 1.0)
#: Number of harmonics of the Fourier series; time of its smooth start, and of its stop [s].
HARMONICS, RISE = 6, 1.5


@dataclass(frozen=True)
class PlannedMotion:
    """A motion that can be built for a robot.

    Attributes
    ----------
    kind : str
        ``sweeps``: the joint moves over its range at six constant speeds; ``postures``: the same at two
        speeds, with the other joints in three random postures; ``points``: moves between random postures;
        ``fourier``: random Fourier series; ``strokes``: short strokes back and forth about five positions.
    joint : int or None
        Joint that moves alone (``sweeps``, ``postures``, ``strokes``); None moves all together.
    seed : int
        Seed of the random postures and series.
    pace, size : float
        Share of the speed limits, and of the range.
    seconds : float
        Duration after which no further move is added [s].
    within : mapping or None
        `home`, `lower`, `upper`, `speed`, `acceleration`, `jerk` by joint, within which the motion is
        planned; None takes those of the robot.
    """

    kind: str
    joint: int | None = None
    seed: int = 0
    pace: float = 1.0
    size: float = 1.0
    seconds: float = 30.0
    within: Mapping[str, Sequence[float]] | None = None

    @property
    def name(self) -> str:
        """Name of the motion, made of its kind and numbers."""
        who = "all" if self.joint is None else f"j{self.joint + 1}"
        return f"{self.kind}_{who}_{self.seed}_{round(100 * self.pace)}_{round(100 * self.size)}"

    def describe(self, joints: list[str]) -> str:
        """Describe the motion in words."""
        who = "all joints" if self.joint is None else f"joint {joints[self.joint]}"
        what = {
            "sweeps": f"sweeps of {who} at constant speeds from {100 * SPEEDS[0] * self.pace:.0f} to "
            f"{100 * SPEEDS[-1] * self.pace:.0f} % of the limit",
            "postures": f"sweeps of {who} with the other joints in three postures",
            "points": f"moves of {who} between drawn postures",
            "fourier": f"drawn Fourier series of {who}",
            "strokes": f"short strokes of {who} to and fro about five positions",
        }[self.kind]
        return (
            f"{what}, {100 * self.size:.0f} % of the range, at most {100 * self.pace:.0f} % of the top speed"
        )

    def build(self, model: RobotModel, dwell: float, step: float) -> Reference:
        """Build the reference motion for a robot; see `wearscope.cycles.base.Cycle`."""
        plan = MotionPlan(self._limit(model), dwell, step)
        getattr(self, f"_plan_{self.kind}")(plan)
        return plan.finish()

    def _limit(self, model: RobotModel) -> RobotModel:
        """Return the robot with the limits in `within`."""
        if self.within is None:
            return model
        given = {key: [float(x) for x in values] for key, values in self.within.items()}
        drive = model.drive.model_dump(exclude_none=True)
        drive |= {f"{key}_limit": given[key] for key in ("speed", "acceleration", "jerk")}
        return model.replace(drive=drive, home=given["home"], lower=given["lower"], upper=given["upper"])

    def plan_within(self, model: RobotModel) -> "PlannedMotion":
        """Return the same motion with this robot's limits stored, so that every later build uses them."""
        low, high = model.position_limits
        speed, acceleration, jerk = model.motion_limits()
        values = {
            "home": model.home_posture,
            "lower": low,
            "upper": high,
            "speed": speed,
            "acceleration": acceleration,
            "jerk": jerk,
        }
        return replace(self, within={key: x.tolist() for key, x in values.items()})

    def make_cycle(self, joints: list[str]) -> Cycle:
        """Return the motion as a test-cycle."""
        text = self.describe(joints)
        return Cycle(self.name, f"{text[0].upper()}{text[1:]}.", self.build)

    def _range(self, plan: MotionPlan) -> tuple[Array, Array]:
        """Return the lower and upper ends (n,) of the part of each joint's range that is used."""
        lower, upper = plan.model.position_limits
        down = np.where(np.isfinite(lower), SHARE * (plan.home - lower), OPEN)
        up = np.where(np.isfinite(upper), SHARE * (upper - plan.home), OPEN)
        return plan.home - self.size * down, plan.home + self.size * up

    def _targets(self, plan: MotionPlan, end: Array, others: Array | None = None) -> Array:
        """Return the posture with the moving joints at `end`, the others at `others` or where they are."""
        moves = np.ones(plan.n, bool) if self.joint is None else np.arange(plan.n) == self.joint
        return np.where(moves, end, plan.posture if others is None else others)

    def _plan_sweeps(self, plan: MotionPlan) -> None:
        """Sweep back and forth at each of the constant speeds."""
        low, high = self._range(plan)
        budget = self.seconds / len(SPEEDS)
        for share in SPEEDS:
            top = share * self.pace * plan.speed
            # A slow sweep covers only as much of the range, about its middle, as the time allows.
            reach = np.minimum(0.5 * (high - low), 0.5 * top * max(0.5 * budget - 0.5, 0.3))
            middle = 0.5 * (low + high)
            plan.move_to(self._targets(plan, middle - reach), 0.5)
            for end in (middle + reach, middle - reach):
                plan.move_to(self._targets(plan, end), acceleration=0.5, top_speed=top)
            if plan.duration > self.seconds:
                break

    def _plan_postures(self, plan: MotionPlan) -> None:
        """Sweep at two speeds with the other joints in three random postures."""
        low, high = self._range(plan)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, 1]))
        for _ in range(3):
            place = low + rng.uniform(0.1, 0.9, plan.n) * (high - low)
            for share in (0.15, 0.6):
                top = share * self.pace * plan.speed
                for end in (low, high):
                    plan.move_to(self._targets(plan, end, place), acceleration=0.5, top_speed=top)
                    if plan.duration > self.seconds:
                        return

    def _plan_points(self, plan: MotionPlan) -> None:
        """Move all joints between random postures at random speeds."""
        low, high = self._range(plan)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, 2]))
        while plan.duration < self.seconds:
            end = low + rng.uniform(0.0, 1.0, plan.n) * (high - low)
            pace = self.pace * float(rng.choice([0.1, 0.4, 1.0]))
            here = plan.posture
            # A slow move goes only part of the way, so that it does not take too long.
            plan.move_to(here + min(1.0, 2.0 * pace) * (end - here), pace, acceleration=0.8)

    def _plan_strokes(self, plan: MotionPlan) -> None:
        """Make short strokes back and forth about five positions."""
        low, high = self._range(plan)
        for share in (0.1, 0.3, 0.5, 0.7, 0.9):
            centre = low + share * (high - low)
            plan.move_to(self._targets(plan, centre), 0.5)
            for part in (0.01, 0.03):
                for side in (1.0, -1.0, 1.0, -1.0, 0.0):
                    end = centre + side * part * (high - low)
                    plan.move_to(self._targets(plan, end), self.pace, acceleration=0.3)
            if plan.duration > self.seconds:
                return

    def _plan_fourier(self, plan: MotionPlan) -> None:
        """Follow a random Fourier series with a smooth start and stop, scaled to the range and the limits."""
        low, high = self._range(plan)
        rng = np.random.default_rng(np.random.SeedSequence([self.seed, 3]))
        span = self.seconds - 4.0
        k = np.arange(1, HARMONICS + 1)
        sine, cosine = rng.standard_normal((2, plan.n, HARMONICS)) / k
        omega = 2.0 * np.pi * k * max(1, round(span / 10.0)) / span

        def series(time: Array, order: int) -> Array:
            angle = np.multiply.outer(time, omega) + 0.5 * np.pi * order
            weight = omega**order
            return (weight * np.sin(angle)) @ sine.T + (weight * np.cos(angle)) @ cosine.T

        def fade(time: Array) -> tuple[Array, Array, Array]:
            x = np.clip(np.minimum(time, span - time) / RISE, 0.0, 1.0)
            turn = np.where(time < 0.5 * span, 1.0, -1.0)
            value = x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
            slope = turn * 30.0 * (x * (1.0 - x)) ** 2 / RISE
            return value, slope, 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / RISE**2

        def raw(time: Array) -> tuple[Array, Array, Array]:
            f, f1, f2 = (one[:, None] for one in fade(time))
            s, s1, s2 = (series(time, order) for order in range(3))
            return f * s, f1 * s + f * s1, f2 * s + 2.0 * f1 * s1 + f * s2

        grid = np.linspace(0.0, span, 4001)
        q, v, a = raw(grid)
        room = np.where(q > 0.0, high - plan.home, plan.home - low)
        jerk = np.abs(np.diff(a, axis=0)) / (grid[1] - grid[0])
        scale = np.minimum.reduce(
            [
                np.min(room / np.maximum(np.abs(q), 1e-12), axis=0),
                0.95 * self.pace * plan.speed / np.abs(v).max(axis=0),
                0.95 * plan.acceleration / np.abs(a).max(axis=0),
                0.9 * plan.jerk / jerk.max(axis=0),
            ]
        )

        def follow(time: Array) -> tuple[Array, Array, Array]:
            q, v, a = raw(time)
            return plan.home + scale * q, scale * v, scale * a

        plan.run(span, follow, plan.home)


def write_cycle(motion: PlannedMotion, joints: list[str], reason: str) -> str:
    """Return the text of a ``.py`` file that defines the motion as ``CYCLE``; `reason` is its docstring."""
    fields = ", ".join(f"{name}={value!r}" for name, value in vars(motion).items())
    return (
        f'"""{reason}"""\n\n'
        "from wearscope.cycles.planned import PlannedMotion\n\n"
        f"CYCLE = PlannedMotion({fields}).make_cycle({joints!r})\n"
    )
