"""Detectors on the rigid-body residual: recovery of planted friction, wear and temperature."""

import numpy as np
import pytest
from detectors.two_joints import LAW, MODEL, simulate
from scipy.signal import savgol_filter

from wearscope.cycles.base import load_cycle
from wearscope.detectors.base import (
    Batch,
    compute_payload_torque,
    differentiate_locally,
    estimate_acceleration,
    find_top_speed,
    load_detector,
)
from wearscope.detectors.wear_temperature_fit import (
    FIRST_TEMPERATURES,
    FIRST_WEARS,
    FOUND,
    MAX_CONDITION,
    MIN_SHARE,
    NOT_FOUND,
    _find_valleys,
    _orthonormal,
    _told_apart,
    evaluate_curves,
    evaluate_form,
    make_form,
    normal_equations,
    pack_law,
    search_wear,
)
from wearscope.effects.base import load_effect
from wearscope.robots.model import load_model
from wearscope.simulation.study import Conditions, simulate_point


def fitted(name, nominal, **options):
    detector = load_detector(name, options)
    detector.fit([nominal], 0, MODEL)
    return detector


def test_acceleration_has_no_lag():
    batch = simulate()
    a = estimate_acceleration(batch)
    exact = np.gradient(batch.qd[:, 0], batch.t)
    assert np.abs(a[10:-10, 0] - exact[10:-10]).max() < 0.01
    assert estimate_acceleration(batch) is a


@pytest.mark.parametrize("length", [5, 9, 31])
@pytest.mark.parametrize("samples", [31, 32, 400])
def test_local_derivative_is_the_filter_of_savitzky_and_golay_to_the_last_bit(samples, length):
    speed = np.random.default_rng(samples).normal(size=(samples, 3)).cumsum(axis=0)
    filtered = savgol_filter(speed, length, polyorder=2, deriv=1, delta=0.004, axis=0)
    assert differentiate_locally(speed, length, 0.004).tobytes() == filtered.tobytes()


def test_payload_torque_is_the_difference_that_the_load_makes():
    plain, heavy = simulate(), simulate(payload_factor=1.2)
    column = compute_payload_torque(plain, MODEL, 0.03)
    inner = slice(10, -10)
    assert (heavy.tau - plain.tau)[inner] == pytest.approx(0.2 * column[inner], abs=0.02)


def test_friction_fit_recovers_planted_parameters():
    detector = fitted("friction_fit", simulate(lambda v: 12 * np.sign(v) + 7 * v + 2))
    assert detector.nominal == pytest.approx([12, 0, 7], abs=0.05)
    more = simulate(lambda v: 15 * np.sign(v) + 9 * v - 3)
    assert detector.estimate_parameters(more) - detector.nominal == pytest.approx([3, 0, 2], abs=1e-6)
    assert detector.test_quantity(more) == pytest.approx(3 + detector.top_speed, rel=1e-6)


def test_friction_fit_weights_choose_the_parameters():
    nominal = simulate(lambda v: 12 * np.sign(v) + 7 * v)
    detector = fitted("friction_fit", nominal, weights=[1, 0, 0])
    assert detector.test_quantity(simulate(lambda v: 12 * np.sign(v) + 50 * v)) == pytest.approx(0, abs=1e-6)
    assert detector.test_quantity(simulate(lambda v: 14 * np.sign(v) + 7 * v)) == pytest.approx(2, abs=1e-6)


@pytest.mark.parametrize("name", ["friction_fit", "wear_temperature_fit"])
def test_rises_with_planted_wear(name):
    detector = fitted(name, simulate(noise=2.0, seed=99))
    y = [
        detector.test_quantity(simulate(wear=w, noise=2.0, seed=k))
        for k, w in enumerate(np.arange(0, 60, 12.5))
    ]
    assert np.all(np.diff(y) > 0)
    assert abs(y[0]) < 0.1 * y[-1]


