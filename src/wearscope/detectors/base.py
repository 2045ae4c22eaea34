"""Input of a detector (`Batch`), its interface (`Detector`), and its loading (`load_detector`).

Signals that several detectors derive from a recording are computed once for each batch.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import numpy as np
import scipy
from numpy.typing import NDArray
from pydantic import ConfigDict, Field, ValidationError

from wearscope import plugins
from wearscope.errors import InputError, explain_breach, tell_error

if TYPE_CHECKING:
    from wearscope.robots.model import RobotModel

Array = NDArray[np.float64]
#: Configuration of a detector's class: options are checked by their types, and unknown options are refused.
OPTIONS = ConfigDict(extra="forbid")
#: Types of options: above 0; between 0 and 1.
Positive = Annotated[float, Field(gt=0)]
Share = Annotated[float, Field(gt=0, lt=1)]
#: What a detector may know: only nominal recordings; the declared model too; or the simulator's friction law
#: too. No plant knows the latter, so the results of such a detector are an upper bound.
KNOWLEDGE = ("nothing", "nominal model", "simulator's law")
#: Sample rates that differ by less than this share count as equal.
SAME_RATE = 1e-3


@dataclass(frozen=True, eq=False)
class Batch:
    """One recorded test-cycle of all joints, evenly sampled.

    Parameters
    ----------
    t : array (N,)
        Time [s].
    q, qd, tau : array (N, n)
        Joint position [rad or m], joint speed [rad/s or m/s] and motor torque on the joint side [N m or N],
        as the drive records them.
    sample_rate : float, optional
        Samples per second [Hz]; by default from `t`.

    Attributes
    ----------
    derived : dict
        Cache of signals derived from the recording (acceleration, rigid-body torque), which several detectors
        and axes share.

    Raises
    ------
    ValueError
        Where the shapes do not match or there are fewer than 2 samples.
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

    A detector is made with its options as keyword arguments and fitted once for a robot, test-cycle and axis.
    It then returns one number for each batch. Any class with these two methods is a detector. A class
    attribute `unit` may state the unit of that number; ``torque`` means that of the tested joint, N m or N. A
    class attribute `knows` may state what the detector knows, one of `KNOWLEDGE`; by default nothing.
    """

    def fit(self, nominal: Sequence[Batch], axis: int, model: "RobotModel") -> None:
        """Learn the nominal behaviour without wear.

        Parameters
        ----------
        nominal : sequence of Batch
            Wear-free recordings of this robot and test-cycle, at least one.
        axis : int
            The tested axis, counted from 0: a column of `Batch.q`, `qd` and `tau`.
        model : RobotModel
            The robot as its controller knows it, with the declared payload and the declared effects.
        """

    def test_quantity(self, batch: Batch) -> float:
        """Return the scalar y of a batch, which tells how far the tested axis is from nominal.

        Raise an exception where the batch does not allow that; it counts as a failed point.
        """


def name_unit(detector: Any, models: "Iterable[RobotModel]") -> str:
    """Return the unit of a detector's test quantity on some robots; empty where the detector states none.

    Both N m and N are named where the robots' wearing joints have both units of torque.
    """
    unit = str(getattr(detector, "unit", ""))
    if unit != "torque":
        return unit
    units = {model.torque_units[model.joints.index(joint)] for model in models for joint in model.wear_joints}
    return " or ".join(sorted(units, reverse=True))


def name_knowledge(reference: str) -> str:
    """Return what a detector knows, one of `KNOWLEDGE`.

    Parameters
    ----------
    reference : str
        As in `load_detector`.

    Raises
    ------
    InputError
        Where there is no such detector, or its `knows` has another value.
    """
    told = str(getattr(plugins.load(reference, "detectors", "DETECTOR"), "knows", KNOWLEDGE[0]))
    if told not in KNOWLEDGE:
        raise InputError(f"{reference}: knows: '{told}' is not known; say one of {', '.join(KNOWLEDGE)}.")
    return told


def list_bounds(detectors: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Return the upper bounds of a configuration: detectors that know the simulator's friction law."""
    return [name for name, one in detectors.items() if name_knowledge(one["use"]) == KNOWLEDGE[2]]


