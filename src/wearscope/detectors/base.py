"""What a detector sees (`Batch`), what it must offer (`Detector`), and how one is found (`load_detector`)."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError

from wearscope import plugins
from wearscope.errors import InputError, explain_breach, tell_error

if TYPE_CHECKING:
    from wearscope.robots.model import RobotModel

Array = NDArray[np.float64]
#: Options above 0, and between 0 and 1.
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(gt=0, lt=1)]
#: What a detector may be told: nominal recordings alone, the declared model too, or the law that the
#: simulator itself uses. The last one exists in no plant, so its result is an upper bound.
KNOWLEDGE = ("nothing", "nominal model", "simulator's law")
#: Sample rates that differ by less than this share count as equal.
SAME_RATE = 1e-3


@dataclass(frozen=True, eq=False)
class Batch:
    """One recorded test-cycle, all joints, evenly sampled.

    Parameters
    ----------
    t : array (N,)
        Time [s].
    q, qd, tau : array (N, n)
        Joint position [rad or m], joint speed [rad/s or m/s] and motor torque on the joint side [N m or N],
        as the drive records them.
    sample_rate : float, optional
        Samples per second [Hz]; from `t` when left out.

    Attributes
    ----------
    derived : dict
        Signals derived from the recording (acceleration, rigid-body torque), kept so that several detectors
        and axes compute them once.

    Raises
    ------
    ValueError
        Where the shapes do not fit together or there are fewer than 2 samples.
    """

    t: Array
    q: Array
    qd: Array
    tau: Array
    sample_rate: float = 0.0
    derived: dict[Any, Any] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        for name in ("t", "q", "qd", "tau"):
            object.__setattr__(self, name, np.asarray(getattr(self, name), dtype=float))
        if self.t.ndim != 1 or len(self.t) < 2:
            raise ValueError(f"a batch needs at least 2 samples of t (N,), got shape {self.t.shape}")
        for name in ("q", "qd", "tau"):
            shape = getattr(self, name).shape
            if len(shape) != 2 or shape[0] != len(self.t) or shape != self.q.shape:
                raise ValueError(f"batch: {name} has shape {shape}, expected ({len(self.t)}, n) like q")
        if not self.sample_rate:
            object.__setattr__(self, "sample_rate", float((len(self.t) - 1) / (self.t[-1] - self.t[0])))


class Detector(Protocol):
    """A batch fault detector (the paper's FDA) for one axis; it never sees factor values.

    A detector is made with its options as keyword arguments, fitted once for a robot, test-cycle and axis,
    and then asked for one number a batch. Any class with these two methods is a detector. A class attribute
    `unit` may say the unit of that number; ``torque`` is that of the tested joint, N m or N. A class
    attribute `knows` may say what the detector is told, one of `KNOWLEDGE`; without it, nothing.
    """

    def fit(self, nominal: Sequence[Batch], axis: int, model: "RobotModel") -> None:
        """Learn the nominal, wear-free behaviour.

        Parameters
        ----------
        nominal : sequence of Batch
            Wear-free recordings of this robot and test-cycle, at least one.
        axis : int
            The tested axis, counted from 0: a column of `Batch.q`, `qd` and `tau`.
        model : RobotModel
            The robot as its controller knows it: the declared payload and the declared effects.
        """

    def test_quantity(self, batch: Batch) -> float:
        """The scalar y of a batch: how far the tested axis is from nominal.

        Raise an exception where the batch allows none; it is counted as a failed point.
        """


def name_unit(detector: Any, models: "Iterable[RobotModel]") -> str:
    """Unit of a detector's test quantity on some robots; empty where it is not said.

    Where their wearing joints differ in torque's unit, both are named.
    """
    unit = str(getattr(detector, "unit", ""))
    if unit != "torque":
        return unit
    units = {model.torque_units[model.joints.index(joint)] for model in models for joint in model.wear_joints}
    return " or ".join(sorted(units, reverse=True))


def name_knowledge(reference: str) -> str:
    """What a detector is told, one of `KNOWLEDGE`.

    Parameters
    ----------
    reference : str
        As in `load_detector`.

    Raises
    ------
    InputError
        Where there is no such detector, or it says something else.
    """
    told = str(getattr(plugins.load(reference, "detectors", "DETECTOR"), "knows", KNOWLEDGE[0]))
    if told not in KNOWLEDGE:
        raise InputError(f"{reference}: knows: '{told}' is not known; say one of {', '.join(KNOWLEDGE)}.")
    return told


def list_bounds(detectors: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Detectors of a configuration that are told the simulator's law: upper bounds, not to be deployed."""
    return [name for name, one in detectors.items() if name_knowledge(one["use"]) == KNOWLEDGE[2]]


def load_detector(reference: str, options: Mapping[str, Any] | None = None) -> Detector:
    """Make a detector.

    Parameters
    ----------
    reference : str
        The name of a module of `wearscope.detectors`, or the path of a ``.py`` file, that defines a class
        ``DETECTOR``.
    options : mapping, optional
        Keyword arguments of that class; defaults otherwise.

    Raises
    ------
    InputError
        Where there is no such detector, it has not the two methods, or it refuses the options.
    """
    return make_detector(plugins.load(reference, "detectors", "DETECTOR"), reference, options)


def make_detector(factory: Any, reference: str, options: Mapping[str, Any] | None = None) -> Detector:
    """Make a detector of a class already loaded by `plugins.load`; see `load_detector`."""
    options = dict(options or {})
    if not callable(factory):
        raise InputError(f"{reference}: DETECTOR is no class; set DETECTOR to the detector's class.")
    try:
        detector = factory(**options)
    except Exception as error:
        told = explain_breach(error) if isinstance(error, ValidationError) else tell_error(error)
        raise InputError(
            f"{reference}: the detector refuses its options {options} ({told}); give options that it has."
        ) from error
    for method in ("fit", "test_quantity"):
        if not callable(getattr(detector, method, None)):
            raise InputError(f"{reference}: the detector has no method {method}; add it.")
    return detector


def check_nominal(nominal: Sequence[Batch]) -> None:
    """Refuse nominal data that a built-in detector cannot learn from.

    Raises
    ------
    ValueError
        Where there is none, the sample rates differ, or a sample is not finite.
    """
    if not nominal:
        raise ValueError("no nominal batch to fit to")
    for batch in nominal:
        check_sample_rate(batch, nominal[0].sample_rate)
        if not (np.isfinite(batch.tau).all() and np.isfinite(batch.q).all() and np.isfinite(batch.qd).all()):
            raise ValueError("a nominal batch holds samples that are not finite")


def check_sample_rate(batch: Batch, sample_rate: float) -> None:
    """Refuse a batch sampled at another rate than the nominal data (to `SAME_RATE`) with ValueError."""
    if abs(batch.sample_rate - sample_rate) > SAME_RATE * sample_rate:
        raise ValueError(
            f"the batch is sampled at {batch.sample_rate:g} Hz, the nominal data at {sample_rate:g} Hz"
        )