@pytest.mark.parametrize("payload_factor", [0.9, 1.0, 1.1])
@pytest.mark.parametrize("temperature", [32.0, 50.0, 68.0])
@pytest.mark.parametrize("wear", [0.0, 10.0, 45.0])
def test_wear_and_temperature_are_recovered_together(wear, temperature, payload_factor):
    detector = fitted("wear_temperature_fit", simulate())
    planted = simulate(wear=wear, temperature=temperature, payload_factor=payload_factor)
    estimate = detector.estimate(planted)
    assert estimate == pytest.approx((wear, temperature), abs=0.3)
    assert detector.test_quantity(planted) == pytest.approx(wear, abs=0.3)


#: Wear, temperature and pace, and how near both are found. (16, 48) fits (40, 35) best nearby: each low-speed
#: term has the other's speed. From any one start the search for the last ones ends in a valley at no or
#: negative wear, or swings across one.
SLOW = [
    (0, 30, 0.2, 0.3), (25, 50, 0.2, 0.3), (40, 35, 0.2, 0.3), (5, 70, 0.2, 0.3),
    (50, 60, 0.2, 1.0), (12.5, 40, 0.05, 1.0), (25, 70, 0.05, 1.0), (37.5, 60, 0.05, 1.0),
    (50, 40, 0.05, 1.0), (50, 70, 0.05, 1.0),
]  # fmt: skip


@pytest.mark.parametrize(("wear", "temperature", "pace", "near"), SLOW)
def test_slow_motion_does_not_trap_the_search(wear, temperature, pace, near):
    planted = simulate(wear=wear, temperature=temperature, pace=pace)
    detector = fitted("wear_temperature_fit", simulate(pace=pace))
    assert detector.estimate(planted) == pytest.approx((wear, temperature), abs=near)


def test_search_leaves_the_lowest_place_of_the_grid_where_another_valley_is_deeper():
    # From the lowest place of a coarser grid it ended at no wear and 49 deg C.
    model = load_model("medium")
    reference = load_cycle("point_to_point").build(model, 0.05, 0.004)
    axis = model.joints.index(model.wear_joints[2])
    batches = []
    for seed, conditions in enumerate((Conditions(), Conditions((20.0, 15.0, 12.0), 47.0))):
        recorded = simulate_point(model, reference, conditions, seed=seed + 1)
        batches.append(Batch(recorded.t, recorded.q, recorded.qd, recorded.tau))
    detector = load_detector("wear_temperature_fit", {})
    detector.fit(batches[:1], axis, model)
    assert detector.estimate(batches[1]) == pytest.approx((12.0, 47.0), abs=0.5)


def test_valleys_are_places_without_a_lower_neighbour_the_lowest_first():
    cost = np.full((len(FIRST_WEARS), FIRST_TEMPERATURES), 9.0)
    cost[3, 5], cost[3, 6], cost[0, 0], cost[10, -1], cost[15, 20] = 2.0, 1.0, 3.0, 0.5, 4.0
    cost += 1e-3 * np.hypot(*np.indices(cost.shape))  # no plain of equal costs
    found = [np.unravel_index(k, cost.shape) for k in _find_valleys(cost.ravel())]
    assert found == [(10, FIRST_TEMPERATURES - 1), (3, 6), (0, 0)]


def test_misfit_is_the_sum_of_squares_that_a_payload_and_an_offset_leave():
    rng = np.random.default_rng(4)
    nodes = np.array([-2.0, -1.0, -0.5, 0.5, 1.0, 2.0])
    speed, residual, load = rng.uniform(-2, 2, 80), rng.normal(size=80), rng.normal(size=80)
    basis = np.linalg.qr(np.column_stack([np.ones(80), load]))[0]
    form = make_form(speed, nodes, residual, basis)
    values = rng.normal(size=(3, 6))
    for row, cost in zip(values, evaluate_form(form, values), strict=True):
        left = residual - np.interp(speed, nodes, row)
        _, (direct,), _, _ = np.linalg.lstsq(np.column_stack([np.ones(80), load]), left)
        assert cost == pytest.approx(direct)
    n11, n12, n22, *gradient_and_norms = normal_equations(form, values[0], values[1:])
    normal, gradient = np.array([[n11, n12], [n12, n22]]), np.array(gradient_and_norms[:2])
    step = np.array([1e-3, -2e-3])
    foreseen = evaluate_form(form, values[0]) + 2 * gradient @ step + step @ normal @ step
    assert evaluate_form(form, values[0] + step @ values[1:]) == pytest.approx(foreseen, rel=1e-12)
    assert gradient_and_norms[2:] == pytest.approx(
        [np.linalg.norm(np.interp(speed, nodes, row)) for row in values[1:]]
    )


