"""What an effect is: one formula with two uses.

An effect is a contribution to the torque that a motor must supply at a joint. Its compiled `row` writes the
regressors of one sample; identification stacks the rows along measured signals, and the simulator multiplies
the same row with the parameters at each step. An effect is linear in its `coefficients` and may depend on
further `shape` parameters; `states` carry memory (presliding) from one sample to the next.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numba import njit, types

from wearscope import plugins
from wearscope.differentiation import differentiate
from wearscope.errors import InputError

_VECTOR = types.Array(types.float64, 1, "C")

#: Signature of an effect's row, called for joint `j` of `n`:
#: ``row(j, t, dt, sign, q, v, a, load, temperature, wear, shape, state, next_state, out)``.
#: All vectors but the last four are (n,), in joint order; `sign` is the direction of motion, -1 to 1, given
#: apart from `v` so that the simulator can ask for the torque on either side of rest; `load` is the torque of
#: the rigid body; `next_state` and `out` are written.
ROW = types.void(
    types.int64,
    types.float64,
    types.float64,
    *([_VECTOR] * 7),
    _VECTOR,
    _VECTOR,
    _VECTOR,
    _VECTOR,
)

#: Compiles an effect's row.
compile_row: Callable = njit(ROW, cache=True)


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes
    ----------
    name : str
    unit : str
        With ``{torque}`` and ``{position}`` standing for the joint's units (N m and rad, or N and m).
    lower, upper : float
        Bounds that physics sets.
    default : float
        Value where a model leaves the parameter out.
    """

    name: str
    unit: str
    lower: float = -np.inf
    upper: float = np.inf
    default: float = 0.0

    def unit_at(self, position: str, torque: str) -> str:
        """Unit for a joint whose position and torque have the given units."""
        return self.unit.format(position=position, torque=torque)


@dataclass
class Signals:
    """Signals along which effects are evaluated.

    Attributes
    ----------
    t : ndarray (N,)
        Time since the start of the run [s].
    q, v, a : ndarray (N, n)
        Joint position, speed and acceleration.
    sign : ndarray (N, n)
        Direction of motion, -1 to 1; 0 at rest.
    load : ndarray (N, n)
        Rigid-body torque.
    temperature : ndarray (N, n)
        Joint temperature [deg C]; NaN where unknown.
    wear : ndarray (N, n)
        Wear level f of eq. (17) [-].
    rigid_body : wearscope.robots.dynamics.RigidBody or None
        The dynamics that gave `load`, for effects that perturb it.
    torque : ndarray (N, n) or None
        Torque predicted by the model without the effect, for errors of the measurement itself.
    bandwidth : float
        Frequency [Hz] above which the signals are not used.
    transmitted : ndarray (N, n) or None
        Torque through each gear, where more is known of it than `load`.
    lag : ndarray (n,) or None
        Delay [s] of each torque channel about which one is sought; about none where None.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    sign: np.ndarray
    load: np.ndarray
    temperature: np.ndarray
    wear: np.ndarray
    rigid_body: Any = None
    torque: np.ndarray | None = None
    bandwidth: float = np.inf
    transmitted: np.ndarray | None = None
    lag: np.ndarray | None = None
    _slopes: dict[int, tuple[np.ndarray, np.ndarray, np.ndarray]] = field(default_factory=dict)

    def load_slopes(self, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Derivatives (N, n) of the rigid-body torque by position, speed and acceleration of a joint."""
        if joint not in self._slopes:
            move = np.zeros(self.q.shape[1])
            move[joint] = 1e-5
            along = self.rigid_body.inverse_dynamics
            self._slopes[joint] = (
                (along(self.q + move, self.v, self.a) - self.load) / 1e-5,
                (along(self.q, self.v + move, self.a) - self.load) / 1e-5,
                (along(self.q, self.v, self.a + move) - self.load) / 1e-5,
            )
        return self._slopes[joint]

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0


@dataclass
class Term:
    """A torque term installed in a plant: an effect's row at a joint with its numbers."""

    row: Callable
    joint: int
    shape: np.ndarray
    coefficients: np.ndarray
    n_states: int


@dataclass
class Plant:
    """What effects change in a simulated robot of `n` joints.

    Attributes
    ----------
    terms : list of Term
        Joint torques, evaluated at the end-of-step speed.
    armature : ndarray (n,)
        Inertia on the motor side of the transmission, reflected to the joint.
    payload : ndarray (10,)
        Additional inertial parameters of the last joint's link, in its frame: mass [kg], first moments
        [kg m], inertia about the frame's origin [kg m^2] (xx, xy, yy, xz, yz, zz).
    compliance : ndarray (n,)
        Deflection of the transmission per torque; 0 is rigid.
    lost_motion : ndarray (n,)
        Total lost motion of the transmission at torque reversal.
    mesh_torque : ndarray (n,)
        Torque at which the lost motion is taken up: the deflection is
        ``lost_motion / 2 * tanh(torque / mesh_torque)``.
    torque_gain, torque_delay : ndarray (n,)
        Gain error [-] and lag [s] of the recorded torque.
    """

    n: int
    terms: list[Term] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.armature = np.zeros(self.n)
        self.payload = np.zeros(10)
        self.compliance = np.zeros(self.n)
        self.lost_motion = np.zeros(self.n)
        self.mesh_torque = np.ones(self.n)
        self.torque_gain = np.zeros(self.n)
        self.torque_delay = np.zeros(self.n)


