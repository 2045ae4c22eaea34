"""Data sets made by the effects themselves, on a small arm, with the truth at hand."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from changed_fields import DECLARED, write_fields
from duo import JOINTS, URDF, draw_motion
from scipy import signal

from wearscope.closed_loop.inference.answer import find_terms
from wearscope.closed_loop.inference.policy import Policy
from wearscope.closed_loop.inference.problem import Problem
from wearscope.closed_loop.inference.score import Model
from wearscope.closed_loop.intake.dataset import read_dataset
from wearscope.closed_loop.intake.filtering import differentiate
from wearscope.closed_loop.intake.preprocessing import prepare
from wearscope.closed_loop.posing import find_prismatic
from wearscope.effects.base import Signals, TransmissionEffect, load_effect
from wearscope.robots.dynamics import Payload, RigidBody
from wearscope.robots.urdf import normalise_urdf

INERTIA = np.array([1.5, 0.6])
COULOMB, VISCOUS = np.array([6.0, 3.0]), np.array([4.0, 2.0])
NOISE = np.array([1.0, 0.5])
PAYLOAD = Payload(3.0, (0.3, 0.0, 0.0))

Record = Callable[..., Path]


def bend_gear(effect, joint, values, load, q, t) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Motion of the motors where the links follow q: the gear at a joint bends under the load."""
    coefficients, shape = effect.pack(values)
    motor = q.copy()
    motor[:, joint] += coefficients[0] * effect.bend(load[:, joint], shape)
    speed = differentiate(motor, 1.0 / (t[1] - t[0]))
    return motor, speed, differentiate(speed, 1.0 / (t[1] - t[0]))


def answer_disturbance(rng, t, size) -> tuple[np.ndarray, np.ndarray]:
    """Torque (N, 2) that disturbs both joints, and what they move by in position loops of 4 Hz."""
    rate = 1.0 / (t[1] - t[0])
    colour = signal.butter(2, 20.0, fs=rate)
    torque = size * signal.lfilter(*colour, rng.standard_normal((len(t), 2)), axis=0) * np.sqrt(rate / 40.0)
    w = 2 * np.pi * 4.0
    stiff = INERTIA * w**2
    loop = signal.bilinear([w**2], [1.0, 1.4 * w, w**2], rate)
    return torque, signal.lfilter(*loop, torque / stiff, axis=0)