def test_batch_faster_than_the_nominal_ones_is_read_too():
    detector = fitted("wear_temperature_fit", simulate(pace=0.5))
    assert detector.estimate(simulate(wear=20.0, temperature=45.0)) == pytest.approx((20, 45), abs=0.3)


def test_wear_estimate_does_not_clip_noise_at_no_wear():
    detector = fitted("wear_temperature_fit", simulate())
    y = np.array([detector.test_quantity(simulate(noise=3.0, seed=seed)) for seed in range(12)])
    assert y.min() < 0 < y.max()
    assert abs(y.mean()) < 3 * y.std(ddof=1) / np.sqrt(len(y)) + 0.1


def test_payload_error_biases_the_wear_estimate_unless_estimated():
    heavy = simulate(payload_factor=1.1)
    with_it = fitted("wear_temperature_fit", simulate()).test_quantity(heavy)
    without = fitted("wear_temperature_fit", simulate(), estimate_payload=False).test_quantity(heavy)
    assert abs(with_it) < 0.2 * abs(without)


def test_batches_that_tell_nothing_are_refused():
    nominal = simulate()
    still = Batch(nominal.t, nominal.q, 0 * nominal.qd, nominal.tau)
    broken = simulate()
    broken.tau[7, 0] = np.nan
    for name in ("friction_fit", "wear_temperature_fit"):
        detector = fitted(name, nominal)
        with pytest.raises(ValueError, match="moves in 0 samples"):
            detector.test_quantity(still)
        with pytest.raises(ValueError, match="not finite"):
            detector.test_quantity(broken)
        with pytest.raises(ValueError, match="does not move in the nominal data"):
            fitted(name, still)


def test_one_speed_does_not_tell_wear_from_temperature():
    nominal = simulate()
    detector = fitted("wear_temperature_fit", nominal)
    constant = Batch(nominal.t, nominal.q, np.ones_like(nominal.qd), nominal.tau)
    with pytest.raises(ValueError, match="wear and temperature apart"):
        detector.estimate(constant)


def split_law(reference=40.0):
    """The parts of the law as effects of their own, what is left of it holding at a reference temperature."""
    warm = ("eta1", "eta2", "eta3", "eta4", "eta6", "alpha")
    still = {name: value for name, value in LAW.items() if name not in ("eta7", "eta9")}
    still |= {"eta1": LAW["eta1"] + LAW["eta2"] * reference, "eta2": 0.0}
    still |= {"eta3": LAW["eta3"] + LAW["eta4"] * reference, "eta4": 0.0}
    still |= {"eta5": LAW["eta5"] + LAW["eta6"] * reference, "eta6": 0.0}
    parts = {
        "coulomb": {"level": still["eta0"]},
        "stribeck": {"level": still["eta1"], "speed": still["eta3"], "exponent": still["alpha"]},
        "viscous": {"slope": still["eta5"]},
        "friction_temperature": {name: LAW[name] for name in warm} | {"reference": reference},
        "wear": {name: LAW[name] for name in ("eta7", "eta8", "eta9", "alpha")},
    }
    effects = [{"joint": "j1", "effect": "torque_offset", "parameters": {"offset": 1.5}}]
    effects += [{"joint": "j1", "effect": name, "parameters": values} for name, values in parts.items()]
    return MODEL.replace(effects=effects)