_MATRIX = types.Array(types.float64, 2, "C")


# The row as a first-class function: compiled once for all effects and kept, where a dispatcher argument would
# compile anew in every process. All shapes in one pass, since a sample's views cost more than a row.
@njit(
    _MATRIX(
        types.FunctionType(ROW), types.int64, _VECTOR, types.float64, *([_MATRIX] * 7), _MATRIX, types.int64,
        types.int64,
    ),
    cache=True,
)  # fmt: skip
def _stack_rows(row, j, t, dt, sign, q, v, a, load, temperature, wear, shapes, n_states, p):
    out = np.empty((len(t), len(shapes) * p))
    state = np.zeros((len(shapes), max(n_states, 1)))
    next_state = np.zeros((len(shapes), max(n_states, 1)))
    for i in range(len(t)):
        signi, qi, vi, ai, loadi = sign[i], q[i], v[i], a[i], load[i]
        temperaturei, weari = temperature[i], wear[i]
        for s in range(len(shapes)):
            row(
                j, t[i], dt, signi, qi, vi, ai, loadi, temperaturei, weari,
                shapes[s], state[s], next_state[s], out[i, s * p : (s + 1) * p],
            )  # fmt: skip
        # One by one: the assignment of a whole array takes seconds more to compile.
        for s in range(len(shapes)):
            for c in range(n_states):
                state[s, c] = next_state[s, c]
    return out


@dataclass(frozen=True)
class Effect:
    """A joint-torque effect of the vocabulary.

    Attributes
    ----------
    name : str
    form : str
        The formula, as text.
    coefficients : tuple of Parameter
        Parameters in which the torque is linear, one a regressor column.
    source : str
        Reference of the form.
    shape : tuple of Parameter
        Parameters in which it is not.
    row : callable or None
        Compiled with `compile_row`; None for effects that are no torque of the joint's own motion.
    n_states : int
    depends_on : tuple of str
        Signals, with ``{joint}`` for the joint and ``{other}`` for a driving joint.
    spread : bool
        Whether the effect at one joint is felt in the torque of every joint.
    variants : tuple of tuple of str
        Subsets of coefficients that make sense on their own; all of them together where empty.
    extensions : tuple of tuple of str
        Richer subsets that only ever refine an effect that a variant has already named.
    search : callable or None
        Values of the shape parameters worth trying for given signals and joint, (S, k); the defaults where
        None.
    """

    name: str
    form: str
    coefficients: tuple[Parameter, ...]
    source: str
    depends_on: tuple[str, ...]
    shape: tuple[Parameter, ...] = ()
    row: Callable | None = None
    n_states: int = 0
    spread: bool = False
    variants: tuple[tuple[str, ...], ...] = ()
    extensions: tuple[tuple[str, ...], ...] = ()
    search: Callable[[Signals, int], np.ndarray] | None = None

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters: coefficients, then shape."""
        return self.coefficients + self.shape

    def check_values(self, values: Mapping[str, float], where: str) -> None:
        """Refuse unknown parameter names and values outside their bounds.

        Raises
        ------
        InputError
        """
        known = {p.name: p for p in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise InputError(
                    f"{where}: effect '{self.name}' has no parameter '{name}'; it has {', '.join(known)}."
                )
            p = known[name]
            if not p.lower <= value <= p.upper:
                raise InputError(
                    f"{where}: {self.name}.{name} = {value} lies outside [{p.lower}, {p.upper}] {p.unit}."
                )

    def pack(self, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Coefficient and shape vectors of named values, defaults filled in."""
        take = lambda ps: np.array([values.get(p.name, p.default) for p in ps], dtype=float)  # noqa: E731
        return take(self.coefficients), take(self.shape)

    def shapes(self, signals: Signals, joint: int) -> np.ndarray:
        """Shape vectors worth trying for given signals, (S, k)."""
        if self.search is None:
            return self.pack({})[1][None, :]
        return np.atleast_2d(self.search(signals, joint))

    def subsets(self) -> list[np.ndarray]:
        """Indices of the coefficients of each variant."""
        names = [p.name for p in self.coefficients]
        variants = self.variants or (tuple(names),)
        return [np.array([names.index(name) for name in variant], dtype=int) for variant in variants]

    def plain_subsets(self) -> list[np.ndarray]:
        """Those of `subsets` that contain no other."""
        sets = [{int(i) for i in subset} for subset in self.subsets()]
        return [np.array(sorted(a)) for a in sets if not any(b < a for b in sets)]

    def richer_subsets(self, subset: tuple[int, ...]) -> list[np.ndarray]:
        """What variants and extensions add to a subset that they contain."""
        names = [p.name for p in self.coefficients]
        sets = [{int(i) for i in s} for s in self.subsets()]
        sets += [{names.index(name) for name in extension} for extension in self.extensions]
        return [np.array(sorted(s - set(subset))) for s in sets if set(subset) < s]

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressors along signals.

        Parameters
        ----------
        signals : Signals
        joint : int
        shape : ndarray
            Values of the shape parameters.

        Returns
        -------
        ndarray (N, p), or (N, n, p) where `spread`
        """
        return self.stack(signals, joint, shape[None, :])

    def stack(self, signals: Signals, joint: int, shapes: np.ndarray) -> np.ndarray:
        """Regressors of several shapes (S, k) side by side: (N, S*p), or (N, n, S*p) where `spread`."""
        if self.row is None or type(self).columns is not Effect.columns:
            return np.concatenate([self.columns(signals, joint, shape) for shape in shapes], axis=-1)
        take = lambda x: np.ascontiguousarray(x, dtype=float)  # noqa: E731
        return _stack_rows(
            self.row, joint, take(signals.t), signals.dt, take(signals.sign), take(signals.q),
            take(signals.v), take(signals.a), take(signals.load), take(signals.temperature),
            take(signals.wear), take(shapes), self.n_states, len(self.coefficients),
        )  # fmt: skip

    def torque(self, signals: Signals, joint: int, values: Mapping[str, float]) -> np.ndarray:
        """Torque along signals for given parameter values: (N,), or (N, n) where `spread`."""
        coefficients, shape = self.pack(values)
        return self.columns(signals, joint, shape) @ coefficients

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Put the effect with the given parameter values at a joint of a simulated plant."""
        assert self.row is not None
        coefficients, shape = self.pack(values)
        plant.terms.append(Term(self.row, joint, shape, coefficients, self.n_states))