def load_detector(reference: str, options: Mapping[str, Any] | None = None) -> Detector:
    """Make a detector.

    Parameters
    ----------
    reference : str
        The name of a module of `wearscope.detectors`, or the path of a ``.py`` file, that defines a class
        ``DETECTOR``.
    options : mapping, optional
        Keyword arguments of that class; options that are left out have their defaults.

    Raises
    ------
    InputError
        Where there is no such detector, it lacks one of the two methods, or it refuses the options.
    """
    return make_detector(plugins.load(reference, "detectors", "DETECTOR"), reference, options)


def make_detector(factory: Any, reference: str, options: Mapping[str, Any] | None = None) -> Detector:
    """Make a detector from a class that `plugins.load` has loaded; see `load_detector`."""
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
        Where there is no batch, the sample rates differ, or a sample is not finite.
    """
    if not nominal:
        raise ValueError("no nominal batch to fit to")
    for batch in nominal:
        check_sample_rate(batch, nominal[0].sample_rate)
        if not (np.isfinite(batch.tau).all() and np.isfinite(batch.q).all() and np.isfinite(batch.qd).all()):
            raise ValueError("a nominal batch holds samples that are not finite")


def check_sample_rate(batch: Batch, sample_rate: float) -> None:
    """Raise ValueError where a batch has another sample rate than the nominal data."""
    if abs(batch.sample_rate - sample_rate) > SAME_RATE * sample_rate:
        raise ValueError(
            f"the batch is sampled at {batch.sample_rate:g} Hz, the nominal data at {sample_rate:g} Hz"
        )


PAYLOAD_STEP = 0.01  # relative change of the payload's mass in a difference quotient


def find_top_speed(nominal: Sequence[Batch], axis: int) -> float:
    """Return the 99 % quantile of an axis's nominal absolute speed [rad/s or m/s]; axes count from 0.

    Raises
    ------
    ValueError
        Where the axis stands still.
    """
    speed = np.abs(np.concatenate([batch.qd[:, axis] for batch in nominal]))
    top_speed = float(np.quantile(speed, 0.99))
    if not top_speed > 0:
        raise ValueError("the tested axis does not move in the nominal data")
    return top_speed


def estimate_acceleration(batch: Batch, window: float = 0.03) -> Array:
    """Estimate the joint accelerations by a zero-phase filter of the recorded speed.

    Parameters
    ----------
    batch : Batch
    window : float
        Length of the filter [s]; at least 5 samples are used.

    Returns
    -------
    array (N, n)
        Derivative of the local least-squares parabola of `qd` (Savitzky and Golay, Anal. Chem. 36, 1964). The
        filter is symmetric and so without delay.

    Raises
    ------
    ValueError
        Where the batch is shorter than the filter.
    """
    key = ("acceleration", window)
    if key not in batch.derived:
        half = max(2, round(0.5 * window * batch.sample_rate))
        length = 2 * half + 1
        if length > len(batch.t):
            raise ValueError(f"the batch has {len(batch.t)} samples, the acceleration needs {length}")
        batch.derived[key] = differentiate_locally(batch.qd, length, 1.0 / batch.sample_rate)
    return batch.derived[key]


def differentiate_locally(values: Array, length: int, delta: float) -> Array:
    """Differentiate by least-squares parabolas of `length` samples; the ends use the first and last parabola.

    The result equals ``scipy.signal.savgol_filter(values, length, 2, deriv=1, delta=delta, axis=0)`` to the
    last bit. Importing that function would take as long as evaluating detectors on several recordings.

    Parameters
    ----------
    values : array (N, n)
    length : int
        Odd number of samples.
    delta : float
        Sampling interval [s].

    Returns
    -------
    array (N, n)
    """
    values = np.asarray(values, dtype=float)
    half = length // 2
    at = np.arange(-half, length - half, dtype=float)[::-1]
    powers = at ** np.arange(3.0)[:, None]
    weights = _solve_least_squares(powers, np.array([0.0, 1.0 / delta, 0.0]))
    slope = scipy.ndimage.convolve1d(values, weights, axis=0, mode="constant")
    count = len(values)
    at = np.arange(length, dtype=float)
    slope[:half] = _slope_of_parabola(values[:length], at[:half]) / delta
    slope[count - half :] = _slope_of_parabola(values[count - length :], at[half + 1 :]) / delta
    return slope


def _solve_least_squares(matrix: Array, right: Array) -> Array:
    """Solve a least-squares problem with the rank tolerance of `numpy.polyfit`."""
    return np.asarray(scipy.linalg.lstsq(matrix, right, cond=np.finfo(float).eps * max(matrix.shape))[0])


def _slope_of_parabola(values: Array, at: Array) -> Array:
    """Return the slope per sample, at samples `at`, of the least-squares parabola of `values` (M, n)."""
    powers = np.arange(len(values), dtype=float)[:, None] ** np.array([2.0, 1.0, 0.0])
    scale = np.sqrt(np.sum(powers * powers, axis=0))
    square, linear, _ = (_solve_least_squares(powers / scale, values).T / scale).T
    return 2.0 * square * at[:, None] + linear


def compute_rigid_torque(batch: Batch, model: "RobotModel", window: float) -> Array:
    """Compute inverse dynamics with the declared payload along the recorded motion, without rotors.

    Parameters
    ----------
    batch : Batch
    model : RobotModel
    window : float
        Length of the acceleration filter [s], see `estimate_acceleration`.

    Returns
    -------
    array (N, n)
        [N m] or [N].
    """
    # The cached value holds the model, so that its id cannot become that of another model.
    key = ("rigid_torque", id(model), window)
    if key not in batch.derived:
        body = model.rigid_body(model.declared_payload)
        torque = body.inverse_dynamics(batch.q, batch.qd, estimate_acceleration(batch, window))
        batch.derived[key] = (model, torque)
    return batch.derived[key][1]


def compute_payload_torque(batch: Batch, model: "RobotModel", window: float) -> Array | None:
    """Compute the torque of the declared payload, which is the derivative by its relative mass error.

    Mass and inertia scale together; the centre of mass does not change.

    Returns
    -------
    array (N, n) or None
        None where the model declares no payload.
    """
    payload = model.declared_payload
    if payload is None or payload.mass == 0.0:
        return None
    key = ("payload_torque", id(model), window)
    if key not in batch.derived:
        body = model.rigid_body(payload.scaled(1.0 + PAYLOAD_STEP))
        torque = body.inverse_dynamics(batch.q, batch.qd, estimate_acceleration(batch, window))
        # Inverse dynamics is linear in the inertial parameters, so that the difference quotient is exact.
        batch.derived[key] = (model, (torque - compute_rigid_torque(batch, model, window)) / PAYLOAD_STEP)
    return batch.derived[key][1]


def compute_joint_residual(batch: Batch, model: "RobotModel", axis: int, window: float) -> Array:
    """Compute the torque (N,) that friction has to explain: recorded minus rigid body minus rotor torque.

    Parameters
    ----------
    batch : Batch
    model : RobotModel
    axis : int
        Axis, counted from 0.
    window : float
        Length of the acceleration filter [s], see `estimate_acceleration`.

    Raises
    ------
    ValueError
        Where a sample is not finite.
    """
    rotor = model.rotor_inertia[axis] * estimate_acceleration(batch, window)[:, axis]
    residual = batch.tau[:, axis] - compute_rigid_torque(batch, model, window)[:, axis] - rotor
    if not np.isfinite(residual).all():
        raise ValueError("the batch holds samples that are not finite")
    return residual
