"""Planted effects as additive torque: each a shape of unit amplitude, in a form of the generator's own.

Where a form has variants, the case's random generator chooses one, so that no single formula is "the" truth.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wearscope.demonstration.motions import Machine

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Signals:
    """What a term may depend on along one run: (N,) `t`; (N, n) motor-side `q`, `v`, `a`, and the rest.

    `load` is the torque the link asks for [N m], `temperature` [deg C], `reference_speed` (n,) the speed
    limit, `grain` (n,) the speed over which the real machine's friction changes sign.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    load: Array
    temperature: Array
    reference_speed: Array
    grain: Array

    def sign(self, j: int) -> Array:
        """Smooth sign of the speed of joint j, as this machine has it."""
        return np.tanh(self.v[:, j] / self.grain[j])


Parameters = Callable[[float], dict[str, tuple[float, str]]]


@dataclass(frozen=True)
class Term:
    """An additive effect on joint `joint` (index): torque = amplitude x shape(signals).

    `form` names the formula in words; `parameters(amplitude)` gives the planted parameters as ``name: (value,
    unit)``, with ``{tau}`` and ``{pos}`` for the joint's units; `sign` is the amplitude's.
    """

    joint: int
    shape: Callable[[Signals], Array]
    form: str
    parameters: Parameters = lambda amplitude: {}
    sign: float = 1.0
    extra: dict[str, object] = field(default_factory=dict)


Builder = Callable[[Machine, int, np.random.Generator], Term]
NAMED: dict[str, Builder] = {}


def named(builder: Builder) -> Builder:
    """Enters a builder by its name."""
    return NAMED.setdefault(builder.__name__, builder)


