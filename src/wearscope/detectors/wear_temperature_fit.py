"""Joint estimate of wear, temperature and payload error under the declared friction law (detector D)."""

from collections.abc import Sequence
from contextlib import suppress
from typing import Annotated, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from wearscope.detectors.base import Array, Batch, Positive, check_nominal
from wearscope.detectors.motion import (
    compute_joint_residual,
    compute_payload_torque,
    compute_rigid_torque,
    estimate_acceleration,
    find_top_speed,
)
from wearscope.detectors.wear_search import (
    FOUND,
    NOT_TOLD_APART,
    Form,
    evaluate_curves,
    pack_law,
    search_wear,
)
from wearscope.effects.base import Effect, Signals, load_effect

SPEED_ONLY = {"qd_{joint}", "sign_qd_{joint}", "temp_{joint}", "wear_{joint}"}
# Nodes of the friction torque over speed, in each direction.
NODES = 64
# Grid on which the search for f [-] and T [deg C] looks first (wears, number of temperatures), and number of
# its lowest places from which a search starts.
FIRST_WEARS = (
    1.0, 2.0, 3.0, 4.5, 6.0, 8.0, 10.0, 12.5, 15.0, 17.5, 20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 57.0,
    65.0, 80.0, 100.0,
)  # fmt: skip
FIRST_TEMPERATURES = 32
STARTS = 3


@dataclass
class WearTemperatureFit:
    r"""Wear level f estimated together with the temperature T of the declared friction law.

    .. math:: \min_{f, T, \beta, \mu} \sum_k (r_k - \tau_f(v_k, T, f) - \beta - \mu \, \tau_{p,k})^2

    over the samples in motion: r is the residual of the tested axis (recorded torque minus inverse dynamics
    with the declared payload, rotor inertia and the other declared effects), :math:`\tau_f` the declared
    friction that wear or temperature change, eq. (17) of Samuelsson et al. (2014) as a whole or its parts as
    effects of their own, :math:`\beta` an offset, :math:`\tau_p` the torque of the declared
    payload, whose relative mass error :math:`\mu` is estimated along. The linear unknowns are projected out
    (Golub, Pereyra, SIAM J. Numer. Anal. 10, 1973). The sum of squares has several minima and long valleys in
    f and T: damped Gauss-Newton (`wearscope.detectors.wear_search`) starts in the lowest valleys of a grid,
    damped so that it does not swing across a valley where wear and temperature nearly trade their terms.
    The test quantity is f less its estimate on nominal data [-]; negative estimates extend eq. (17) oddly
    in f, so that noise around no wear is not clipped.

    Wear and temperature part only where the motion visits the low and the high speed band. The detector
    knows the friction law with its parameters, as identified for the robot; where that law is also the
    simulator's, its result is a bound for what a friction model can give, not what it gives in the field.

    After Bittencourt, Axelsson, Modeling and experiment design for identification of wear in a robot joint
    under load and temperature uncertainties based on friction data, IEEE/ASME Trans. Mechatronics 19 (2014).

    Parameters
    ----------
    estimate_payload : bool
        Whether :math:`\mu` is estimated.
    start_temperature : float
        A temperature at which the law holds [deg C]. The search starts once more where wear and temperature
        have traded the speeds of their low-speed terms, the local minimum that eq. (17) invites; the best fit
        is taken.
    temperature_limit : float
        Highest temperature searched [deg C]; the lowest is where the declared Stribeck speed falls to 1 % of
        its value at `start_temperature`, or `start_temperature` less 100.
    rest_share : float
        Speed under which a sample counts as at rest, as share of the 99 % quantile of the nominal speed.
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
        # All batches of a test-cycle are about as fast: one grid serves them.
        self.top_speed = 1.1 * max(float(np.abs(batch.qd[:, axis]).max()) for batch in nominal)
        self.grids: dict[float, _Grid] = {}
        self.nominal_wear = float(np.mean([self.estimate(batch)[0] for batch in nominal]))

    def _lowest_temperature(self) -> float:
        """Lowest temperature searched: just above where the law ends, and at most 100 K below the start."""
        limits = [effect.temperatures(values) for effect, values in self.varying]
        low, high = max(low for low, _ in limits), min(high for _, high in limits)
        if not low < self.start_temperature < high:
            raise ValueError(f"the declared friction law does not hold at {self.start_temperature:g} deg C")
        if np.isfinite(high):
            raise ValueError("the declared Stribeck speed falls with temperature")
        return float(max(self.start_temperature - 100.0, low + 0.01 * (self.start_temperature - low)))

    def estimate(self, batch: Batch) -> tuple[float, float]:
        """Wear level f [-] and temperature T [deg C] of a batch.

        Raises
        ------
        ValueError
            Where the axis moves too little or the motion does not tell the two apart.
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
            with suppress(ValueError):  # where this search fails, the result before stays
                other, other_cost = self._minimise(start, grid.nodes, form)
                if other_cost < cost:
                    x, cost = other, other_cost
        return float(x[0]), float(x[1])

    def _make_grid(self, top_speed: float) -> "_Grid":
        """Nodes, geometric in each direction, and the friction there at the first places of the search."""
        if top_speed not in self.grids:
            half = np.geomspace(self.rest_speed, top_speed, NODES)
            nodes = np.concatenate([-half[::-1], half])
            temperatures = np.linspace(self.lowest, self.temperature_limit, FIRST_TEMPERATURES)
            places = np.array([(wear, temperature) for wear in FIRST_WEARS for temperature in temperatures])
            self.grids[top_speed] = _Grid(nodes, places, evaluate_curves(self.packed, nodes, places))
        return self.grids[top_speed]

    def _trade_speeds(self, x: Array) -> Array | None:
        """Wear and temperature whose low-speed terms have each other's speeds, None without such terms."""
        start, slope, wear_slope = (self.law.get(name, 0.0) for name in ("eta3", "eta4", "eta8"))
        if slope <= 0 or wear_slope <= 0 or x[0] <= 0:
            return None
        temperature = (wear_slope * x[0] - start) / slope
        wear = (start + slope * x[1]) / wear_slope
        return np.array([wear, np.clip(temperature, self.lowest, self.temperature_limit)])

    def _make_signals(self, batch: Batch) -> Signals:
        unknown = np.zeros_like(batch.q)
        return Signals(
            batch.t, batch.q, batch.qd, estimate_acceleration(batch, self.window), np.sign(batch.qd),
            compute_rigid_torque(batch, self.model, self.window), unknown, unknown,
        )  # fmt: skip

    def _minimise(self, start: Array, nodes: Array, form: Form) -> tuple[Array, float]:
        """Wear and temperature (2,) of the smallest sum of squares near a start, and that sum."""
        outcome, wear, temperature, cost = search_wear(
            self.packed, nodes, form, start, self.lowest, self.temperature_limit, self.max_iterations
        )
        if outcome == NOT_TOLD_APART:
            raise ValueError("the motion of the tested axis does not tell wear and temperature apart")
        if outcome != FOUND:
            raise ValueError(f"no wear and temperature found in {self.max_iterations} iterations")
        return np.array([wear, temperature]), cost

    def test_quantity(self, batch: Batch) -> float:
        """Estimated wear level less that of the nominal data [-]."""
        return self.estimate(batch)[0] - self.nominal_wear