@pytest.mark.parametrize(("wear", "temperature"), [(20.0, 45.0), (35.0, 62.0)])
def test_wear_fit_reads_the_law_as_a_whole_and_in_parts_alike(wear, temperature):
    batch = simulate(wear=wear, temperature=temperature, noise=1.0)
    answers = []
    for model in (MODEL, split_law()):
        detector = load_detector("wear_temperature_fit")
        detector.fit([simulate()], 0, model)
        answers.append(detector.estimate(batch))
    # The parts that stay are not interpolated between nodes of the speed.
    assert answers[1] == pytest.approx(answers[0], abs=0.01)
    assert answers[0] == pytest.approx((wear, temperature), abs=1.0)


def test_wear_fit_needs_a_dependence_on_wear_and_on_temperature():
    parts = split_law().to_mapping()["effects"]
    model = MODEL.replace(effects=[one for one in parts if one["effect"] != "friction_temperature"])
    for axis, one, cause in ((0, model, "temperature"), (1, MODEL, "wear")):
        with pytest.raises(ValueError, match=f"no effect at j{axis + 1} that depends on {cause}"):
            load_detector("wear_temperature_fit").fit([simulate()], axis, one)


def test_the_friction_fit_reads_a_bump_that_dies_out_over_its_share_of_the_top_speed():
    """Planted on a motion whose speeds are listed, as no simulation of the platform makes them."""
    detector = load_detector("friction_fit", {"low_speed_share": 0.2})
    detector.top_speed = 3.0
    speed = np.array([-3.0, -0.6, 0.3, 0.6, 1.2])
    bump = [-np.exp(-5.0), -np.exp(-1.0), np.exp(-0.5), np.exp(-1.0), np.exp(-2.0)]
    expected = np.column_stack([[-1.0, -1.0, 1.0, 1.0, 1.0], bump, speed, np.ones(5)])
    np.testing.assert_allclose(detector.evaluate_regressors(speed), expected, rtol=1e-12)


def test_the_friction_fit_weighs_by_the_mean_over_all_speeds_up_to_the_top_one():
    detector = fitted("friction_fit", simulate(lambda v: 20.0 * np.sign(v) + 4.0 * v), low_speed_share=0.2)
    speed = (np.arange(20000) + 0.5) / 20000 * detector.top_speed
    mean = detector.evaluate_regressors(speed)[:, :3].mean(axis=0)
    np.testing.assert_allclose(detector.mean_regressors, mean, rtol=1e-6)


