"""What an effect is: one formula with two uses, and all that is known of it.

An effect is a contribution to the torque that a motor must supply at a joint. Its compiled `row` writes the
regressors of one sample; identification stacks the rows along measured signals, and the simulator multiplies
the same row with the parameters at each step. An effect is linear in its `coefficients` and may depend on
further `shape` parameters; `states` carry memory (presliding) from one sample to the next.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from wearscope.effects.parameter import Parameter
from wearscope.effects.rows import Plant, Term, stack_rows
from wearscope.effects.signals import Signals
from wearscope.errors import InputError

#: Motions that show effects, one sentence each, so that advice for several effects agrees.
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


#: Half width of the search about a grid value of a shape parameter, in the parameter's logarithm: neighbours
#: on a grid differ by factors of up to e^0.8.
SEARCH_WIDTH = 0.8


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
    regressors : callable or None
        ``regressors(signals, joint, shape)`` gives the regressors (N, p), or (N, n, p) where `spread`, of
        signals that have further channels, which `row` does not see. Where there is a `row` too, it stands
        for signals without channels, such as those of a planned motion, and is what is simulated.
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
    searched : int or None
        Number of shape parameters that the search fits to the torque; where None, those that are estimated.
    search_width : callable or None
        ``search_width(signals, joint, shape)``: half width, in the logarithm of the first estimated shape
        parameter, of the range about `shape` that holds the best value; `SEARCH_WIDTH` where None.
    standard : bool
        Whether a plain joint has it, so that the search tries it first.
    candidate : bool
        Whether a model that lacks it may be told so by name; False for what is only declared or generic.
    empirical : bool
        Whether it is a generic form whose coefficients have no meaning of their own.
    parents : tuple of str
        At least one of these effects must be in the joint's model before this one is a candidate.
    contains : tuple of str
        Effects whose columns lie in the span of its own, so that it leaves nothing of them to find.
    parts : mapping of str to tuple of str
        Effects that are a part of it, each with the parameters that it shares with them.
    corrects : str
        Declared effect with given values whose error this is: a candidate only together with that one.
    given_by : str
        Field that may give its value, in a model's `drive` or a data set's `robot`; where it does, nothing
        is fitted.
    repeatable : bool
        Whether a joint can have several of it.
    per_robot : bool
        Whether there is one for the whole robot, which stands at the last joint.
    applies : callable or None
        ``applies(signals, joint)``: whether the signals hold what it needs; always where None.
    lacking : str
        What to say of signals to which it does not apply; empty where there is nothing to record.
    least : callable or None
        ``least(signals)``: smallest believable size of its first coefficient; 0 where None.
    periodic : bool
        Whether it is periodic in the joint's position, with its first shape parameter as wavenumber, so that
        a spectrum of the residual over position shows which are worth trying.
    resembles_any : callable or None
        ``resembles_any(signals, joint, shape)``: whether it can follow any function of its signals with that
        shape, so that it needs more evidence; never where None.
    opposes_gravity : bool
        Whether it is built to take gravity's load off its joint, and is believed first where it does.
    excitation : str
        Motion that shows it best.
    excitation_alone : str
        The same on a robot of a single joint; `excitation` where empty.
    title : str
        What people call it, where the name as text says too little.
    name_driver : callable or None
        ``name_driver(shape, joints, joint)``: signals it depends on, where its shape says which.
    limit_temperature : callable or None
        ``limit_temperature(values)``: lowest and highest temperature [deg C], exclusive, at which it holds
        with given values of all parameters; at every one where None.
    changes : int or None
        Place in the order of changes that the comparison of sessions tries at every joint, the most
        believable first; None where only a joint that has the effect is tested for it.
    change_shape : callable or None
        ``change_shape(top_speed)``: its shape parameters (k,) as such a change; the defaults where None.
    mounted : bool
        Whether it is a part that somebody mounts on the joint, and nobody unknowingly.
    thermal : bool
        Whether it is how a joint's friction depends on a temperature that is recorded.
    passive : callable or None
        ``passive(values, temperature)``: what formats with passive joints hold of it, of `friction`,
        `damping`, `quadratic` (factor of v abs(v)), `stiffness`, `preload`, and tuples of `falling` (level,
        speed, exponent), `presliding` (level, displacement) and `wave` (cosine, sine, wavenumber); nothing
        where None.
    passive_lacks : str
        What they do not hold of it, with ``{temperature}`` [deg C]; empty where that is nothing.
    reference : str
        Path of the file that it was loaded from; empty in the vocabulary.
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
    regressors: Callable[[Signals, int, np.ndarray], np.ndarray] | None = None
    searched: int | None = None
    search_width: Callable[[Signals, int, np.ndarray], float] | None = None
    standard: bool = False
    candidate: bool = True
    empirical: bool = False
    parents: tuple[str, ...] = ()
    contains: tuple[str, ...] = ()
    parts: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    corrects: str = ""
    given_by: str = ""
    repeatable: bool = False
    per_robot: bool = False
    applies: Callable[[Signals, int], bool] | None = None
    lacking: str = "the runs do not hold the signals that it needs"
    least: Callable[[Signals], float] | None = None
    periodic: bool = False
    resembles_any: Callable[[Signals, int, Sequence[float]], bool] | None = None
    opposes_gravity: bool = False
    excitation: str = OTHERS
    excitation_alone: str = ""
    title: str = ""
    name_driver: Callable[[Sequence[float], Sequence[str], int], list[str]] | None = None
    limit_temperature: Callable[[Mapping[str, float]], tuple[float, float]] | None = None
    changes: int | None = None
    change_shape: Callable[[float], np.ndarray] | None = None
    mounted: bool = False
    thermal: bool = False
    passive: Callable[[Mapping[str, float], float], Mapping[str, float | tuple[float, ...]]] | None = None
    passive_lacks: str = ""
    reference: str = ""

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """All parameters: coefficients, then shape."""
        return self.coefficients + self.shape

    @property
    def label(self) -> str:
        """What a model file calls the effect: its path, or its name in the vocabulary."""
        return self.reference or self.name

    @property
    def is_friction(self) -> bool:
        """Whether its torque depends on the joint's own speed or its sign, and is felt there alone."""
        return bool({"qd_{joint}", "sign_qd_{joint}"} & set(self.depends_on)) and not self.spread

    @property
    def follows_direction(self) -> bool:
        """Whether its columns may change with how the direction of motion reverses; an own effect's may."""
        own = self.empirical or bool(self.reference)
        return own or any(name.startswith("sign_qd") for name in self.depends_on)

    @property
    def is_plain_friction(self) -> bool:
        """Whether it is friction of a plain joint, which can hide or resemble an effect still missing."""
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
        """Whether its torque never changes."""
        return set(self.depends_on) == {"constant"}

    @property
    def needs_wear(self) -> bool:
        """Whether its torque depends on how worn the joint is."""
        return "wear_{joint}" in self.depends_on

    def for_robot(self, n: int) -> "Effect":
        """The effect on a robot of `n` joints; another object only where its coefficients depend on `n`."""
        return self

    def check_values(self, values: Mapping[str, float], where: str) -> None:
        """Refuse unknown parameter names, values outside their bounds, and missing values without a default.

        Raises
        ------
        InputError
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
        """Coefficient and shape vectors of named values, defaults filled in."""
        filled, count = np.array(list(self.fill(values).values())), len(self.coefficients)
        return filled[:count], filled[count:]

    def fill(self, values: Mapping[str, float]) -> dict[str, float]:
        """Values of all parameters by name, defaults filled in."""
        return {p.name: float(values.get(p.name, p.default)) for p in self.parameters}

    def shapes(self, signals: Signals, joint: int) -> np.ndarray:
        """Shape vectors worth trying for given signals, (S, k)."""
        if self.search is None:
            return self.pack({})[1][None, :]
        return np.atleast_2d(self.search(signals, joint))

    def estimated_shapes(self) -> list[int]:
        """Indices of the shape parameters that data estimate."""
        return [k for k, p in enumerate(self.shape) if p.estimated]

    def width(self, signals: Signals, joint: int, shape: Sequence[float]) -> float:
        """Half width of the search for the best value of the first estimated shape parameter [-].

        In its logarithm, about a shape vector (k,) that the search gave.
        """
        if self.search_width is None:
            return SEARCH_WIDTH
        return self.search_width(signals, joint, np.asarray(shape, dtype=float))

    def complexity(self, subset: Iterable[int]) -> int:
        """Number of values that a fit chooses: the coefficients of a subset and the shapes searched."""
        fitted = 0
        if self.search is not None:
            fitted = len(self.estimated_shapes()) if self.searched is None else self.searched
        return len(list(subset)) + fitted

    def subsets(self) -> list[np.ndarray]:
        """Indices of the coefficients of each variant."""
        names = [p.name for p in self.coefficients]
        variants = self.variants or (tuple(names),)
        return [np.array([names.index(name) for name in variant], dtype=int) for variant in variants]

    def plain_subsets(self) -> list[np.ndarray]:
        """The subsets that contain no other subset."""
        sets = [{int(i) for i in subset} for subset in self.subsets()]
        return [np.array(sorted(a)) for a in sets if not any(b < a for b in sets)]

    def has_parent(self, present: Iterable["Effect"]) -> bool:
        """Whether the model of a joint has what this effect refines.

        Parameters
        ----------
        present : iterable of Effect
            Effects in the joint's model; one that `contains` a parent counts as it.
        """
        if not self.parents:
            return True
        return any(not {e.name, *e.contains}.isdisjoint(self.parents) for e in present)

    def is_usable(self, signals: Signals, joint: int) -> bool:
        """Whether the signals hold what the effect needs at a joint."""
        return self.applies is None or bool(self.applies(signals, joint))

    def least_size(self, signals: Signals) -> float:
        """Smallest believable size of the first coefficient, in its unit."""
        return 0.0 if self.least is None else float(self.least(signals))

    def motion_for(self, n: int) -> str:
        """Motion that shows the effect on a robot of `n` joints."""
        return self.excitation_alone if n == 1 and self.excitation_alone else self.excitation

    def temperatures(self, values: Mapping[str, float]) -> tuple[float, float]:
        """Lowest and highest temperature [deg C], exclusive, at which the effect holds with given values."""
        if self.limit_temperature is None:
            return -np.inf, np.inf
        return self.limit_temperature(self.fill(values))

    def name_signals(self, shape: Sequence[float], joints: Sequence[str], joint: int) -> list[str]:
        """Signals that the effect with given shape parameters (k,) at a joint depends on."""
        if self.name_driver is not None:
            return self.name_driver(shape, joints, joint)
        return [name.format(joint=joints[joint]) for name in self.depends_on]

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
        """Torque along signals for given parameter values: (N,), or (N, n) where `spread`."""
        coefficients, shape = self.pack(values)
        return self.columns(signals, joint, shape) @ coefficients

    def install(self, plant: Plant, joint: int, values: Mapping[str, float]) -> None:
        """Put the effect with the given parameter values at a joint of a simulated plant.

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