class _Grid(NamedTuple):
    """Speeds `nodes` (K,), wears and temperatures `places` (m, 2), friction there `values` (m, K)."""

    nodes: Array
    places: Array
    values: Array


def make_form(speed: Array, nodes: Array, residual: Array, basis: Array) -> Form:
    """Sum of squares that a friction curve over speed leaves of a residual, less what a basis takes.

    The curve is interpolated linearly between nodes, so that the sum is a quadratic form in its values there;
    between nodes a ratio r apart, exp(-v/s) is missed by at most 0.07 (r - 1)^2. With S the interpolation and
    P the projection that takes the basis B away, it is c - 2 b'x + x'A x, A = S'P S, b = S'P r, c = r'P r.
    S'S is tridiagonal and S'B as wide as the basis, so A is not made: two curves are weighed in K steps.

    Parameters
    ----------
    speed, residual : array (N,)
    nodes : array (K,)
        Rising speeds that enclose all others.
    basis : array (N, k)
        Orthonormal.
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
    """Sum of squares (...) for curves (..., K) at the nodes."""
    own = values**2 @ form.diagonal + 2.0 * (values[..., 1:] * values[..., :-1]) @ form.between
    taken = ((values @ form.seen) ** 2).sum(axis=-1)
    return form.constant + own - taken - 2.0 * (values @ form.vector)


def _find_valleys(cost: Array) -> NDArray[np.integer]:
    """Places of the grid, at most `STARTS` and the lowest first, that have no neighbour of a lower cost."""
    table = cost.reshape(len(FIRST_WEARS), FIRST_TEMPERATURES)
    padded = np.pad(table, 1, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3)).min(axis=(2, 3))
    valleys = np.flatnonzero(table == around)
    return valleys[np.argsort(cost[valleys], kind="stable")][:STARTS]


def _orthonormal(columns: Array) -> Array:
    """Orthonormal basis (N, k) of the columns, those that add nothing left out."""
    left, values, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return left[:, values > 1e-8 * values[0]]


DETECTOR = WearTemperatureFit
