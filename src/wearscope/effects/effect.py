"""The class `Effect`: one formula for a joint's torque, used for identification and simulation.

An effect is a contribution to the torque that a motor must supply at a joint. Its compiled `row` writes the
regressors of one sample. Identification stacks these rows along measured signals; the simulator multiplies
the same row with the parameters at each step. The torque is linear in the `coefficients` and may depend on
further `shape` parameters nonlinearly. Internal states, as of presliding, pass from one sample to the next.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from wearscope.effects.parameter import Parameter
from wearscope.effects.rows import Plant, Term, stack_rows
from wearscope.effects.signals import Signals
from wearscope.errors import InputError

#: Motions that show effects, one sentence each. Effects share them, so that advice for several effects
#: agrees.
SPEEDS = "move in both directions at several constant speeds, from 1 % to 100 % of the largest one"
SLOW_MOTION = "add slow motion: constant speeds below 5 % of the largest one, in both directions"
RANGE = "cover the whole position range slowly, in both directions"
POSTURES = "repeat the motion with the other joints in other postures, so that gravity's share changes"
PAYLOAD = "repeat the motion with another known payload and with none"
QUICK = "add motion with large accelerations about several postures (periodic excitation)"
REVERSALS = "add slow reversals of a few tenths of a degree about several positions"
TEMPERATURE = "repeat the motion cold and warm, and record the joint's temperature"
TIME = "repeat one motion from a cold start until the friction no longer changes"
GRAVITY_SIGN = "cross the posture where the gravity torque changes sign, slowly"
SESSIONS = "record constant slow speed over the whole range in two sessions, both for training"
ALONE = "move each joint alone, the others held still"
WEAR = "repeat the motion new and worn, at one temperature"
#: Advice for an effect that names no motion.
OTHERS = "repeat the motion at other speeds, in other postures and with another payload"

#: Effects of a usual joint. They hide or mimic missing effects, so that the search tries them first.
USUAL = frozenset({"coulomb", "rotor_inertia", "torque_offset", "viscous"})
#: Half width of the search about a grid value of a shape parameter, in its logarithm. Neighbours on a grid
#: differ by factors of up to e^0.8.
SEARCH_WIDTH = 0.8


@dataclass(frozen=True)
class Effect:
    """A joint-torque effect. The vocabulary is all effects of the platform.

    A kind of effect with rules of its own is a class in `wearscope.effects.kinds`, or in the effect's file.
    It overrides the properties and methods below.

    Attributes
    ----------
    name : str
    form : str
        The formula, as text.
    coefficients : tuple of Parameter
        Parameters in which the torque is linear, one for each regressor column.
    source : str
        Reference of the form.
    depends_on : tuple of str
        Signals, with ``{joint}`` for the joint. ``{other}`` is another joint that drives this one: the first
        shape parameter is its index.
    shape : tuple of Parameter
        Parameters in which the torque is not linear.
    row : callable or None
        Function that writes the regressors of one sample, compiled with `compile_row`; None for an effect
        that is not a torque of the joint's own motion.
    n_states : int
        Number of internal states of `row`.
    regressors : callable or None
        ``regressors(signals, joint, shape)`` returns regressors (N, p), or (N, n, p) where `spread`, from
        signals with further measured channels, which `row` does not get. An effect that also has a `row` uses
        it for signals without channels, such as those of a planned motion, and in the simulation.
    spread : bool
        Whether the effect at one joint changes the torque of every joint.
    search : callable or None
        ``search(signals, joint)`` returns values of the shape parameters to try, (S, k); None tries the
        defaults.
    variants : tuple of tuple of str
        Subsets of coefficients that the search tries on their own; empty for all of them together.
    extensions : tuple of tuple of str
        Larger subsets, which the search tries only where a variant was already named.
    candidate : bool or str
        Whether the diagnosis may name the effect as missing; False for one that is only declared, or generic.
        The name of another effect: only where that one's value is given, of which this effect is the error.
    parents : tuple of str
        At least one of these effects must be in the joint's model before this one is a candidate.
    contains : tuple of str
        Effects whose columns are linear combinations of its own, so that they need not be searched next to
        it.
    applies : callable or None
        ``applies(signals, joint)`` returns whether the signals hold what the effect needs; None for always.
    excitation : str
        Motion that shows the effect best.
    passive : callable or None
        ``passive(values, temperature)`` returns what formats with passive joints (URDF, MJCF) can hold of the
        effect: `friction`, `damping`, `quadratic` (factor of v abs(v)), `stiffness`, `preload`, `by_load`
        (friction over load), and the tuples `falling` (level, speed, exponent), `presliding` (level,
        displacement) and `wave` (cosine, sine, wavenumber). None where they hold nothing.
    reference : str
        Path of the file that the effect was loaded from; empty for the platform's effects.
    """

    name: str
    form: str
    coefficients: tuple[Parameter, ...]
    source: str
    depends_on: tuple[str, ...]
    shape: tuple[Parameter, ...] = ()
    row: Callable | None = None
    n_states: int = 0
    regressors: Callable[[Signals, int, np.ndarray], np.ndarray] | None = None
    spread: bool = False
    search: Callable[[Signals, int], np.ndarray] | None = None
    variants: tuple[tuple[str, ...], ...] = ()
    extensions: tuple[tuple[str, ...], ...] = ()
    candidate: bool | str = True
    parents: tuple[str, ...] = ()
    contains: tuple[str, ...] = ()
    applies: Callable[[Signals, int], bool] | None = None
    excitation: str = OTHERS
    passive: Callable[[Mapping[str, float], float], Mapping[str, float | tuple[float, ...]]] | None = None
    reference: str = ""

    #: Whether a kind of effect belongs to the whole robot; it is then listed at the last joint.
    per_robot: ClassVar[bool] = False
    #: Whether a kind of effect is a generic form whose coefficients have no meaning of their own.
    empirical: ClassVar[bool] = False

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters: the coefficients, then the shape parameters."""
        return self.coefficients + self.shape

    @property
    def label(self) -> str:
        """Name of the effect in a model file: the path of its file, or its name in the vocabulary."""
        return self.reference or self.name

    @property
    def standard(self) -> bool:
        """Whether a usual joint has the effect, so that the search tries it first."""
        return self.name in USUAL

    @property
    def corrects(self) -> str:
        """Declared effect of whose given value this one is the error; empty where it is none."""
        return self.candidate if isinstance(self.candidate, str) else ""

    @property
    def selects_signals(self) -> bool:
        """Whether its shape parameters select the signals that it depends on."""
        return any("{" in name and "{joint}" not in name for name in self.depends_on)

    @property
    def repeatable(self) -> bool:
        """Whether a joint can have the effect several times: once for each signal that it may depend on."""
        return self.selects_signals

    @property
    def is_friction(self) -> bool:
        """Whether its torque depends on the joint's own speed or its sign, and acts at that joint alone."""
        return bool({"qd_{joint}", "sign_qd_{joint}"} & set(self.depends_on)) and not self.spread

    @property
    def follows_direction(self) -> bool:
        """Whether its columns may depend on the direction of motion; a user's own effect always counts."""
        own = self.empirical or bool(self.reference)
        return own or any(name.startswith("sign_qd") for name in self.depends_on)

    @property
    def is_plain_friction(self) -> bool:
        """Whether it is friction that a usual joint has; such friction can hide or mimic a missing effect."""
        return self.standard and self.is_friction

    @property
    def is_in_every_drive(self) -> bool:
        """Whether every drive has it: a standard effect whose coefficients cannot be negative."""
        return self.standard and all(p.lower >= 0.0 for p in self.coefficients)

    @property
    def is_thermal(self) -> bool:
        """Whether its torque depends on temperature or time."""
        return bool({"temp_{joint}", "t"} & set(self.depends_on))

    @property
    def is_offset(self) -> bool:
        """Whether its torque is constant."""
        return set(self.depends_on) == {"constant"}

    @property
    def is_by_position(self) -> bool:
        """Whether its torque depends on the joint's position alone, as that of a mounted spring."""
        return set(self.depends_on) == {"q_{joint}"}

    @property
    def needs_wear(self) -> bool:
        """Whether its torque depends on how worn the joint is."""
        return "wear_{joint}" in self.depends_on

    def for_robot(self, n: int) -> "Effect":
        """Return the effect for `n` joints; another object only where its coefficients depend on `n`."""
        return self

    def check_values(self, values: Mapping[str, float], where: str) -> None:
        """Refuse unknown parameters, values outside their bounds, and missing values without a default.

        Raises
        ------
        InputError
            Names the effect and the parameter; `where` begins the sentence.
        """
        known = {p.name: p for p in self.parameters}
        for name, value in values.items():
            if name not in known:
                raise InputError(
                    f"{where}: effect '{self.name}' has no parameter '{name}'; it has "
                    f"{', '.join(known) or 'none'}."
                )
            p = known[name]
            if not p.lower <= value <= p.upper:
                raise InputError(
                    f"{where}: {self.name}.{name} = {value} lies outside [{p.lower}, {p.upper}] {p.unit}."
                )
        for p in self.parameters:
            if np.isnan(p.default) and p.name not in values:
                raise InputError(f"{where}: effect '{self.name}' has no value for '{p.name}'; add it.")

    def pack(self, values: Mapping[str, float]) -> tuple[np.ndarray, np.ndarray]:
        """Return the coefficients (p,) and shape parameters (k,) of named values, with defaults filled in."""
        filled, count = np.array(list(self.fill(values).values())), len(self.coefficients)
        return filled[:count], filled[count:]

    def fill(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the values of all parameters by name, with defaults filled in."""
        return {p.name: float(values.get(p.name, p.default)) for p in self.parameters}

    def shapes(self, signals: Signals, joint: int) -> np.ndarray:
        """Return the values of the shape parameters to try for given signals, (S, k)."""
        if self.search is None:
            return self.pack({})[1][None, :]
        return np.atleast_2d(self.search(signals, joint))

    def shape_of(self, subset: Iterable[int]) -> tuple[Parameter, ...]:
        """Return the shape parameters on which the regressors of a subset of coefficients depend."""
        shaped = [self.coefficients[k].shaped for k in subset]
        return self.shape if any(shaped) or not shaped else ()

    def estimated_shapes(self, subset: Iterable[int] = ()) -> list[int]:
        """Return the indices of the shape parameters that are estimated with a subset of coefficients."""
        return [k for k, p in enumerate(self.shape_of(subset)) if p.estimated]

    def width(self, signals: Signals, joint: int, shape: Sequence[float]) -> float:
        """Return the half width of the search for the first estimated shape parameter, in its logarithm [-].

        The search is about a value (k,) that `shapes` returned.
        """
        return SEARCH_WIDTH

    def count_alternatives(self, shapes: int) -> float:
        """Return the number of alternatives among a number of shapes; neighbours may hardly differ."""
        return float(shapes)

    def complexity(self, subset: Iterable[int]) -> int:
        """Return the number of fitted values: the coefficients of a subset, and the searched shapes."""
        chosen = list(subset)
        return len(chosen) + (0 if self.search is None else len(self.estimated_shapes(chosen)))

    def subsets(self) -> list[np.ndarray]:
        """Return the indices of the coefficients of each variant."""
        names = [p.name for p in self.coefficients]
        variants = self.variants or (tuple(names),)
        return [np.array([names.index(name) for name in variant], dtype=int) for variant in variants]

    def plain_subsets(self) -> list[np.ndarray]:
        """Return the variants that contain no other variant, as indices of coefficients."""
        sets = [{int(i) for i in subset} for subset in self.subsets()]
        return [np.array(sorted(a)) for a in sets if not any(b < a for b in sets)]

    def has_parent(self, present: Iterable["Effect"]) -> bool:
        """Return whether a joint's model has one of the parents of this effect.

        Parameters
        ----------
        present : iterable of Effect
            Effects in the joint's model; an effect that `contains` a parent counts as the parent.
        """
        if not self.parents:
            return True
        return any(not {e.name, *e.contains}.isdisjoint(self.parents) for e in present)

    def is_usable(self, signals: Signals, joint: int) -> bool:
        """Return whether the signals hold what the effect needs at a joint."""
        return self.applies is None or bool(self.applies(signals, joint))

    def acts_on(self, position_unit: str) -> bool:
        """Return whether a joint with that unit of position, rad or m, can have the effect."""
        return True

    def least_size(self, signals: Signals) -> float:
        """Return the smallest believable magnitude of the first coefficient, in its unit."""
        return 0.0

    def motion_for(self, n: int) -> str:
        """Return the advice on the motion that shows the effect on a robot of `n` joints."""
        return self.excitation

    def temperatures(self, values: Mapping[str, float]) -> tuple[float, float]:
        """Return the lowest and highest temperature [deg C], exclusive, at which the effect is valid."""
        return -np.inf, np.inf

    def name_signals(self, shape: Sequence[float], joints: Sequence[str], joint: int) -> list[str]:
        """Return the signals that the effect at a joint depends on, with given shape parameters (k,)."""
        others = {"other": joints[int(shape[0])]} if self.selects_signals else {}
        return [name.format(joint=joints[joint], **others) for name in self.depends_on]

    def columns(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Return the regressors along signals.

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
        """Return the regressors for several shapes (S, k): (N, S*p), or (N, n, S*p) where `spread`."""
        if self.regressors is not None and (signals.channels or self.row is None):
            parts = [self._evaluate_regressors(signals, joint, shape) for shape in shapes]
            return np.concatenate(parts, axis=-1)
        if self.row is None or type(self).columns is not Effect.columns:
            return np.concatenate([self.columns(signals, joint, shape) for shape in shapes], axis=-1)
        take = lambda x: np.ascontiguousarray(x, dtype=float)  # noqa: E731
        return stack_rows(
            self.row, joint, take(signals.t), signals.dt, take(signals.sign), take(signals.q),
            take(signals.v), take(signals.a), take(signals.load), take(signals.temperature),
            take(signals.wear), take(shapes), self.n_states, len(self.coefficients),
        )  # fmt: skip

    def _evaluate_regressors(self, signals: Signals, joint: int, shape: np.ndarray) -> np.ndarray:
        """Call `regressors` and check the shape of what it returns."""
        assert self.regressors is not None
        try:
            x = np.asarray(self.regressors(signals, joint, shape), dtype=float)
        except KeyError as error:
            raise InputError(
                f"{self.label}: effect '{self.name}' needs the channel {error}, which is not among those "
                f"declared ({', '.join(signals.channels) or 'none'}); add it to 'channels' of the data set."
            ) from error
        count = len(self.coefficients)
        wanted = (len(signals.t), signals.q.shape[1], count) if self.spread else (len(signals.t), count)
        if x.shape != wanted:
            raise InputError(
                f"{self.label}: regressors of effect '{self.name}' have the shape {x.shape} where {wanted} "
                "is needed, a row a sample and a column a coefficient; correct the file."
            )
        return x

    def torque(self, signals: Signals, joint: int, values: Mapping[str, float]) -> np.ndarray:
        """Return the torque along signals for given parameter values: (N,), or (N, n) where `spread`."""
        coefficients, shape = self.pack(values)
        return self.columns(signals, joint, shape) @ coefficients

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Add the effect with the given parameter values to a joint of a simulated plant.

        Raises
        ------
        InputError
            Where the effect has no compiled row.
        """
        if self.row is None:
            raise InputError(
                f"{self.label}: effect '{self.name}' has no 'row', which the simulator evaluates; add one to "
                "the file, or take the effect out of the model."
            )
        coefficients, shape = self.pack(values)
        plant.terms.append(Term(self.row, joint, shape, coefficients, self.n_states, self.name))
