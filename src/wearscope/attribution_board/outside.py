"""Planted structure that no name of the vocabulary describes; the right answer to it is ``unknown``."""

import numpy as np

from wearscope.attribution_board.machines import Machine
from wearscope.attribution_board.terms import Array, Builder, Signals, Term


def _no_parameters(amplitude: float) -> dict[str, tuple[float, str]]:
    return {}


def position_dependent_friction(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Friction that waxes and wanes along the track: sin(k q + p) sign(v)."""
    order = 3.0 * 1.2 / m.reach[j]
    phase = float(rng.uniform(0, 2 * np.pi))
    return Term(
        j,
        lambda s: np.sin(order * s.q[:, j] + phase) * s.sign(j),
        _no_parameters,
        "sin(k q + p) sign(v)",
    )


def position_speed_product(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque proportional to (q - centre) v."""
    return Term(j, lambda s: (s.q[:, j] - m.centre[j]) * s.v[:, j], _no_parameters, "(q - centre) v")


def acceleration_cubed(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque proportional to the cube of the acceleration."""
    return Term(
        j,
        lambda s: (s.a[:, j] / m.acceleration[j]) ** 3,
        _no_parameters,
        "a^3",
    )


def speed_banded_resonance(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """A friction hump at one middling speed: a band of resonance."""
    middle, width = 0.55 * m.speed[j], 0.07 * m.speed[j]

    def shape(s: Signals) -> Array:
        x = np.abs(s.v[:, j])
        return np.exp(-(((x - middle) / width) ** 2)) * s.sign(j)

    return Term(j, shape, _no_parameters, "exp(-((|v| - v1)/w)^2) sign(v)")


def other_position(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Torque that follows another joint's position, as a dragged cable would."""
    other = j - 1 if j > 0 else 1

    def shape(s: Signals) -> Array:
        return np.sin(2.2 * (s.q[:, other] - m.centre[other]) / m.reach[other])

    extra: dict[str, object] = {"source": m.joints[other], "accept": ["cross_coupling"]}
    return Term(j, shape, _no_parameters, "sin(c (q_k - centre_k))", extra)


def sticking_spot(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """One damaged place on the track that is passed with a friction bump."""
    place = m.centre[j] + float(rng.uniform(-0.3, 0.3)) * m.reach[j]
    width = 0.06 * m.reach[j]
    return Term(
        j,
        lambda s: np.exp(-(((s.q[:, j] - place) / width) ** 2)) * s.sign(j),
        _no_parameters,
        "exp(-((q - q1)/w)^2) sign(v)",
    )


OUTSIDE: dict[str, Builder] = {
    "position_dependent_friction": position_dependent_friction,
    "position_speed_product": position_speed_product,
    "acceleration_cubed": acceleration_cubed,
    "speed_banded_resonance": speed_banded_resonance,
    "other_position": other_position,
    "sticking_spot": sticking_spot,
}