def test_a_column_that_is_the_sum_of_others_adds_nothing_to_a_basis():
    a, b = np.array([1.0, 0.0, 0.0, 1.0]), np.array([0.0, 3.0, 4.0, 0.0])
    basis = _orthonormal(np.column_stack([a, b, a + b]))
    assert basis.shape == (4, 2)
    np.testing.assert_allclose(basis.T @ basis, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(basis @ basis.T, np.outer(a, a) / 2 + np.outer(b, b) / 25, atol=1e-12)


@pytest.mark.parametrize("size", [(1.0, 1.0), (3.0, 2000.0)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_wear_and_temperature_are_told_apart_up_to_a_condition_number(size, sign):
    """Of their slopes, each brought to length one: that of [[1, c], [c, 1]], (1 + c)/(1 - c)."""
    for condition in (1.0, 1e4, 0.1 * MAX_CONDITION, 10.0 * MAX_CONDITION, 1e3 * MAX_CONDITION):
        alike = sign * (condition - 1.0) / (condition + 1.0)
        matrix = np.array([[1.0, alike], [alike, 1.0]]) * np.outer(size, size)
        told = _told_apart(matrix[0, 0], matrix[0, 1], matrix[1, 1], *size)
        assert told == (condition < MAX_CONDITION)
        if condition < 1e6:
            assert np.linalg.cond(matrix / np.outer(size, size)) == pytest.approx(condition, rel=1e-6)
    # Nothing is left of one slope's length by offset and payload.
    left = 0.1 * MIN_SHARE
    assert not _told_apart((left * size[0]) ** 2, 0.0, size[1] ** 2, *size)
    assert not _told_apart(size[0] ** 2, 0.0, (left * size[1]) ** 2, *size)
    assert _told_apart((100.0 * left * size[0]) ** 2, 0.0, size[1] ** 2, *size)


def test_temperature_is_searched_down_to_where_the_stribeck_speed_ends():
    detector = load_detector("wear_temperature_fit", {"start_temperature": 50.0})
    detector.fit([simulate()], 0, MODEL)
    ends = 0.2481 / 0.0098  # eta3 + eta4 T is zero there
    assert detector.lowest == pytest.approx(ends + (50.0 - ends) / 100, rel=1e-12)


@pytest.mark.parametrize(("wear", "temperature"), [(60.0, 40.0), (90.0, 62.0)])
def test_traded_speeds_are_each_other_s(wear, temperature):
    detector = fitted("wear_temperature_fit", simulate())
    there = detector._trade_speeds(np.array([wear, temperature]))
    speed, worn_speed = LAW["eta3"] + LAW["eta4"] * temperature, LAW["eta8"] * wear
    assert LAW["eta3"] + LAW["eta4"] * there[1] == pytest.approx(worn_speed, rel=1e-12)
    assert LAW["eta8"] * there[0] == pytest.approx(speed, rel=1e-12)
    assert detector._trade_speeds(there) == pytest.approx([wear, temperature], rel=1e-12)


def test_a_friction_that_is_linear_in_both_is_found_in_four_steps_as_by_least_squares():
    """Damped by a thousandth, then each time by a tenth of that: the fourth step moves less than 1e-4."""
    worn = {"eta7": 0.0, "eta8": 1.0, "eta9": 0.5, "alpha": 1.0}
    warm = {"coulomb_slope": 3.0, "viscous_slope": 0.0, "reference": 0.0}
    law = pack_law([(load_effect("wear"), worn), (load_effect("temperature_dependent_friction"), warm)])
    nodes = np.linspace(-2.0, 2.0, 9)
    curves = evaluate_curves(*law, nodes, np.array([[7.0, 40.0], [-7.0, 40.0]]))
    np.testing.assert_allclose(curves, [s * 3.5 * nodes + 120.0 * np.sign(nodes) for s in (1.0, -1.0)])
    rng = np.random.default_rng(1)
    speed = rng.choice(nodes[nodes != 0.0], 200)
    columns = np.column_stack([0.5 * speed, 3.0 * np.sign(speed)])
    residual = columns @ [30.0, 60.0] + 4.0 + rng.normal(size=200)
    form = make_form(speed, nodes, residual, np.full((200, 1), 200**-0.5))
    start = np.array([20.0, 50.0])
    wanted, (cost,) = np.linalg.lstsq(np.column_stack([columns, np.ones(200)]), residual)[:2]
    found = search_wear(*law, nodes, form, start, 0.0, 100.0, 4)
    assert found == pytest.approx((FOUND, *wanted[:2], cost), rel=1e-5)
    assert search_wear(*law, nodes, form, start, 0.0, 100.0, 3)[0] == NOT_FOUND
    # At the end of the range the wear alone is left to find.
    for lowest, highest, end in ((0.0, 55.0, 55.0), (65.0, 100.0, 65.0)):
        rest = residual - 3.0 * end * np.sign(speed)
        wear, (cost,) = np.linalg.lstsq(np.column_stack([columns[:, 0], np.ones(200)]), rest)[:2]
        for first in (50.0, end):
            found = search_wear(*law, nodes, form, np.array([20.0, first]), lowest, highest, 6)
            assert found == pytest.approx((FOUND, wear[0], end, cost), rel=1e-5)


def test_the_top_speed_is_that_below_which_99_of_a_hundred_samples_lie():
    speed = np.linspace(-100.0, 100.0, 201)[:, None]
    batches = [Batch(0.01 * np.arange(len(v)), v, v, v) for v in (speed[:101], speed[100:])]
    assert find_top_speed(batches, 0) == pytest.approx(99.0)
    still = [Batch(one.t, one.q, 0.0 * one.qd, one.tau) for one in batches]
    with pytest.raises(ValueError, match="does not move"):
        find_top_speed(still, 0)