@dataclass(frozen=True)
class RigidBodyEffect(Effect):
    """The multibody dynamics themselves; the plant always has them."""

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressors of the inertial parameters at a joint, (N, 10 n)."""
        return signals.rigid_body.inertial_regressor(signals.q, signals.v, signals.a)[:, joint, :]

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Nothing to add."""


@dataclass(frozen=True)
class ArmatureEffect(Effect):
    """Inertia on the motor side."""

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add to the armature."""
        plant.armature[joint] += self.pack(values)[0][0]


@dataclass(frozen=True)
class PayloadEffect(Effect):
    """Mass at the last link beyond the declared payload; regressors are those of the rigid body."""

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressors of the inertial parameters at every joint, (N, n, 10)."""
        return signals.rigid_body.payload_regressor(signals.q, signals.v, signals.a)

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add to the payload."""
        plant.payload += self.pack(values)[0]


@dataclass(frozen=True)
class TransmissionEffect(Effect):
    """Deflection of the gear between motor (measured) and link, delta(tau) = coefficient * `bend`(tau).

    The link lags the motor by delta; its torque is that of the rigid body along the link's motion, so that
    the regressor is the derivative of inverse dynamics along the deflection, at every joint. tau is the
    torque through the gear where it is known, else that of the rigid body along the motor's motion. The
    deflection of an `abrupt` one jumps.
    """

    bend: Callable = field(default=lambda torque, shape: torque)
    abrupt: bool = False
    installs: tuple[str, ...] = ()

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressor at every joint, (N, n, 1)."""
        torque = signals.load if signals.transmitted is None else signals.transmitted
        delta = self.bend(torque[:, joint], shape)
        speed = differentiate(delta, 1.0 / signals.dt)
        acceleration = differentiate(speed, 1.0 / signals.dt)
        by_position, by_speed, by_acceleration = signals.load_slopes(joint)
        lag = (
            by_position * delta[:, None] + by_speed * speed[:, None] + by_acceleration * acceleration[:, None]
        )
        return -lag[:, :, None]

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Set the transmission's deflection law."""
        coefficients, shape = self.pack(values)
        for name, value in zip(self.installs, [*coefficients, *shape], strict=True):
            getattr(plant, name)[joint] = value


@dataclass(frozen=True)
class MeasurementEffect(Effect):
    """An error of the recorded torque; regressors are made from the predicted torque."""

    kind: Literal["gain", "lag"] = "gain"

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Regressor, (N, 1): the predicted torque, or its change by a delay, per delay."""
        assert signals.torque is not None
        torque = signals.torque[:, joint]
        if self.kind == "gain":
            return torque[:, None]
        lag = 0.0 if signals.lag is None else float(signals.lag[joint])
        if abs(lag) < 1e-3 * signals.dt:
            return -differentiate(torque, 1.0 / signals.dt)[:, None]
        # Imported here: every simulation job loads the effects, and none needs it.
        from scipy.interpolate import CubicSpline

        late = CubicSpline(signals.t, torque)(np.clip(signals.t - lag, signals.t[0], signals.t[-1]))
        return ((late - torque) / lag)[:, None]

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Set the recording's gain error or lag."""
        target = plant.torque_gain if self.kind == "gain" else plant.torque_delay
        target[joint] += self.pack(values)[0][0]


def load_effect(name: str) -> Effect:
    """Effect of the vocabulary by name.

    Raises
    ------
    InputError
        Where the name is not in the vocabulary.
    """
    effect: Effect = plugins.load(name, "effects", "EFFECT")
    return effect
