"""Planted structure that no name of the vocabulary describes; the right answer to it is ``unknown``."""

from collections.abc import Callable

import numpy as np
from scipy.signal import lfilter

from benchmarks.board.terms import Array, Builder, Signals, Term
from wearscope.demonstration.motions import Machine

TWO_JOINTS = ("other_position", "position_product")
"""Outside effects that need a second joint."""
KINDS: dict[str, list[str]] = {}
"""Names by kind."""
OUTSIDE: dict[str, Builder] = {}


def outside(kind: str) -> Callable[[Builder], Builder]:
    """Enters a builder by its name."""

    def enter(builder: Builder) -> Builder:
        KINDS.setdefault(kind, []).append(builder.__name__)
        return OUTSIDE.setdefault(builder.__name__, builder)

    return enter


@outside("one_signal")
def position_dependent_friction(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Friction that waxes and wanes along the track."""
    order = 3.0 * 1.2 / m.reach[j]
    phase = float(rng.uniform(0, 2 * np.pi))
    return Term(j, lambda s: np.sin(order * s.q[:, j] + phase) * s.sign(j), "sin(k q + p) sign(v)")


@outside("two_signals")
def position_speed_product(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque by the product of position and speed."""
    return Term(j, lambda s: (s.q[:, j] - m.centre[j]) * s.v[:, j], "(q - centre) v")


@outside("one_signal")
def acceleration_cubed(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque proportional to the cube of the acceleration."""
    return Term(j, lambda s: (s.a[:, j] / m.acceleration[j]) ** 3, "a^3")


@outside("one_signal")
def speed_banded_resonance(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """A friction hump at one middling speed: a band of resonance."""
    middle, width = 0.55 * m.speed[j], 0.07 * m.speed[j]

    def shape(s: Signals) -> Array:
        return np.exp(-(((np.abs(s.v[:, j]) - middle) / width) ** 2)) * s.sign(j)

    return Term(j, shape, "exp(-((|v| - v1)/w)^2) sign(v)")


@outside("two_signals")
def other_position(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque that follows another joint's position, as a dragged cable would."""
    other = j - 1 if j > 0 else 1

    def shape(s: Signals) -> Array:
        return np.sin(2.2 * (s.q[:, other] - m.centre[other]) / m.reach[other])

    extra: dict[str, object] = {"source": m.joints[other], "accept": ["cross_coupling"]}
    return Term(j, shape, "sin(c (q_k - centre_k))", extra=extra)


@outside("one_signal")
def sticking_spot(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """One damaged place on the track that is passed with a friction bump."""
    place = m.centre[j] + float(rng.uniform(-0.3, 0.3)) * m.reach[j]
    width = 0.06 * m.reach[j]

    def shape(s: Signals) -> Array:
        return np.exp(-(((s.q[:, j] - place) / width) ** 2)) * s.sign(j)

    return Term(j, shape, "exp(-((q - q1)/w)^2) sign(v)")


@outside("two_signals")
def position_product(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque by the product of two joints' positions, as a hose across two axes makes."""
    other = j - 1 if j > 0 else 1

    def shape(s: Signals) -> Array:
        return (s.q[:, j] - m.centre[j]) * (s.q[:, other] - m.centre[other])

    return Term(j, shape, "(q - centre)(q_k - centre_k)", extra={"source": m.joints[other]})


@outside("two_signals")
def load_speed_product(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Damping that grows with the transmitted torque."""
    return Term(j, lambda s: np.abs(s.load[:, j]) * s.v[:, j], "|load| v")


def _own_phase(s: Signals) -> float:
    """A phase that differs from run to run: time-dependent torque does not know when a run starts."""
    return float(1e3 * np.abs(s.q[-1]).sum() % 1.0)


@outside("time")
def square_wave(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """A torque that switches sign every few seconds, whatever the machine does."""
    period = float(rng.uniform(2.0, 6.0))

    def shape(s: Signals) -> Array:
        return np.sign(np.sin(2 * np.pi * (s.t / period + _own_phase(s))) + 1e-12)

    return Term(j, shape, "sign(sin(2 pi t / period))")


@outside("time")
def step_in_time(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """A torque that sets in at a moment of each run and stays."""
    sign = float(rng.choice([-1.0, 1.0]))
    return Term(j, lambda s: sign * (s.t > (0.3 + 0.4 * _own_phase(s)) * s.t[-1]), "step at a moment")


@outside("time")
def sine_in_time(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """A slow sine in time."""
    frequency = float(rng.uniform(0.1, 0.8))
    return Term(j, lambda s: np.sin(2 * np.pi * (frequency * s.t + _own_phase(s))), "sin(2 pi f t)")


@outside("history")
def fading_memory(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Friction that has risen with the speed of the last seconds."""
    memory = float(rng.uniform(1.0, 4.0))

    def shape(s: Signals) -> Array:
        keep = np.exp(-(s.t[1] - s.t[0]) / memory)
        past = lfilter([1 - keep], [1.0, -keep], np.abs(s.v[:, j]))
        return np.asarray(past) * s.sign(j)

    return Term(j, shape, "sign(v) (|v| filtered to the past)")


@outside("history")
def turning_point(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque by where the joint last turned round."""

    def shape(s: Signals) -> Array:
        forwards = s.v[:, j] > 0
        turns = np.flatnonzero(np.diff(forwards.astype(int)) != 0) + 1
        last = np.concatenate([[0], turns])[np.searchsorted(turns, np.arange(len(s.t)), side="right")]
        return (s.q[last, j] - m.centre[j]) / m.reach[j]

    return Term(j, shape, "q at the last reversal")
