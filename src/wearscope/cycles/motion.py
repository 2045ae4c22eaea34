"""Building blocks of test-cycles: postures as shares of a robot's range, and moves within its limits."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from ruckig import InputParameter, Result, Ruckig, RuckigError, Trajectory

from wearscope import limits
from wearscope.cycles.base import Reference
from wearscope.errors import InputError
from wearscope.robots.model import RobotModel
from wearscope.robots.spatial import Array

# Each joint stays within this distance of home [rad or m], and this share of the way from home to a limit.
LARGEST_EXCURSION = 0.8
SHARE_OF_RANGE = 0.9
# Motor speed [rad/s] that is assumed at the speed limit of a joint whose gear ratio is unknown.
MOTOR_SPEED_AT_LIMIT = 300.0

# Function that returns position, speed and acceleration (k, n) at times (k,) since the motion's start [s].
Motion = Callable[[Array], tuple[Array, Array, Array]]


class MotionPlan:
    """A motion that is planned move by move, each from rest to rest, and sampled at the end.

    Parameters
    ----------
    model : RobotModel
        Robot; the motion starts at its home posture.
    dwell : float
        Pause before each move [s].
    step : float
        Time step of the samples [s].

    Raises
    ------
    InputError
        Where the model has no motion limits, or `dwell` or `step` is no time.
    """

    def __init__(self, model: RobotModel, dwell: float, step: float) -> None:
        if not (np.isfinite(dwell) and dwell >= 0.0 and np.isfinite(step) and step > 0.0):
            raise InputError(
                f"dwell = {dwell} s, step = {step} s: give a dwell of 0 or more and a step above 0."
            )
        self.model = model
        self.dwell = dwell
        self.step = step
        self.speed, self.acceleration, self.jerk = model.motion_limits()
        self.home = model.home_posture
        self.posture = self.home.copy()
        lower, upper = model.position_limits
        self._down = np.minimum(SHARE_OF_RANGE * (self.home - lower), LARGEST_EXCURSION)
        self._up = np.minimum(SHARE_OF_RANGE * (upper - self.home), LARGEST_EXCURSION)
        self._segments: list[tuple[float, Motion]] = []

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.model.n

    @property
    def duration(self) -> float:
        """Duration of the moves planned so far [s]."""
        return sum(duration for duration, _ in self._segments)

    def posture_at(self, shares: ArrayLike) -> Array:
        """Return the posture (n,) at shares of the way from home (0) to the lower (-1) or upper (1) end.

        A list longer than the robot's joints is cut; a shorter one is filled with 0.
        """
        padded = np.zeros(self.n)
        given = np.asarray(shares, dtype=float)[: self.n]
        padded[: len(given)] = given
        return self.home + np.where(padded < 0.0, padded * self._down, padded * self._up)

    def excursion(self) -> Array:
        """Return the distance (n,) that each joint can move to both sides of home."""
        return np.minimum(self._down, self._up)

    def joint_speed(self, motor_speed: float) -> Array:
        """Return the joint speed (n,) at a motor speed [rad/s], at most 0.9 times the speed limit."""
        if self.model.drive.gear_ratio is None:
            wanted = motor_speed / MOTOR_SPEED_AT_LIMIT * self.speed
        else:
            wanted = motor_speed / np.abs(self.model.gear_ratio)
        return np.minimum(wanted, 0.9 * self.speed)

    def move_to(
        self,
        posture: ArrayLike,
        speed: float = 1.0,
        acceleration: float = 0.3,
        top_speed: ArrayLike | None = None,
    ) -> None:
        """Dwell, then move all joints to a posture (n,), within limits on speed, acceleration and jerk.

        All joints start and arrive together. A move to the present posture is left out, with its dwell.

        Parameters
        ----------
        posture : array (n,)
        speed : float
            Share of the speed limits.
        acceleration : float
            Share of the acceleration and jerk limits.
        top_speed : array (n,), optional
            Largest joint speeds, in place of `speed`.
        """
        top = speed * self.speed if top_speed is None else np.asarray(top_speed, dtype=float)
        target = np.asarray(posture, dtype=float)
        if np.array_equal(target, self.posture):
            return
        trajectory = self._plan(target, top, acceleration)
        self.run(trajectory.duration, partial(_follow, trajectory), target)

    def _plan(self, target: Array, top: Array, acceleration: float) -> Trajectory:
        """Plan a move with Ruckig within speeds `top` and a share of the acceleration and jerk limits."""
        order = InputParameter(self.n)
        order.current_position = self.posture.tolist()
        order.target_position = target.tolist()
        order.max_velocity = top.tolist()
        # Ruckig fails at distances at which the acceleration limit is only just reached; a slightly lower
        # limit avoids this case.
        for share in (1.0, 0.99, 0.97):
            order.max_acceleration = (share * acceleration * self.acceleration).tolist()
            order.max_jerk = (acceleration * self.jerk).tolist()
            trajectory = Trajectory(self.n)
            try:
                if Ruckig(self.n).calculate(order, trajectory) in (Result.Working, Result.Finished):
                    return trajectory
            except (RuckigError, ValueError):  # ValueError: Ruckig's error code is not known to its binding
                continue
        raise InputError(
            f"robot '{self.model.name}': no motion from {self.posture.round(3)} to {target.round(3)} found; "
            "change its home posture or its limits a little."
        )

    def run(self, duration: float, motion: Motion, end: ArrayLike) -> None:
        """Dwell, then follow a motion from rest at the present posture to rest at `end` (n,)."""
        self.pause(self.dwell)
        self._segments.append((duration, motion))
        self.posture = np.asarray(end, dtype=float)

    def pause(self, duration: float) -> None:
        """Hold the present posture for a duration [s]."""
        held = self.posture.copy()

        def hold(times: Array) -> tuple[Array, Array, Array]:
            still = np.zeros((len(times), len(held)))
            return held + still, still, still

        self._segments.append((duration, hold))

    def finish(self) -> Reference:
        """Dwell once more and sample the whole motion; it ends at rest."""
        self.pause(max(self.dwell, 2.0 * self.step))
        starts = np.concatenate(([0.0], np.cumsum([duration for duration, _ in self._segments])))
        if starts[-1] / self.step * self.n > limits.SAMPLES:
            raise InputError(
                f"robot '{self.model.name}': a motion within its limits takes {starts[-1]:.3g} s, too long "
                f"to sample every {self.step:g} s; correct its speed and acceleration limits, or payload."
            )
        count = int(np.ceil(starts[-1] / self.step - 1e-9)) + 1
        t = self.step * np.arange(count, dtype=np.float64)
        which = np.minimum(np.searchsorted(starts, t, side="right") - 1, len(self._segments) - 1)
        samples = np.empty((3, count, self.n))
        for index, (duration, motion) in enumerate(self._segments):
            rows = slice(*np.searchsorted(which, (index, index + 1)))
            if rows.start < rows.stop:
                samples[:, rows] = motion(np.minimum(t[rows] - starts[index], duration))
        return Reference(t, samples[0], samples[1], samples[2])


def _follow(trajectory: Trajectory, times: Array) -> tuple[Array, Array, Array]:
    """Sample a trajectory at times (k,) at once; the values equal those of its `at_time` to the last bit."""
    (profiles,) = trajectory.profiles
    ends = np.cumsum([profile.t for profile in profiles], axis=1)
    phase = np.sum(times[:, None, None] >= ends, axis=2)
    phase[times >= trajectory.duration] = ends.shape[1]
    joints = np.arange(len(profiles))
    pick = lambda values: np.array(values)[joints, phase]  # noqa: E731
    t = times[:, None] - pick([[0.0, *row] for row in ends.tolist()])
    q, v, a = (pick([getattr(profile, name) for profile in profiles]) for name in ("p", "v", "a"))
    jerk = pick([[*profile.j, 0.0] for profile in profiles])
    return q + t * (v + t * (a / 2 + t * jerk / 6)), v + t * (a + t * jerk / 2), a + t * jerk
