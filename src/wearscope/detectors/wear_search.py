"""Search for the wear and the temperature whose friction curve a residual fits best, compiled.

Damped Gauss-Newton (Marquardt, 1963) on a quadratic form in the curve's values at nodes of the speed; the
damping follows how well a step's gain was foreseen (Nielsen, Damping parameter in Marquardt's method, DTU,
1999).
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from wearscope.effects.base import Effect
from wearscope.effects.rows import hold_rows

Array = NDArray[np.float64]
# Difference steps in wear [-] and temperature [deg C], and the change at which the search ends. Wear and
# temperature are not told apart where offset and payload leave less than `MIN_SHARE` of a slope, or where the
# normal equations' condition is above `MAX_CONDITION`.
STEPS = (0.5, 0.25)
TOLERANCE = 1e-4
MIN_SHARE = 1e-6
MAX_CONDITION = 1e8
MAX_DAMPING = 1e8
FOUND, NOT_TOLD_APART, NOT_FOUND = 0, 1, 2


class Law(NamedTuple):
    """Friction of an axis as its declared effects that see speed, temperature and wear alone.

    Attributes
    ----------
    rows : typed.List of compiled row (m,)
    width, size, states : ndarray of int (m,)
        Number of coefficients, shape parameters and states of each effect.
    coefficients, shapes : ndarray (m, widest)
    """

    rows: Any
    width: NDArray[np.int64]
    size: NDArray[np.int64]
    states: NDArray[np.int64]
    coefficients: Array
    shapes: Array


class Form(NamedTuple):
    """Sum of squares ``constant - 2 vector'x + x'(D - S S')x`` for a curve x (K,) at the nodes.

    Attributes
    ----------
    diagonal, between : ndarray (K,), (K - 1,)
        Of the tridiagonal matrix D, whose form is the sum of the curve's own squares over the samples.
    seen : ndarray (K, k)
        S, what the basis that is projected out takes of each node's part of the curve.
    vector : ndarray (K,)
    constant : float
    """

    diagonal: Array
    between: Array
    seen: Array
    vector: Array
    constant: float


def pack_law(effects: Sequence[tuple[Effect, Mapping[str, float]]]) -> Law:
    """Pack effects, each with a compiled row, and their parameters."""
    packed = [effect.pack(values) for effect, values in effects]
    width, size = (np.array([len(one[k]) for one in packed], dtype=np.int64) for k in (0, 1))
    coefficients, shapes = (np.zeros((len(packed), max(one, default=0) + 1)) for one in (width, size))
    for k, (own_coefficients, own_shape) in enumerate(packed):
        coefficients[k, : width[k]], shapes[k, : size[k]] = own_coefficients, own_shape
    states = np.array([effect.n_states for effect, _ in effects], dtype=np.int64)
    rows = [effect.row for effect, _ in effects if effect.row is not None]
    return Law(hold_rows(tuple(rows)), width, size, states, coefficients, shapes)


@njit(cache=True)
def _add_worn(law, nodes, wear, temperature, factor, curve):
    """Add the torque at `nodes` (K,), times a factor, to a curve (K,); the wear is not negative."""
    one, zero, direction = np.zeros(1), np.zeros(1), np.zeros(1)
    worn, warm = np.full(1, wear), np.full(1, temperature)
    out = np.zeros(law.coefficients.shape[1])
    for m in range(len(law.width)):
        row, width, states = law.rows[m], law.width[m], max(law.states[m], 1)
        shape, state, next_state = law.shapes[m, : law.size[m]], np.zeros(states), np.zeros(states)
        for k in range(len(nodes)):
            one[0], direction[0] = nodes[k], np.sign(nodes[k])
            # These effects see nothing but the axis: one joint represents it.
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
def _fill_curve(law, nodes, wear, temperature, curve):
    """Torque (K,) at `nodes`, odd in the wear."""
    curve[:] = 0.0
    if wear < 0.0:
        _add_worn(law, nodes, 0.0, temperature, 2.0, curve)
        _add_worn(law, nodes, -wear, temperature, -1.0, curve)
    else:
        _add_worn(law, nodes, wear, temperature, 1.0, curve)


@njit(cache=True)
def evaluate_curves(law: Law, nodes: Array, places: Array) -> Array:
    """Torque (m, K) at speeds `nodes` (K,) and wears and temperatures `places` (m, 2), odd in the wear."""
    curves = np.empty((len(places), len(nodes)))
    for k in range(len(places)):
        _fill_curve(law, nodes, places[k, 0], places[k, 1], curves[k])
    return curves


@njit(cache=True)
def _weigh(form, a, b):
    """Forms a'D b and a'(D - S S')b of two curves (K,)."""
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
    total = 0.0
    for k in range(len(a)):
        total += a[k] * b[k]
    return total


@njit(cache=True)
def normal_equations(
    form: Form, curve: Array, slopes: Array
) -> tuple[float, float, float, float, float, float, float]:
    """Normal matrix, gradient and norms of Gauss-Newton at a curve (K,) that changes with slopes (2, K).

    Returns
    -------
    tuple of float
        Matrix 11, 12 and 22; gradient 1 and 2; norms over the samples of the slopes, nothing taken away.
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
    return form.constant + _weigh(form, curve, curve)[1] - 2.0 * _dot(form.vector, curve)


@njit(cache=True)
def _told_apart(n11, n12, n22, size1, size2):
    """Whether the slopes by wear and temperature differ after offset and payload are fitted."""
    if not (n11 > (MIN_SHARE * size1) ** 2 and n22 > (MIN_SHARE * size2) ** 2):
        return False
    # Condition of a matrix of two rows with ones on its diagonal.
    alike = abs(n12) / np.sqrt(n11 * n22)
    return 1.0 + alike < MAX_CONDITION * (1.0 - alike)


@njit(cache=True)
def search_wear(
    law: Law, nodes: Array, form: Form, start: Array, lowest: float, highest: float, iterations: int
) -> tuple[int, float, float, float]:
    """Wear and temperature of the smallest sum of squares near a start.

    Parameters
    ----------
    law : Law
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
    _fill_curve(law, nodes, wear, temperature, here)
    cost, damping = _cost(form, here), 1e-3
    for _ in range(iterations):
        _fill_curve(law, nodes, wear + STEPS[0], temperature, there)
        _fill_curve(law, nodes, wear - STEPS[0], temperature, work)
        for k in range(count):
            slopes[0, k] = (there[k] - work[k]) / (2.0 * STEPS[0])
        ahead, behind = min(temperature + STEPS[1], highest), max(temperature - STEPS[1], lowest)
        _fill_curve(law, nodes, wear, ahead, there)
        _fill_curve(law, nodes, wear, behind, work)
        for k in range(count):
            slopes[1, k] = (there[k] - work[k]) / (ahead - behind)
        n11, n12, n22, g1, g2, size1, size2 = normal_equations(form, here, slopes)
        if not _told_apart(n11, n12, n22, size1, size2):
            return NOT_TOLD_APART, wear, temperature, cost
        # A temperature at its bound that the gradient pushes outward stays there.
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
            _fill_curve(law, nodes, wear_there, temperature_there, there)
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