def _toss(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


@named
def stribeck(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Extra friction near zero speed: Gaussian (exponent 2) or Hess-Soom (rational) decay."""
    width = float(rng.uniform(0.05, 0.12)) * m.speed[j]
    parameters: Parameters = lambda x: {"level": (x, "{tau}"), "speed": (width, "{pos}/s")}  # noqa: E731
    if rng.uniform() < 0.5:
        form = "exp(-(v/vs)^2) sign(v)"
        return Term(j, lambda s: np.exp(-((s.v[:, j] / width) ** 2)) * s.sign(j), form, parameters)
    form = "sign(v) / (1 + (v/vs)^2)"
    return Term(j, lambda s: s.sign(j) / (1 + (s.v[:, j] / width) ** 2), form, parameters)


@named
def coulomb_asymmetry(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Coulomb level higher by `amplitude` forwards and lower by it backwards; nothing at rest."""
    return Term(
        j, lambda s: s.sign(j) ** 2, "tanh(v/w)^2", lambda x: {"half_difference": (x, "{tau}")}, _toss(rng)
    )


@named
def viscous_asymmetry(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Viscous slope higher forwards and lower backwards by `amplitude`."""
    return Term(
        j, lambda s: s.v[:, j] * s.sign(j), "v tanh(v/w)",
        lambda x: {"half_difference": (x, "{tau} s/{pos}")}, _toss(rng),
    )  # fmt: skip


@named
def quadratic_viscous(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Churning loss."""
    knee = float(rng.uniform(0.02, 0.1)) * m.speed[j]

    def shape(s: Signals) -> Array:
        return s.v[:, j] * np.sqrt(s.v[:, j] ** 2 + knee**2)

    return Term(j, shape, "v sqrt(v^2 + c^2)", lambda x: {"slope": (x, "{tau} s^2/{pos}^2")})


@named
def concave_viscous(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Shear-thinning grease: a logarithm, or a power of a softened speed."""
    v0 = float(rng.uniform(0.02, 0.06)) * m.speed[j]
    if rng.uniform() < 0.5:
        form = "log(1 + |v|/v0) sign(v)"
        return Term(
            j, lambda s: np.log1p(np.abs(s.v[:, j]) / v0) * s.sign(j), form, lambda x: {"level": (x, "{tau}")}
        )
    power = float(rng.uniform(0.3, 0.55))

    def shape(s: Signals) -> Array:
        return ((s.v[:, j] ** 2 + v0**2) ** (power / 2) - v0**power) * s.sign(j)

    return Term(j, shape, "((v^2 + v0^2)^(p/2) - v0^p) sign(v)", lambda x: {"power": (power, "1")})


@named
def load_dependent_friction(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Friction growing with the transmitted torque."""

    def shape(s: Signals) -> Array:
        scale = 0.02 * np.abs(s.load[:, j]).max()
        return (np.sqrt(s.load[:, j] ** 2 + scale**2) - scale) * s.sign(j)

    return Term(j, shape, "mu (sqrt(load^2 + l0^2) - l0) sign(v)", lambda x: {"coefficient": (x, "1")})


@named
def temperature_dependent_friction(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Viscous (mainly) and Coulomb friction falling exponentially with temperature."""
    decay = float(rng.uniform(16.0, 24.0))
    mix = float(rng.uniform(0.1, 0.5))

    def shape(s: Signals) -> Array:
        fall = np.exp(-(s.temperature[:, j] - 35.0) / decay) - 1.0
        return fall * ((1 - mix) * s.v[:, j] / s.reference_speed[j] + mix * s.sign(j))

    form = "(exp(-(T - 35)/T1) - 1) ((1 - m) v/vmax + m sign(v))"
    return Term(j, shape, form, lambda x: {"decay": (decay, "K")})


@named
def warm_up_drift(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Friction falling hyperbolically with time since the start of the run, temperature unmeasured."""
    share = float(rng.uniform(0.15, 0.35))
    mix = float(rng.uniform(0.3, 0.7))

    def shape(s: Signals) -> Array:
        fall = 1.0 / (1.0 + (s.t - s.t[0]) / (share * (s.t[-1] - s.t[0]))) ** 2
        return fall * ((1 - mix) * s.v[:, j] / s.reference_speed[j] + mix * s.sign(j))

    return Term(j, shape, "(1 + t/t1)^-2 ((1 - m) v/vmax + m sign(v))")


@named
def presliding_hysteresis(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Maxwell slip: three stick-slip springs in parallel, breaking loose one after another."""
    slip = float(rng.uniform(0.015, 0.035)) * m.reach[j]

    def shape(s: Signals) -> Array:
        total = np.zeros(len(s.t))
        for limit, weight in ((0.3 * slip, 0.3), (slip, 0.4), (2.2 * slip, 0.3)):
            total += weight * slip_spring(s.q[:, j], limit)
        return total

    return Term(
        j, shape, "three Maxwell-slip elements", lambda x: {"level": (x, "{tau}"), "slip": (slip, "{pos}")}
    )


def slip_spring(q: Array, limit: float) -> Array:
    """Force (-1..1) of a spring that slips where its stretch passes `limit`; starts relaxed."""
    return np.asarray(_slip(np.diff(q, prepend=q[0]), limit))


@njit(cache=True)  # type: ignore[untyped-decorator]
def _slip(steps: Array, limit: float) -> Array:
    stretch = 0.0
    out = np.empty(len(steps))
    for i in range(len(steps)):
        stretch = min(limit, max(-limit, stretch + steps[i]))
        out[i] = stretch / limit
    return out


@named
def torque_ripple(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Ripple periodic in position, with a second harmonic."""
    order = m.gear_ratio[j] if m.prismatic[j] else float(rng.integers(9, 40))
    phase, phase2 = rng.uniform(0, 2 * np.pi, 2)
    unit = "1/{pos}" if m.prismatic[j] else "1"

    def shape(s: Signals) -> Array:
        return np.sin(order * s.q[:, j] + phase) + 0.25 * np.sin(2 * order * s.q[:, j] + phase2)

    form = "sin(k q + p1) + 0.25 sin(2 k q + p2)"
    return Term(j, shape, form, lambda x: {"amplitude": (x, "{tau}"), "order": (order, unit)})


@named
def joint_spring(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Hose package: a spring about a rest position, stiffening slightly away from it."""
    rest = m.centre[j] + float(rng.uniform(-0.5, 0.5)) * m.reach[j]

    def shape(s: Signals) -> Array:
        x = s.q[:, j] - rest
        return x * (1 + 0.06 * (x / m.reach[j]) ** 2)

    form = "k x (1 + 0.06 (x/reach)^2), x = q - q0"
    return Term(j, shape, form, lambda x: {"stiffness": (x, "{tau}/{pos}"), "rest": (rest, "{pos}")})


@named
def gravity_counterbalance(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """A balancer between a fixed and a turning pin: coil spring, or gas spring with polytropic pressure."""
    span, arm = float(rng.uniform(0.6, 0.9)), float(rng.uniform(0.18, 0.28))
    tilt = float(rng.uniform(0.4, 1.3)) * _toss(rng)
    gas = bool(rng.uniform() < 0.5)

    def shape(s: Signals) -> Array:
        angle = s.q[:, j] - m.centre[j] + tilt + np.pi
        length = np.sqrt(span**2 + arm**2 - 2 * span * arm * np.cos(angle))
        lever = span * arm * np.sin(angle) / length
        shortest = span - arm
        stroke = (length - shortest) / (2 * arm)
        force = (1 - 0.35 * stroke) ** -1.25 if gas else 0.35 + 1.1 * stroke
        return -force * lever

    pins: dict[str, object] = {"span": span, "arm": arm, "tilt": tilt}
    return Term(j, shape, "gas spring" if gas else "coil spring", extra=pins)


@named
def rotor_inertia_error(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Rotor inertia beyond what the declared model has."""
    unit = "kg" if m.prismatic[j] else "kg m^2"
    return Term(j, lambda s: s.a[:, j], "J a", lambda x: {"inertia": (x, unit)})


@named
def cross_coupling(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Friction of joint j driven by a neighbour's motion, as geared wrists have it."""
    source = j - 1 if j > 0 else 1
    mix = float(rng.uniform(0.3, 0.7))

    def shape(s: Signals) -> Array:
        other = s.v[:, source]
        return mix * np.tanh(other / s.grain[source]) + (1 - mix) * other / s.reference_speed[source]

    extra: dict[str, object] = {"source": m.joints[source]}
    return Term(j, shape, "m sign(v_k) + (1 - m) v_k/vmax_k", sign=_toss(rng), extra=extra)


@named
def torque_offset(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """A constant."""
    return Term(j, lambda s: np.ones(len(s.t)), "constant", lambda x: {"offset": (x, "{tau}")}, _toss(rng))


@named
def coulomb(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Coulomb friction that the model does not have at all."""

    def shape(s: Signals) -> Array:
        return s.v[:, j] / np.sqrt(s.v[:, j] ** 2 + s.grain[j] ** 2)

    return Term(j, shape, "v / sqrt(v^2 + w^2)", lambda x: {"level": (x, "{tau}")})


@named
def viscous(m: Machine, j: int, rng: np.random.Generator) -> Term:
    """Viscous friction that the model does not have at all."""
    return Term(j, lambda s: s.v[:, j], "Fv v", lambda x: {"slope": (x, "{tau} s/{pos}")})


NAMED["rotor_inertia"] = rotor_inertia_error
