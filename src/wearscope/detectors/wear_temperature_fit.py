"""Joint estimate of wear, temperature and payload error with the declared friction law (detector D).

Wear and temperature are those whose friction curve fits the torque residual best. The search for them is
compiled. It is a damped Gauss-Newton method (Marquardt, 1963) on a quadratic form in the curve's values at
nodes of the speed. The damping depends on how well the gain of a step was predicted (Nielsen, Damping
parameter in Marquardt's method, DTU, 1999).
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from wearscope.detectors.base import (
    OPTIONS,
    Array,
    Batch,
    Positive,
    check_nominal,
    compute_joint_residual,
    compute_payload_torque,
    compute_rigid_torque,
    estimate_acceleration,
    find_top_speed,
)
from wearscope.effects.base import Effect, Signals, load_effect
from wearscope.effects.rows import hold_rows

# Difference steps in wear [-] and temperature [deg C], and the change of both below which the search ends.
# Wear and temperature cannot be told apart where offset and payload explain all but the share `MIN_SHARE` of
# a slope, or where the condition number of the normal equations exceeds `MAX_CONDITION`.
STEPS = (0.5, 0.25)
TOLERANCE = 1e-4
MIN_SHARE = 1e-6
MAX_CONDITION = 1e8
MAX_DAMPING = 1e8
FOUND, NOT_TOLD_APART, NOT_FOUND = 0, 1, 2


class Law(NamedTuple):
    """Friction law of an axis, packed: its declared effects that depend on speed, temperature and wear alone.

    Their compiled rows are a list of their own. Within a tuple, numba would find out its type at every call.

    Attributes
    ----------
    width, size, states : ndarray of int (m,)
        Number of coefficients, shape parameters and states of each effect.
    coefficients, shapes : ndarray (m, widest)
    """

    width: NDArray[np.int64]
    size: NDArray[np.int64]
    states: NDArray[np.int64]
    coefficients: Array
    shapes: Array


class Form(NamedTuple):
    """Sum of squared residuals ``constant - 2 vector'x + x'(D - S S')x`` of a friction curve x (K,) at nodes.

    Attributes
    ----------
    diagonal, between : ndarray (K,), (K - 1,)
        Diagonal and off-diagonal of the tridiagonal matrix D; x'D x is the sum of the curve's squares over
        the samples.
    seen : ndarray (K, k)
        Matrix S, the product of the curve's interpolation and the basis that is projected out.
    vector : ndarray (K,)
    constant : float
    """

    diagonal: Array
    between: Array
    seen: Array
    vector: Array
    constant: float


def pack_law(effects: Sequence[tuple[Effect, Mapping[str, float]]]) -> tuple[Any, Law]:
    """Pack effects that have compiled rows: a typed list of the rows (m,), and their parameters in arrays."""
    packed = [effect.pack(values) for effect, values in effects]
    width, size = (np.array([len(one[k]) for one in packed], dtype=np.int64) for k in (0, 1))
    coefficients, shapes = (np.zeros((len(packed), max(one, default=0) + 1)) for one in (width, size))
    for k, (own_coefficients, own_shape) in enumerate(packed):
        coefficients[k, : width[k]], shapes[k, : size[k]] = own_coefficients, own_shape
    states = np.array([effect.n_states for effect, _ in effects], dtype=np.int64)
    rows = [effect.row for effect, _ in effects if effect.row is not None]
    return hold_rows(tuple(rows)), Law(width, size, states, coefficients, shapes)


@njit(cache=True)
def _add_worn(rows, law, nodes, wear, temperature, factor, curve):
    """Add the torque at speeds `nodes` (K,), times a factor, to a curve (K,); the wear is not negative."""
    one, zero, direction = np.zeros(1), np.zeros(1), np.zeros(1)
    worn, warm = np.full(1, wear), np.full(1, temperature)
    out = np.zeros(law.coefficients.shape[1])
    for m in range(len(law.width)):
        row, width, states = rows[m], law.width[m], max(law.states[m], 1)
        shape, state, next_state = law.shapes[m, : law.size[m]], np.zeros(states), np.zeros(states)
        for k in range(len(nodes)):
            one[0], direction[0] = nodes[k], np.sign(nodes[k])
            # These effects depend on their own axis alone, so that arrays of one joint suffice.
            row(
                0,
                0.0,
                1.0,
                direction,
                zero,
                one,
                zero,
                zero,
                warm,
                worn,
                shape,
                state,
                next_state,
                out[:width],
            )
            torque = 0.0
            for c in range(width):
                torque += law.coefficients[m, c] * out[c]
            curve[k] += factor * torque


@njit(cache=True)
def _fill_curve(rows, law, nodes, wear, temperature, curve):
    """Fill a curve (K,) with the torque at speeds `nodes`.

    Its change with wear is odd: at a negative wear the added torque has the opposite sign.
    """
    curve[:] = 0.0
    if wear < 0.0:
        _add_worn(rows, law, nodes, 0.0, temperature, 2.0, curve)
        _add_worn(rows, law, nodes, -wear, temperature, -1.0, curve)
    else:
        _add_worn(rows, law, nodes, wear, temperature, 1.0, curve)


@njit(cache=True)
def evaluate_curves(rows: Any, law: Law, nodes: Array, places: Array) -> Array:
    """Return the torque (m, K) at speeds `nodes` (K,), for wears and temperatures `places` (m, 2)."""
    curves = np.empty((len(places), len(nodes)))
    for k in range(len(places)):
        _fill_curve(rows, law, nodes, places[k, 0], places[k, 1], curves[k])
    return curves


@njit(cache=True)
def _weigh(form, a, b):
    """Return a'D b and a'(D - S S')b of two curves (K,).

    D is the tridiagonal matrix of `form`, and S has the columns `form.seen`.
    """
    last = len(a) - 1
    own = form.diagonal[last] * a[last] * b[last]
    for k in range(last):
        own += form.diagonal[k] * a[k] * b[k] + form.between[k] * (a[k] * b[k + 1] + a[k + 1] * b[k])
    left = own
    for p in range(form.seen.shape[1]):
        of_a, of_b = 0.0, 0.0
        for k in range(len(a)):
            of_a += form.seen[k, p] * a[k]
            of_b += form.seen[k, p] * b[k]
        left -= of_a * of_b
    return own, left


@njit(cache=True)
def _dot(a, b):
    """Return the scalar product of two vectors."""
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@njit(cache=True)
def normal_equations(
    form: Form, curve: Array, slopes: Array
) -> tuple[float, float, float, float, float, float, float]:
    """Return the normal equations of Gauss-Newton at a curve (K,) with its slopes (2, K).

    Returns
    -------
    tuple of float
        Matrix elements 11, 12 and 22; gradient 1 and 2; norms of the two slopes over the samples, before the
        basis is projected out.
    """
    first, second = slopes[0], slopes[1]
    own1, n11 = _weigh(form, first, first)
    own2, n22 = _weigh(form, second, second)
    n12 = _weigh(form, first, second)[1]
    g1 = _weigh(form, first, curve)[1] - _dot(first, form.vector)
    g2 = _weigh(form, second, curve)[1] - _dot(second, form.vector)
    return n11, n12, n22, g1, g2, np.sqrt(own1), np.sqrt(own2)


@njit(cache=True)
def _cost(form, curve):
    """Return the sum of squared residuals of a curve."""
    return form.constant + _weigh(form, curve, curve)[1] - 2.0 * _dot(form.vector, curve)


@njit(cache=True)
def _told_apart(n11, n12, n22, size1, size2):
    """Return whether the slopes by wear and temperature are independent after offset and payload."""
    if not (n11 > (MIN_SHARE * size1) ** 2 and n22 > (MIN_SHARE * size2) ** 2):
        return False
    # Condition number of the normal matrix after scaling its diagonal to ones.
    alike = abs(n12) / np.sqrt(n11 * n22)
    return 1.0 + alike < MAX_CONDITION * (1.0 - alike)


@njit(cache=True)
def search_wear(
    rows: Any,
    law: Law,
    nodes: Array,
    form: Form,
    start: Array,
    lowest: float,
    highest: float,
    iterations: int,
) -> tuple[int, float, float, float]:
    """Find the wear and temperature of the smallest sum of squares near a start.

    Parameters
    ----------
    rows, law : typed.List of compiled row (m,), Law
    nodes : array (K,)
        Speeds at which the curve is evaluated.
    form : Form
    start : array (2,)
        Wear [-] and temperature [deg C].
    lowest, highest : float
        Range of the temperature.
    iterations : int

    Returns
    -------
    outcome : int
        `FOUND`, `NOT_TOLD_APART` or `NOT_FOUND`.
    wear, temperature, cost : float
    """
    count = len(nodes)
    here, there, work = np.empty(count), np.empty(count), np.empty(count)
    slopes = np.empty((2, count))
    wear, temperature = start[0], start[1]
    _fill_curve(rows, law, nodes, wear, temperature, here)
    cost, damping = _cost(form, here), 1e-3
    for _ in range(iterations):
        _fill_curve(rows, law, nodes, wear + STEPS[0], temperature, there)
        _fill_curve(rows, law, nodes, wear - STEPS[0], temperature, work)
        for k in range(count):
            slopes[0, k] = (there[k] - work[k]) / (2.0 * STEPS[0])
        ahead, behind = min(temperature + STEPS[1], highest), max(temperature - STEPS[1], lowest)
        _fill_curve(rows, law, nodes, wear, ahead, there)
        _fill_curve(rows, law, nodes, wear, behind, work)
        for k in range(count):
            slopes[1, k] = (there[k] - work[k]) / (ahead - behind)
        n11, n12, n22, g1, g2, size1, size2 = normal_equations(form, here, slopes)
        if not _told_apart(n11, n12, n22, size1, size2):
            return NOT_TOLD_APART, wear, temperature, cost
        # A temperature at a bound stays there where the gradient points outside.
        bound = (temperature <= lowest and g2 > 0.0) or (temperature >= highest and g2 < 0.0)
        moved1, moved2, growth = 0.0, 0.0, 2.0
        while damping < MAX_DAMPING:
            d11, d22 = n11 * (1.0 + damping), n22 * (1.0 + damping)
            if bound:
                step1, step2 = -g1 / d11, 0.0
            else:
                determinant = d11 * d22 - n12 * n12
                step1, step2 = (n12 * g2 - d22 * g1) / determinant, (n12 * g1 - d11 * g2) / determinant
            wear_there = wear + step1
            temperature_there = min(max(temperature + step2, lowest), highest)
            _fill_curve(rows, law, nodes, wear_there, temperature_there, there)
            cost_there = _cost(form, there)
            if cost_there <= cost:
                moved1, moved2 = wear_there - wear, temperature_there - temperature
                foreseen = -(
                    2.0 * (moved1 * g1 + moved2 * g2)
                    + moved1 * (n11 * moved1 + n12 * moved2)
                    + moved2 * (n12 * moved1 + n22 * moved2)
                )
                gain = (cost - cost_there) / foreseen if foreseen > 0.0 else 1.0
                wear, temperature, cost = wear_there, temperature_there, cost_there
                for k in range(count):  # the assignment of a whole array takes seconds to compile
                    here[k] = there[k]
                damping = max(damping * max(0.1, 1.0 - (2.0 * min(gain, 1.0) - 1.0) ** 3), 1e-9)
                break
            damping, growth = damping * growth, 2.0 * growth
        if abs(moved1) < TOLERANCE and abs(moved2) < TOLERANCE:
            return FOUND, wear, temperature, cost
    return NOT_FOUND, wear, temperature, cost


# Signals that the friction law may depend on.
SPEED_ONLY = {"qd_{joint}", "sign_qd_{joint}", "temp_{joint}", "wear_{joint}"}
# Number of nodes of the friction curve over speed, in each direction.
NODES = 64
# The sum of squares is first evaluated on a grid of these wears [-] and this number of temperatures. A search
# starts at each of the `STARTS` lowest local minima of the grid.
FIRST_WEARS = (
    1.0, 2.0, 3.0, 4.5, 6.0, 8.0, 10.0, 12.5, 15.0, 17.5, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 57.0,
    65.0, 80.0, 100.0,
)  # fmt: skip
FIRST_TEMPERATURES = 32
STARTS = 3


@dataclass(config=OPTIONS)
class WearTemperatureFit:
    r"""Wear index f, estimated together with the temperature T in the declared friction law.

    .. math:: \min_{f, T, \beta, \mu} \sum_k (r_k - \tau_f(v_k, T, f) - \beta - \mu \, \tau_{p,k})^2

    over the samples in motion. The residual r of the tested axis is the recorded torque minus inverse
    dynamics with the declared payload, rotor inertia and the other declared effects. :math:`\tau_f` is the
    declared friction that depends on wear or temperature: eq. (17) of Samuelsson et al. (2014), or its parts
    as separate effects. :math:`\beta` is an offset, and :math:`\tau_p` the torque of the declared payload,
    whose relative mass error :math:`\mu` is estimated too. The linear unknowns are projected out (Golub,
    Pereyra, SIAM J. Numer. Anal. 10, 1973). The sum of squares has several minima and long valleys in f and
    T. So a damped Gauss-Newton search (`search_wear`) starts in the lowest valleys of a grid. The damping
    keeps it from jumping across a valley, along which wear and temperature nearly replace each other. The
    test quantity is f minus its estimate on nominal data [-]. For negative f the wear terms of eq. (17)
    change their sign, so that noise around zero wear is not clipped.

    Wear and temperature can be told apart only where the motion covers both low and high speeds. The detector
    knows the friction law with its parameters, as identified for the robot. Where the simulator uses the same
    law, the result is an upper bound for detectors with a friction model, and not what a plant would reach.

    After Bittencourt, Axelsson, Modeling and experiment design for identification of wear in a robot joint
    under load and temperature uncertainties based on friction data, IEEE/ASME Trans. Mechatronics 19 (2014).

    Parameters
    ----------
    estimate_payload : bool
        Whether :math:`\mu` is estimated.
    start_temperature : float
        A temperature at which the law is valid [deg C]; the range that is searched depends on it.
    temperature_limit : float
        Highest temperature that is searched [deg C]. The lowest is that at which the declared Stribeck speed
        falls to 1 % of its value at `start_temperature`, but at most 100 K below `start_temperature`.
    rest_share : float
        Speed below which a sample counts as at rest, as a share of the 99 % quantile of the nominal speed.
    window : float
        Length of the acceleration filter [s].
    max_iterations : int
    """

    estimate_payload: bool = True
    start_temperature: float = 50.0
    temperature_limit: float = 150.0
    rest_share: Positive = 0.01
    window: Positive = 0.03
    max_iterations: Annotated[int, Field(gt=0)] = 60
    unit: ClassVar[str] = "1"
    knows: ClassVar[str] = "simulator's law"

    def __post_init__(self) -> None:
        if not self.temperature_limit > self.start_temperature:
            raise ValueError("temperature_limit must be above start_temperature")

    def fit(self, nominal: Sequence[Batch], axis: int, model: Any) -> None:
        """Read the declared friction law of the axis and estimate the wear of the nominal batches."""
        check_nominal(nominal)
        self.axis, self.model = axis, model
        joint = model.joints[axis]
        entries = [entry for entry in model.effects if entry.joint == joint]
        self.varying: list[tuple[Effect, dict[str, float]]] = []
        self.steady: list[tuple[Effect, dict[str, float]]] = []
        for entry in entries:
            effect = load_effect(entry.effect)
            if effect.row is None:
                continue
            changes = {"temp_{joint}", "wear_{joint}"} & set(effect.depends_on)
            if changes and not set(effect.depends_on) <= SPEED_ONLY:
                raise ValueError(f"{entry.effect} depends on more than speed, temperature and wear")
            (self.varying if changes else self.steady).append((effect, entry.parameters))
        for what, signal in (("wear", "wear_{joint}"), ("temperature", "temp_{joint}")):
            if not any(signal in effect.depends_on for effect, _ in self.varying):
                raise ValueError(f"the model declares no effect at {joint} that depends on {what}")
        self.packed = pack_law(self.varying)
        self.law = {name: value for _, values in self.varying for name, value in values.items()}
        self.lowest = self._lowest_temperature()
        self.rest_speed = self.rest_share * find_top_speed(nominal, axis)
        # All batches of a test-cycle have about the same top speed, so that one grid serves them.
        self.top_speed = 1.1 * max(float(np.abs(batch.qd[:, axis]).max()) for batch in nominal)
        self.grids: dict[float, _Grid] = {}
        self.nominal_wear = float(np.mean([self.estimate(batch)[0] for batch in nominal]))

    def _lowest_temperature(self) -> float:
        """Return the lowest temperature to search: just above the law's limit, at most 100 K below the start.

        Raises
        ------
        ValueError
            Where the law is not valid at `start_temperature`, or ends at a higher temperature.
        """
        limits = [effect.temperatures(values) for effect, values in self.varying]
        low, high = max(low for low, _ in limits), min(high for _, high in limits)
        if not low < self.start_temperature < high:
            raise ValueError(f"the declared friction law does not hold at {self.start_temperature:g} deg C")
        if np.isfinite(high):
            raise ValueError("the declared Stribeck speed falls with temperature")
        return float(max(self.start_temperature - 100.0, low + 0.01 * (self.start_temperature - low)))

    def estimate(self, batch: Batch) -> tuple[float, float]:
        """Estimate the wear index f [-] and the temperature T [deg C] of a batch.

        Raises
        ------
        ValueError
            Where the axis moves too little, or the motion does not tell the two apart.
        """
        moving = np.flatnonzero(np.abs(batch.qd[:, self.axis]) > self.rest_speed)
        if len(moving) < 20:
            raise ValueError(f"the tested axis moves in {len(moving)} samples only")
        residual = compute_joint_residual(batch, self.model, self.axis, self.window)
        if self.steady:
            signals = self._make_signals(batch)
            residual = residual - sum(effect.torque(signals, self.axis, p) for effect, p in self.steady)
        columns = [np.ones(len(moving))]
        payload = compute_payload_torque(batch, self.model, self.window) if self.estimate_payload else None
        if payload is not None:
            columns.append(payload[moving, self.axis])
        basis = _orthonormal(np.column_stack(columns))
        speed = batch.qd[moving, self.axis]
        grid = self._make_grid(max(self.top_speed, float(np.abs(speed).max())))
        form = make_form(speed, grid.nodes, residual[moving], basis)
        first, *others = grid.places[_find_valleys(evaluate_form(form, grid.values))]
        x, cost = self._minimise(first, grid.nodes, form)
        traded = self._trade_speeds(x)
        for start in [*others, *([] if traded is None else [traded])]:
            with suppress(ValueError):  # a search that fails leaves the earlier result
                other, other_cost = self._minimise(start, grid.nodes, form)
                if other_cost < cost:
                    x, cost = other, other_cost
        return float(x[0]), float(x[1])

    def _make_grid(self, top_speed: float) -> "_Grid":
        """Return speed nodes, geometric in each direction, and the friction curves of the search's grid."""
        if top_speed not in self.grids:
            half = np.geomspace(self.rest_speed, top_speed, NODES)
            nodes = np.concatenate([-half[::-1], half])
            temperatures = np.linspace(self.lowest, self.temperature_limit, FIRST_TEMPERATURES)
            places = np.array([(wear, temperature) for wear in FIRST_WEARS for temperature in temperatures])
            self.grids[top_speed] = _Grid(nodes, places, evaluate_curves(*self.packed, nodes, places))
        return self.grids[top_speed]

    def _trade_speeds(self, x: Array) -> Array | None:
        """Return the start at which the low-speed terms of wear and temperature have swapped their speeds.

        Eq. (17) often has a second local minimum there. None where the law has no such terms.
        """
        start, slope, wear_slope = (self.law.get(name, 0.0) for name in ("eta3", "eta4", "eta8"))
        if slope <= 0 or wear_slope <= 0 or x[0] <= 0:
            return None
        temperature = (wear_slope * x[0] - start) / slope
        wear = (start + slope * x[1]) / wear_slope
        return np.array([wear, np.clip(temperature, self.lowest, self.temperature_limit)])

    def _make_signals(self, batch: Batch) -> Signals:
        """Return the signals of a batch, along which the other declared effects are evaluated."""
        load = compute_rigid_torque(batch, self.model, self.window)
        return Signals.along(batch.t, batch.qd, batch.q, estimate_acceleration(batch, self.window), load)

    def _minimise(self, start: Array, nodes: Array, form: Form) -> tuple[Array, float]:
        """Return wear and temperature (2,) of the smallest sum of squares near a start, and that sum."""
        outcome, wear, temperature, cost = search_wear(
            *self.packed, nodes, form, start, self.lowest, self.temperature_limit, self.max_iterations
        )
        if outcome == NOT_TOLD_APART:
            raise ValueError("the motion of the tested axis does not tell wear and temperature apart")
        if outcome != FOUND:
            raise ValueError(f"no wear and temperature found in {self.max_iterations} iterations")
        return np.array([wear, temperature]), cost

    def test_quantity(self, batch: Batch) -> float:
        """Return the estimated wear index minus that of the nominal data [-]."""
        return self.estimate(batch)[0] - self.nominal_wear


class _Grid(NamedTuple):
    """Speeds `nodes` (K,), wears and temperatures `places` (m, 2), and their friction `values` (m, K)."""

    nodes: Array
    places: Array
    values: Array


def make_form(speed: Array, nodes: Array, residual: Array, basis: Array) -> Form:
    """Return the sum of squared residuals as a quadratic form in a friction curve's values at nodes.

    The curve is interpolated linearly between the nodes. Where successive nodes have the ratio r, the error
    of exp(-v/s) is at most 0.07 (r - 1)^2. With S the interpolation and P the projection that removes the
    basis B, the sum is c - 2 b'x + x'A x with A = S'P S, b = S'P residual and c = residual'P residual. S'S is
    tridiagonal and S'B has few columns, so that A need not be formed: a product x'A x takes only K steps.

    Parameters
    ----------
    speed, residual : array (N,)
    nodes : array (K,)
        Rising speeds whose range contains all of `speed`.
    basis : array (N, k)
        Orthonormal columns.
    """
    left = np.clip(np.searchsorted(nodes, speed) - 1, 0, len(nodes) - 2)
    right_share = (speed - nodes[left]) / (nodes[left + 1] - nodes[left])
    left_share = 1.0 - right_share

    def gather(place: NDArray[np.integer], values: Array) -> Array:
        return np.bincount(place, values, len(nodes)).astype(float, copy=False)

    def to_nodes(values: Array) -> Array:
        return gather(left, left_share * values) + gather(left + 1, right_share * values)

    diagonal = gather(left, left_share**2) + gather(left + 1, right_share**2)
    between = gather(left, left_share * right_share)[:-1]
    seen = np.column_stack([to_nodes(column) for column in basis.T])
    taken = basis.T @ residual
    constant = float(residual @ residual - taken @ taken)
    return Form(diagonal, between, seen, to_nodes(residual) - seen @ taken, constant)


def evaluate_form(form: Form, values: Array) -> Array:
    """Return the sum of squared residuals (...) of curves (..., K) at the nodes."""
    own = values**2 @ form.diagonal + 2.0 * (values[..., 1:] * values[..., :-1]) @ form.between
    taken = ((values @ form.seen) ** 2).sum(axis=-1)
    return form.constant + own - taken - 2.0 * (values @ form.vector)


def _find_valleys(cost: Array) -> NDArray[np.integer]:
    """Return the indices of the grid's local minima, the lowest first, at most `STARTS`."""
    table = cost.reshape(len(FIRST_WEARS), FIRST_TEMPERATURES)
    padded = np.pad(table, 1, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min(axis=(2, 3))
    valleys = np.flatnonzero(table == around)
    return valleys[np.argsort(cost[valleys], kind="stable")][:STARTS]


def _orthonormal(columns: Array) -> Array:
    """Return an orthonormal basis (N, k) of the columns; linearly dependent ones are left out."""
    left, values, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return left[:, values > 1e-8 * values[0]]


DETECTOR = WearTemperatureFit