def write_dataset(
    folder: Path, planted=(), seed=0, declared=DECLARED, runs=5,
    noise=1.0, extra_torque=None, duration=12.0, rate=200.0, warm=True, fields=None, robot=None, repeat=False,
    disturbance=0.0, together=None,
) -> Path:  # fmt: skip
    """Write a data set with planted effects [(joint index, effect, values)] and return its folder.

    `extra_torque(t, q, v, a, rng)` gives further torque (N, 2); `disturbance` is the size of one that
    the joints' position loops answer; `warm` records temperatures; `fields` and `robot` are further entries
    of ``dataset.yaml``; `repeat` makes the second run follow the first; `together` are the second joint's
    speeds over the first's, by run, but for a hundredth of what it would do.
    """
    (folder / "runs").mkdir(parents=True)
    (folder / "robot.urdf").write_text(URDF)
    body = RigidBody(normalise_urdf(URDF, JOINTS), JOINTS, payload=PAYLOAD)
    entries = []
    for r in range(runs):
        rng = np.random.default_rng([seed, r])
        t = np.arange(int(duration * rate)) / rate
        drawn = draw_motion(rng, t)
        q, v, a = draw_motion(np.random.default_rng([seed, 0]), t) if repeat and r == 1 else drawn
        if together is not None:
            for x in (q, v, a):
                x[:, 1] = together[r] * x[:, 0] + 0.01 * x[:, 1]
        disturbing = np.zeros_like(q)
        if disturbance:
            disturbing, answer = answer_disturbance(rng, t, disturbance)
            q = q + answer
            v = differentiate(q, rate)
            a = differentiate(v, rate)
        load = body.inverse_dynamics(q, v, a)
        temperature = np.tile((25.0 + 8 * r + 3 * t / duration)[:, None], (1, 2))
        signals = Signals(t, q, v, a, np.sign(v), load, temperature, np.zeros_like(q), body)
        tau = load + INERTIA * a + COULOMB * np.sign(v) + VISCOUS * v
        signals.torque = tau.copy()
        for joint, name, values in planted:
            effect = load_effect(name)
            if isinstance(effect, TransmissionEffect):
                q, v, a = bend_gear(effect, joint, values, load, q, t)
                tau = load + INERTIA * a + COULOMB * np.sign(v) + VISCOUS * v
                continue
            added = effect.torque(signals, joint, values)
            if effect.spread:
                tau = tau + added
            else:
                tau[:, joint] += added
        # What a motor's loop gives is short of what disturbs the joint.
        tau = tau - disturbing
        if extra_torque is not None:
            tau = tau + extra_torque(t, q, v, a, rng)
        tau = tau + noise * NOISE * rng.standard_normal(q.shape)
        columns = {"t": t}
        for j, joint in enumerate(JOINTS):
            columns[f"q_{joint}"] = q[:, j] + 2e-6 * rng.standard_normal(len(t))
            columns[f"tau_{joint}"] = tau[:, j]
            if warm:
                columns[f"temp_{joint}"] = temperature[:, j]
        pd.DataFrame(columns).to_parquet(folder / "runs" / f"r{r}.parquet")
        load = {"mass": PAYLOAD.mass, "com": list(PAYLOAD.com)}
        use = "train" if r < runs - 1 else "test"
        entries.append({"file": f"runs/r{r}.parquet", "use": use, "payload": load})
    robot = {"rotor_inertia": INERTIA.tolist()} | (robot or {})
    robot = {key: value for key, value in robot.items() if value is not None}
    return write_fields(folder, JOINTS, rate, entries, declared, robot, **(fields or {}))


def pose_problem(folder: Path, own=()) -> Problem:
    """Problem of a data set's folder."""
    dataset = read_dataset(folder, find_prismatic)
    declared = [load_effect(name) for name in dataset.fields.declared_effects]
    return Problem(prepare(dataset), declared, own)


def fit_declared(problem: Problem) -> Model:
    """The declared model of a problem, weighed by what it leaves."""
    scale = np.maximum(np.sqrt(np.mean(problem.target**2, axis=0)), 1e-9)
    return Model(problem, (), scale).rescale().rescale()


@pytest.fixture
def declared_model() -> Callable[[Problem], Model]:
    """`fit_declared`."""
    return fit_declared


@pytest.fixture
def name_terms(pose) -> Callable[[Path], set[tuple[str, int]]]:
    """Names and joints that the search finds in a data set's folder."""

    def find(folder: Path) -> set[tuple[str, int]]:
        return {(f.term.effect.name, f.term.joint) for f in find_terms(pose(folder), Policy()).found}

    return find


@pytest.fixture
def carry():
    """Torque of a further load [kg] in the hand, run by run, and of friction as a share of `a`'s load."""

    def make(masses, friction=0.0):
        given = iter(masses)
        declared = RigidBody(normalise_urdf(URDF, JOINTS), JOINTS, payload=PAYLOAD)

        def torque(t, q, v, a, rng):
            load = Payload(PAYLOAD.mass + next(given), PAYLOAD.com)
            heavier = RigidBody(normalise_urdf(URDF, JOINTS), JOINTS, payload=load).inverse_dynamics(q, v, a)
            added = heavier - declared.inverse_dynamics(q, v, a)
            added[:, 0] += friction * np.abs(heavier[:, 0]) * np.sign(v[:, 0])
            return added

        return torque

    return make


@pytest.fixture(scope="session")
def record_at() -> Record:
    """`write_dataset`, for fixtures of a whole module."""
    return write_dataset


@pytest.fixture
def record(tmp_path: Path) -> Record:
    """`write_dataset` into the test's own folder."""
    return lambda *args, **kwargs: write_dataset(tmp_path / "duo", *args, **kwargs)


@pytest.fixture(scope="session")
def pose() -> Callable[..., Problem]:
    """`pose_problem`."""
    return pose_problem
